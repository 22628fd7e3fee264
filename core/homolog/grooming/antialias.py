"""A smooth level function whose zero level passes between the voxels inside and those outside."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy import ndimage

from homolog.arrays import Array, BoolArray, Float32Array
from homolog.threads import on_one_thread

__all__ = ["along_axis", "antialiased", "near_distance", "near_squared", "smoothed"]

_BLOCK = 32  # rows of a band matrix that are multiplied at a time
_ROUNDS = 8
_SLACK = 0.1  # voxels
_REACH = 10
"""Distances farther from the border than this do not affect the surface [voxels]."""


def antialiased(mask: BoolArray, sigma: float = 1.0, *, near_only: bool = False) -> Float32Array:
    """Return a level function of a binary grid without the grid's steps.

    The signed distance of the voxels is smoothed repeatedly. After each iteration the voxels next to the
    border are constrained to their own side and to within one voxel of it, as in Whitaker's antialiasing
    (Reducing aliasing artifacts in iso-surfaces of binary volumes, VolVis 2000). There the
    surface moves by mean curvature, which shrinks convex shapes within the bounds. The smoothing used here is
    of fourth order (`smoothed`) and does not shrink them.

    Parameters
    ----------
    mask : bool array of any dimension
        True inside; the border of the grid is outside.
    sigma : float
        Standard deviation of the smoothing [voxels].
    near_only : bool
        Whether to omit distances far from the border, which take most of the time.

    Returns
    -------
    float32 array
        Negative at the voxels inside, positive outside; roughly the signed distance [voxels].
    """
    if near_only:
        level = near_distance(~mask, _REACH)
        np.subtract(near_distance(mask, _REACH), level, out=level)
    else:
        inside: Array = ndimage.distance_transform_edt(mask)
        outside: Array = ndimage.distance_transform_edt(~mask)
        level = (outside - inside).astype(np.float32)
    border = np.abs(level) == 1.0
    level -= np.sign(level) * np.float32(0.5)
    if sigma == 0.0:
        return level
    places = np.flatnonzero(border)
    side = np.where(mask.ravel()[places], np.float32(-1.0), np.float32(1.0))
    for _ in range(_ROUNDS):
        level = smoothed(level, sigma)
        flat = level.ravel()
        flat[places] = side * np.clip(side * flat[places], _SLACK, 1.0)
    least = np.float32(_SLACK)
    return np.where((level < 0) == mask, level, np.where(mask, -least, least))


def near_distance(mask: BoolArray, reach: int) -> Float32Array:
    """Return the distance to the nearest voxel of a mask [voxels], exact up to `reach` and clipped there.

    Parameters
    ----------
    mask : bool array of any dimension
        Voxels at distance 0.
    reach : int
        Largest distance computed [voxels], at most 10.
    """
    roots = np.sqrt(np.arange(reach**2 + 1, dtype=np.float32))
    return np.asarray(roots[near_squared(mask, reach)])


def near_squared(mask: BoolArray, reach: int) -> Array:
    """Return the square of `near_distance`, as uint8: minimized along one axis after another."""
    most = reach**2
    squared = np.where(mask, np.uint8(0), np.uint8(most))
    farther = np.empty_like(squared)
    for axis in range(mask.ndim):
        old = np.moveaxis(squared, axis, 0)
        squared = squared.copy()
        new, sums = np.moveaxis(squared, axis, 0), np.moveaxis(farther, axis, 0)
        for step in range(1, min(reach, len(old) - 1) + 1):
            np.add(old, np.uint8(step**2), out=sums)
            np.minimum(new[step:], sums[:-step], out=new[step:])
            np.minimum(new[:-step], sums[step:], out=new[:-step])
    return squared


def smoothed(values: Array, sigma: float | tuple[float, ...]) -> Float32Array:
    """Smooth without the shrinking of a plain Gaussian: 2 G u - G G u, a kernel without second moment.

    Parameters
    ----------
    values : array
        Any dimension.
    sigma : float or tuple of float
        Standard deviation of G, common to all axes or one for each [nodes].
    """
    widths = np.broadcast_to(sigma, values.ndim).tolist()
    once = _blurred(values, widths)
    twice = _blurred(once, widths)
    once *= np.float32(2.0)
    once -= twice
    return once


def _blurred(values: Array, sigmas: Sequence[float]) -> Float32Array:
    """Return the result of `ndimage.gaussian_filter`, as products with band matrices: twice as fast."""
    result: Float32Array = np.asarray(values, np.float32)
    for axis, sigma in enumerate(sigmas):
        if sigma > 0.0:
            result = along_axis(_weights(values.shape[axis], sigma), result, axis)
    return result


@lru_cache(maxsize=16)
def _weights(count: int, sigma: float) -> Float32Array:
    """Return the matrix that smooths the values of a line."""
    identity = np.eye(count, dtype=np.float32)
    return np.asarray(ndimage.gaussian_filter1d(identity, sigma, axis=0, mode="nearest"))


@on_one_thread
def along_axis(matrix: Float32Array, values: Array, axis: int) -> Float32Array:
    """Return the products of a matrix with all lines of values along an axis.

    Columns without any weight in a block of rows are omitted, most of them in a band matrix.

    Parameters
    ----------
    matrix : (N, M) array
        Weights, no row of zeros.
    values : array
        M values along the axis, of any dimension.
    axis : int

    Returns
    -------
    float32 array
        N values along the axis.
    """
    after = int(np.prod(values.shape[axis + 1 :]))
    lines = values.reshape(-1, values.shape[axis], after)
    result = np.empty((len(lines), len(matrix), after), np.float32)
    for start in range(0, len(matrix), _BLOCK):
        rows = slice(start, start + _BLOCK)
        used = np.flatnonzero(matrix[rows].any(axis=0))
        columns = slice(used[0], used[-1] + 1)
        if after == 1:
            np.matmul(lines[:, columns, 0], matrix[rows, columns].T, out=result[:, rows, 0])
        else:
            np.matmul(matrix[rows, columns], lines[:, columns], out=result[:, rows])
    return result.reshape(*values.shape[:axis], len(matrix), *values.shape[axis + 1 :])
