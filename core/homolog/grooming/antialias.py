"""A smooth level function whose zero level passes between the voxels inside and those outside."""

import numpy as np
from scipy import ndimage

from homolog.arrays import Array, BoolArray, Float32Array

__all__ = ["antialiased", "smoothed"]

_ROUNDS = 8
_SLACK = 0.1  # voxels


def antialiased(mask: BoolArray, sigma: float = 1.0) -> Float32Array:
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

    Returns
    -------
    float32 array
        Negative at the voxels inside, positive outside; roughly the signed distance [voxels].
    """
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
