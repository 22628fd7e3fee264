"""A smooth level function whose zero level passes between the voxels inside and those outside."""

import numpy as np
from scipy import ndimage

from homolog.arrays import Array, BoolArray, Float32Array

__all__ = ["antialiased", "near_distance", "smoothed"]

_ROUNDS = 8
_SLACK = 0.1  # voxels
_REACH = 10
"""Voxels: farther from the border, distances make no difference to the surface."""


def antialiased(mask: BoolArray, sigma: float = 1.0, *, near_only: bool = False) -> Float32Array:
    """Return a level function of a binary grid without the grid's steps.

    The signed distance of the voxels is smoothed over and over, and after each round the voxels on either
    side of the border are put back to their own side and within one voxel of it, as in Whitaker's
    antialiasing (Reducing aliasing artifacts in iso-surfaces of binary volumes, VolVis 2000). There the
    surface moves by mean curvature, which shrinks convex shapes within the bounds; here the smoothing is of
    fourth order (`smoothed`), which does not.

    Parameters
    ----------
    mask : bool array of any dimension
        True inside; the border of the grid is outside.
    sigma : float
        Standard deviation of the smoothing [voxels].
    near_only : bool
        Whether distances far from the border are not to be computed, which takes most of the time.

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
    side = np.where(mask[border], -1.0, 1.0)
    for _ in range(_ROUNDS):
        level = smoothed(level, sigma)
        level[border] = side * np.clip(side * level[border], _SLACK, 1.0)
    return np.where((level < 0) == mask, level, np.where(mask, -_SLACK, _SLACK)).astype(np.float32)


def near_distance(mask: BoolArray, reach: int) -> Float32Array:
    """Return the distance to the nearest voxel of a mask, exact up to `reach`, that value beyond [voxels].

    Squared distances are the least sums over the three axes one after another; small ones fit into a byte.

    Parameters
    ----------
    mask : bool array of any dimension
        Where the distance is 0.
    reach : int
        At most 10.
    """
    most = reach**2
    squared = np.where(mask, np.uint8(0), np.uint8(most))
    for axis in range(mask.ndim):
        old = np.moveaxis(squared, axis, 0)
        squared = squared.copy()
        new = np.moveaxis(squared, axis, 0)
        for step in range(1, min(reach, len(old) - 1) + 1):
            np.minimum(new[step:], old[:-step] + np.uint8(step**2), out=new[step:])
            np.minimum(new[:-step], old[step:] + np.uint8(step**2), out=new[:-step])
    roots = np.sqrt(np.arange(most + 1, dtype=np.float32))
    return np.asarray(roots[squared])


def smoothed(values: Array, sigma: float | tuple[float, ...]) -> Float32Array:
    """Smooth without the shrinking of a plain Gaussian: 2 G u - G G u, a kernel without second moment.

    Parameters
    ----------
    values : array
        Any dimension.
    sigma : float or tuple of float
        Standard deviation of G, of all axes or of each [nodes].
    """
    once = ndimage.gaussian_filter(values, sigma, mode="nearest", output=np.float32)
    return 2.0 * once - ndimage.gaussian_filter(once, sigma, mode="nearest", output=np.float32)
