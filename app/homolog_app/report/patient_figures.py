"""Pictures of a patient's report: maps on the surface, and the patient among the controls."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from homolog.arrays import BoolArray, FloatArray
from homolog.geometry import inverse_matrices
from homolog.patient import PatientComparison, Percentile, Reference
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.pictures.displacement import common_limit
from homolog_app.pictures.layout import Panel, arrange
from homolog_app.pictures.visible import view_of_region
from homolog_app.rendering.colours import LIGHT, diverging_colours
from homolog_app.rendering.draw import draw
from homolog_app.rendering.hollows import hollows
from homolog_app.rendering.scene import Scene, Surface, surface
from homolog_app.rendering.views import VIEWS, View, frame_around, three_quarter_view

__all__ = ["MapPictures", "draw_bars", "draw_percentiles", "map_pictures"]

_BLUE, _ORANGE, _GREY = "#0072B2", "#D55E00", "#8a8a8a"
_FONT_PT = 8.5
_ANATOMICAL = ("anterior", "posterior", "superior")
_FADED = 0.35
"""Of the map's colour where the difference is within the limit."""


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
    own = _own_surface(comparison)
    beyond = np.zeros(len(comparison.z), dtype=bool)
    for region in comparison.regions:
        beyond[region.vertices] = True
    limit = common_limit([comparison.residual, comparison.total])
    views = _views(comparison, own)
    shadow = hollows(own)
    local = _shaded(comparison.residual, limit, beyond)
    total = diverging_colours(comparison.total, limit)
    rows = [_row(surface(own, colours, shadow), own, views, width) for colours in (local, total)]
    return MapPictures(rows[0], rows[1], limit, limit)


def draw_percentiles(comparison: PatientComparison, reference: Reference) -> Figure:
    """Draw the patient's global numbers among those of the controls."""
    figure = Figure(figsize=(6.6, 2.6), dpi=150, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    draw_bars(list(figure.subplots(4, 1)), comparison, reference)
    return figure


def draw_bars(places: Sequence[Axes], comparison: PatientComparison, reference: Reference) -> None:
    """Draw a line for each number on four axes: controls as marks, their middle 90 %, the patient."""
    rows: list[tuple[str, Percentile, FloatArray, str]] = [
        ("distance in the modes (SD)", comparison.mahalanobis, reference.mahalanobis, ".1f"),
        ("outside of them (mm)", comparison.outside, reference.outside, ".2f"),
        ("size, of the expected", comparison.size, reference.size, ".2f"),
        ("largest |z|", comparison.local, reference.maxima, ".1f"),
    ]
    for place, (label, item, controls, form) in zip(places, rows, strict=True):
        low, high = np.quantile(controls, [0.05, 0.95])
        place.axvspan(low, high, ymin=0.25, ymax=0.75, color="#d9e6f2", lw=0)
        place.plot(controls, np.zeros(len(controls)), "|", color=_GREY, markersize=7, markeredgewidth=0.8)
        place.plot([item.value], [0.0], "D", color=_ORANGE if item.p <= 0.05 else _BLUE, markersize=6)
        if item is comparison.local:
            place.axvline(reference.limit, color=_ORANGE, lw=1.0, ls="--")
        end = max(float(controls.max()), item.value, reference.limit if item is comparison.local else 0.0)
        start = min(float(controls.min()), item.value)
        place.set_xlim(start - 0.05 * (end - start), end + 0.05 * (end - start))
        place.set_ylim(-1.0, 1.0)
        place.set_yticks([])
        place.tick_params(labelsize=_FONT_PT - 1.5, length=2)
        place.set_ylabel(label, rotation=0, ha="right", va="center", fontsize=_FONT_PT)
        place.text(
            1.01, 0.5, f"{item.value:{form}}\npercentile {item.percent:.0f}",
            transform=place.transAxes, fontsize=_FONT_PT - 0.5, va="center",
        )  # fmt: skip
        for name, spine in place.spines.items():
            spine.set_visible(name == "bottom")


def _own_surface(comparison: PatientComparison) -> TriangleMesh:
    """Return the expected surface moved onto the patient, in the file's frame."""
    expected = comparison.expected
    there = expected.vertices + comparison.residual[:, None] * expected.vertex_normals
    return TriangleMesh(there, expected.faces).placed(inverse_matrices(comparison.placement))


def _views(comparison: PatientComparison, own: TriangleMesh) -> list[View]:
    """Return a view at the most extreme region, or an oblique one, and anatomical ones."""
    first = replace(three_quarter_view(own.vertices), name="oblique")
    if comparison.regions:
        first = replace(
            view_of_region(own, comparison.regions[0].vertices, comparison.regions[0].centre),
            name="towards region 1",
        )
    return [first, *(VIEWS[name] for name in _ANATOMICAL)]


def _shaded(differences: FloatArray, limit: float, beyond: BoolArray) -> FloatArray:
    """Return colours (V, 3) of a map that are faint within the limit."""
    colours = diverging_colours(differences, limit)
    faint = np.array(LIGHT.surface) + _FADED * (colours - np.array(LIGHT.surface))
    result: FloatArray = np.where(beyond[:, None], colours, faint)
    return result


def _row(solid: Surface, own: TriangleMesh, views: Sequence[View], width: int) -> tuple[Panel, ...]:
    widest = max(frame_around([own.vertices], view).width for view in views)
    panels = []
    for view in views:
        frame = frame_around([own.vertices], view, width=widest)
        panels.append(Panel(draw(Scene((solid,)), frame, width), view.name))
    return tuple(panels)
