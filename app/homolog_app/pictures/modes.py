"""Pictures of modes of variation: the mean surface and what it becomes along each mode."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from homolog.arrays import FloatArray
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.clipping import Clip, Cut, cut_of
from homolog_app.pictures.displacement import common_limit, outward_displacement
from homolog_app.pictures.layout import Panel, arrange
from homolog_app.rendering.colours import LIGHT, Theme, diverging_colours
from homolog_app.rendering.draw import draw
from homolog_app.rendering.hollows import shaded
from homolog_app.rendering.scene import Scene
from homolog_app.rendering.views import Frame, View, frame_around, three_quarter_view

__all__ = ["ModeSurfaces", "draw_modes"]


@dataclass(frozen=True, slots=True, eq=False)
class ModeSurfaces:
    """The mean surface and its modes.

    Attributes
    ----------
    mean : TriangleMesh
        The mean surface.
    displacements : (K, V, 3) array
        How the mean surface's vertices move along each mode, for one standard deviation [mm].
    shares : (K,) array
        Share of the total variance of each mode.
    """

    mean: TriangleMesh
    displacements: FloatArray
    shares: FloatArray

    def at(self, mode: int, deviations: float) -> TriangleMesh:
        """Return the mean moved by so many standard deviations along a mode."""
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
    """Draw a row for each mode: the mean surface and both ends, coloured by outward displacement.

    Parameters
    ----------
    models : mapping of str to ModeSurfaces
        Models by name, in one world frame; several, such as the two methods of the paper's figure 3, stand
        side by side below their names.
    modes : sequence of int
        Which modes to draw, counted from 0.
    deviations : float
        How far to go along each mode, in standard deviations.
    title : str
        Heading.
    view : View, optional
        Direction of sight; a three-quarter view from the side that moves most if not given.
    clip : Clip, optional
        The plane that cuts the shapes open; it stands still.
    theme : Theme
        Background, text and surface colours.
    width : int
        Pixels of a panel's width.
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
    for mode, frame in zip(modes, frames, strict=True):
        strips = [
            _panels(
                model, mode, deviations, frame, limit, theme, width,
                cut_of(clip, model.mean.vertices, frame.view.axes[2]),
            )
            for model in all_models
        ]  # fmt: skip
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
    """Return a frame for each mode, all of one scale, that holds its ends in all the models."""
    ends = [
        [model.at(mode, sign * deviations).vertices for model in models for sign in (-1.0, 1.0)]
        for mode in modes
    ]
    width = max(frame_around(shapes, view).width for shapes in ends)
    return [frame_around(shapes, view, width=width) for shapes in ends]


def _panels(
    model: ModeSurfaces, mode: int, deviations: float, frame: Frame, limit: float, theme: Theme, width: int,
    cut: Cut | None,
) -> list[Panel]:  # fmt: skip
    """Return three panels of a mode: below the mean, the mean, above it."""
    outward = outward_displacement(model.mean, model.displacements[mode])
    panels = []
    for amount in (-deviations, 0.0, deviations):
        colours = diverging_colours(amount * outward, limit) if amount else np.array(theme.surface)
        share = f"mean (mode {mode + 1}: {100.0 * model.shares[mode]:.1f} %)"
        caption = f"{amount:+g} SD".replace("-", "−") if amount else share
        scene = Scene((shaded(model.at(mode, amount), colours),), cut=cut, cap=theme.cut)
        image = draw(scene, frame, width)
        panels.append(Panel(image, caption))
    return panels
