"""Shape-based interpolation of a stack of slices that lie far apart."""

import numpy as np
from scipy import ndimage
from scipy.interpolate import PchipInterpolator

from homolog.arrays import Array, BoolArray, Float32Array, FloatArray
from homolog.grooming.antialias import antialiased

__all__ = ["interpolated"]

_CLOSES_BELOW = 0.5  # of a hole's largest area
_BOTTOM = 0.1  # slices: how far a hole reaches beyond the last slice where it closes


def interpolated(
    mask: BoolArray, thickness: float, heights: FloatArray, sigma: float
) -> tuple[Float32Array, bool]:
    """Return a level function between the slices of a stack.

    The outline of each slice and the hole in it are interpolated one by one as signed distances in the
    plane (Raya and Udupa 1990): where the wall between them moves by more than its thickness from one
    slice to the next, it stays whole. At both ends the shape follows its trend inwards and is cut flat half
    a slice beyond the last one. A hole through the whole stack stays open at its wider end; at the narrower
    one it is closed if it has less than half of its largest area there (a ventricle's apex).

    Parameters
    ----------
    mask : (I, J, K) bool array
        True inside. Slices follow each other along the last axis; the first and last hold something; the
        borders of the other two axes are outside.
    thickness : float
        Distance between slices [in-plane voxels].
    heights : (L,) float64 array
        Where along the last axis the function is wanted, as slice numbers; -0.5 to K - 0.5 is inside.
    sigma : float
        Standard deviation of the in-plane smoothing [voxels].

    Returns
    -------
    (I, J, L) float32 array
        Negative inside [in-plane voxels].
    bool
        Whether a hole was closed at one end.
    """
    outlines = np.stack([ndimage.binary_fill_holes(one) for one in np.moveaxis(mask, 2, 0)], axis=-1)
    holes = outlines & ~mask
    last = mask.shape[2] - 1
    ends = np.maximum(-0.5 - heights, heights - (last + 0.5)) * thickness
    level = np.maximum(_between(_distances(outlines, sigma), heights), ends)
    areas = holes.sum(axis=(0, 1))
    closed = False
    if areas.any():
        hole = _between(_distances(holes, sigma), heights)
        if areas[0] and areas[-1]:
            narrow = 0 if areas[0] < areas[-1] else last
            closed = bool(areas[narrow] < _CLOSES_BELOW * areas.max())
            if closed:
                beyond = -heights if narrow == 0 else heights - last
                hole = np.maximum(hole, (beyond - _BOTTOM) * thickness)
        level = np.maximum(level, -hole)
    return level.astype(np.float32), closed


def _distances(masks: BoolArray, sigma: float) -> Float32Array:
    """Signed distances in each slice; slices without anything mirror the nearest ones that have something."""
    present = np.flatnonzero(masks.any(axis=(0, 1)))
    result = np.empty(masks.shape, np.float32)
    for k in present:
        result[..., k] = antialiased(masks[..., k], sigma)
    for k in np.setdiff1d(np.arange(masks.shape[2]), present):
        nearest = present[np.argmin(np.abs(present - k))]
        result[..., k] = np.maximum(-result[..., nearest], np.abs(result[..., nearest]))
    return result


def _between(slices: Float32Array, heights: FloatArray) -> Array:
    """Interpolate along the last axis without overshoot; beyond the ends the trend goes on if it shrinks."""
    last = slices.shape[2] - 1
    if last == 0:
        return np.repeat(slices, len(heights), axis=2)
    inner: Array = PchipInterpolator(np.arange(last + 1), slices, axis=2)(np.clip(heights, 0, last))
    before, after = np.clip(-heights, 0, None), np.clip(heights - last, 0, None)
    inner += np.maximum(slices[..., :1] - slices[..., 1:2], 0.0) * before
    inner += np.maximum(slices[..., -1:] - slices[..., -2:-1], 0.0) * after
    return inner
