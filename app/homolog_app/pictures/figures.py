"""Figures of shapes: modes, group differences, particles, and all figures of a project."""

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from homolog.arrays import Array, BoolArray, FloatArray
from homolog.io.project import ProjectFolder
from homolog.io.results import read_modes, read_result, read_surfaces
from homolog.progress import Tick, no_tick
from homolog.statistics.shape_model import ShapeModel
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.pictures.layout import Panel, arrange, write_picture
from homolog_app.rendering.camera import (
    Clip,
    ClipPlane,
    Cut,
    Frame,
    View,
    cut_of,
    extent_of,
    frame_around,
    three_quarter_view,
)
from homolog_app.rendering.colours import (
    FAINT,
    LIGHT,
    Theme,
    colours_by_place,
    common_limit,
    diverging_colours,
    outward_displacement,
)
from homolog_app.rendering.draw import draw
from homolog_app.rendering.rays import shaded
from homolog_app.rendering.scene import Balls, Scene, Surface, ball_radius

__all__ = [
    "ModeSurfaces",
    "draw_differences",
    "draw_figures",
    "draw_modes",
    "draw_particles",
    "draw_subjects",
]


@dataclass(frozen=True, slots=True, eq=False)
class ModeSurfaces:
    """The mean surface and its modes.

    Attributes
    ----------
    mean : TriangleMesh
        The mean surface.
    displacements : (K, V, 3) array
        Displacements of the mean surface's vertices for one standard deviation of each mode [mm].
    shares : (K,) array
        Share of the total variance of each mode.
    """

    mean: TriangleMesh
    displacements: FloatArray
    shares: FloatArray

    def at(self, mode: int, deviations: float) -> TriangleMesh:
        """Return the mean displaced by a number of standard deviations along a mode."""
        return TriangleMesh(self.mean.vertices + deviations * self.displacements[mode], self.mean.faces)


def draw_modes(
    models: Mapping[str, ModeSurfaces],
    *,
    modes: Sequence[int],
    deviations: float = 2.0,
    title: str = "",
    view: View | None = None,
    clip: Clip | None = None,
    theme: Theme = LIGHT,
    width: int = 440,
) -> Figure:
    """Draw one row per mode: the mean surface and both ends, coloured by outward displacement.

    Parameters
    ----------
    models : mapping of str to ModeSurfaces
        Models by name, in one world frame. Several models, such as the two methods of the paper's figure 3,
        are drawn side by side below their names.
    modes : sequence of int
        Indices of the modes to draw, from 0.
    deviations : float
        Range along each mode, in standard deviations.
    title : str
        Heading.
    view : View, optional
        View direction; by default a three-quarter view from the side that moves most.
    clip : Clip, optional
        The plane that cuts the shapes open; it does not move.
    theme : Theme
        Background, text and surface colours.
    width : int
        Width of a panel [pixels].
    """
    all_models = list(models.values())
    frames = _frames(all_models, modes, deviations, view or _view(all_models[0]))
    limit = common_limit(
        [
            deviations * outward_displacement(model.mean, model.displacements[mode])
            for model in all_models
            for mode in modes
        ]
    )
    rows = []
    means = [shaded(model.mean, np.array(theme.surface)) for model in all_models]
    for mode, frame in zip(modes, frames, strict=True):
        strips = [
            _panels(
                model,
                mean,
                mode,
                deviations,
                frame,
                limit,
                theme,
                width,
                cut_of(clip, model.mean.vertices, frame.view.axes[2]),
            )
            for model, mean in zip(all_models, means, strict=True)
        ]
        rows.append([panel for strip in strips for panel in strip])
    return arrange(
        rows,
        title=title,
        row_labels=[f"mode {mode + 1}" for mode in modes],
        headings=list(models) if len(models) > 1 else [],
        limit=limit,
        theme=theme,
    )


def _view(model: ModeSurfaces) -> View:
    """Return a three-quarter view from the side where the modes move most."""
    return three_quarter_view(model.mean.vertices, (model.displacements**2).sum(axis=(0, 2)))


def _frames(
    models: Sequence[ModeSurfaces], modes: Sequence[int], deviations: float, view: View
) -> list[Frame]:
    """Return a frame for each mode that contains its ends in all models; all have the same scale."""
    ends = [
        [model.at(mode, sign * deviations).vertices for model in models for sign in (-1.0, 1.0)]
        for mode in modes
    ]
    width = max(frame_around(shapes, view).width for shapes in ends)
    return [frame_around(shapes, view, width=width) for shapes in ends]


def _panels(
    model: ModeSurfaces,
    mean: Surface,
    mode: int,
    deviations: float,
    frame: Frame,
    limit: float,
    theme: Theme,
    width: int,
    cut: Cut | None,
) -> list[Panel]:
    """Return three panels of a mode: below the mean, the mean, and above it."""
    outward = outward_displacement(model.mean, model.displacements[mode])
    panels = []
    for amount in (-deviations, 0.0, deviations):
        share = f"mean (mode {mode + 1}: {100.0 * model.shares[mode]:.1f} %)"
        caption = f"{amount:+g} SD".replace("-", "−") if amount else share
        surface = mean
        if amount:
            surface = shaded(model.at(mode, amount), diverging_colours(amount * outward, limit))
        image = draw(Scene((surface,), cut=cut, cap=theme.cut), frame, width)
        panels.append(Panel(image, caption))
    return panels


def draw_differences(
    surfaces: Mapping[str, tuple[TriangleMesh, FloatArray]],
    *,
    pale: Mapping[str, BoolArray] | None = None,
    views: Sequence[View] = (),
    inside: Sequence[View] = (),
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
        The surface of each row and the displacement of its vertices [mm], such as from one group's mean to
        the other's, by name.
    pale : mapping of str to (V,) bool array, optional
        Vertices in pale colours, by name; the others are outlined.
    views : sequence of View
        View of each column; by default a three-quarter view and the opposite one.
    inside : sequence of View
        Views of further columns, as many as `views`, in which the half that faces the viewer is removed.
    limit : float, optional
        End of the colour scale [mm]; by default a round value for all rows.
    clip : Clip, optional
        The plane that cuts the shapes open.
    title : str
        Heading.
    theme : Theme
        Background and text.
    width : int
        Width of a panel [pixels].
    """
    outward = {name: outward_displacement(mesh, moves) for name, (mesh, moves) in surfaces.items()}
    limit = limit or common_limit(list(outward.values()))
    vertices = [mesh.vertices for mesh, _ in surfaces.values()]
    if not views:
        front = three_quarter_view(vertices[0], np.abs(next(iter(outward.values()))))
        views = [front, front.opposite]
    frames = [frame_around(vertices, view) for view in (*views, *inside)]
    clips = [clip] * len(views) + [Clip(plane=ClipPlane.VIEW)] * len(inside)
    rows = []
    for name, (mesh, _) in surfaces.items():
        colours = diverging_colours(outward[name], limit)
        if pale is not None and name in pale:
            colours = _outlined(colours, mesh, pale[name])
        surface = shaded(mesh, colours)
        scenes = [
            Scene((surface,), cut=cut_of(item, mesh.vertices, frame.view.axes[2]), cap=theme.cut)
            for frame, item in zip(frames, clips, strict=True)
        ]
        pictures = zip(scenes, frames, strict=True)
        rows.append([Panel(draw(scene, frame, width), frame.view.name) for scene, frame in pictures])
    labels = list(surfaces) if len(surfaces) > 1 else []
    headings = ("outside", "inside") if inside else ()
    return arrange(rows, title=title, row_labels=labels, headings=headings, limit=limit, theme=theme)


def _outlined(colours: FloatArray, mesh: TriangleMesh, pale: BoolArray) -> FloatArray:
    """Return colours (V, 3) that are pale where marked, with a dark line around the others."""
    middle = diverging_colours(np.zeros(1), 1.0)
    shown = np.where(pale[:, None], middle + FAINT * (colours - middle), colours)
    mixed = mesh.faces[pale[mesh.faces].any(axis=1) & ~pale[mesh.faces].all(axis=1)]
    edge = np.zeros(len(pale), dtype=bool)
    edge[mixed.ravel()] = True
    shown[edge & pale] = 0.25
    return shown


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
        View of each panel; by default a three-quarter view and the opposite one.
    colours : (N, 3) uint8 array, optional
        Red, green, blue of each particle; by default by position on this shape.
    theme : Theme
        Background, text and surface colours.
    width : int
        Width of a panel [pixels].
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
    """Draw every subject with its particles, page by page, at the same scale.

    Parameters
    ----------
    names : sequence of M str
        Captions.
    meshes : sequence of M TriangleMesh
        The subjects' surfaces in world coordinates.
    particles : (M, N, 3) array
        Their particles in world coordinates [mm]. A particle has one colour on all subjects.
    view : View, optional
        View direction; by default a three-quarter view.
    theme : Theme
        Background, text and surface colours.
    columns, rows : int
        Numbers of panels on a page.
    width : int
        Width of a panel [pixels].
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
    executor = ThreadPoolExecutor(1)  # draws the next page while the current one is composed and written
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


_MODES = 3
_FEW, _MANY = (4, 3, 440), (6, 5, 300)
"""Columns, rows and panel width [pixels] of pages with few subjects, and with many."""


def draw_figures(project: ProjectFolder, tick: Tick = no_tick) -> None:
    """Draw a project's result into its ``figures`` folder.

    Parameters
    ----------
    project : ProjectFolder
    tick : Tick

    Raises
    ------
    InputError
        If there is no result, or a picture can't be written.
    """
    tick(0.0, "pictures")
    result, record = read_result(project), project.read().result
    assert record is not None, "a result was read"
    aside = f" ({record.mirrored_text})" if record.mirrored_text else ""
    _write(
        project,
        "mean.png",
        draw_particles(result.mean_surface, result.world.mean(axis=0), title=f"Mean shape{aside}"),
    )
    tick(0.2, "pictures of the modes")
    moves = read_modes(project, result.mean_surface)
    shares = ShapeModel().fit(result.world).explained_variance_ratio_[: len(moves)]
    if len(moves):  # identical shapes have no modes
        modes = ModeSurfaces(result.mean_surface, moves, shares)
        _write(
            project,
            "modes.png",
            draw_modes({"": modes}, modes=range(min(_MODES, len(moves))), title=f"Modes of variation{aside}"),
        )
    surfaces = read_surfaces(project)
    tick(0.4, "pictures of the subjects")
    names = [
        f"{subject.name}, mirrored" if subject.is_mirrored else subject.name for subject in record.subjects
    ]
    columns, rows, width = _FEW if len(names) <= _FEW[0] * _FEW[1] else _MANY
    pages = draw_subjects(names, surfaces, result.world, columns=columns, rows=rows, width=width)
    for page, figure in enumerate(pages, start=1):
        _write(project, f"subjects_{page:02d}.png", figure)
        tick(0.4 + 0.6 * min(columns * rows * page / len(surfaces), 1.0), "pictures of the subjects")


def _write(project: ProjectFolder, name: str, figure: Figure) -> None:
    write_picture(figure, project.figures / name)
