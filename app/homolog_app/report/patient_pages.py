"""A patient's report as two A4 pages of PDF."""

from collections.abc import Sequence
from pathlib import Path

from homolog.patient import PatientComparison, Reference
from homolog_app.plots import draw_percentiles
from homolog_app.rendering.colours import LIGHT, page_colours
from homolog_app.report.patient_figures import MapPictures
from homolog_app.report.patient_groups import GROUP_CAUTION
from homolog_app.report.patient_words import (
    METHOD,
    REGION_COLUMNS,
    detectable_words,
    measure_rows,
    nearest_words,
    reference_rows,
    region_rows,
    verdict,
)
from homolog_app.report.sheets import EDGE, HIGH, WIDE, Sheet, write_sheets

__all__ = ["write_pdf"]

_MOST_REGIONS = 12


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


def _title(comparison: PatientComparison) -> str:
    return f"Shape of {comparison.name} against a reference"


def _first(comparison: PatientComparison, reference: Reference, maps: MapPictures) -> Sheet:
    sheet = Sheet(_title(comparison))
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
    _add_bars(sheet, comparison, reference)
    sheet.text(
        "Marks: controls fitted as patients; band: their middle 90 %; diamond: this subject, red "
        "where p is 0.05 or less; dashed: limit.",
        7.5,
    )
    return sheet


def _second(comparison: PatientComparison, reference: Reference, groups: Sequence[str]) -> Sheet:
    sheet = Sheet(_title(comparison))
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


def _add_bars(sheet: Sheet, comparison: PatientComparison, reference: Reference) -> None:
    """Add the patient among the controls."""
    places = []
    for _ in range(4):
        width, high = WIDE - 2.0 * EDGE, 0.16
        bottom = 1.0 - (sheet.y + 0.16 + high) / HIGH  # below the title
        places.append(sheet.figure.add_axes((EDGE / WIDE, bottom, width / WIDE, high / HIGH)))
        sheet.y += high + 0.38
    draw_percentiles(places, comparison, reference, page_colours(LIGHT))
