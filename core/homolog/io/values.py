"""Values of volumes: what a file's numbers mean, which labels there are, and where they lie."""

from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from scipy import ndimage

from homolog.arrays import Array, BoolArray
from homolog.errors import InputError
from homolog.settings import Values

__all__ = [
    "are_interpolated",
    "box_of",
    "counted",
    "cropped",
    "labels_apart",
    "labels_from",
    "labels_of_channels",
    "labels_seen",
    "sides_of",
]

_ROUNDING = 1e-3
"""Largest deviation of labels from whole numbers, due to scaling and single precision."""
_LARGEST = 2**31 - 1
_HALF = 0.5
"""Probability at the surface."""
_MOST_OF_BORDER = 0.9
"""Least share of the image's border that is outside."""
_PASSED = 1 / 3
"""Share of steps by two labels or more that pass one between, above which a map was interpolated.

Interpolated at a random place, a step by two labels passes the one between in half of all cases, longer steps
in more. Real layers of one voxel are rare: 0.01 in maps of the brain, 0.2 in thick slices of hearts.
"""
_LOOKED_AT = 2_000_000
_COUNTED = 2**22
"""Number of voxels counted at once."""
_LISTED = 2**20
"""Smaller values are counted with np.bincount, larger ones by sorting."""


def slices_of(values: Array) -> Iterator[Array]:
    """Return slices of a volume in the order of memory."""
    axis = int(np.argmax(values.strides))
    return iter(np.moveaxis(values, axis, 0))


def labels_from(path: Path, values: Array, declared: Values) -> tuple[Array, str]:
    """Return labels, and a note if they are not the file's values.

    Probabilities become 1 from half of their full value on, signed distances on the side away from the
    border of the image. Two values, one of them negative or a fraction, are a mask.

    Parameters
    ----------
    path : Path
        The file, for messages.
    values : (I, J, K) array
    declared : Values
        What the values are.

    Returns
    -------
    labels : (I, J, K) array of whole numbers
        The same array if it needs no change.
    note : str

    Raises
    ------
    InputError
        If the values are not what they were declared to be; the message says what they look like.
    """
    fractional = np.issubdtype(values.dtype, np.floating)
    values, background = _without_nan(path, values) if fractional else (values, "")
    if declared is Values.PROBABILITY:
        return _likely(path, values)
    if declared is Values.DISTANCE:
        return _inside(path, values)
    low, high = float(values.min()), float(values.max())
    if not fractional and low >= 0.0:
        return values, ""
    whole, off = _rounded(values) if fractional else (values, 0.0)
    if (off > _ROUNDING or low < 0.0) and low < high and _are_two(values, low, high):
        border = _border(values)
        outside = high if np.count_nonzero(border > (low + high) / 2.0) > _HALF * border.size else low
        inside = low + high - outside
        note = f"its values are {low:.3g} and {high:.3g}: {inside:.3g} was used as the structure"
        mask = (values > (low + high) / 2.0) == (inside == high)
        return mask * np.int32(inside if off <= _ROUNDING and inside > 0.0 else 1), note
    if off > _ROUNDING:
        looks, kind = ("signed distances", "distance") if low < 0.0 else ("probabilities", "probability")
        raise InputError(
            f"{path}: contains fractions, so it is not a label map; if they are {looks}, declare it (values: "
            f"{kind}); resample label maps with nearest neighbour, and segment pictures first"
        )
    return whole, background


def _rounded(values: Array) -> tuple[Array, float]:
    """Return the nearest whole numbers, and the largest distance to them, slice by slice as in the file."""
    whole, off = np.empty_like(values, dtype=np.int32), 0.0
    for source, target in zip(slices_of(values), slices_of(whole), strict=True):
        rounded = np.rint(source)
        off = max(off, float(np.abs(source - rounded).max()))
        target[...] = np.clip(rounded, -_LARGEST, _LARGEST)
    return whole, off


def _likely(path: Path, values: Array) -> tuple[Array, str]:
    """Return 1 from half of the full value on: of 1, or of the median of the upper half (percent, bytes)."""
    low, high = float(values.min()), float(values.max())
    full = 1.0 if high < 1.0 + _HALF else float(np.median(values[values > _HALF * high]))
    if not (abs(low) < _HALF * full and high < (1.0 + _HALF) * full):
        raise InputError(
            f"{path}: has values from {low:.3g} to {high:.3g}, which are not probabilities but look like "
            f"{'signed distances' if low < 0.0 else 'a picture'}; correct what they are declared as (values)"
        )
    note = f"voxels of at least {_HALF * full:.4g} were used as the structure"
    return (values >= _HALF * full).astype(np.uint8), note


def _inside(path: Path, values: Array) -> tuple[Array, str]:
    """Return 1 where signed distances are inside their surface."""
    low, high = float(values.min()), float(values.max())
    outside = float(np.mean(_border(values) > 0.0))
    if not low < 0.0 < high or 1.0 - _MOST_OF_BORDER < outside < _MOST_OF_BORDER:
        raise InputError(
            f"{path}: has values from {low:.3g} to {high:.3g}, which are not the distances from a surface "
            f"within the image but look like {'a picture' if low < 0.0 else 'labels or probabilities'}; "
            "correct what they are declared as (values)"
        )
    sign, where = (1, "negative") if outside > _HALF else (-1, "positive")
    return (values * sign < 0).astype(np.uint8), f"voxels with {where} distances were used as the structure"


def _are_two(values: Array, low: float, high: float) -> bool:
    """Return whether all voxels have one of two values, up to rounding."""
    near = _ROUNDING * (high - low)
    return all(((entry < low + near) | (entry > high - near)).all() for entry in slices_of(values))


def are_interpolated(labels: Array) -> bool:
    """Return whether labels pass through those between them at their edges, as interpolation makes them."""
    passing = steps = 0
    for axis in range(3):
        lines = np.moveaxis(labels, axis, 0)[:, :: max(1, labels.size // _LOOKED_AT)]
        change = np.diff(lines.astype(np.int64), axis=0)
        between = np.sign(change[:-1]) * np.sign(change[1:]) > 0
        beside = np.pad(between, [(0, 1), (0, 0), (0, 0)]) | np.pad(between, [(1, 0), (0, 0), (0, 0)])
        passing += int(np.count_nonzero(between))
        steps += int(np.count_nonzero((np.abs(change) > 1) & ~beside))
    return passing > _PASSED * (passing + steps)


def _without_nan(path: Path, values: Array) -> tuple[Array, str]:
    """Replace values that are not numbers by 0 if they are the background; also return a note."""
    if all(np.isfinite(entry).all() for entry in slices_of(values)):
        return values, ""
    border = _border(values)
    if np.isinf(values).any() or np.mean(np.isnan(border) | (border == 0)) < _MOST_OF_BORDER:
        raise InputError(f"{path}: contains values that are not numbers; export the label map again")
    return np.nan_to_num(values), "voxels without a number (NaN) were used as the background"


def _sample(values: Array) -> Array:
    """Return an evenly spaced sample of the voxels."""
    return values.ravel(order="K")[:: max(1, values.size // _LOOKED_AT)]


def box_of(mask: BoolArray) -> tuple[slice, ...]:
    """Return the smallest box around the true voxels of a mask that has some."""
    return next(box for box in ndimage.find_objects(mask.view(np.uint8)) if box is not None)


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


def labels_apart(values: Array) -> list[int]:
    """Return the labels of a map if they are separate structures, such as the bones of a hand; else none.

    In this case the other pieces together have at least half as many voxels as the largest one, and at least
    half of the labels are mostly outside it.
    """
    pieces, count = ndimage.label(values > 0, np.ones((3, 3, 3)))
    if count < 2:
        return []
    sizes = np.bincount(pieces.ravel())
    largest = int(np.argmax(sizes[1:])) + 1
    if 3 * sizes[largest] > 2 * sizes[1:].sum():
        return []
    present, number = np.unique(values[pieces > 0], return_inverse=True)
    inside = np.bincount(number, weights=pieces[pieces > 0] == largest)
    elsewhere = np.count_nonzero(inside < _HALF * np.bincount(number))
    return present.tolist() if len(present) > 1 and elsewhere >= _HALF * len(present) else []


def labels_seen(path: Path, values: Array) -> int:
    """Return the number of labels in a sample of a layer.

    Most neighbouring voxels above 0 are equal in a label map, which has regions, and differ in a picture.

    Raises
    ------
    InputError
        If it is a picture, which would make all voxels above 0 the structure.
    """
    if values.min() < 0:
        raise InputError(
            f"{path}: contains values below 0, so it is a picture or signed distances rather than a label "
            "map; segment the structure first, name a label, or declare it (values: distance)"
        )
    seen = np.unique(_sample(values))
    if np.count_nonzero(seen) > 1 and 2.0 * _differing(values) > 1.0:
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


def sides_of(values: Array) -> list[Array]:
    """Return the six outermost slices of a volume."""
    return [np.moveaxis(values, axis, 0)[end] for axis in range(3) for end in (0, -1)]


def counted(values: Array) -> Counter[int]:
    """Return the number of voxels of each value above 0."""
    n_voxels: Counter[int] = Counter()
    flat = values.ravel(order="K")
    for start in range(0, flat.size, _COUNTED):
        part = flat[start : start + _COUNTED]
        if part.dtype.kind != "u" and part.min() < 0:
            part = part[part > 0]
        if part.size and part.max() < _LISTED:
            counts = np.bincount(part.astype(np.intp, copy=False))
            present = np.flatnonzero(counts)
            n_voxels.update(dict(zip(present.tolist(), counts[present].tolist(), strict=True)))
        elif part.size:
            several, counts = np.unique(part, return_counts=True)
            n_voxels.update(dict(zip(several.tolist(), counts.tolist(), strict=True)))
    del n_voxels[0]
    return n_voxels


def cropped(values: Array, inside: Callable[[Array], Array]) -> tuple[BoolArray, tuple[int, ...]] | None:
    """Return the voxels that are inside, with a margin of one voxel, and the first index of that box.

    Works slice by slice, so that no array of the volume's size is allocated.
    """
    first = int(np.argmax(values.strides))
    stack = np.moveaxis(values, first, 0)
    rows, columns = np.zeros(stack.shape[1], np.bool_), np.zeros(stack.shape[2], np.bool_)
    depth = np.zeros(len(stack), np.bool_)
    for index, entry in enumerate(stack):
        hit = inside(entry)
        across = hit.any(axis=0)
        depth[index] = across.any()
        if depth[index]:
            columns |= across
            rows |= hit.any(axis=1)
    if not depth.any():
        return None
    spans = [np.flatnonzero(item)[[0, -1]] for item in (depth, rows, columns)]
    box = tuple(slice(max(int(low) - 1, 0), int(high) + 2) for low, high in spans)
    mask = np.moveaxis(np.asarray(inside(stack[box]), np.bool_), 0, first)
    starts = [item.start for item in box[1:]]
    starts.insert(first, box[0].start)
    return mask, tuple(starts)
