"""Shape-based interpolation of a stack of distant slices."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from homolog.arrays import Array, BoolArray, Float32Array, FloatArray
from homolog.grooming.antialias import antialiased, smoothed
from homolog.surfaces.topology import without_cavities

__all__ = ["Stack", "interpolated"]

_CLOSES_BELOW = 0.5  # fraction of a hole's largest area: a narrower end is nearer to closed than to open
_BOTTOM = 0.1  # slices: distance that a closing hole continues beyond the last slice
_ALONG = 0.6  # slices: standard deviation of the smoothing from slice to slice
_FLAT = 0.5  # slices: distance of the cut of an open end beyond the last slice's middle, where it ends
_DOME = 0.75  # slices: height h of an ellipsoidal cap with the volume of half a slice, 2 h / 3 = 1 / 2


@dataclass(frozen=True, slots=True, eq=False)
class Stack:
    """Level functions between slices, negative inside [in-plane voxels].

    The structure lies inside `outline` and `ends` and outside `hole`.

    Attributes
    ----------
    outline : (I, J, L) float32 array
        The filled slices, continued beyond open ends.
    hole : (I, J, L) float32 array or None
        The opening inside the outlines of the slices.
    ends : (L,) float32 array
        The planes that cut open ends.
    closed : bool
        Whether the hole was closed at one end.
    """

    outline: Float32Array
    hole: Float32Array | None
    ends: Float32Array
    closed: bool


def interpolated(mask: BoolArray, thickness: float, heights: FloatArray, sigma: float) -> Stack:
    """Interpolate a stack of slices.

    The outline of each slice and the hole in it are interpolated separately as signed distances in the plane
    (Raya and Udupa 1990). The wall between them therefore stays closed even if it moves by more than its
    thickness from one slice to the next. A hole through the whole stack stays open at its wider end. Its
    narrower end is closed if its area is less than half of the largest (a ventricle's apex). Open ends are
    cut flat half a slice beyond the last one; closed ends become domes of the same volume.

    Parameters
    ----------
    mask : (I, J, K) bool array
        True inside. Slices are stacked along the last axis. The first and last slices are not empty; the
        borders along the other two axes are outside.
    thickness : float
        Distance between slices [in-plane voxels].
    heights : (L,) float64 array
        Positions of the result along the last axis, in slices; the structure spans -0.5 to K - 0.5.
    sigma : float
        Standard deviation of the in-plane smoothing [voxels].
    """
    outlines = np.stack([without_cavities(item) for item in np.moveaxis(mask, 2, 0)], axis=-1)
    holes = outlines & ~mask
    areas = holes.sum(axis=(0, 1))
    goes_on = areas[[0, -1]] > 0
    narrow = int(areas[-1] < areas[0])
    closing = bool(goes_on.all() and areas[-narrow] < _CLOSES_BELOW * areas.max())
    if closing:
        goes_on[narrow] = False
    outline = _between(_distances(outlines, sigma), heights)
    ends = np.full(len(heights), -np.inf, np.float32)
    for end, beyond in enumerate((-heights, heights - (mask.shape[2] - 1))):
        if goes_on[end]:
            ends = np.maximum(ends, (beyond - _FLAT) * thickness)
        else:
            outline = outline + _dome(outline, beyond, thickness)
    hole = None
    if areas.any():
        hole = _between(_distances(holes, sigma), heights)
        if closing:
            beyond = heights - (mask.shape[2] - 1) if narrow else -heights
            hole = np.maximum(hole, (beyond - _BOTTOM) * thickness)
        hole = hole.astype(np.float32)
    return Stack(outline.astype(np.float32), hole, ends.astype(np.float32), closing)


def _dome(level: Array, beyond: FloatArray, thickness: float) -> FloatArray:
    """Return a term that makes a level function end in a dome; `beyond` is the distance past the last slice.

    A dome is at most as high as a hemisphere, so that a tiny last slice does not become a spike.
    """
    inradius = max(float(-level[..., np.argmin(np.abs(beyond))].min()), 0.5)
    height = min(_DOME, inradius / thickness)
    done = np.clip(beyond / height, 0.0, 1.0)
    dome = inradius * (1.0 - np.sqrt(1.0 - done**2)) + np.maximum(beyond - height, 0.0) * thickness
    return np.asarray(dome)


def _distances(masks: BoolArray, sigma: float) -> Float32Array:
    """Signed distances in each slice; in empty slices, such that the neighbour's shape ends half-way."""
    present = np.flatnonzero(masks.any(axis=(0, 1)))
    result = np.empty(masks.shape, np.float32)
    for k in present:
        result[..., k] = antialiased(masks[..., k], sigma)
    for k in np.setdiff1d(np.arange(masks.shape[2]), present):
        nearest = present[np.argmin(np.abs(present - k))]
        result[..., k] = np.abs(result[..., nearest])
    return result


def _between(slices: Float32Array, heights: FloatArray) -> Array:
    """Interpolate along the last axis without overshoot; beyond the ends the last slice is repeated.

    Slices that are shifted against their neighbours (another breath hold) are aligned first.
    """
    last = slices.shape[2] - 1
    if last == 0:
        return np.repeat(slices, len(heights), axis=2)
    if last > 1:
        trend = np.pad(slices, ((0, 0), (0, 0), (2, 2)), mode="reflect", reflect_type="odd")
        slices = smoothed(trend, (0.0, 0.0, _ALONG))[..., 2:-2]
    return np.asarray(PchipInterpolator(np.arange(last + 1), slices, axis=2)(np.clip(heights, 0, last)))
