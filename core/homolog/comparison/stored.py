"""Answers that are stored in a project: questions, provenance, the primary one."""

import csv
import json
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

from pydantic import BaseModel, ConfigDict

from homolog.comparison.question import Question
from homolog.errors import InputError
from homolog.io.atomic import write_text
from homolog.io.project import OUT_OF_DATE, ProjectFolder
from homolog.io.tables import write_table
from homolog.statistics.effects import Effect
from homolog.statistics.procrustes import Alignment

__all__ = [
    "PRIMARY",
    "Provenance",
    "StoredAnswer",
    "StoredTest",
    "folder_of",
    "is_primary",
    "name_primary",
    "stored_answers",
    "stored_poses",
    "write_question",
]

_RECORD, _TESTS, _WITHOUT = "study.json", "tests.csv", "tests_without_outliers.csv"
PRIMARY = "primary"
"""Column of the answer's tables."""
_DISTANCE = "mahalanobis_d_corrected"


class Provenance(BaseModel):
    """Result, date, version and digest of the data of an answer."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    fingerprint: str = ""
    result_finished: str = ""
    homolog: str = ""
    date: str = ""
    data: str = ""

    @classmethod
    def now(cls, project: ProjectFolder, data: str = "") -> "Provenance":
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


def folder_of(project: ProjectFolder, question: Question) -> Path:
    """Return the folder of an answer's tables: the one of this question, or an unused one."""
    root = project.folder / "analysis"
    folders = {path.name.casefold(): path for path in root.iterdir()} if root.is_dir() else {}
    number = 1
    while True:
        name = question.name if number == 1 else f"{question.name}_{number}"
        taken = folders.get(name.casefold())
        record = taken / _RECORD if taken else None
        if record is None or not record.is_file():
            return taken or root / name
        if _read(record).question.identity == question.identity:
            return record.parent
        number += 1


def write_question(question: Question, folder: Path, provenance: Provenance) -> None:
    """Store a question with the record of its answer; raises InputError if it can't be written.

    A primary question remains primary.
    """
    _write(folder / _RECORD, _Record(question, provenance, is_primary(folder)))
    (folder / OUT_OF_DATE).unlink(missing_ok=True)


def is_primary(folder: Path) -> bool:
    """Return whether a folder contains the primary answer; raises InputError if its question is damaged."""
    path = folder / _RECORD
    return path.is_file() and _read(path).is_primary


def name_primary(project: ProjectFolder, question: Question | None) -> None:
    """Make the stored answer to a question the only primary one; without a question, none is primary.

    Raises
    ------
    InputError
        If a stored question is damaged, or the project can't be written to.
    """
    for path in _records(project):
        kept = _read(path)
        chosen = question is not None and kept.question.identity == question.identity
        if chosen != kept.is_primary:
            _write(path, kept._replace(is_primary=chosen))
            for name in (_TESTS, _WITHOUT):
                _mark(path.parent / name, chosen)


def _mark(path: Path, is_primary: bool) -> None:
    """State in a table whether it is of the primary question; tables of earlier versions are unchanged."""
    if not path.is_file():
        return
    with path.open(encoding="utf-8", newline="") as stream:
        head, *rows = csv.reader(stream)
    if PRIMARY in head:
        at = head.index(PRIMARY)
        write_table(path, head, [[*row[:at], int(is_primary), *row[at + 1 :]] for row in rows])


class StoredTest(NamedTuple):
    """The test of one comparison: corrected p, its permutations, and the effect in SD, if it has one."""

    p: float
    permutations: int
    distance: Effect | None


class StoredAnswer(NamedTuple):
    """A question that is stored in a project.

    Attributes
    ----------
    is_outdated : bool
        Whether its tables belong to earlier particles.
    tests : dict of str to StoredTest
        The test of each comparison; empty if the table can't be read.
    is_primary : bool
        Whether it was declared the primary one.
    provenance : Provenance
        Provenance of its tables.
    """

    question: Question
    is_outdated: bool
    tests: Mapping[str, StoredTest]
    is_primary: bool = False
    provenance: Provenance = Provenance()


def stored_answers(project: ProjectFolder) -> tuple[list[StoredAnswer], list[str]]:
    """Return the stored questions about shapes with their answers, and a line on each that is damaged.

    The primary question is the first; form and shape of the same one are adjacent.
    """
    kept, damaged = _stored(project)
    kept = [answer for answer in kept if not answer.question.pose]
    leading = next((_topic(answer.question) for answer in kept if answer.is_primary), None)

    def place(answer: StoredAnswer) -> tuple[bool, bool, str, int]:
        question = answer.question
        order = -list(Alignment).index(question.alignment)  # shape before form
        return _topic(question) != leading, not answer.is_primary, _topic(question), order

    return sorted(kept, key=place), damaged


def stored_poses(project: ProjectFolder) -> list[StoredAnswer]:
    """Return the stored questions about poses; `stored_answers` names those that are damaged."""
    return [answer for answer in _stored(project)[0] if answer.question.pose]


def _stored(project: ProjectFolder) -> tuple[list[StoredAnswer], list[str]]:
    kept, damaged = [], []
    for path in _records(project):
        try:
            question, provenance, first = _read(path)
        except InputError as error:
            damaged.append(str(error))
            continue
        old = (path.parent / OUT_OF_DATE).is_file()
        kept.append(StoredAnswer(question, old, _stored_tests(path.parent / _TESTS), first, provenance))
    return kept, damaged


def _records(project: ProjectFolder) -> list[Path]:
    return sorted((project.folder / "analysis").glob(f"*/{_RECORD}"))


def _stored_tests(path: Path) -> dict[str, StoredTest]:
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            return {row["comparison"]: _stored_test(row) for row in csv.DictReader(stream)}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _stored_test(row: Mapping[str, str]) -> StoredTest:
    percent = "90" if f"{_DISTANCE}_low_90" in row else "95"  # of version 0.2
    far = [row[name] for name in (_DISTANCE, *(f"{_DISTANCE}_{end}_{percent}" for end in ("low", "high")))]
    return StoredTest(
        float(row["p_permutation_corrected"]),
        int(row["permutations"]),
        Effect(float(far[0]), float(far[1]), float(far[2]), level=int(percent) / 100.0) if far[0] else None,
    )


def _topic(question: Question) -> str:
    """Return the name of a question regardless of the alignment."""
    return question.model_copy(update={"alignment": Alignment.FORM}).name


class _Record(NamedTuple):
    """A stored question, the provenance of its answer, and whether it is the primary one."""

    question: Question
    provenance: Provenance
    is_primary: bool


def _write(path: Path, record: _Record) -> None:
    content = {
        "question": record.question.model_dump(mode="json", exclude={"earlier"}),
        "answered": record.provenance.model_dump(mode="json"),
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
                Question.model_validate({"alignment": Alignment.FORM, **content["question"]}),
                Provenance.model_validate(content.get("answered", {})),
                content.get("primary") is True,
            )
        return _Record(Question.model_validate(content), Provenance(), False)
    except (OSError, ValueError, TypeError, RecursionError) as error:
        raise InputError(f"{path}: is damaged; delete its folder and analyze again") from error
