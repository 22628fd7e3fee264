"""Pages of HTML that open without a network: a report, and the index of a batch. Templates escape texts."""

import base64
import csv
import io
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup, escape

from homolog.cohort import Cohort
from homolog.io.atomic import write_text
from homolog.io.records import ResultRecord
from homolog.run.batch import Batch, BatchItem, ItemState
from homolog_app.rendering.text import complete_texts, typeset
from homolog_app.report import NOTICE
from homolog_app.report.figures import ReportFigure

__all__ = [
    "Link",
    "Page",
    "Picture",
    "write_index",
]


_DPI = 150


@dataclass(frozen=True, slots=True)
class Link:
    """A link to a file, by its path relative to the page."""

    text: str
    target: str


@dataclass(frozen=True, slots=True)
class Picture:
    """A linked picture: path relative to the page, caption, and target file."""

    source: str
    caption: str
    target: str


class Page:
    """A page that is built from top to bottom. Texts are plain text; markup in them is escaped."""

    def __init__(self, title: str, notice: str, *, footer: str = "") -> None:
        self.title, self.notice, self._footer = title, notice, footer
        self.parts: list[dict[str, object]] = []
        self._numbers = {"Table": 0, "Figure": 0}

    def _numbered(self, kind: str, caption: str) -> str:
        self._numbers[kind] += 1
        return f"{kind} {self._numbers[kind]}. {caption}"

    def write(
        self,
        text: str,
        figures: "Mapping[str, Sequence[ReportFigure]]",
        tables: Mapping[str, Mapping[str, Any]],
    ) -> None:
        """Add the lines of a text, and the figures and tables that it names.

        A line that begins with ``# `` or ``## `` is a heading, with ``! `` a caution, ``@name`` is a table or
        figures of that name, and every other line that is not empty a paragraph.
        """
        for line in filter(None, map(str.strip, text.splitlines())):
            mark, _, rest = line.partition(" ")
            if line[0] == "@":
                self.figures(figures.get(line[1:], ()))
                if line[1:] in tables:
                    self.table(**tables[line[1:]], as_text=True, omit="–")
            elif mark in ("#", "##"):
                self.heading(rest, len(mark) + 1)
            elif mark == "!":
                self.caution(rest)
            else:
                self.paragraph(line)

    def heading(self, text: str, level: int = 2) -> None:
        """Add a heading."""
        self._add("heading", text=text, level=level)

    def paragraph(self, text: str) -> None:
        """Add a paragraph."""
        self._add("paragraph", text=text)

    def caution(self, text: str) -> None:
        """Add a highlighted paragraph."""
        self._add("caution", text=text)

    def points(self, points: Iterable[tuple[str, str | Sequence[str]]]) -> None:
        """Add a list of points, each a highlighted beginning and a text of one or several lines."""
        lines = [(first, [rest] if isinstance(rest, str) else list(rest)) for first, rest in points]
        self._add("points", points=lines)

    def table(
        self,
        columns: Sequence[str],
        rows: Iterable[Sequence[str | Link]],
        *,
        as_text: bool = False,
        summary: str = "",
        omit: str | None = None,
        caption: str = "",
    ) -> None:
        """Add a table; cells are left-aligned if they are text, and a table with a summary is collapsed.

        Columns whose cells are all `omit` are omitted, and so is a table without rows. A table with a caption
        is numbered.
        """
        rows = list(rows)
        if not rows:
            return
        kept = [index for index in range(len(columns)) if any(row[index] != omit for row in rows)]
        columns = [columns[index] for index in kept]
        rows = [[row[index] for index in kept] for row in rows]
        caption = self._numbered("Table", caption) if caption else ""
        self._add("table", columns=columns, rows=rows, as_text=as_text, summary=summary, caption=caption)

    def figures(self, figures: Sequence[ReportFigure]) -> None:
        """Add numbered figures, next to each other if they fit."""
        if not figures:
            return
        numbered = [replace(item, caption=self._numbered("Figure", item.caption)) for item in figures]
        self._add("figures", figures=[_embedded(figure) for figure in numbered])

    def pictures(self, pictures: Sequence[Picture]) -> None:
        """Add small pictures from the page's folder, as many in a row as fit."""
        if pictures:
            self._add("pictures", pictures=pictures)

    def links(self, targets: Iterable[str], summary: str) -> None:
        """Add a collapsed list of files, by their paths relative to the page."""
        self._add("links", targets=list(targets), summary=summary)

    @property
    def html(self) -> str:
        """The whole page."""
        resources = files("homolog_resources")
        source, style = (
            (resources / name).read_text(encoding="utf-8") for name in ("report.html", "report.css")
        )
        environment = Environment(autoescape=True, undefined=StrictUndefined, keep_trailing_newline=True)
        environment.filters["typeset"] = _typeset
        return environment.from_string(source).render(
            title=self.title, notice=self.notice, footer=self._footer, parts=self.parts, style=style
        )

    def _add(self, kind: str, **content: object) -> None:
        self.parts.append({"kind": kind, **content})


_OPTION = re.compile(r"(?<!\S)--[a-z][\w-]*(?: \d+)?")


def _typeset(text: str) -> Markup:
    """Return an escaped text with typographic characters and unbroken command options."""
    return Markup(_OPTION.sub(r'<span class="unbroken">\g<0></span>', str(escape(typeset(text)))))


def _embedded(report_figure: ReportFigure) -> dict[str, object]:
    """Return a figure for the template: its picture as text, its width [pixels], its caption.

    The PDF embeds the figure itself.
    """
    picture, figure = io.BytesIO(), report_figure.figure
    complete_texts(figure)
    figure.savefig(picture, format="png", dpi=_DPI, facecolor=figure.get_facecolor())
    data = base64.b64encode(picture.getvalue()).decode("ascii")
    return {
        "data": data,
        "width": round(figure.get_figwidth() * 96),
        "caption": report_figure.caption,
        "figure": figure,
    }


_HEADS = (
    "structure",
    "number",
    "subjects",
    "absent",
    "at border",
    "in pieces",
    "median (ml)",
    "range (ml)",
    "particles",
    "first mode (%)",
    "state",
)


_ENDED = {"iterations": "not converged"}


def write_index(batch: Batch, cohort: Cohort, problems: Mapping[str, str], empty: Sequence[str] = ()) -> Path:
    """Write ``index.html`` and ``volumes.csv`` of a batch, which may still be running.

    Parameters
    ----------
    batch : Batch
    cohort : Cohort
        All its subjects.
    problems : mapping of str to str
        Reasons why files of subjects can't be read, by the subjects' names.
    empty : sequence of str
        Structures without voxels in all subjects.

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
    parts += [f"{len(empty)} empty"] if empty else []
    count = len(items) + len(empty)
    page.paragraph(f"{len(cohort.subjects)} subjects, {count} structures: {', '.join(parts)}.")
    page.table(_HEADS, [_row(item, batch.folder) for item in items])
    page.pictures([picture for item in items for picture in _pictures(item, batch.folder)])
    failed = [item for item in items if item.state in (ItemState.FAILED, ItemState.TOO_FEW)]
    without = [(item.structure.title, item.message) for item in failed]
    without += [(name, "the masks of all subjects are empty") for name in empty]
    if without:
        page.heading("Structures without a model")
        page.points(without)
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
    """Return the explained variance of the first mode, from the project's own table."""
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
