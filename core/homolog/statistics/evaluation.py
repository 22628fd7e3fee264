"""Quality of a shape model: compactness, generalization, specificity (Davies, Twining and Taylor 2008).

Distances between shapes are the mean over the particles of the distance between corresponding particles [mm].
"""

from collections.abc import Sequence

import numpy as np

from homolog.arrays import FloatArray
from homolog.errors import InputError
from homolog.progress import Tick, no_tick
from homolog.statistics.checks import checked_particles
from homolog.statistics.shape_model import ShapeModel, principal_components

__all__ = ["compactness", "generalization", "specificity"]


def compactness(model: ShapeModel) -> FloatArray:
    """Return the share of the total variance in the first k modes, for k = 1 … K."""
    share: FloatArray = np.cumsum(model.explained_variance_ratio)
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
    deviations = generator.standard_normal((draws, len(model.explained_variance)))
    nearest = np.empty((len(modes), draws))
    for row, k in enumerate(modes):
        if not 1 <= k <= len(model.explained_variance):
            raise InputError(
                f"specificity of {k} modes: the model has only {len(model.explained_variance)}; use fewer"
            )
        for draw in range(draws):
            tick((row + draw / draws) / len(modes), "specificity")
            apart = particles - model.instance(deviations[draw, :k])
            nearest[row, draw] = np.sqrt(np.square(apart).sum(axis=2)).mean(axis=1).min()
    errors: FloatArray = nearest.mean(axis=1)
    return errors
