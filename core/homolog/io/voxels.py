"""Values of label arrays: counts, outermost slices, boxes around structures."""

from collections import Counter
from collections.abc import Callable

import numpy as np

from homolog.arrays import Array, BoolArray

__all__ = ["counted", "cropped", "sides_of"]

_COUNTED = 2**22
"""Number of voxels counted at once."""

_LISTED = 2**20
"""Smaller values are counted with np.bincount, larger ones by sorting."""


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
