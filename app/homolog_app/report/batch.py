"""The index page of a batch, and its table of volumes."""

import csv
import io
from collections.abc import Iterator, Mapping
from pathlib import Path

from homolog.cohort import Cohort
from homolog.files.atomic import write_text
from homolog.files.records import ResultRecord
from homolog.run.batch import Batch, BatchItem, ItemState
from homolog_app.report import NOTICE
from homolog_app.report.page import Link, Page, Picture

__all__ = ["write_index"]

_HEADS = (
    "structure", "number", "subjects", "absent", "at border", "in pieces", "median (ml)", "range (ml)",
    "particles", "first mode (%)", "state",
)  # fmt: skip


_ENDED = {"iterations": "not converged"}


def write_index(batch: Batch, cohort: Cohort, problems: Mapping[str, str]) -> Path:
    """Write ``index.html`` and ``volumes.csv`` of a batch, also of one that is still going on.

    Parameters
    ----------
    batch : Batch
    cohort : Cohort
        All its subjects.
    problems : mapping of str to str
        Why files of subjects can't be read, by the subjects' names.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    InputError
        If the folder can't be written to.
    """
    items = batch.items
    page = Page(f"Structures of {cohort.folder.resolve().name}", NOTICE)
    states = [item.state for item in items]
    parts = [f"{states.count(state)} {state}" for state in ItemState if state in states]
    page.paragraph(f"{len(cohort.subjects)} subjects, {len(items)} structures: {', '.join(parts)}.")
    page.table(_HEADS, [_row(item, batch.folder) for item in items])
    page.pictures([picture for item in items for picture in _pictures(item, batch.folder)])
    failed = [item for item in items if item.state in (ItemState.FAILED, ItemState.TOO_FEW)]
    if failed:
        page.heading("Structures without a model")
        page.points((item.structure.title, item.message) for item in failed)
    remarks = [row for item in items for row in _remarks(item)]
    if remarks or problems:
        page.heading("Subjects")
        page.points((name, message) for name, message in problems.items())
        page.table(("structure", "subject", "note"), remarks, as_text=True)
    page.links(["volumes.csv"], "Volumes of all structures in all subjects")
    write_text(batch.folder / "volumes.csv", _volumes(items, cohort))
    write_text(batch.folder / "index.html", page.html)
    return batch.folder / "index.html"


def _row(item: BatchItem, folder: Path) -> tuple[str | Link, ...]:
    low, middle, high = item.structure.volumes
    result = item.project.read().result if item.state is ItemState.FINISHED else None
    title = item.structure.title
    pieces = sum(any("pieces" in note for note in notes) for notes in item.remarks.values())
    return (
        title if result is None else Link(title, f"{item.project.folder.relative_to(folder).as_posix()}/"),
        "/".join(map(str, item.structure.values)) or "–",
        str(len(result.subjects) if result is not None else len(item.structure.by_subject)),
        str(len(item.absent) or "–"),
        str(len(item.structure.at_border) or "–"),
        str(pieces or "–"),
        f"{middle:.4g}",
        f"{low:.4g} – {high:.4g}",
        str(result.particles) if result is not None else "–",
        _first_mode(item, result),
        item.state if result is None else _ENDED.get(result.ended, result.ended),
    )


def _first_mode(item: BatchItem, result: ResultRecord | None) -> str:
    """Return the share of the first mode, from the project's own table."""
    path = item.project.model / "eigenvalues.csv"
    if result is None or not path.is_file():
        return "–"
    rows = list(csv.DictReader(io.StringIO(path.read_text(encoding="utf-8"))))
    return f"{100.0 * float(rows[0]['share']):.0f}" if rows and "share" in rows[0] else "–"


def _pictures(item: BatchItem, folder: Path) -> Iterator[Picture]:
    mean = item.project.figures / "mean.png"
    if item.state is ItemState.FINISHED and mean.is_file():
        place = mean.relative_to(folder).as_posix()
        modes = item.project.figures / "modes.png"
        target = modes if modes.is_file() else mean
        yield Picture(place, item.structure.title, target.relative_to(folder).as_posix())


def _remarks(item: BatchItem) -> Iterator[tuple[str, str, str]]:
    for name, notes in item.remarks.items():
        yield item.structure.title, name, "; ".join(notes)
    for line in item.left_out:
        yield item.structure.title, "", f"skipped: {line}"


def _volumes(items: tuple[BatchItem, ...], cohort: Cohort) -> str:
    stream = io.StringIO()
    table = csv.writer(stream, lineterminator="\n")
    table.writerow(["name", *(f"{item.structure.title} [ml]" for item in items)])
    for subject in cohort.subjects:
        structures = (item.structure.by_subject.get(subject.name) for item in items)
        table.writerow([subject.name, *("" if item is None else f"{item.volume:.6g}" for item in structures)])
    return stream.getvalue()
