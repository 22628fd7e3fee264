"""Missing slices of a label map: a single empty one between others, or labels on every n-th slice only."""

from dataclasses import replace

import numpy as np
from scipy import ndimage

from homolog.arrays import Array, BoolArray, IntArray
from homolog.io.images import Segmentation

__all__ = ["with_missing_slices"]

_ALIKE = 0.5
"""Least Dice overlap of two slices of one structure: nearer to equal than to apart."""
_FEWEST = 4
"""Least number of labelled slices that show a regular distance."""
_ORDINALS = {2: "second", 3: "third"}


def with_missing_slices(segmentation: Segmentation) -> tuple[Segmentation, tuple[str, ...]]:
    """Return a structure with its missing slices filled, and notes on them.

    If only every n-th slice is labelled, the labelled slices become a stack of thick slices. A single empty
    slice between two that overlap is filled halfway between their outlines.

    Parameters
    ----------
    segmentation : Segmentation
        At least one voxel.
    """
    notes = []
    for axis in range(3):
        slices = np.moveaxis(segmentation.mask, axis, 0)
        labelled = np.flatnonzero(slices.any(axis=(1, 2)))
        apart = np.diff(labelled)
        if not (apart > 1).any():
            continue
        every = int(apart[0])
        if every > 1 and len(labelled) >= _FEWEST and (apart == every).all() and _overlap(slices[labelled]):
            segmentation = _thick(segmentation, axis, labelled, every)
            which = _ORDINALS.get(every, f"{every}th")
            notes.append(f"only every {which} slice is labelled; those between were interpolated")
        elif len(missing := _single(slices, labelled[:-1][apart == 2] + 1)):
            mask = slices.copy()
            for index in missing.tolist():
                mask[index] = _between(slices[index - 1], slices[index + 1])
            segmentation = replace(segmentation, mask=np.moveaxis(mask, 0, axis))
            notes.append(f"empty slices between slices of the structure were filled: {len(missing)}")
    return segmentation, tuple(notes)


def _single(slices: BoolArray, empty: IntArray) -> IntArray:
    """Return the empty slices whose neighbours overlap."""
    return (
        empty[[_overlap(slices[[index - 1, index + 1]]) for index in empty.tolist()]] if len(empty) else empty
    )


def _overlap(slices: BoolArray) -> bool:
    """Return whether most neighbouring slices overlap."""
    both = (slices[1:] & slices[:-1]).sum(axis=(1, 2))
    areas = slices.sum(axis=(1, 2))
    return float(np.median(2.0 * both / (areas[1:] + areas[:-1]))) >= _ALIKE


def _thick(segmentation: Segmentation, axis: int, labelled: IntArray, every: int) -> Segmentation:
    """Return only the labelled slices, each as thick as their distance, with an empty slice at either end."""
    first = int(labelled[0])
    mask = np.take(segmentation.mask, labelled, axis)
    ends = [(0, 0)] * 3
    ends[axis] = (1, 1)
    spacing = segmentation.spacing * np.where(np.arange(3) == axis, every, 1)
    shift = segmentation.rotation[:, axis] * segmentation.spacing[axis] * (first - every)
    return replace(segmentation, mask=np.pad(mask, ends), spacing=spacing, origin=segmentation.origin + shift)


def _between(below: BoolArray, above: BoolArray) -> BoolArray:
    """Return the outline halfway between two outlines."""
    return np.asarray(_signed(below) + _signed(above) < 0.0)


def _signed(mask: BoolArray) -> Array:
    padded = np.pad(mask, 1)
    distances = ndimage.distance_transform_edt(~padded) - ndimage.distance_transform_edt(padded)
    return np.asarray(distances[1:-1, 1:-1])
