"""Pictures of surfaces with their particles."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from matplotlib.figure import Figure

from homolog.arrays import Array, FloatArray
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.clipping import extent_of
from homolog_app.pictures.layout import Panel, arrange
from homolog_app.rendering.colours import LIGHT, Theme, colours_by_place
from homolog_app.rendering.draw import draw
from homolog_app.rendering.hollows import shaded
from homolog_app.rendering.scene import Balls, Scene, ball_radius
from homolog_app.rendering.views import View, frame_around, three_quarter_view

__all__ = ["draw_particles", "draw_subjects"]


def draw_particles(
    mesh: TriangleMesh,
    particles: FloatArray,
    *,
    title: str = "",
    views: Sequence[View] = (),
    colours: Array | None = None,
    theme: Theme = LIGHT,
    width: int = 700,
) -> Figure:
    """Draw one surface with its particles.

    Parameters
    ----------
    mesh : TriangleMesh
        The surface, such as the mean.
    particles : (N, 3) array
        Particles on it [mm].
    title : str
        Heading.
    views : sequence of View
        A panel each; a three-quarter view and the opposite one if none are given.
    colours : (N, 3) uint8 array, optional
        Red, green, blue of each particle; by place on this shape if not given.
    theme : Theme
        Background, text and surface colours.
    width : int
        Pixels of a panel's width.
    """
    colours = colours_by_place(particles) if colours is None else colours
    radius = ball_radius(extent_of(mesh.vertices), len(particles))
    scene = Scene((shaded(mesh, np.array(theme.surface)),), Balls(particles, radius, colours))
    front = three_quarter_view(particles)
    frames = [
        frame_around([mesh.vertices, particles], view, border=radius)
        for view in (views or (front, front.opposite))
    ]
    panels = [Panel(draw(scene, frame, width), frame.view.name) for frame in frames]
    return arrange([panels], title=title, theme=theme)


def draw_subjects(
    names: Sequence[str],
    meshes: Sequence[TriangleMesh],
    particles: FloatArray,
    *,
    view: View | None = None,
    theme: Theme = LIGHT,
    columns: int = 4,
    rows: int = 3,
    width: int = 440,
) -> Iterator[Figure]:
    """Draw every subject with its particles, page by page, all at one scale.

    Parameters
    ----------
    names : sequence of M str
        Captions.
    meshes : sequence of M TriangleMesh
        The subjects' surfaces in world coordinates.
    particles : (M, N, 3) array
        Their particles in world coordinates [mm]. A particle has one colour on all subjects.
    view : View, optional
        Direction of sight; a three-quarter view if not given.
    theme : Theme
        Background, text and surface colours.
    columns, rows : int
        Panels on a page.
    width : int
        Pixels of a panel's width.
    """
    mean = particles.mean(axis=0)
    colours = colours_by_place(mean)
    view = view or three_quarter_view(mean, particles.var(axis=0).sum(axis=1))
    radius = ball_radius(extent_of(np.concatenate([mesh.vertices for mesh in meshes])), len(mean))
    frame = frame_around([mesh.vertices for mesh in meshes], view, border=radius)

    def panel(k: int) -> Panel:
        surface = shaded(meshes[k], np.array(theme.surface))
        return Panel(draw(Scene((surface,), Balls(particles[k], radius, colours)), frame, width), names[k])

    size = columns * rows
    pages = [range(k, min(k + size, len(meshes))) for k in range(0, len(meshes), size)]
    executor = ThreadPoolExecutor(1)  # draws the next page while a page is composed and written
    try:
        ahead = [executor.submit(panel, k) for k in pages[0]]
        for page, after in enumerate([*pages[1:], range(0)], start=1):
            drawn, ahead = ahead, [executor.submit(panel, k) for k in after]
            panels = [future.result() for future in drawn]
            title = f"Subjects ({page} of {len(pages)})" if len(pages) > 1 else "Subjects"
            yield arrange(
                [panels[k : k + columns] for k in range(0, len(panels), columns)], title=title, theme=theme
            )
    finally:
        executor.shutdown(cancel_futures=True)
