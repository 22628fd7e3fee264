"""Pictures of a patient's report: maps on the surface, and the patient among the controls."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from homolog.arrays import BoolArray, FloatArray
from homolog.geometry import inverse_matrices
from homolog.patient import PatientComparison, Reference
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.pictures.displacement import common_limit
from homolog_app.pictures.layout import Panel, arrange
from homolog_app.pictures.visible import view_of_region
from homolog_app.plots import draw_percentiles, new_figure
from homolog_app.rendering.colours import LIGHT, diverging_colours, page_colours
from homolog_app.rendering.draw import draw
from homolog_app.rendering.hollows import hollows
from homolog_app.rendering.scene import Scene, Surface, surface
from homolog_app.rendering.views import VIEWS, View, frame_around, three_quarter_view

__all__ = ["MapPictures", "change_pictures", "map_pictures", "percentiles_figure"]

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


def change_pictures(
    own: TriangleMesh, distance: FloatArray, beyond: BoolArray | None, limit: float, width: int = 400
) -> tuple[Panel, ...]:
    """Draw a map of change on a patient's first surface; faint where it is not `beyond`, if that is given.

    Parameters
    ----------
    own : TriangleMesh
        In the file's frame (LPS).
    distance : (V,) array
        [mm].
    beyond : (V,) bool array or None
    limit : float
        Ends of the colour scale [mm].
    width : int
        Pixels of a panel's width.
    """
    everywhere = np.ones(len(distance), dtype=bool) if beyond is None else beyond
    views = [
        replace(three_quarter_view(own.vertices), name="oblique"),
        *(VIEWS[name] for name in _ANATOMICAL),
    ]
    colours = _shaded(distance, limit, everywhere)
    return _row(surface(own, colours, hollows(own)), own, views, width)


def percentiles_figure(comparison: PatientComparison, reference: Reference) -> Figure:
    """Draw the patient's global numbers among those of the controls."""
    figure = new_figure(6.6, 2.6, colours := page_colours(LIGHT))
    draw_percentiles(figure.subplots(4, 1), comparison, reference, colours)
    return figure


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
