"""The A4 pages of a report's PDF."""

import re
import textwrap
from collections.abc import Iterable, Sequence
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from homolog.arrays import Array
from homolog.errors import InputError
from homolog.io.atomic import atomic_write, write_text
from homolog_app.rendering.text import complete_texts, shortened, typeset
from homolog_app.report import NOTICE
from homolog_app.report.page import Link, Page
from homolog_app.report.pdf import Bookmark, EmbeddedFigure, pdf_of

__all__ = ["check_page_name", "drawn_sheets", "sheets_of", "write_page"]

_WIDE, _HIGH = 8.27, 11.69
"""Of A4 [inches]."""
_EDGE = 0.6
"""Margin [inches]."""
_LINE = 0.17
_WRAP = 108  # characters per line of small text
_ROW_LINE = 0.145  # line height in a table's cell
_ROW_GAP = 0.04
_ACROSS = 15.0  # characters per inch in a table's cell
_BOTTOM = _HIGH - 0.65
"""Lower end of the content of a page [inches]."""
_ORANGE, _GREY = "#a03c00", "#5a5a62"
_SMALLEST = 0.75
"""Smallest scale of a figure to fit next to another."""
_BOLD = 1.12
"""Relative width of bold letters."""
_CAPITALS = 0.3
"""Relative width of capital letters."""
_MOST_COLUMNS = 9
_UNCUT = 0.6
"""Fraction of a sheet up to which a table is not divided."""
_MOST_TURNED = 4
"""Rows of a transposed table next to each other."""
_MOST_ROWS = 200
_NUMBER = re.compile(r"Table \d+")


class Sheet:
    """An A4 page that is filled from top to bottom; lengths in inches."""

    def __init__(self, title: str, *, running: bool = False) -> None:
        """Begin a sheet with its title and the notice, or with a small running title."""
        self.figure = Figure(figsize=(_WIDE, _HIGH), facecolor="white")
        FigureCanvasAgg(self.figure)
        self.y = _EDGE
        if running:
            self.line(shortened(typeset(title), _WRAP), 7.5, colour=_GREY)
            self.y += 0.08
            return
        self.text(title, 12.0, bold=True)
        self.text(NOTICE, 8.5, colour=_ORANGE, bold=True)
        self.y += 0.08

    def foot(self, number: int, pages: int) -> None:
        """Write the page number at the bottom."""
        foot = f"{NOTICE} Page {number} of {pages}"
        self.figure.text(0.5, 0.35 / _HIGH, foot, ha="center", fontsize=7)

    def text(self, content: str, size: float = 8.5, *, bold: bool = False, colour: str = "#1a1a1e") -> None:
        """Add a paragraph."""
        for line in wrapped(content, size * (_BOLD if bold else 1.0)):
            self.line(line, size, bold=bold, colour=colour)
        self.y += 0.05

    def line(self, content: str, size: float = 8.5, *, bold: bool = False, colour: str = "#1a1a1e") -> None:
        """Add a line."""
        self.figure.text(
            _EDGE / _WIDE,
            1.0 - self.y / _HIGH,
            content,
            fontsize=size,
            va="top",
            color=colour,
            weight="bold" if bold else "normal",
        )
        self.y += _LINE * size / 8.5

    def heading(self, content: str) -> None:
        """Add a heading."""
        self.y += 0.1
        self.text(content, 10.5, bold=True)

    def row(self, row: Sequence[str], starts: Sequence[float], *, bold: bool = False) -> None:
        """Add a row of a table."""
        cells = wrapped_cells(row, starts, _BOLD if bold else 1.0)
        for parts, start in zip(cells, starts, strict=True):
            self.figure.text(
                (_EDGE + start) / _WIDE,
                1.0 - self.y / _HIGH,
                "\n".join(parts),
                fontsize=8,
                va="top",
                weight="bold" if bold else "normal",
                linespacing=1.3,
            )
        self.y += row_height(cells)

    def embed(self, figure: Figure, left: float, top: float, width: float) -> None:
        """Place a figure as vector graphics."""
        scale = width / figure.get_figwidth()
        bottom = _HIGH - top - scale * figure.get_figheight()
        self.figure.add_artist(EmbeddedFigure(figure, left, bottom, scale), clip=False)


def wrapped(content: str, size: float = 8.5) -> list[str]:
    """Return the lines of a paragraph."""
    return textwrap.wrap(typeset(content), int(_WRAP * 8.5 / size), break_on_hyphens=False) or [""]


def wrapped_cells(row: Sequence[str], starts: Sequence[float], width: float = 1.0) -> list[list[str]]:
    """Return the lines of each cell of a row; `width` is the letters' width relative to regular ones."""
    ends = [*starts[1:], _WIDE - 2 * _EDGE]
    lines = []
    for cell, start, end in zip(row, starts, ends, strict=True):
        most = max(4, int((end - start) * _ACROSS / width * len(cell) / max(_length(cell), 1.0)))
        text = _breakable(cell)
        if max(map(len, text.split(" "))) > most:  # a break between number and unit is preferred
            text = text.replace("\u00a0", " ")
        lines.append(textwrap.wrap(text, most) or [""])
    return lines


def _breakable(cell: str) -> str:
    """Return the text of a cell, which may be broken between an estimate and its interval."""
    return typeset(cell).replace("\u00a0(", " (")


def row_height(cells: Sequence[Sequence[str]]) -> float:
    """Return the height of a table's row [inches] from the lines of its cells."""
    return _ROW_LINE * max(map(len, cells)) + _ROW_GAP


def drawn_sheets(sheets: Sequence[Sheet], dpi: float) -> list[Array]:
    """Return pages as 8-bit pictures (H, W, 3) for printing."""
    pictures = []
    for figure in _finished(sheets):
        figure.set_dpi(dpi)
        canvas: Any = FigureCanvasAgg(figure)  # matplotlib does not type it
        canvas.draw()
        pictures.append(np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[:, :, :3]))
    return pictures


def _finished(sheets: Sequence[Sheet]) -> list[Figure]:
    """Return the figures of pages, with their numbers."""
    for number, sheet in enumerate(sheets, start=1):
        sheet.foot(number, len(sheets))
        complete_texts(sheet.figure)
    return [sheet.figure for sheet in sheets]


def write_page(path: Path, page: Page) -> None:
    """Write a page as HTML or, without what is collapsed, as a PDF of A4 pages with bookmarks, by the suffix.

    Raises
    ------
    InputError
        If the suffix is another one, or the file can't be written.
    """
    check_page_name(path)
    if path.suffix.lower() == ".html":
        write_text(path, page.html)
        return
    flow = _flow(page)
    content = pdf_of(_finished(flow.sheets), page.title, flow.contents)
    with atomic_write(path) as part:
        part.write_bytes(content)


def check_page_name(path: Path) -> None:
    """Raise InputError if a file's name is not that of a page."""
    if path.suffix.lower() not in (".pdf", ".html"):
        raise InputError(f"{path}: a page is written as .pdf or .html; choose such a name")


def sheets_of(page: Page) -> list[Sheet]:
    """Return the A4 pages of a page."""
    return _flow(page).sheets


def _flow(page: Page) -> "_Flow":
    flow = _Flow(page.title)
    flow.paragraph(page.notice.removeprefix(NOTICE).strip())
    for part in page.parts:
        flow.add(part)
    return flow


class _Flow:
    """Distributes the parts of a page over as many sheets as necessary."""

    def __init__(self, title: str) -> None:
        self._title = title
        self._headings: list[tuple[str, int]] = []
        self.sheets = [Sheet(title)]
        self.contents: list[Bookmark] = []

    def add(self, part: dict[str, object]) -> None:
        """Add one of `Page.parts`."""
        match part:
            case {"kind": "heading", "text": str(text), "level": int(level)}:
                self._headings.append((text, level - 1))
            case {"kind": "paragraph", "text": str(text)}:
                self.paragraph(text)
            case {"kind": "caution", "text": str(text)}:
                self.paragraph(f"Caution: {text}", colour=_ORANGE)
            case {"kind": "points", "points": list(points)}:
                for first, rest in points:
                    self.paragraph(f"• {first}", bold=True, gap=0.0)
                    for line in rest:
                        self.paragraph(line, gap=0.0)
                    self.sheet.y += 0.05
            case {
                "kind": "table",
                "columns": columns,
                "rows": list(rows),
                "summary": "",
                "caption": str(name),
            }:
                assert isinstance(columns, Sequence)
                if name:
                    self._headings.append((name, 0))
                self.table(columns, [[_cell_text(cell) for cell in row] for row in rows], name)
            case {"kind": "figures", "figures": list(figures)}:
                self.figures(figures)

    @property
    def sheet(self) -> Sheet:
        """The current sheet."""
        return self.sheets[-1]

    def room(self, height: float) -> None:
        """Start a new sheet if the current one has less space [inches], and write the pending headings."""
        if self.sheet.y + height + 0.35 * len(self._headings) > _BOTTOM:
            self.sheets.append(Sheet(self._title, running=True))
        headings, self._headings = self._headings, []
        for text, level in headings:
            self.sheet.heading(text) if level == 1 else self.sheet.text(text, 9.0, bold=True)
            if level:
                self.contents.append(Bookmark(text, level, len(self.sheets)))

    def paragraph(self, text: str, *, bold: bool = False, colour: str = "#1a1a1e", gap: float = 0.05) -> None:
        """Add a paragraph, which may continue on the next sheet."""
        lines = wrapped(text, 8.5 * (_BOLD if bold else 1.0)) if text else []
        for number, line in enumerate(lines):
            self.room(_LINE * (1 if number else 3))
            self.sheet.line(line, bold=bold, colour=colour)
        self.sheet.y += gap

    def table(self, columns: Sequence[str], rows: Sequence[Sequence[str]], name: str = "") -> None:
        """Add a table; one with many columns is transposed.

        Rows are not divided. A table that continues on the next sheet repeats its number and header there.
        """
        if len(columns) > _MOST_COLUMNS:
            size = ceil(len(rows) / max(ceil(len(rows) / _MOST_TURNED), 1))
            for start in range(0, len(rows), max(size, 1)):
                turned = list(zip(columns, *rows[start : start + size], strict=True))
                self.table(turned[0], turned[1:], name)
            return
        starts = _starts([columns, *rows[:_MOST_ROWS]])
        heights = [row_height(wrapped_cells(columns, starts, _BOLD))]
        heights += [row_height(wrapped_cells(row, starts)) for row in rows[:_MOST_ROWS]]
        whole = sum(heights)
        self.room(whole if whole < _UNCUT * (_BOTTOM - _EDGE) else sum(heights[:3]))
        self.sheet.row(columns, starts, bold=True)
        for row, high in zip(rows, heights[1:], strict=False):
            if self.sheet.y + high > _BOTTOM:
                if name:
                    number = _NUMBER.match(name)
                    self._headings.append((f"{number[0] if number else name} (continued)", 0))
                self.room(_BOTTOM)
                self.sheet.row(columns, starts, bold=True)
            self.sheet.row(row, starts)
        self.sheet.y += 0.08
        if len(rows) > _MOST_ROWS:
            self.paragraph(f"{len(rows) - _MOST_ROWS} more rows: see the HTML page.")

    def figures(self, figures: Iterable[dict[str, Any]]) -> None:
        """Add figures with captions, side by side if they fit, also when slightly reduced."""
        items, room = [(item["figure"], str(item["caption"])) for item in figures], _WIDE - 2 * _EDGE
        widths = [figure.get_figwidth() for figure, _ in items]
        smaller = (room - 0.1 * len(items)) / max(sum(widths), room)
        is_row = len(items) > 1 and smaller > _SMALLEST
        placed = [
            _placed(figure, text, min(own * (smaller if is_row else 1.0), room))
            for (figure, text), own in zip(items, widths, strict=True)
        ]
        row = max((needed for *_, needed in placed), default=0.0)
        left = 0.0
        below = 0.0
        for figure, caption, width, high, needed in placed:
            if not left or left + width > room or self.sheet.y + needed > _BOTTOM:
                self.sheet.y += below
                left = below = 0.0
                self.room(row if is_row else needed)
            self.sheet.embed(figure, _EDGE + left, self.sheet.y, width)
            self.sheet.figure.text(
                (_EDGE + left) / _WIDE,
                1.0 - (self.sheet.y + high + 0.03) / _HIGH,
                caption,
                fontsize=7.5,
                va="top",
                linespacing=1.3,
            )
            left, below = left + width + 0.1, max(below, needed + 0.1)
        self.sheet.y += below


def _placed(figure: Figure, text: str, width: float) -> tuple[Figure, str, float, float, float]:
    """Return a figure with its wrapped caption, its width and height, and the height of both [inches]."""
    high = figure.get_figheight() / figure.get_figwidth() * width
    if high > (limit := _BOTTOM - 2.2):
        width, high = width * limit / high, limit
    caption = textwrap.wrap(typeset(text), max(20, int(width * _ACROSS)))
    return figure, "\n".join(caption), width, high, high + 0.05 + _LINE * len(caption)


def _cell_text(cell: str | Link) -> str:
    return cell if isinstance(cell, str) else cell.text


def _starts(rows: Sequence[Sequence[str]]) -> list[float]:
    """Return the left edges of the columns: wide for long texts, if possible without divided words.

    The first row is the header, whose texts may be broken between words.
    """
    columns = list(zip(*([_breakable(cell) for cell in row] for row in rows), strict=True))
    least = np.array([3 + _letters([cell.split(" ") for cell in column]) for column in columns])
    whole = np.array(
        [3 + _letters([column[0].split(" "), *([cell] for cell in column[1:])]) for column in columns]
    )
    room = (_WIDE - 2 * _EDGE) * _ACROSS
    left = max(room - least.sum(), 0.0)
    widths = least + (whole - least) * min(1.0, left / max((whole - least).sum(), 1))
    headers = np.array([3 + _letters([[column[0]]]) for column in columns])
    missing = np.maximum(headers - widths, 0.0)
    widths += missing * min(1.0, max(room - widths.sum(), 0.0) / max(missing.sum(), 1))
    widths = widths * min(1.0, room / widths.sum())
    places: list[float] = (np.concatenate([[0.0], widths.cumsum()[:-1]]) / _ACROSS).tolist()
    return places


def _letters(cells: Sequence[Sequence[str]]) -> float:
    """Return the length of the longest word of a column's cells; the first cell is bold."""
    longest = [max(map(_length, parts), default=0.0) for parts in cells]
    return max(_BOLD * longest[0], *longest[1:], 0)


def _length(text: str) -> float:
    """Return the length of a text in letters of average width, with wider capitals."""
    return len(text) + _CAPITALS * sum(letter.isupper() for letter in text)
