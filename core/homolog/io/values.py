"""Interpretation of a file's values: labels, probabilities, signed distances, or grey values."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy import ndimage

from homolog.arrays import Array, BoolArray, FloatArray
from homolog.errors import InputError

__all__ = [
    "box_of",
    "hardened",
    "labels_apart",
    "labels_from",
    "labels_of_channels",
    "labels_seen",
    "slices_of",
]

_ROUNDING = 1e-3
"""Largest deviation of labels from whole numbers, due to scaling and single precision."""
_LARGEST = 2**31 - 1
_HALF = 0.5
"""Probability at the surface."""
_SURE = (0.1, 0.9)
_MOST_UNSURE = 0.95
"""Largest share of intermediate probabilities among the voxels that may belong to the structure."""
_MOST_OF_BORDER = 0.9
"""Least share of the image's border that is outside."""
_OVERSHOOT = 0.6
"""Largest overshoot of interpolated values beyond 0 and 1."""
_PERCENT = 100
"""Least value of a full voxel in a soft mask of whole numbers: 100 (percent), or 255 (byte)."""
_FEW_VALUES = 8
"""Number of intermediate values above which a mask has soft edges."""
_PLATEAU = 0.8
"""Quantile of the upper values that is a full voxel; higher values may overshoot."""
_SMOOTHING = (0.5, 0.75, 1.0)
"""Widths [voxels] of the Gaussians that soft edges are compared with."""
_MOST_COMPARED = 128
"""Longest edge of the part in the middle that is compared [voxels]."""
_UNLIKE_SMOOTHED = 0.145
"""Root mean square difference of soft edges from those of the smoothed mask, as a fraction of a full voxel.

Below 0.144 where masks of brain structures and hearts are smoothed or interpolated; above 0.17 for pictures,
and for label maps of many labels.
"""
_PROBABILITY = "its values are probabilities; voxels of at least 0.5 were used as the structure"
_SLOPE = (0.85, 1.15)
"""Slope of signed distances, per mm or per voxel, at most voxels near the surface."""
_NEAR_SURFACE = 20_000
"""Number of voxels at which the slope is computed."""
_MOST_VALUES = 1000
"""A file with more different values is a picture rather than a label map."""
_MANY_VALUES = 50
"""Number of different values from which on differences of neighbours are tested."""
_MOST_DIFFERENT = 0.5
"""Least share of neighbouring voxels above 0 that differ in a picture."""
_MOST_IN_ONE = 0.85
"""Least share of the voxels in the largest piece if all labels are one structure."""
_LOOKED_AT = 2_000_000


def slices_of(values: Array) -> Iterator[Array]:
    """Return slices of a volume in the order of memory."""
    axis = int(np.argmax(values.strides))
    return iter(np.moveaxis(values, axis, 0))


def labels_from(path: Path, values: Array, spacing: FloatArray) -> tuple[Array, str]:
    """Return labels and notes.

    Probabilities of at least 0.5 become 1. Signed distances become 1 inside; the border of the image is
    outside.

    Parameters
    ----------
    path : Path
        The file, for messages.
    values : (I, J, K) array
    spacing : (3,) float64 array
        Spacing of the voxels [mm].

    Returns
    -------
    labels : (I, J, K) array of whole numbers
    note : str
        Empty if the values are labels.

    Raises
    ------
    InputError
        If the values are neither labels, probabilities nor distances.
    """
    if not np.issubdtype(values.dtype, np.floating):
        return values, ""
    values, numbers = _without_nan(path, values)
    whole = np.empty_like(values, dtype=np.int32)  # slice by slice in the order of the file
    off, low, high = 0.0, np.inf, -np.inf
    for source, target in zip(slices_of(values), slices_of(whole), strict=True):
        rounded = np.rint(source)
        off = max(off, float(np.abs(source - rounded).max()))
        low, high = min(low, float(source.min())), max(high, float(source.max()))
        target[...] = np.clip(rounded, -_LARGEST, _LARGEST)
    if off <= _ROUNDING:
        return whole, numbers
    if low >= 0.0 and (only := _only_value(values)):
        note = f"its values are 0 and {only:.3g}: the latter was used as the structure"
        return (values > 0).astype(np.uint8), note
    full = float(np.median(values[values > _HALF * high])) if high > 0.0 else 0.0
    within = -_OVERSHOOT * full <= low and high <= (1.0 + _OVERSHOOT) * full
    if within and full >= _PERCENT * (1.0 - _ROUNDING) and _are_probabilities(values / full):
        return _half_of(values, full)
    if low >= -_OVERSHOOT and high <= 1.0 + _OVERSHOOT and _are_probabilities(values):
        return (values >= _HALF).astype(np.uint8), _PROBABILITY
    if within and full > _FEW_VALUES and _has_soft_edges(values, full):  # an interpolated label
        return _half_of(values, full)
    if low < 0.0 < high and (sign := _outward_sign(values, spacing)):
        return _inside(values, sign)
    if low < 0.0 and abs(low + high) <= _ROUNDING * high:  # distances clipped at both ends
        for sign in (1, -1):
            if _are_probabilities(_HALF - _HALF * sign * values / high):
                return _inside(values, sign)
    raise InputError(f"{path}: contains fractions, so it is not a label map; threshold it first")


def hardened(values: Array, spacing: FloatArray) -> tuple[Array, str]:
    """Return a mask of whole numbers that are not labels as 0 and 1, with a note; label maps unchanged.

    Most voxels of a soft mask (percent, bytes) have nearly its largest value, or the others are those of a
    smoothed mask, as if a thin structure or a label was interpolated; both have many intermediate values.
    With values below 0, two values are a mask, and others are distances (see `labels_from`).

    Parameters
    ----------
    values : (I, J, K) array of whole numbers
    spacing : (3,) float64 array
        Spacing of the voxels [mm].
    """
    seen = _sample(values)
    if seen.min() < 0:
        return _hardened_signed(values, spacing)
    full = int(seen.max(initial=0))
    between = seen[(seen > _SURE[0] * full) & (seen < _SURE[1] * full)]
    if len(np.unique(between)) <= _FEW_VALUES:
        return values, ""
    if full >= _PERCENT and len(between) <= np.count_nonzero(seen >= _SURE[1] * full):
        return _half_of(values, full)
    plateau = float(np.quantile(seen[seen > _HALF * full], _PLATEAU))
    return _half_of(values, plateau) if _has_soft_edges(values, plateau) else (values, "")


def box_of(mask: BoolArray) -> tuple[slice, ...]:
    """Return the smallest box around the true voxels of a mask that has some."""
    return next(box for box in ndimage.find_objects(mask.view(np.uint8)) if box is not None)


def _has_soft_edges(values: Array, full: float) -> bool:
    """Return whether intermediate values are those of a smoothed mask, and the image's border is outside."""
    if np.mean(_border(values) < _SURE[0] * full) <= _MOST_OF_BORDER:
        return False
    box = box_of(values > _SURE[0] * full)
    trims = [max(0, (side.stop - side.start - _MOST_COMPARED) // 2) for side in box]
    part = values[
        tuple(slice(side.start + trim, side.stop - trim) for side, trim in zip(box, trims, strict=True))
    ]
    part = np.pad(part.astype(np.float32) / np.float32(full), 2, mode="edge" if any(trims) else "constant")
    between = (part > _SURE[0]) & (part < _SURE[1])
    if not between.any():
        return False
    mask = (part >= _HALF).astype(np.float32)
    return any(
        np.sqrt(np.mean(np.square(ndimage.gaussian_filter(mask, width) - part)[between])) < _UNLIKE_SMOOTHED
        for width in _SMOOTHING
    )


def _hardened_signed(values: Array, spacing: FloatArray) -> tuple[Array, str]:
    """Convert two values, one of them below 0, or signed distances to 0 and 1."""
    low, high = int(values.min()), int(values.max())
    if not ((values != low) & (values != high)).any():
        border = _border(values)
        outside = high if np.count_nonzero(border == high) > _HALF * border.size else low
        inside = low + high - outside
        note = f"its values are {low} and {high}: {inside} was used as the structure"
        return (values == inside).astype(np.uint8), note
    distances = values.astype(np.float32)
    for field in (distances, np.sign(distances) * np.sqrt(np.abs(distances))):  # SimpleITK squares them
        if low < 0 < high and (sign := _outward_sign(field, spacing)):
            return _inside(values, sign)
    return values, ""


def _inside(distances: Array, sign: int) -> tuple[Array, str]:
    """Return 1 where signed distances are inside their surface, and a note."""
    inside = "negative" if sign > 0 else "positive"
    note = f"its values are signed distances; voxels where they are {inside} were used as the structure"
    return (distances * sign < 0).astype(np.uint8), note


def _without_nan(path: Path, values: Array) -> tuple[Array, str]:
    """Replace values that are not numbers by 0 if they are the background; also return a note."""
    if all(np.isfinite(entry).all() for entry in slices_of(values)):
        return values, ""
    border = _border(values)
    if np.isinf(values).any() or np.mean(np.isnan(border) | (border == 0)) < _MOST_OF_BORDER:
        raise InputError(f"{path}: contains values that are not numbers; export the label map again")
    return np.nan_to_num(values), "voxels without a number (NaN) were used as the background"


def _half_of(values: Array, full: float) -> tuple[Array, str]:
    half = full / 2.0
    note = f"its edges are soft; voxels of at least {half:.4g} were used as the structure"
    return (values >= half).astype(np.uint8), note


def _only_value(values: Array) -> float:
    """Return the value that all voxels other than 0 have; 0 if there are several."""
    high = float(values.max())
    same = (((entry == 0) | (entry > high * (1.0 - _ROUNDING))).all() for entry in slices_of(values))
    return high if all(same) else 0.0


def _sample(values: Array) -> Array:
    """Return an evenly spaced sample of the voxels."""
    return values.ravel(order="K")[:: max(1, values.size // _LOOKED_AT)]


def labels_of_channels(path: Path, values: Array) -> tuple[Array, str]:
    """Return the labels of a map of probabilities for each structure (one-hot, if they are 0 and 1).

    Parameters
    ----------
    path : Path
        The file, for messages.
    values : (I, J, K, C) array

    Returns
    -------
    labels : (I, J, K) array
        Index of the channel with a value of 0.5 or more, from 1, or from 0 if the first channel is the
        background. A single non-empty channel is returned unchanged.
    note : str

    Raises
    ------
    InputError
        If the channels don't exclude each other: points in time, colours, or structures that overlap.
    """
    *size, count = values.shape
    held = [channel + 1 for channel in range(count) if values[..., channel].any()]
    if len(held) == 1 and count > 1:
        return values[
            ..., held[0] - 1
        ], f"of its {count} channels or points in time only {held[0]} has labels"
    total, labels = np.zeros(size, np.float32), np.zeros(size, np.uint8)
    for channel in range(count):
        part = values[..., channel]
        if not np.isfinite(part).all() or part.min() < 0 or part.max() > 1.0 + _ROUNDING:
            total += np.inf
            continue
        total += part
        labels[(part >= _HALF) & (labels == 0)] = channel + 1
    if total.max() > 1.0 + _ROUNDING:
        of_which = f" ({', '.join(map(str, held))} are not empty)" if len(held) < count else ""
        raise InputError(
            f"{path}: has {count} values per voxel{of_which}: points in time, colours, or structures that "
            "overlap; save a label map for each subject and point in time"
        )
    note = f"its {count} channels were used as labels 1 to {count}"
    border = np.bincount(_border(labels), minlength=count + 1)
    outside = int(np.argmax(border))
    if outside and border[outside] > _MOST_OF_BORDER * border.sum():
        labels[labels == outside] = 0
        if outside == 1:
            labels[labels > 0] -= 1
        note = f"channel {outside} of {count} was used as the background, the others as labels"
    return labels, note


def _border(values: Array) -> Array:
    return np.concatenate([np.moveaxis(values, axis, 0)[end].ravel() for axis in range(3) for end in (0, -1)])


def _are_probabilities(values: Array) -> bool:
    """Return whether values from 0 to 1 are near one of them at most places, and near 0 at the border."""
    low, high = _SURE
    outside, inside = np.count_nonzero(values < low), np.count_nonzero(values > high)
    unsure = values.size - outside - inside
    decided = bool(inside > 0 and unsure < _MOST_UNSURE * (unsure + inside))
    return decided and bool(np.mean(_border(values) < low) > _MOST_OF_BORDER)


def _outward_sign(values: Array, spacing: FloatArray) -> int:
    """Return the sign of signed distances outside their surface; 0 if the values are not distances."""
    positive = float(np.mean(_border(values) > 0.0))
    if min(values.shape) < 3 or 1.0 - _MOST_OF_BORDER < positive < _MOST_OF_BORDER:
        return 0
    least = float(np.abs(values).min())
    values = values - np.sign(values) * (least / 2.0)  # distances between voxels are never zero
    inner = values[1:-1, 1:-1, 1:-1]
    near = np.flatnonzero(np.abs(inner) < 2.0 * spacing.max())
    near = near[:: max(1, len(near) // _NEAR_SURFACE)]
    at = np.stack(np.unravel_index(near, inner.shape)) + 1
    steps = np.eye(3, dtype=np.intp)[:, :, None]
    change = np.stack([values[tuple(at + step)] - values[tuple(at - step)] for step in steps]) / 2.0
    slopes = (np.linalg.norm(change / spacing[:, None], axis=0), np.linalg.norm(change, axis=0))
    shares = [np.mean((slope > _SLOPE[0]) & (slope < _SLOPE[1])) if len(near) else 0.0 for slope in slopes]
    return 0 if max(shares) < _HALF else 1 if positive > _HALF else -1


def labels_apart(values: Array) -> list[int]:
    """Return the labels of a map if they are separate structures, such as the bones of a hand; else none.

    In this case the largest piece has less than 85 % of the voxels, and at least half of the labels are
    mostly outside it.
    """
    pieces, count = ndimage.label(values > 0, np.ones((3, 3, 3)))
    if count < 2:
        return []
    sizes = np.bincount(pieces.ravel())
    largest = int(np.argmax(sizes[1:])) + 1
    if sizes[largest] >= _MOST_IN_ONE * sizes[1:].sum():
        return []
    present, number = np.unique(values[pieces > 0], return_inverse=True)
    inside = np.bincount(number, weights=pieces[pieces > 0] == largest)
    elsewhere = np.count_nonzero(inside < _HALF * np.bincount(number))
    return present.tolist() if len(present) > 1 and elsewhere >= _HALF * len(present) else []


def labels_seen(path: Path, values: Array) -> int:
    """Return the number of labels in a sample of a layer.

    Raises
    ------
    InputError
        If it is a picture, which would make all voxels above 0 the structure.
    """
    if values.min() < 0:
        raise InputError(
            f"{path}: contains values below 0, so it is a picture rather than a label map; segment the "
            "structure first, or name a label"
        )
    seen = np.unique(_sample(values))
    if len(seen) > _MOST_VALUES:
        raise InputError(
            f"{path}: contains more than {_MOST_VALUES} different values, so it is a picture rather than a "
            "label map; segment the structure first, or name a label"
        )
    if len(seen) > _MANY_VALUES and _differing(values) > _MOST_DIFFERENT:
        raise InputError(
            f"{path}: has {len(seen)} different values, and most neighbours differ, so it is a picture or a "
            "map of probabilities rather than a label map; threshold it first, or name a label"
        )
    return int(np.count_nonzero(seen))


def _differing(values: Array) -> float:
    """Return the share of neighbours above 0 that differ, along the contiguous axis."""
    pairs = differ = 0
    for entry in slices_of(values):
        rows = entry if entry.strides[-1] <= entry.strides[0] else entry.T
        both = (rows[:, 1:] > 0) & (rows[:, :-1] > 0)
        pairs += int(np.count_nonzero(both))
        differ += int(np.count_nonzero(both & (rows[:, 1:] != rows[:, :-1])))
    return differ / max(pairs, 1)
