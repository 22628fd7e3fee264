"""Studies that are stored in a project: questions, provenance of the answers, the primary study."""

import csv
import json
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

from pydantic import BaseModel, ConfigDict

from homolog.errors import InputError
from homolog.io.atomic import write_text
from homolog.io.project import OUT_OF_DATE, ProjectFolder
from homolog.io.tables import write_table
from homolog.statistics.effects import Effect
from homolog.statistics.procrustes import Alignment
from homolog_app.report.request import StudyRequest

__all__ = [
    "PRIMARY",
    "Answered",
    "KeptStudy",
    "StoredTest",
    "is_primary",
    "kept_studies",
    "name_primary",
    "read_requests",
    "study_folder",
    "write_request",
]

_RECORD, _TESTS, _WITHOUT = "study.json", "tests.csv", "tests_without_outliers.csv"
PRIMARY = "primary"
"""Column of the study's tables."""
_DISTANCE = "mahalanobis_d_corrected"


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
        """Describe an answer about a project's current result."""
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


def study_folder(project: ProjectFolder, request: StudyRequest) -> Path:
    """Return the folder of a study's tables: the one of this question, or an unused one."""
    return _folder_in(project.folder / "analysis", request)


def _folder_in(root: Path, request: StudyRequest) -> Path:
    folders = {path.name.casefold(): path for path in root.iterdir()} if root.is_dir() else {}
    number = 1
    while True:
        name = request.name if number == 1 else f"{request.name}_{number}"
        taken = folders.get(name.casefold())
        record = taken / _RECORD if taken else None
        if record is None or not record.is_file():
            return taken or root / name
        if _read(record).request.question == request.question:
            return record.parent
        number += 1


def write_request(request: StudyRequest, folder: Path, answered: Answered) -> None:
    """Store a question with the record of its answer; raises InputError if it can't be written.

    A primary study remains primary.
    """
    path = folder / _RECORD
    _write(path, _Record(request, answered, is_primary(folder)))
    (folder / OUT_OF_DATE).unlink(missing_ok=True)


def is_primary(folder: Path) -> bool:
    """Return whether a folder contains the primary study; raises InputError if its question is damaged."""
    path = folder / _RECORD
    return path.is_file() and _read(path).is_primary


def name_primary(project: ProjectFolder, request: StudyRequest | None) -> None:
    """Make the stored study of a question the only primary one; without a question, none is primary.

    Raises
    ------
    InputError
        If a stored question is damaged, or the project can't be written to.
    """
    for path in _records(project):
        kept = _read(path)
        chosen = request is not None and kept.request.question == request.question
        if chosen != kept.is_primary:
            _write(path, kept._replace(is_primary=chosen))
            for name in (_TESTS, _WITHOUT):
                _mark(path.parent / name, chosen)


def _mark(path: Path, is_primary: bool) -> None:
    """State in a table whether its study is the primary one; tables of earlier versions are unchanged."""
    if not path.is_file():
        return
    with path.open(encoding="utf-8", newline="") as stream:
        head, *rows = csv.reader(stream)
    if PRIMARY in head:
        at = head.index(PRIMARY)
        write_table(path, head, [[*row[:at], int(is_primary), *row[at + 1 :]] for row in rows])


def read_requests(project: ProjectFolder) -> list[StudyRequest]:
    """Return the questions stored in a project, the primary one first, answers to the same one adjacent.

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
    """A question that is stored in a project.

    Attributes
    ----------
    is_outdated : bool
        Whether its tables belong to earlier particles.
    tests : dict of str to StoredTest
        The test of each comparison; empty if the table can't be read.
    is_primary : bool
        Whether it was declared the primary study.
    answered : Answered
        Provenance of its tables.
    """

    request: StudyRequest
    is_outdated: bool
    tests: Mapping[str, StoredTest]
    is_primary: bool = False
    answered: Answered = Answered()


def kept_studies(project: ProjectFolder) -> list[KeptStudy]:
    """Return the questions in the order of `read_requests`, with their answers.

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
    """Return the name of a question regardless of the alignment."""
    return request.model_copy(update={"alignment": Alignment.RIGID}).name


def _place(request: StudyRequest) -> tuple[str, int]:
    """Return the sort key of questions: form before shape."""
    return _name(request), list(Alignment).index(request.alignment)


class _Record(NamedTuple):
    """A stored question, the provenance of its answer, and whether its study is the primary one."""

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
