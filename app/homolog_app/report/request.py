"""The question of a study, stored in the project so that the report can be generated again."""

import csv
import json
import re
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from homolog.analysis.design import is_missing
from homolog.analysis.effects import Effect
from homolog.analysis.procrustes import Alignment, rms_radii
from homolog.arrays import FloatArray
from homolog.cohort.column_types import CATEGORY, plain_name
from homolog.errors import InputError
from homolog.files.atomic import write_text
from homolog.files.project import OUT_OF_DATE, ProjectFolder
from homolog.files.results import Result
from homolog.geometry import scale_of

__all__ = [
    "SHAPE_SIZE", "SIZE", "Answered", "KeptStudy", "StoredTest", "StudyRequest", "category_of", "column_of",
    "columns_of", "compared_shapes", "kept_studies", "levels", "name_primary", "read_requests",
    "study_folder", "write_request",
]  # fmt: skip

SIZE = "size"
SHAPE_SIZE = "shape-size"


def levels(values: Sequence[str]) -> list[str]:
    """Return the different values in the order in which they appear, missing ones left out."""
    return [value for value in dict.fromkeys(values) if not is_missing(value)]


def column_of(result: Result, column: str) -> list[str]:
    """Return a column of the cohort's table for each subject, missing values as empty text.

    ``group`` and ``shape-size`` are always there; so is ``size``, unless the table has such a column.

    Raises
    ------
    InputError
        If there is no such column.
    """
    known = columns_of(result)
    if column not in known and f"{column}{CATEGORY}" in known:
        column = f"{column}{CATEGORY}"  # the table declares it
    if column == "group":
        values = [group or "" for group in result.groups]
    elif column == SHAPE_SIZE or (column == SIZE and SIZE not in known):
        return [repr(float(size)) for size in rms_radii(_at_own_size(result))]
    elif column in known:
        values = [columns.get(column, "") for columns in result.columns]
    else:
        there = ", ".join(["group", SHAPE_SIZE, *sorted(known)])
        raise InputError(f"no column {column!r}; the cohort has: {there}")
    return ["" if is_missing(value) else value for value in values]


def compared_shapes(result: Result, alignment: Alignment) -> FloatArray:
    """Return the particles (M, N, 3) that are compared [mm], before they are aligned.

    For every alignment but "as it lies" each shape has its own size, also if the run brought all to one.
    """
    return result.world if alignment is Alignment.AS_IT_LIES else _at_own_size(result)


def _at_own_size(result: Result) -> FloatArray:
    scale = scale_of(result.alignments)
    if np.allclose(scale, 1.0, rtol=1e-9):
        return result.world
    centre = result.world.mean(axis=1, keepdims=True)
    return np.asarray(centre + (result.world - centre) / scale[:, None, None], np.float64)


def columns_of(result: Result) -> set[str]:
    """Return the names of the columns of a result's table."""
    return {name for columns in result.columns for name in columns}


_RECORD, _TESTS = "study.json", "tests.csv"
_DISTANCE = "mahalanobis_d_corrected"
_LONGEST = 90
SIZE_TEXTS = {
    Alignment.AS_IT_LIES: "as the shapes lie",
    Alignment.RIGID: "form (size and shape)",
    Alignment.SIMILARITY: "shape (size removed)",
}


class StudyRequest(BaseModel):
    """One question to a project's result.

    Attributes
    ----------
    kind : str
        ``groups`` compares the groups of a column, ``regression`` asks for a linear effect of a column,
        ``pairs`` compares the two subjects that share a value of `pairs`.
    column : str
        The groups, or the variable.
    between : tuple of str
        The groups in order: differences are from the first; two of them for pairs.
    pairs : str or None
        The column that names the pairs.
    covariates : tuple of str
        Columns adjusted for; ``COLUMN:c`` takes numbers as codes of categories, ``shape-size`` is the size of
        the shapes (``size`` too, if the cohort has no column of that name).
    alignment : Alignment
        How shapes are aligned before they are compared.
    complete_cases : bool
        Whether subjects without a value in a column that is used are left out.
    modes : int or None
        Number of modes; by parallel analysis if not given.
    permutations, null_repeats, seed, answers : int
        See `homolog.analysis.comparison.Options`.
    earlier : bool
        Whether an earlier version kept the question, which did not align shapes rigidly.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Literal["groups", "regression", "pairs"] = "groups"
    column: str = "group"
    between: tuple[str, ...] = ()
    pairs: str | None = None
    covariates: tuple[str, ...] = ()
    alignment: Alignment = Alignment.RIGID
    complete_cases: bool = False
    modes: Annotated[int, Field(ge=1)] | None = None
    permutations: Annotated[int, Field(ge=99, le=1_000_000)] = 10_000
    null_repeats: Annotated[int, Field(ge=0, le=100_000)] = 1000
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 0
    answers: Annotated[int, Field(ge=1, le=3)] = 1
    earlier: bool = False

    @model_validator(mode="before")
    @classmethod
    def _read_earlier(cls, values: Any) -> Any:  # noqa: ANN401 - whatever the file holds
        """Take the alignment from `scaling`, which said in earlier versions whether size was removed."""
        if isinstance(values, dict) and "scaling" in values:
            values = dict(values)
            alignment = Alignment.SIMILARITY if values.pop("scaling") is True else Alignment.RIGID
            values = {"alignment": alignment, "earlier": alignment is Alignment.RIGID} | values
        return values

    @property
    def title(self) -> str:
        """The question in one line."""
        what = {
            "groups": f"{self.column}: {', '.join(self.between)}",
            "regression": f"effect of {self.column}",
            "pairs": f"{self.column}: {' and '.join(self.between)}, paired by {self.pairs}",
        }[self.kind]
        allowed = f", adjusted for {', '.join(self.covariates)}" if self.covariates else ""
        return f"{what}{allowed}; {SIZE_TEXTS[self.alignment]}"

    @property
    def arguments(self) -> list[str]:
        """The equivalent options of ``homolog analyze``."""
        options = ["--regress", self.column] if self.kind == "regression" else ["--group", self.column]
        options += ["--between", *self.between] if self.between else []
        options += ["--pairs", self.pairs] if self.pairs else []
        options += ["--covariates", *self.covariates] if self.covariates else []
        options += ["--complete-cases"] if self.complete_cases else []
        return [*options, "--alignment", self.alignment.value]

    @property
    def name(self) -> str:
        """A file name for the question; `study_folder` resolves collisions of truncated names."""
        parts = [self.kind, self.column, *self.between]
        parts += ["paired_by", self.pairs] if self.pairs else []
        parts += ["for", *self.covariates] if self.covariates else []
        tail = ["complete_cases"] if self.complete_cases else []
        tail += [f"{self.modes}_modes"] if self.modes is not None else []
        tail += [f"seed_{self.seed}"] if self.seed else []
        tail += {Alignment.AS_IT_LIES: ["as_it_lies"], Alignment.SIMILARITY: ["without_size"]}.get(
            self.alignment, []
        )
        stem, end = (re.sub(r"[^\w.-]+", "_", "_".join(part)) for part in (parts, tail))
        return "_".join(part for part in (stem[:_LONGEST].strip("._"), end) if part)

    @property
    def question(self) -> str:
        """The identity of a question, regardless of the precision of its answer."""
        return self.model_dump_json(exclude={"permutations", "null_repeats", "answers", "earlier"})


class Answered(BaseModel):
    """Result, date, version and digest of the data of an answer."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    fingerprint: str = ""
    result_finished: str = ""
    homolog: str = ""
    date: str = ""
    data: str = ""

    @classmethod
    def now(cls, project: ProjectFolder, data: str = "") -> "Answered":
        """Describe an answer about a project's present result."""
        record = project.read().result
        try:
            number = version("homolog")
        except PackageNotFoundError:
            number = ""
        return cls(
            fingerprint=record.fingerprint if record else "",
            result_finished=record.finished if record else "",
            homolog=number,
            date=datetime.now(UTC).isoformat(timespec="seconds"),
            data=data,
        )


def category_of(column: str, known: "set[str]") -> tuple[str, bool]:
    """Return a covariate's column, and whether its numbers are declared codes of categories.

    The question declares it (``site:c``), or the table, whose column then has such a name.
    """
    if column not in known and f"{column}{CATEGORY}" in known:
        return f"{column}{CATEGORY}", True
    if column not in known and column.endswith(CATEGORY):
        return plain_name(column), True
    return column, column.endswith(CATEGORY)


def study_folder(project: ProjectFolder, request: StudyRequest) -> Path:
    """Return the folder of a study's tables: the one that holds this question, or a free one."""
    return _folder_in(project.folder / "analysis", request)


def _folder_in(root: Path, request: StudyRequest) -> Path:
    there = {path.name.casefold(): path for path in root.iterdir()} if root.is_dir() else {}
    number = 1
    while True:
        name = request.name if number == 1 else f"{request.name}_{number}"
        taken = there.get(name.casefold())
        record = taken / _RECORD if taken else None
        if record is None or not record.is_file():
            return taken or root / name
        if _read(record).request.question == request.question:
            return record.parent
        number += 1


def write_request(request: StudyRequest, folder: Path, answered: Answered) -> None:
    """Store a question with the record of its answer; raises InputError if it can't be written.

    A primary study stays so.
    """
    path = folder / _RECORD
    _write(path, _Record(request, answered, path.is_file() and _read(path).is_primary))
    (folder / OUT_OF_DATE).unlink(missing_ok=True)


def name_primary(project: ProjectFolder, request: StudyRequest | None) -> None:
    """Make the stored study of a question the primary one, and no other; none if no question is given.

    Raises
    ------
    InputError
        If a stored question is damaged, or the project can't be written to.
    """
    for path in _records(project):
        kept = _read(path)
        is_primary = request is not None and kept.request.question == request.question
        if is_primary != kept.is_primary:
            _write(path, kept._replace(is_primary=is_primary))


def read_requests(project: ProjectFolder) -> list[StudyRequest]:
    """Return the questions stored in a project, the primary one first, answers to each next to each other.

    Raises
    ------
    InputError
        If one of them is damaged.
    """
    return [study.request for study in kept_studies(project)]


class StoredTest(NamedTuple):
    """The test of one comparison: corrected p, its permutations, and the effect in SD, if it has one."""

    p: float
    permutations: int
    distance: Effect | None


class KeptStudy(NamedTuple):
    """A request that is stored in a project.

    Attributes
    ----------
    is_outdated : bool
        Whether its tables belong to earlier particles.
    tests : dict of str to StoredTest
        The test of each comparison; empty if the table can't be read.
    is_primary : bool
        Whether it was named the primary study.
    answered : Answered
        What its tables belong to.
    """

    request: StudyRequest
    is_outdated: bool
    tests: Mapping[str, StoredTest]
    is_primary: bool = False
    answered: Answered = Answered()


def kept_studies(project: ProjectFolder) -> list[KeptStudy]:
    """Return the questions as `read_requests` does, with their answers.

    Raises
    ------
    InputError
        If one of them is damaged.
    """
    kept = []
    for path in _records(project):
        request, answered, is_primary = _read(path)
        old = (path.parent / OUT_OF_DATE).is_file()
        kept.append(KeptStudy(request, old, _stored_tests(path.parent / _TESTS), is_primary, answered))
    first = next((_name(study.request) for study in kept if study.is_primary), None)
    return sorted(
        kept,
        key=lambda study: (_name(study.request) != first, not study.is_primary, *_place(study.request)),
    )


def _records(project: ProjectFolder) -> list[Path]:
    return sorted((project.folder / "analysis").glob(f"*/{_RECORD}"))


def _stored_tests(path: Path) -> dict[str, StoredTest]:
    low, high = f"{_DISTANCE}_low_95", f"{_DISTANCE}_high_95"
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            rows = list(csv.DictReader(stream))
        return {
            row["comparison"]: StoredTest(
                float(row["p_permutation_corrected"]),
                int(row["permutations"]),
                Effect(float(row[_DISTANCE]), float(row[low]), float(row[high])) if row[_DISTANCE] else None,
            )
            for row in rows
        }
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _name(request: StudyRequest) -> str:
    """Return the name of a question, whatever the alignment."""
    return request.model_copy(update={"alignment": Alignment.RIGID}).name


def _place(request: StudyRequest) -> tuple[str, int]:
    """Return the sort key of questions: form before shape."""
    return _name(request), list(Alignment).index(request.alignment)


class _Record(NamedTuple):
    """A stored question, what its answer belongs to, and whether its study is the primary one."""

    request: StudyRequest
    answered: Answered
    is_primary: bool


def _write(path: Path, record: _Record) -> None:
    content = {
        "question": record.request.model_dump(mode="json", exclude={"earlier"}),
        "answered": record.answered.model_dump(mode="json"),
        "primary": record.is_primary,
    }
    write_text(path, json.dumps(content, indent=2) + "\n")


def _read(path: Path) -> _Record:
    try:
        content = json.loads(path.read_bytes())
        if not isinstance(content, dict):
            raise ValueError("contains no question")
        if "question" in content:
            return _Record(
                StudyRequest.model_validate(content["question"]),
                Answered.model_validate(content.get("answered", {})),
                content.get("primary") is True,
            )
        return _Record(StudyRequest.model_validate(content), Answered(), False)
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: is damaged; delete its folder and analyze again") from error
