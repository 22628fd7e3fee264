"""Maps of displacement, like the paper's figure 4."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from homolog.arrays import FloatArray
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.clipping import Clip, cut_of
from homolog_app.pictures.displacement import common_limit, outward_displacement
from homolog_app.pictures.layout import Panel, arrange
from homolog_app.rendering.colours import LIGHT, Theme, diverging_colours
from homolog_app.rendering.draw import draw
from homolog_app.rendering.hollows import shaded
from homolog_app.rendering.scene import Scene
from homolog_app.rendering.views import View, frame_around, three_quarter_view

__all__ = ["draw_differences"]


def draw_differences(
    surfaces: Mapping[str, tuple[TriangleMesh, FloatArray]],
    *,
    views: Sequence[View] = (),
    limit: float | None = None,
    clip: Clip | None = None,
    title: str = "",
    theme: Theme = LIGHT,
    width: int = 520,
) -> Figure:
    """Draw displacement maps: blue is out of the tissue, yellow into it (the paper's figure 4).

    Parameters
    ----------
    surfaces : mapping of str to (TriangleMesh, (V, 3) array)
        A row each: its name, the surface and how its vertices move [mm], such as from one group's mean to
        the other's.
    views : sequence of View
        A column each; a three-quarter view and the opposite one if none are given.
    limit : float, optional
        End of the colour scale [mm]; a round value that fits all rows if not given.
    clip : Clip, optional
        The plane that cuts the shapes open.
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
        surface = shaded(mesh, diverging_colours(outward[name], limit))
        scenes = [
            Scene((surface,), cut=cut_of(clip, mesh.vertices, frame.view.axes[2]), cap=theme.cut)
            for frame in frames
        ]
        pictures = zip(scenes, frames, strict=True)
        rows.append([Panel(draw(scene, frame, width), frame.view.name) for scene, frame in pictures])
    labels = list(surfaces) if len(surfaces) > 1 else []
    return arrange(rows, title=title, row_labels=labels, limit=limit, theme=theme)
