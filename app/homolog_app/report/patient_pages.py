"""A patient's report as two A4 pages of PDF: maps on the surface, the patient among the controls."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from homolog.arrays import BoolArray, FloatArray
from homolog.geometry import inverse_matrices
from homolog.patient import PatientComparison, Reference
from homolog_app.pictures.layout import Panel, arrange, view_of_region
from homolog_app.plots import draw_percentiles, new_figure
from homolog_app.rendering.camera import VIEWS, View, frame_around, three_quarter_view
from homolog_app.rendering.colours import LIGHT, common_limit, displacement_scale, page_colours
from homolog_app.rendering.draw import draw
from homolog_app.rendering.rays import hollows
from homolog_app.rendering.scene import Scene, Surface, surface
from homolog_app.report.patient_texts import (
    GROUP_CAUTION,
    MARKS,
    METHOD,
    REGION_COLUMNS,
    cut_off_text,
    finding,
    measure_rows,
    nearest_controls_text,
    reference_rows,
    region_rows,
    who_text,
)
from homolog_app.report.sheets import BOTTOM, EDGE, HIGH, WIDE, Sheet, write_sheets

__all__ = [
    "MapPictures",
    "change_pictures",
    "first_sheet",
    "map_pictures",
    "patient_sheets",
    "percentiles_figure",
    "second_sheet",
    "write_pdf",
]

_ANATOMICAL = ("anterior", "posterior", "superior")


@dataclass(frozen=True, slots=True, eq=False)
class MapPictures:
    """Rendered maps: rows of panels, with their colour limits [mm].

    Attributes
    ----------
    local, total : tuple of Panel
        Differences from the expected shape and from the mean.
    limit, total_limit : float
        Ends of the colour scales [mm].
    """

    local: tuple[Panel, ...]
    total: tuple[Panel, ...]
    limit: float
    total_limit: float

    def figure(self) -> Figure:
        """Return both rows as one figure."""
        rows = [self.local, self.total]
        limit = max(self.limit, self.total_limit)
        return arrange(
            rows,
            row_labels=["from the expected shape", "from the mean"],
            limit=limit,
            theme=LIGHT,
        )


def map_pictures(comparison: PatientComparison, width: int = 400) -> MapPictures:
    """Draw the maps on the patient's own surface, in the patient's frame (LPS).

    Parameters
    ----------
    comparison : PatientComparison
    width : int
        Pixels of a panel's width.
    """
    own = comparison.own
    beyond = np.zeros(len(comparison.z), dtype=bool)
    for region in comparison.regions:
        beyond[region.vertices] = True
    limit = common_limit([comparison.residual, comparison.total])
    scale, grey = displacement_scale(limit), own.marked(comparison.missing)
    views = _views(comparison)
    shadow = hollows(own.mesh)
    rows = [
        _row(surface(own.mesh, scale.colours(own.carried(values), grey, faint) / 255.0, shadow), views, width)
        for values, faint in ((comparison.residual, ~own.marked(beyond)), (comparison.total, None))
    ]
    return MapPictures(rows[0], rows[1], limit, limit)


def change_pictures(
    first: PatientComparison, distance: FloatArray, beyond: BoolArray | None, limit: float, width: int = 400
) -> tuple[Panel, ...]:
    """Draw a map of change on a patient's first surface, in the file's frame (LPS).

    Parameters
    ----------
    first : PatientComparison
        Comparison of the first time.
    distance : (V,) array
        Change at the reference's vertices [mm].
    beyond : (V,) bool array or None
        Vertices where the map is not faint; None for all.
    limit : float
        Ends of the colour scale [mm].
    width : int
        Pixels of a panel's width.
    """
    own = first.own
    views = [
        replace(three_quarter_view(own.mesh.vertices), name="oblique"),
        *(VIEWS[name] for name in _ANATOMICAL),
    ]
    faint = None if beyond is None else ~own.marked(beyond)
    colours = displacement_scale(limit).colours(own.carried(distance), None, faint) / 255.0
    return _row(surface(own.mesh, colours, hollows(own.mesh)), views, width)


def percentiles_figure(comparison: PatientComparison, reference: Reference) -> Figure:
    """Draw the patient's global numbers among those of the controls."""
    figure = new_figure(6.6, 2.6, colours := page_colours(LIGHT))
    draw_percentiles(figure.subplots(4, 1), comparison, reference, colours)
    return figure


def _views(comparison: PatientComparison) -> list[View]:
    """Return a view of the most extreme region, or an oblique one, and anatomical views."""
    first = replace(three_quarter_view(comparison.own.mesh.vertices), name="oblique")
    if comparison.regions:
        region = comparison.regions[0]
        matched = comparison.matched.placed(inverse_matrices(comparison.placement))
        first = replace(view_of_region(matched, region.vertices, region.centre), name="towards region 1")
    return [first, *(VIEWS[name] for name in _ANATOMICAL)]


def _row(solid: Surface, views: Sequence[View], width: int) -> tuple[Panel, ...]:
    widest = max(frame_around([solid.vertices], view).width for view in views)
    panels = []
    for view in views:
        frame = frame_around([solid.vertices], view, width=widest)
        panels.append(Panel(draw(Scene((solid,)), frame, width), view.name))
    return tuple(panels)


_MOST_REGIONS, _MOST_CAUTIONS = 12, 3
_BESIDE_MAPS = 4.4
"""Height of the first page's other content below the finding [inches]."""


def write_pdf(
    path: Path,
    comparison: PatientComparison,
    reference: Reference,
    maps: MapPictures,
    groups: Sequence[str] = (),
) -> None:
    """Write the report as two pages; `groups` are sentences on the typicality for several groups.

    Raises
    ------
    InputError
        If the file can't be written.
    """
    sheets = patient_sheets(comparison, reference, maps, groups)
    write_sheets(path, f"Shape of {comparison.name}", sheets)


def patient_sheets(
    comparison: PatientComparison, reference: Reference, maps: MapPictures, groups: Sequence[str] = ()
) -> list[Sheet]:
    """Return the report's two pages."""
    return [first_sheet(comparison, reference, maps), second_sheet(comparison, reference, groups)]


def _title(comparison: PatientComparison) -> str:
    return f"Shape of {comparison.name} against a reference"


def first_sheet(comparison: PatientComparison, reference: Reference, maps: MapPictures) -> Sheet:
    """Return the page with findings, cautions, maps and the position among the controls."""
    sheet = Sheet(_title(comparison))
    sheet.text(who_text(comparison, reference))
    sheet.heading("Finding")
    sheet.text(finding(comparison, reference), 9.0)
    for text in comparison.cautions[:_MOST_CAUTIONS]:
        sheet.text(f"Caution: {text}.")
    most = (BOTTOM - sheet.y - _BESIDE_MAPS) / 2.0
    sheet.heading("Difference from the shape that the reference expects of this subject (mm)")
    sheet.panels(maps.local, maps.limit, most)
    faint = "Within the limit colours are faint; beyond it they are full."
    sheet.text(f"{faint}{cut_off_text(comparison)}", 7.5)
    sheet.heading("Difference from the mean of the reference (mm)")
    sheet.panels(maps.total, maps.total_limit, most)
    sheet.heading("Among the controls")
    _add_bars(sheet, comparison, reference)
    sheet.text(MARKS, 7.5)
    return sheet


def second_sheet(comparison: PatientComparison, reference: Reference, groups: Sequence[str] = ()) -> Sheet:
    """Return the page with regions, numbers, remarks, method and reference."""
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
    if nearest := nearest_controls_text(comparison, reference):
        sheet.text(nearest)
    if groups:
        sheet.heading("Groups")
        for line in (GROUP_CAUTION, *groups):
            sheet.text(line)
    before = comparison.cautions[:_MOST_CAUTIONS]
    if remarks := [text for text in comparison.remarks if text not in before]:
        sheet.heading("Remarks")
        for text in remarks:
            sheet.text(f"• {text}")
    sheet.heading("Method")
    for text in METHOD:
        sheet.text(text, 8.0)
    sheet.heading("Reference")
    sheet.rows(reference_rows(reference), (0.0, 1.6), has_header=False)
    return sheet


def _add_bars(sheet: Sheet, comparison: PatientComparison, reference: Reference) -> None:
    """Add the chart of the patient among the controls."""
    places = []
    for _ in range(4):
        width, high = WIDE - 2.0 * EDGE, 0.16
        bottom = 1.0 - (sheet.y + 0.16 + high) / HIGH  # below the title
        places.append(sheet.figure.add_axes((EDGE / WIDE, bottom, width / WIDE, high / HIGH)))
        sheet.y += high + 0.38
    draw_percentiles(places, comparison, reference, page_colours(LIGHT))
