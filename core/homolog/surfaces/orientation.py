"""How strongly a surface determines its orientation, compared with prior knowledge."""

import numpy as np

from homolog.arrays import FloatArray

__all__ = ["FILES_SPREAD", "INDEPENDENT", "TURNED_FILES", "prior_weights", "softness"]

INDEPENDENT = 20.0
"""Effective number of independent deviations of a surface that determine its orientation."""
FILES_SPREAD = float(np.radians(5.0))
"""Standard deviation of the orientations of consistent files, about each axis [rad]."""
TURNED_FILES = 0.01
"""Share of files that lie in any other way than most of a cohort."""
_EPSILON = 1e-9


def prior_weights(squares: FloatArray) -> FloatArray:
    """Return prior weights of squared rotations [rad²] from the files' orientation, by squared distances.

    They give the most probable pose if the orientations in the files have a standard deviation of 5° about
    each axis, and 20 distances are independent.

    Parameters
    ----------
    squares : array
        Mean squared distances along the normals between aligned shapes.
    """
    weights: FloatArray = squares / (INDEPENDENT * FILES_SPREAD**2)
    return weights


def softness(points: FloatArray, normals: FloatArray, along: FloatArray, weights: FloatArray) -> FloatArray:
    """Return how little surfaces determine their orientations: the share of the prior knowledge, in [0, 1].

    It refers to the axis of the least determined rotation, if translation and scale are free, too.

    Parameters
    ----------
    points, normals : (B, n, 3) arrays
        Points and normals of each surface.
    along : (B, n) array
        Distances to the corresponding points of another surface, along the normals.
    weights : (B, n) array
        Weights of the points.

    Returns
    -------
    (B,) array
    """
    shares = weights / weights.sum(axis=1, keepdims=True)
    arms = points - np.einsum("bn,bni->bi", shares, points)[:, None]
    growth = np.einsum("bni,bni->bn", arms, normals)
    moves = np.concatenate([np.cross(arms, normals), normals, growth[..., None]], axis=2)
    matrix = (shares[..., None] * moves).transpose(0, 2, 1) @ moves + _EPSILON * np.eye(7)
    turn, both, rest = matrix[:, :3, :3], matrix[:, :3, 3:], matrix[:, 3:, 3:]
    stiffness = np.linalg.eigvalsh(turn - both @ np.linalg.solve(rest, both.transpose(0, 2, 1)))[:, 0]
    prior = prior_weights((shares * np.square(along)).sum(axis=1))
    result: FloatArray = prior / (prior + np.maximum(stiffness, 0.0) + _EPSILON)
    return result
