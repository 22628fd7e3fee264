"""Similarities as (4, 4) matrices: application, fit, scale and rotation; farthest-point sampling."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.distance import cdist

from homolog.arrays import FloatArray, IntArray

__all__ = [
    "farthest_point_sampling",
    "fit_rotation",
    "fit_similarity",
    "inverse_matrices",
    "rms_radius",
    "rotation_of",
    "scale_of",
    "transform_points",
]


def transform_points(matrices: FloatArray, points: FloatArray) -> FloatArray:
    """Return points mapped by affine matrices.

    Parameters
    ----------
    matrices : (..., 4, 4) array
        One matrix, or one for each set of points.
    points : (..., n, 3) array

    Returns
    -------
    (..., n, 3) array
    """
    mapped: FloatArray = points @ np.swapaxes(matrices[..., :3, :3], -1, -2) + matrices[..., None, :3, 3]
    return mapped


def inverse_matrices(matrices: FloatArray) -> FloatArray:
    """Return the inverses of (..., 4, 4) matrices."""
    inverses: FloatArray = np.asarray(np.linalg.inv(matrices), dtype=np.float64)
    return inverses


def scale_of(matrices: FloatArray) -> FloatArray:
    """Return the positive scale (...) of similarities (..., 3, 3) or (..., 4, 4), mirror images included."""
    return np.asarray(np.cbrt(np.abs(np.linalg.det(matrices[..., :3, :3]))))


def rotation_of(matrices: FloatArray) -> FloatArray:
    """Return the rotations (..., 3, 3) of similarities (..., 4, 4) without reflection."""
    linear = matrices[..., :3, :3]
    return np.asarray(linear / np.cbrt(np.linalg.det(linear))[..., None, None])


def fit_rotation(
    covariance: FloatArray, *, mirrored: bool = False
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the least-squares rotation of centred points to centred targets (Kabsch 1976).

    Parameters
    ----------
    covariance : (..., 3, 3) array
        Sum of target ⊗ point over the points.
    mirrored : bool
        Whether to return the best reflection instead.

    Returns
    -------
    left, right : (..., 3, 3) arrays
        Factors of the rotation, ``left @ right``; apply a scale to the first, which saves a rounding.
    overlap : (...,) array
        Sum over the points of target · rotated point.
    """
    u, values, vt = np.linalg.svd(covariance)
    signs = np.ones(values.shape)
    signs[..., 2] = np.sign(np.linalg.det(u @ vt)) * (-1.0 if mirrored else 1.0)
    return u * signs[..., None, :], vt, np.vecdot(values, signs)


def fit_similarity(
    points: FloatArray, targets: FloatArray, *, scaling: bool, mirrored: bool = False
) -> FloatArray:
    """Return the least-squares similarity of points to targets (Umeyama 1991).

    Parameters
    ----------
    points, targets : (n, 3) arrays
        Corresponding positions.
    scaling : bool
        Whether the size may change; otherwise the motion is rigid.
    mirrored : bool
        Whether to return the best reflection instead of the best proper similarity.

    Returns
    -------
    (4, 4) float64 array
    """
    centre, target_centre = points.mean(axis=0), targets.mean(axis=0)
    centred = points - centre
    left, right, overlap = fit_rotation((targets - target_centre).T @ centred, mirrored=mirrored)
    spread = np.square(centred).sum()
    scale = float(overlap / spread) if scaling and spread > 0.0 else 1.0
    result = np.eye(4)
    result[:3, :3] = scale * left @ right
    result[:3, 3] = target_centre - result[:3, :3] @ centre
    return result


def rms_radius(points: FloatArray) -> FloatArray:
    """Return the root mean square distance of points (..., n, 3) from their centroid, (...,)."""
    centred = points - points.mean(axis=-2, keepdims=True)
    radius: FloatArray = np.sqrt(np.square(centred).sum(axis=-1).mean(axis=-1))
    return radius


def farthest_point_sampling(
    points: FloatArray, count: int, begin: Sequence[int] | IntArray = (0,)
) -> IntArray:
    """Return indices of points far from each other, each the farthest from the previous ones (Gonzalez 1985).

    Parameters
    ----------
    points : (n, 3) array
    count : int
        Number of chosen points, at most n.
    begin : sequence of int
        Indices of the first points.

    Returns
    -------
    (count,) int array
        Indices in the order of their choice.
    """
    chosen = [int(index) for index in begin]
    gap = cdist(points, points[chosen]).min(axis=1)
    columns = np.ascontiguousarray(points.T)  # five times faster than rows
    while len(chosen) < count:
        chosen.append(int(gap.argmax()))
        offsets = columns - columns[:, chosen[-1], None]
        gap = np.minimum(gap, np.sqrt(np.add.reduce(np.square(offsets), axis=0)))
    return np.array(chosen)
