"""The voxels of one structure: largest component, cavities filled, cropped."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from homolog.arrays import BoolArray
from homolog.errors import InputError
from homolog.io.images import Segmentation
from homolog.io.values import box_of
from homolog.settings import Pieces
from homolog.surfaces.topology import without_cavities

__all__ = ["Cleaned", "cleaned", "is_pair"]

_ANY_NEIGHBOUR = np.ones((3, 3, 3), dtype=bool)
_LEAST_OF_PAIR, _MOST_OF_ALL = 0.5, 0.9
"""Two pieces are a pair if the smaller has at least the first fraction of the larger one's voxels, and both
have at least the second fraction of all voxels."""


@dataclass(frozen=True, slots=True)
class Cleaned:
    """A cleaned segmentation of one solid piece, and the changes made.

    Attributes
    ----------
    segmentation : Segmentation
        Cropped to the structure.
    components_dropped, holes_filled : int
        Smaller pieces removed; enclosed cavities filled.
    borders : tuple of (3,) tuples
        Unit vectors out of the image (LPS) where the structure touched its border and may be cut off.
    """

    segmentation: Segmentation
    components_dropped: int
    holes_filled: int
    borders: tuple[tuple[float, float, float], ...]


def cleaned(segmentation: Segmentation, pieces: Pieces = Pieces.LARGEST) -> Cleaned:
    """Keep the largest component (26-connectivity), fill its cavities, crop to it.

    Raises
    ------
    InputError
        If all components are to be kept and there are several.
    """
    box = box_of(segmentation.mask)
    mask: BoolArray = segmentation.mask[box]
    labels, count = ndimage.label(mask, _ANY_NEIGHBOUR)
    if count > 1 and pieces is Pieces.ALL:
        sizes = sorted(np.bincount(labels.ravel())[1:].tolist(), reverse=True)
        listed = ", ".join(map(str, sizes[:3])) + (" …" if count > 3 else "")
        raise InputError(
            f"is in {count} pieces that do not touch (of {listed} voxels), which can't give one surface; "
            "join them in the segmentation, or keep the largest (pieces: largest)"
        )
    if count > 1:
        mask = labels == 1 + int(np.argmax(np.bincount(labels.ravel())[1:]))
    del labels  # it has four bytes per voxel
    filled = without_cavities(mask)
    cavities = filled & ~mask
    holes = int(ndimage.label(cavities)[1]) if cavities.any() else 0
    inner = box_of(filled)
    start = np.array([outer.start + axis.start for outer, axis in zip(box, inner, strict=True)])
    stop = start + [axis.stop - axis.start for axis in inner]
    result = Segmentation(
        mask=filled[inner],
        rotation=segmentation.rotation,
        spacing=segmentation.spacing,
        origin=segmentation.origin + segmentation.rotation @ (start * segmentation.spacing),
    )
    touched = ((-1.0, start == 0), (1.0, stop == segmentation.mask.shape))
    borders = [sign * segmentation.rotation[:, axis] for sign, at in touched for axis in np.flatnonzero(at)]
    return Cleaned(result, count - 1, holes, tuple((float(x), float(y), float(z)) for x, y, z in borders))


def is_pair(mask: BoolArray) -> bool:
    """Return whether a mask is mainly two separate pieces of similar size, as both lungs are."""
    sizes = np.sort(np.bincount(ndimage.label(mask, _ANY_NEIGHBOUR)[0].ravel())[1:])
    return bool(
        len(sizes) > 1
        and sizes[-2] >= _LEAST_OF_PAIR * sizes[-1]
        and sizes[-2:].sum() >= _MOST_OF_ALL * sizes.sum()
    )
