"""Similarities that bring corresponding points onto each other."""

import numpy as np

from homolog.arrays import FloatArray

__all__ = ["best_similarity"]


def best_similarity(points: FloatArray, targets: FloatArray, *, scaling: bool) -> FloatArray:
    """Return the similarity of points to targets with least squares (Umeyama 1991), shape (4, 4).

    Parameters
    ----------
    points, targets : (n, 3) arrays
        Corresponding positions.
    scaling : bool
        Whether the size may change; otherwise the motion is rigid. Reflections are not allowed.
    """
    middle, goal = points.mean(axis=0), targets.mean(axis=0)
    own = points - middle
    u, values, vt = np.linalg.svd((targets - goal).T @ own)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    scale = float(values @ signs / np.square(own).sum()) if scaling else 1.0
    result = np.eye(4)
    result[:3, :3] = scale * (u * signs) @ vt
    result[:3, 3] = goal - result[:3, :3] @ middle
    return result
