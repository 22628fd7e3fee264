"""A patient's report as two A4 pages of PDF."""

import io
import textwrap
from collections.abc import Sequence
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

from homolog import __version__
from homolog.files.atomic import atomic_write
from homolog.patient import PatientComparison, Reference
from homolog_app.fonts import complete_texts
from homolog_app.pictures.layout import Panel, draw_displacement_bar
from homolog_app.plots import draw_percentiles
from homolog_app.rendering.colours import LIGHT, page_colours
from homolog_app.report.patient_figures import MapPictures
from homolog_app.report.patient_groups import GROUP_CAUTION
from homolog_app.report.patient_words import (
    METHOD,
    NOTICE,
    REGION_COLUMNS,
    detectable_words,
    measure_rows,
    nearest_words,
    reference_rows,
    region_rows,
    verdict,
)

__all__ = ["Sheet", "write_pdf", "write_sheets"]

_WIDE, _HIGH = 8.27, 11.69  # A4 [inches]
_EDGE = 0.6
_LINE = 0.17
_WRAP = 108  # characters of small text on a line
_MOST_REGIONS = 12


class Sheet:
    """An A4 page that is filled from top to bottom; lengths in inches."""

    def __init__(self, title: str, number: int, pages: int = 2) -> None:
        self.figure = Figure(figsize=(_WIDE, _HIGH), facecolor="white")
        FigureCanvasAgg(self.figure)
        self.y = _EDGE
        self.text(title, 13.0, bold=True)
        self.text(NOTICE, 8.5, colour="#a03c00", bold=True)
        self.y += 0.08
        foot = f"{NOTICE} Homolog {__version__}. Page {number} of {pages}"
        self.figure.text(0.5, 0.35 / _HIGH, foot, ha="center", fontsize=7)

    def text(self, content: str, size: float = 8.5, *, bold: bool = False, colour: str = "#1a1a1e") -> None:
        """Add a paragraph."""
        for line in textwrap.wrap(content, int(_WRAP * 8.5 / size)) or [""]:
            self.figure.text(
                _EDGE / _WIDE, 1.0 - self.y / _HIGH, line, fontsize=size, va="top", color=colour,
                weight="bold" if bold else "normal",
            )  # fmt: skip
            self.y += _LINE * size / 8.5
        self.y += 0.05

    def heading(self, content: str) -> None:
        """Add a heading."""
        self.y += 0.1
        self.text(content, 10.5, bold=True)

    def rows(self, rows: Sequence[Sequence[str]], starts: Sequence[float]) -> None:
        """Add a table; columns start at these places [inches from the left edge]."""
        for number, row in enumerate(rows):
            lines = 1
            for cell, start, end in zip(row, starts, [*starts[1:], _WIDE - 2 * _EDGE], strict=True):
                parts = textwrap.wrap(cell, max(4, int((end - start) * 15.0))) or [""]
                lines = max(lines, len(parts))
                self.figure.text(
                    (_EDGE + start) / _WIDE, 1.0 - self.y / _HIGH, "\n".join(parts), fontsize=8, va="top",
                    weight="bold" if number == 0 else "normal", linespacing=1.3,
                )  # fmt: skip
            self.y += _LINE * lines
        self.y += 0.05

    def panels(self, panels: Sequence[Panel], limit: float) -> None:
        """Add a row of pictures with the colour bar."""
        room = _WIDE - 2.0 * _EDGE - 1.05
        width = room / len(panels)
        tall = max(panel.image.shape[0] / panel.image.shape[1] for panel in panels) * (width - 0.06)
        for index, panel in enumerate(panels):
            high = panel.image.shape[0] / panel.image.shape[1] * (width - 0.06)
            left, top = _EDGE + index * width, self.y + (tall - high) / 2.0
            place = self.figure.add_axes(
                (left / _WIDE, 1.0 - (top + high) / _HIGH, (width - 0.06) / _WIDE, high / _HIGH)
            )
            place.imshow(panel.image, interpolation="antialiased", aspect="auto")
            place.axis("off")
            self.figure.text(
                (left + width / 2.0) / _WIDE, 1.0 - (self.y + tall + 0.03) / _HIGH, panel.caption,
                fontsize=7.5, ha="center", va="top",
            )  # fmt: skip
        long = max(min(tall, 1.6) - 0.5, 0.5)
        bar = self.figure.add_axes(
            (
                (_WIDE - _EDGE - 0.6) / _WIDE,
                1.0 - (self.y + (tall + long) / 2.0) / _HIGH,
                0.11 / _WIDE,
                long / _HIGH,
            )
        )
        draw_displacement_bar(bar, limit, LIGHT, 6.5)
        self.y += max(tall, long + 0.5) + 0.28

    def bars(self, comparison: PatientComparison, reference: Reference) -> None:
        """Add the patient among the controls."""
        places = []
        for _ in range(4):
            width, high = _WIDE - 2.0 * _EDGE, 0.16
            bottom = 1.0 - (self.y + 0.16 + high) / _HIGH  # below the title
            places.append(self.figure.add_axes((_EDGE / _WIDE, bottom, width / _WIDE, high / _HIGH)))
            self.y += high + 0.38
        draw_percentiles(places, comparison, reference, page_colours(LIGHT))


def write_pdf(
    path: Path,
    comparison: PatientComparison,
    reference: Reference,
    maps: MapPictures,
    groups: Sequence[str] = (),
) -> None:
    """Write the report as two pages; `groups` says how typical the patient is of several groups.

    Raises
    ------
    InputError
        If the file can't be written.
    """
    sheets = [_first(comparison, reference, maps), _second(comparison, reference, groups)]
    write_sheets(path, f"Shape of {comparison.name}", sheets)


def write_sheets(path: Path, title: str, sheets: Sequence[Sheet]) -> None:
    """Write pages to a PDF, whole or not at all; raises InputError if it can't be written."""
    drawn = io.BytesIO()
    with PdfPages(drawn, metadata={"CreationDate": None, "Title": title}) as pages:
        for sheet in sheets:
            complete_texts(sheet.figure)
            pages.savefig(sheet.figure)
    with atomic_write(path) as part:
        part.write_bytes(drawn.getvalue())


def _title(comparison: PatientComparison) -> str:
    return f"Shape of {comparison.name} against a reference"


def _first(comparison: PatientComparison, reference: Reference, maps: MapPictures) -> Sheet:
    sheet = Sheet(_title(comparison), 1)
    about = reference.provenance
    given = ", ".join(f"{name} {value}" for name, value in comparison.covariates.items())
    sheet.text(
        f"Reference: {about.project}{f', {about.group}' if about.group else ''}, {about.controls} controls"
        f"{f'. Patient: {given}' if given else ''}."
    )
    sheet.heading("Finding")
    sheet.text(verdict(comparison, reference), 9.0)
    sheet.text(detectable_words(reference))
    sheet.heading("Difference from the shape that the reference expects of this subject (mm)")
    sheet.panels(maps.local, maps.limit)
    sheet.text("Within the limit colours are faint; beyond it they are full.", 7.5)
    sheet.heading("Difference from the mean of the reference (mm)")
    sheet.panels(maps.total, maps.total_limit)
    sheet.heading("Among the controls")
    sheet.bars(comparison, reference)
    sheet.text(
        "Marks: controls fitted as patients; band: their middle 90 %; diamond: this subject, red "
        "where p is 0.05 or less; dashed: limit.",
        7.5,
    )
    return sheet


def _second(comparison: PatientComparison, reference: Reference, groups: Sequence[str]) -> Sheet:
    sheet = Sheet(_title(comparison), 2)
    sheet.heading("Regions beyond the limit")
    rows = region_rows(comparison, reference)
    if rows:
        sheet.rows([REGION_COLUMNS, *rows[:_MOST_REGIONS]], (0.0, 0.6, 1.45, 2.25, 3.05, 3.85, 5.9))
        if len(rows) > _MOST_REGIONS:
            sheet.text(f"{len(rows) - _MOST_REGIONS} more are in regions.csv.")
    else:
        sheet.text("None.")
    sheet.heading("Numbers")
    header = ("", "value", "percentile of controls (95 % interval)", "p")
    sheet.rows([header, *measure_rows(comparison, reference)], (0.0, 2.3, 3.4, 6.2))
    if nearest := nearest_words(comparison, reference):
        sheet.text(nearest)
    if groups:
        sheet.heading("Groups")
        for line in (GROUP_CAUTION, *groups):
            sheet.text(line)
    if comparison.remarks:
        sheet.heading("Remarks")
        for text in comparison.remarks:
            sheet.text(f"• {text}")
    sheet.heading("Method")
    for text in METHOD:
        sheet.text(text, 8.0)
    sheet.heading("Reference")
    sheet.rows([("", ""), *reference_rows(reference)], (0.0, 1.6))
    return sheet
