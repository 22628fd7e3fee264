"""Quality of a shape model: compactness, generalization, specificity (Davies, Twining and Taylor 2008).

Distances between shapes are the mean over the particles of the distance between corresponding particles [mm].
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from homolog.arrays import BoolArray, FloatArray, frozen
from homolog.errors import InputError
from homolog.progress import Tick, no_tick
from homolog.statistics.checks import checked_particles
from homolog.statistics.parallel import parallel_analysis
from homolog.statistics.shape_model import ShapeModel, principal_components

__all__ = [
    "LeaveOneOut",
    "compactness",
    "description_length",
    "generalization",
    "leave_one_out_residual",
    "left_out_shapes",
    "modes_above_chance",
    "specificity",
]

_FLAT = 1e-10
"""Eigenvalues of a Gram matrix below this fraction of the largest are rounding errors."""


def compactness(model: ShapeModel) -> FloatArray:
    """Return the share of the total variance in the first k modes, for k = 1 … K."""
    share: FloatArray = np.cumsum(model.explained_variance_ratio_)
    return share


def generalization(
    particles: FloatArray, *, names: Sequence[str] | None = None, tick: Tick = no_tick
) -> FloatArray:
    """Return the distance of a held-out shape from its best fit by k modes of the others, for k = 1 … M - 2.

    Parameters
    ----------
    particles : (M, N, 3) array_like
        Aligned positions [mm].
    names : sequence of str, optional
        Subject names, for messages.
    tick : Tick
        Progress and cancellation.

    Returns
    -------
    (M - 2,) array
        Mean over the held-out shapes of the mean particle distance [mm].

    Raises
    ------
    InputError
        If there are fewer than three subjects.
    """
    shapes = checked_particles(particles, names)
    count = len(shapes)
    if count < 3:
        raise InputError(f"generalization leaves one subject out and needs three, not {count}; add subjects")
    rows = shapes.reshape(count, -1)
    distances = np.empty((count, count - 2))
    for left_out in range(count):
        tick(left_out / count, "leave-one-out generalization")
        others = np.delete(rows, left_out, axis=0)
        mean = others.mean(axis=0)
        _, modes, _ = principal_components(others - mean)
        rest = rows[left_out] - mean
        scores = modes @ rest
        for k in range(count - 2):
            if k < len(modes):  # modes without variance fit nothing
                rest = rest - scores[k] * modes[k]
            distances[left_out, k] = np.linalg.norm(rest.reshape(-1, 3), axis=1).mean()
    mean_distance: FloatArray = distances.mean(axis=0)
    return mean_distance


def specificity(
    model: ShapeModel,
    particles: FloatArray,
    modes: Sequence[int],
    *,
    draws: int = 1000,
    seed: int = 0,
    tick: Tick = no_tick,
) -> FloatArray:
    """Return the distance of shapes drawn from the first k modes to the nearest real one, for each k.

    Scores are drawn from normal distributions with the standard deviations of the modes.

    Parameters
    ----------
    model : ShapeModel
        The model, fitted to the particles.
    particles : (M, N, 3) array
        The aligned shapes to which it was fitted [mm].
    modes : sequence of int
        Numbers of modes k, each from 1 to K.
    draws : int
        Number of shapes drawn for each k.
    seed : int
        Same seed, same result.
    tick : Tick
        Progress and cancellation.

    Returns
    -------
    (len(modes),) array
        Mean distance to the nearest real shape [mm].
    """
    generator = np.random.default_rng(seed)
    deviations = generator.standard_normal((draws, len(model.explained_variance_)))
    nearest = np.empty((len(modes), draws))
    for row, k in enumerate(modes):
        if not 1 <= k <= len(model.explained_variance_):
            raise InputError(
                f"specificity of {k} modes: the model has only {len(model.explained_variance_)}; use fewer"
            )
        for draw in range(draws):
            tick((row + draw / draws) / len(modes), "specificity")
            apart = particles - model.instance(deviations[draw, :k])
            nearest[row, draw] = np.sqrt(np.square(apart).sum(axis=2)).mean(axis=1).min()
    errors: FloatArray = nearest.mean(axis=1)
    return errors


@dataclass(frozen=True, slots=True, eq=False)
class LeaveOneOut:
    """What all modes of the other subjects leave of each subject. Arrays are read-only.

    Attributes
    ----------
    residuals : (M,) array
        Root mean square distance over the particles from the best fit of the others' modes [mm].
    spreads : (M,) array
        The same from the others' mean: what is left without any mode [mm].
    """

    residuals: FloatArray
    spreads: FloatArray

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("residuals", "spreads"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))

    @property
    def residual(self) -> float:
        """Root mean square of the residuals [mm]."""
        return float(np.sqrt(np.square(self.residuals).mean()))

    @property
    def spread(self) -> float:
        """Root mean square of the spreads [mm]."""
        return float(np.sqrt(np.square(self.spreads).mean()))

    @property
    def share(self) -> float:
        """Residual as a share of the spread: near 1 if the modes of the others explain nothing."""
        return self.residual / self.spread if self.spread > 0.0 else 0.0

    @property
    def reproducible(self) -> float:
        """Share of a subject's variance that the modes of the others reproduce."""
        return 1.0 - self.share**2


def leave_one_out_residual(particles: FloatArray, *, weights: FloatArray | None = None) -> LeaveOneOut:
    """Return what all modes of the other subjects leave of each subject.

    The squared distance of a point from the flat through all others is the inverse of its diagonal entry in
    the pseudo-inverse of the centred Gram matrix, so that one decomposition (M, M) serves all subjects.

    Parameters
    ----------
    particles : (M, N, 3) array_like
        Aligned positions of three or more subjects [mm].
    weights : (N,) array, optional
        Share of the surface that each particle stands for; equal by default.

    Raises
    ------
    InputError
        If there are fewer than three subjects.
    """
    gram = _centred_gram(particles, weights)
    count = len(gram)
    if count < 3:
        raise InputError(f"generalization leaves one subject out and needs three, not {count}; add subjects")
    inverse, apart = _inverse(gram)
    along = np.diagonal(inverse)
    residuals = np.where(apart, 1.0 / np.sqrt(np.where(apart, along, 1.0)), 0.0)
    spreads = np.sqrt(np.maximum(np.diagonal(gram), 0.0)) * count / (count - 1)
    return LeaveOneOut(residuals, spreads)


def left_out_shapes(particles: FloatArray) -> FloatArray:
    """Return the best fit of each subject by all modes of the others, (M, N, 3) [mm].

    Parameters
    ----------
    particles : (M, N, 3) array_like
        Aligned positions of three or more subjects [mm].
    """
    shapes = checked_particles(particles)
    inverse, apart = _inverse(_centred_gram(shapes, None))
    weights = np.where(apart[:, None], inverse / np.where(apart, np.diagonal(inverse), 1.0)[:, None], 0.0)
    rest = weights @ (shapes - shapes.mean(axis=0)).reshape(len(shapes), -1)
    fits: FloatArray = shapes - rest.reshape(shapes.shape)
    return fits


def modes_above_chance(particles: FloatArray, *, repeats: int = 200, seed: int = 0) -> int:
    """Return the number of leading modes with more variance than in uncorrelated particles.

    Parallel analysis; see `parallel_analysis` for the eigenvalues.
    """
    return parallel_analysis(checked_particles(particles), repeats=repeats, seed=seed).n_retained


def description_length(
    particles: FloatArray, precision: float, *, weights: FloatArray | None = None
) -> float:
    """Return the description length of a model (Davies et al. 2002; as simplified by Thodberg 2003).

    A mode that moves the particles by more than the precision costs 1 + log(variance / precision²), one that
    moves them by less only variance / precision². Models of the same subjects at the same precision can be
    compared: the shorter one is better. Without weights the length also falls if particles crowd where shapes
    vary little.

    Parameters
    ----------
    particles : (M, N, 3) array_like
        Aligned positions [mm].
    precision : float
        Displacement that can't be told from none [mm], for example the error of the surfaces.
    weights : (N,) array, optional
        Share of the surface that each particle stands for; equal by default.

    Returns
    -------
    float
        Sum over the modes [nat].
    """
    if not precision > 0.0:
        raise InputError(f"the precision of a description length is a distance above 0, not {precision}")
    gram = _centred_gram(particles, weights)
    ratio = np.clip(np.linalg.eigvalsh(gram), 0.0, None) / len(gram) / precision**2
    return float(np.where(ratio > 1.0, 1.0 + np.log(np.maximum(ratio, 1.0)), ratio).sum())


def _centred_gram(particles: FloatArray, weights: FloatArray | None) -> FloatArray:
    """Return the mean over the particles of inner products of deviations from the mean, (M, M) [mm²]."""
    shapes = checked_particles(particles)
    count = shapes.shape[1]
    shares = np.full(count, 1.0 / count) if weights is None else np.asarray(weights, np.float64)
    if shares.shape != (count,) or not (np.isfinite(shares).all() and shares.min() >= 0.0 < shares.sum()):
        raise InputError(f"weights need one number of 0 or more for each of {count} particles")
    roots = np.sqrt(shares / shares.sum())[:, None]
    rows = ((shapes - shapes.mean(axis=0)) * roots).reshape(len(shapes), -1)
    gram: FloatArray = rows @ rows.T
    return gram


def _inverse(gram: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the pseudo-inverse of a centred Gram matrix, and which subjects the others don't span."""
    values, vectors = np.linalg.eigh(gram)
    kept = values > _FLAT * max(values[-1], np.finfo(float).tiny)
    values, vectors = values[kept], vectors[:, kept]
    # A subject lies outside the flat of the others only if its own axis is spanned by the modes.
    apart = np.square(vectors).sum(axis=1) > 1.0 - 1.0 / len(gram) - 1e-6
    return (vectors / values) @ vectors.T, apart
