"""Figures of a patient's report: maps on the surface, the patient among the controls."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from homolog.arrays import FloatArray
from homolog.geometry import inverse_matrices
from homolog.patient import Change, FollowUp, PatientComparison
from homolog.patient.findings import beyond_limit
from homolog_app.pictures.layout import Panel, arrange, view_of_region
from homolog_app.plots import PercentileRow, draw_percentiles, new_figure
from homolog_app.rendering.camera import VIEWS, View, frame_around, three_quarter_view
from homolog_app.rendering.colours import (
    LIGHT,
    ColourScale,
    common_limit,
    displacement_scale,
    page_colours,
    thickness_scale,
)
from homolog_app.rendering.draw import draw
from homolog_app.rendering.rays import hollows
from homolog_app.rendering.scene import Scene, Surface, surface

__all__ = ["change_figure", "maps_figure", "percentiles_figure", "wall_figure"]

_ANATOMICAL = ("anterior", "posterior", "superior")


def maps_figure(comparison: PatientComparison, width: int = 400) -> Figure:
    """Draw the differences from the expected shape and from the mean on the patient's own surface.

    Parameters
    ----------
    comparison : PatientComparison
    width : int
        Pixels of a panel's width.
    """
    scale = displacement_scale(common_limit([comparison.residual, comparison.total]))
    rows = [
        _map_row(comparison, scale, comparison.residual, width),
        _map_row(comparison, scale, comparison.total, width, faint=False),
    ]
    labels = ("from the expected shape", "from the mean")
    return arrange(rows, row_labels=labels, scale=scale, theme=LIGHT)


def wall_figure(comparison: PatientComparison, width: int = 400) -> Figure:
    """Draw the differences of the wall's thickness on the patient's own surface; see `maps_figure`."""
    percent = 100.0 * comparison.thicker
    scale = thickness_scale(common_limit([percent]))
    row = _map_row(comparison, scale, percent, width)
    return arrange([row], row_labels=["thickness"], scale=scale, theme=LIGHT)


def _map_row(
    comparison: PatientComparison, scale: ColourScale, values: FloatArray, width: int, *, faint: bool = True
) -> tuple[Panel, ...]:
    """Draw a map (V,) on the patient's own surface, faint within the limit."""
    own, beyond = comparison.own, np.zeros(len(comparison.z), dtype=bool)
    for region in comparison.regions:
        beyond[region.vertices] = True
    grey, within = own.marked(comparison.missing), ~own.marked(beyond) if faint else None
    colours = scale.colours(own.carried(values), grey, within) / 255.0
    return _row(surface(own.mesh, colours, hollows(own.mesh)), _views(comparison), width)


def change_figure(follow_up: FollowUp, change: Change, width: int = 400) -> Figure:
    """Draw a later time's change on the first surface, in the file's frame (LPS); faint within the limit.

    Colours end at the same value for all times.
    """
    limit = common_limit([item.distance for item in follow_up.changes])
    own, beyond = follow_up.comparisons[0].own, beyond_limit(change, follow_up)
    oblique = replace(three_quarter_view(own.mesh.vertices), name="oblique")
    faint = None if beyond is None else ~own.marked(beyond)
    colours = displacement_scale(limit).colours(own.carried(change.distance), None, faint) / 255.0
    views = [oblique, *(VIEWS[name] for name in _ANATOMICAL)]
    row = _row(surface(own.mesh, colours, hollows(own.mesh)), views, width)
    return arrange([row], row_labels=[change.name], limit=limit, theme=LIGHT)


def percentiles_figure(rows: Sequence[PercentileRow]) -> Figure:
    """Draw the patient's numbers among those of the controls."""
    figure = new_figure(6.6, 0.8 * len(rows), colours := page_colours(LIGHT))
    draw_percentiles(figure.subplots(len(rows), 1), rows, colours)
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
