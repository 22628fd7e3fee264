"""What moves: the mean surface along a mode, or from one group's mean to another's."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from homolog.analysis.reconstruction import warp_surface
from homolog.analysis.shape_model import ShapeModel
from homolog.arrays import FloatArray
from homolog.errors import InputError
from homolog.files.results import Result
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["Motion", "group_means", "group_motion", "mode_motions", "standing"]


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A surface that moves on straight lines.

    Attributes
    ----------
    start : TriangleMesh
        Where nothing has moved.
    displacement : (V, 3) array
        How its vertices move for an amount of 1 [mm].
    low, high : float
        Amounts at the ends.
    label : function of the amount
        The caption: what is shown, and how far it has moved.
    """

    start: TriangleMesh
    displacement: FloatArray
    low: float
    high: float
    label: Callable[[float], str]

    @property
    def moves(self) -> bool:
        """Whether it moves at all."""
        return self.high > self.low

    def at(self, amount: float) -> TriangleMesh:
        """Return the surface moved by an amount."""
        return TriangleMesh(self.start.vertices + amount * self.displacement, self.start.faces)


def mode_motions(result: Result, modes: Sequence[int], deviations: float) -> list[Motion]:
    """Return the mean surface moving along each of some modes.

    Parameters
    ----------
    result : Result
    modes : sequence of int
        Counted from 1.
    deviations : float
        How far to either side, in standard deviations.

    Raises
    ------
    InputError
        If there is no such mode.
    """
    model = ShapeModel.fit(result.world, names=result.names)
    count = len(model.explained_variance)
    for mode in modes:
        if not 1 <= mode <= count:
            raise InputError(f"mode {mode}: the result has {count} modes; choose one from 1 to {count}")
    chosen = np.array(modes) - 1
    moves = _carried(result, (model.components * model.standard_deviations[:, None, None])[chosen])
    return [
        Motion(result.mean_surface, move, -deviations, deviations, _mode_words(model, mode, result))
        for mode, move in zip(chosen.tolist(), moves, strict=True)
    ]


def _mode_words(model: ShapeModel, mode: int, result: Result) -> Callable[[float], str]:
    aside = f", {result.mirrored} mirrored" if result.mirrored else ""
    title = f"Mode {mode + 1} ({100.0 * model.explained_variance_ratio[mode]:.1f} % of variance{aside})"
    return lambda amount: f"{title}   {_signed(amount)} SD"


def group_means(result: Result, column: str, groups: Sequence[str]) -> list[FloatArray]:
    """Return the mean particles of some groups of a column, (N, 3) each [mm].

    Raises
    ------
    InputError
        If there is no such column or nobody is in one of the groups.
    """
    from homolog_app.report.study import column_of, levels  # brings slow imports along

    labels = np.array(column_of(result, column))
    for group in groups:
        if group not in labels:
            there = ", ".join(levels(labels.tolist())) or "no values; fill in the column first"
            raise InputError(f"column {column!r}: no subject is in {group!r}; groups are: {there}")
    return [result.world[labels == group].mean(axis=0) for group in groups]


def group_motion(result: Result, column: str, first: str, second: str) -> Motion:
    """Return the surface that goes from one group's mean to another's; raises as `group_means` does."""
    start, end = group_means(result, column, [first, second])
    mean = result.world.mean(axis=0)
    aside = f" ({result.mirrored} mirrored)" if result.mirrored else ""
    to_start, move = _carried(result, np.stack([start - mean, end - start]))

    def label(amount: float) -> str:
        percent = f"{100.0 * amount:.0f}".rjust(3, "\u2007")  # as wide as a digit: the line stands still
        return f"{column}: {first} → {second}{aside}   {percent} %"

    mesh = result.mean_surface
    return Motion(TriangleMesh(mesh.vertices + to_start, mesh.faces), move, 0.0, 1.0, label)


def standing(result: Result) -> Motion:
    """Return the mean surface at rest."""
    surface = result.mean_surface
    label = f"Mean shape ({result.mirrored} mirrored)" if result.mirrored else "Mean shape"
    return Motion(surface, np.zeros_like(surface.vertices), 0.0, 0.0, lambda _: label)


def _carried(result: Result, displacements: FloatArray) -> FloatArray:
    """Return how the mean surface's vertices move (K, V, 3) when the mean particles do (K, N, 3) [mm]."""
    mean = result.world.mean(axis=0)
    return warp_surface(mean, result.mean_surface.vertices, displacements, result.smoothing)


def _signed(amount: float) -> str:
    text = f"{amount:+.1f}".replace("-", "−")
    return "0.0" if text[1:] == "0.0" else text
