"""Similarities that bring corresponding points onto each other."""

import numpy as np
from scipy.spatial.transform import Rotation

from homolog.arrays import BoolArray, FloatArray

__all__ = ["best_similarity", "inverted", "procrustes", "transformed"]


def transformed(matrices: FloatArray, points: FloatArray) -> FloatArray:
    """Return the points (M, n, 3) of each shape mapped by its own (4, 4) matrix."""
    turned = [one @ matrix[:3, :3].T for one, matrix in zip(points, matrices, strict=True)]
    result: FloatArray = np.stack(turned) + matrices[:, None, :3, 3]
    return result


def inverted(matrices: FloatArray) -> FloatArray:
    """Return the inverses of (M, 4, 4) matrices."""
    inverses: FloatArray = np.asarray(np.linalg.inv(matrices), dtype=np.float64)
    return inverses


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


def procrustes(
    points: FloatArray,
    normals: FloatArray,
    poses: FloatArray,
    free: BoolArray,
    *,
    scaling: bool,
    sliding: float = 1.0,
) -> FloatArray:
    """Return poses nearer to those of generalized Procrustes analysis (Gower 1975): one round of it.

    Parameters
    ----------
    points, normals : (M, n, 3) arrays
        Particles and unit normals of each shape, as posed.
    poses : (M, 4, 4) array
        The similarities that posed them.
    free : (M,) bool array
        Shapes whose pose may change. Where some may not, the others are brought to the mean of those.
    scaling : bool
        Whether sizes are taken out too; the geometric mean of the scales is then 1.
    sliding : float
        How much the part of a particle's distance from its mean counts that lies in the mean tangent plane:
        1 for Procrustes analysis; less where particles are still to slide over their surfaces, as a turned
        shape with particles that turned with it would keep its pose for long (Chen and Medioni 1992).

    Returns
    -------
    (M, 4, 4) float64 array
    """
    known = free if free.all() else ~free
    mean, upward = points[known].mean(axis=0), normals[known].sum(axis=0)
    upward /= np.maximum(np.linalg.norm(upward, axis=1, keepdims=True), 1e-12)
    weights = (1.0 - sliding) * upward[:, :, None] * upward[:, None, :] + sliding * np.eye(3)
    result = poses.copy()
    for k in np.flatnonzero(free).tolist():
        result[k] = _nearer(points[k], mean, weights, scaling) @ poses[k]
    if scaling and free.all():
        grown = float(np.exp(np.mean(np.log(np.linalg.det(result[:, :3, :3])))) ** (1.0 / 3.0))
        middle = mean.mean(axis=0)
        result[:, :3, :3] /= grown
        result[:, :3, 3] = middle + (result[:, :3, 3] - middle) / grown
    return result


def _nearer(points: FloatArray, targets: FloatArray, weights: FloatArray, scaling: bool) -> FloatArray:
    """Return the similarity that, to first order, brings points to targets under (n, 3, 3) weights."""
    middle = points.mean(axis=0)
    arms = points - middle
    by_pose = np.zeros((len(points), 3, 7))  # derivative of the points by turn, shift and growth
    for axis in range(3):
        by_pose[:, :, axis] = np.cross(np.eye(3)[axis], arms)
    by_pose[:, :, 3:6] = np.eye(3)
    by_pose[:, :, 6] = arms
    by_pose = by_pose[:, :, : 7 if scaling else 6]
    weighted = np.einsum("nia,nij->naj", by_pose, weights)
    matrix = np.einsum("nai,nib->ab", weighted, by_pose)
    change = np.linalg.solve(matrix, np.einsum("nai,ni->a", weighted, targets - points))
    result = np.eye(4)
    result[:3, :3] = Rotation.from_rotvec(change[:3]).as_matrix() * (np.exp(change[6]) if scaling else 1.0)
    result[:3, 3] = middle + change[3:6] - result[:3, :3] @ middle
    return result
