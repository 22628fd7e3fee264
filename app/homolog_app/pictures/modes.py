"""Pictures of modes of variation: the mean surface and what it becomes along each mode."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from homolog.arrays import FloatArray
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.pictures.colours import LIGHT, Theme, diverging_colours
from homolog_app.pictures.layout import Panel, arrange
from homolog_app.pictures.render import render, surface, vertex_normals
from homolog_app.pictures.views import Frame, View, frame_around, three_quarter_view

__all__ = [
    "ModeSurfaces",
    "common_limit",
    "draw_modes",
    "mode_frames",
    "mode_panels",
    "mode_view",
    "outward_displacement",
]


_STEPS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)


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


def outward_displacement(mesh: TriangleMesh, displacement: FloatArray) -> FloatArray:
    """Return the part of a displacement (V, 3) along the outward normals [mm], shape (V,)."""
    return np.asarray((displacement * vertex_normals(mesh)).sum(axis=1))


def common_limit(values: Sequence[FloatArray]) -> float:
    """Return a round value [mm] that 99 % of all the given values stay below."""
    reach = float(np.percentile(np.abs(np.concatenate(values)), 99.0))
    if reach <= 0.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(reach))
    return float(next(step for step in _STEPS if step * power >= 0.99 * reach) * power)


def mode_view(models: Sequence[ModeSurfaces]) -> View:
    """Return a three-quarter view from the side where the modes move most."""
    model = models[0]
    return three_quarter_view(model.mean.vertices, (model.displacements**2).sum(axis=(0, 2)))


def mode_frames(
    models: Sequence[ModeSurfaces], modes: Sequence[int], deviations: float, view: View
) -> list[Frame]:
    """Return a frame for each mode, all of one scale, that holds its ends in all the models."""
    ends = [
        [model.at(mode, sign * deviations).vertices for model in models for sign in (-1.0, 1.0)]
        for mode in modes
    ]
    width = max(frame_around(shapes, view).width for shapes in ends)
    return [frame_around(shapes, view, width=width) for shapes in ends]


def mode_panels(
    model: ModeSurfaces, mode: int, deviations: float, frame: Frame, limit: float, theme: Theme, width: int
) -> list[Panel]:
    """Return three panels of a mode: below the mean, the mean, above it."""
    outward = outward_displacement(model.mean, model.displacements[mode])
    panels = []
    for amount in (-deviations, 0.0, deviations):
        colours = diverging_colours(amount * outward, limit) if amount else np.array(theme.surface)
        share = f"mean (mode {mode + 1}: {100.0 * model.shares[mode]:.1f} %)"
        caption = f"{amount:+g} SD".replace("-", "−") if amount else share
        image = render([surface(model.at(mode, amount), colours)], frame, width)
        panels.append(Panel(image, caption))
    return panels


def draw_modes(
    model: ModeSurfaces,
    *,
    modes: int = 3,
    deviations: float = 2.0,
    title: str = "",
    view: View | None = None,
    theme: Theme = LIGHT,
    width: int = 440,
) -> Figure:
    """Draw a row for each mode: the mean surface and both ends, coloured by outward displacement.

    Parameters
    ----------
    model : ModeSurfaces
        Mean surface and modes.
    modes : int
        How many of the modes to draw.
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
    chosen = range(min(modes, len(model.displacements)))
    frames = mode_frames([model], chosen, deviations, view or mode_view([model]))
    limit = common_limit(
        [deviations * outward_displacement(model.mean, model.displacements[m]) for m in chosen]
    )
    return arrange(
        [mode_panels(model, m, deviations, frames[m], limit, theme, width) for m in chosen],
        title=title,
        row_labels=[f"mode {mode + 1}" for mode in chosen],
        limit=limit,
        theme=theme,
    )
