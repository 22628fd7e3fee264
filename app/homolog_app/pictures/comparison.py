"""Methods and groups side by side, like the paper's figures 3 and 4."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from homolog.arrays import FloatArray
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.pictures.colours import LIGHT, Theme, diverging_colours
from homolog_app.pictures.layout import Panel, arrange
from homolog_app.pictures.modes import (
    ModeSurfaces,
    common_limit,
    mode_frames,
    mode_panels,
    mode_view,
    outward_displacement,
)
from homolog_app.pictures.render import render, surface
from homolog_app.pictures.views import View, frame_around, three_quarter_view

__all__ = ["draw_comparison", "draw_differences"]


def draw_comparison(
    models: Mapping[str, ModeSurfaces],
    *,
    modes: Sequence[int] = (0, 1),
    deviations: float = 2.0,
    title: str = "",
    view: View | None = None,
    theme: Theme = LIGHT,
    width: int = 320,
) -> Figure:
    """Draw the same modes of several models side by side (the paper's figure 3).

    Parameters
    ----------
    models : mapping of str to ModeSurfaces
        Models by name, such as the two methods of the paper, in one world frame.
    modes : sequence of int
        Which modes to draw, counted from 0.
    deviations : float
        How far to go along each mode, in standard deviations.
    title : str
        Heading.
    view : View, optional
        Direction of sight; a three-quarter view from the side that moves most if not given.
    theme : Theme
        Background, text and surface colours.
    width : int
        Pixels of a panel's width.
    """
    frames = mode_frames(list(models.values()), modes, deviations, view or mode_view(list(models.values())))
    limit = common_limit(
        [
            deviations * outward_displacement(model.mean, model.displacements[mode])
            for model in models.values()
            for mode in modes
        ]
    )
    rows = []
    for mode, frame in zip(modes, frames, strict=True):
        strips = [
            mode_panels(model, mode, deviations, frame, limit, theme, width) for model in models.values()
        ]
        rows.append([panel for strip in strips for panel in strip])
    return arrange(
        rows,
        title=title,
        row_labels=[f"mode {mode + 1}" for mode in modes],
        headings=list(models),
        limit=limit,
        theme=theme,
    )


def draw_differences(
    surfaces: Mapping[str, tuple[TriangleMesh, FloatArray]],
    *,
    views: Sequence[View] = (),
    limit: float | None = None,
    title: str = "",
    theme: Theme = LIGHT,
    width: int = 520,
) -> Figure:
    """Draw displacement maps: blue is expansion, yellow contraction (the paper's figure 4).

    Parameters
    ----------
    surfaces : mapping of str to (TriangleMesh, (V, 3) array)
        A row each: its name, the surface and how its vertices move [mm], such as from one group's mean to
        the other's.
    views : sequence of View
        A column each; a three-quarter view and the opposite one if none are given.
    limit : float, optional
        End of the colour scale [mm]; a round value that fits all rows if not given.
    title : str
        Heading.
    theme : Theme
        Background and text.
    width : int
        Pixels of a panel's width.
    """
    outward = {name: outward_displacement(mesh, moves) for name, (mesh, moves) in surfaces.items()}
    limit = limit or common_limit(list(outward.values()))
    vertices = [mesh.vertices for mesh, _ in surfaces.values()]
    if not views:
        front = three_quarter_view(vertices[0], np.abs(next(iter(outward.values()))))
        views = [front, front.opposite]
    frames = [frame_around(vertices, view) for view in views]
    rows = []
    for name, (mesh, _) in surfaces.items():
        solid = surface(mesh, diverging_colours(outward[name], limit))
        rows.append([Panel(render([solid], frame, width), frame.view.name) for frame in frames])
    labels = list(surfaces) if len(surfaces) > 1 else []
    return arrange(rows, title=title, row_labels=labels, limit=limit, theme=theme)
