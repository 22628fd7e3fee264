"""How firmly a surface determines its orientation, beside what is known of it in advance."""

import numpy as np

from homolog.arrays import FloatArray

__all__ = ["prior_weights", "softness"]

_INDEPENDENT = 20.0
"""Deviations of a surface that vary independently: as many places tell its orientation."""
_SPREAD = np.radians(5.0)
"""Standard deviation of orientations in files that agree, about each axis."""
_EPSILON = 1e-9


def prior_weights(squares: FloatArray) -> FloatArray:
    """Return the weights of a squared turn [rad²] from the files' orientation beside mean squared distances.

    This is the most probable pose for orientations in the files with a standard deviation of 5° about each
    axis, and 20 independent distances.

    Parameters
    ----------
    squares : array
        Mean squared distances along the normals between shapes that are aligned.
    """
    weights: FloatArray = squares / (_INDEPENDENT * _SPREAD**2)
    return weights


def softness(points: FloatArray, normals: FloatArray, along: FloatArray, weights: FloatArray) -> FloatArray:
    """Return how little surfaces tell of their orientations, from 0 to 1: the part of the prior knowledge.

    This is about the axis about which a surface turns most freely, where it may also move and grow.

    Parameters
    ----------
    points, normals : (B, n, 3) arrays
        Of each surface.
    along : (B, n) array
        Distances to the corresponding points of another surface, along the normals.
    weights : (B, n) array
        Of the points.

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
