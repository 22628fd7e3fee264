"""The voxels of one structure: largest component, cavities filled, cropped."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from homolog.arrays import BoolArray, FloatArray, IntArray
from homolog.grooming.levels import STACK_RATIO
from homolog.io.images import Segmentation
from homolog.io.values import box_of
from homolog.settings import Pieces
from homolog.surfaces.topology import without_cavities

__all__ = ["Cleaned", "cleaned", "is_pair"]

_ANY_NEIGHBOUR = np.ones((3, 3, 3), dtype=bool)
_BRIDGE = 2.0
"""Radius of bridges [voxels]. Smoothing by σ leaves 1 - exp(-r²/2σ²) at the axis of a rod, which must be more
than a half: r > 1.2 σ, and grooming adds up to σ = 1.3 by default."""


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
    bridges : tuple of float
        Lengths of the bridges that join pieces [mm].
    """

    segmentation: Segmentation
    components_dropped: int
    holes_filled: int
    borders: tuple[tuple[float, float, float], ...]
    bridges: tuple[float, ...] = ()


def cleaned(segmentation: Segmentation, pieces: Pieces = Pieces.LARGEST) -> Cleaned:
    """Keep the largest component (26-connectivity) or join all, fill cavities, crop to the result.

    In a stack of slices, pieces are one if their outlines touch in neighbouring slices.
    """
    box = box_of(segmentation.mask)
    mask: BoolArray = segmentation.mask[box]
    labels: IntArray
    labels, count = ndimage.label(mask, _ANY_NEIGHBOUR)
    bridges: tuple[float, ...] = ()
    if count > 1:
        axis = int(np.argmax(segmentation.spacing))
        if segmentation.spacing[axis] > STACK_RATIO * np.delete(segmentation.spacing, axis).max():
            labels, count = _joined_slices(np.moveaxis(labels, axis, 2), count, axis)
    if count > 1 and pieces is Pieces.ALL:
        mask, bridges = _bridged(mask, labels, count, segmentation.spacing)
        count = 1
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
    outward = tuple((float(x), float(y), float(z)) for x, y, z in borders)
    return Cleaned(result, count - 1, holes, outward, bridges)


def _joined_slices(labels: IntArray, count: int, axis: int) -> tuple[IntArray, int]:
    """Return the labels of pieces, one for those whose outlines touch in neighbouring slices.

    A cap that lies below the opening of a ring touches its outline, not its voxels. What lies within a
    hole of its own slice has no outline there.

    Parameters
    ----------
    labels : (I, J, K) int array
        The pieces from 1, with slices along the last axis.
    count : int
        Number of pieces.
    axis : int
        Where that axis belongs in the result.
    """
    outlines = np.zeros_like(labels)
    for k in range(labels.shape[2]):
        filled, areas = ndimage.label(without_cavities(labels[..., k] > 0), _ANY_NEIGHBOUR[0])
        beside = np.pad(filled, 1) == 0
        rim = ndimage.binary_dilation(beside)[1:-1, 1:-1] & (filled > 0)
        owners = np.zeros(areas + 1, labels.dtype)
        owners[filled[rim]] = labels[..., k][rim]
        outlines[..., k] = owners[filled]
    near = ndimage.grey_dilation(outlines, size=(3, 3, 1))
    both = (near[..., :-1] > 0) & (outlines[..., 1:] > 0)
    touching = near[..., :-1][both], outlines[..., 1:][both]
    links = coo_array((np.ones(np.count_nonzero(both)), touching), (count + 1, count + 1))
    number, whole = connected_components(links, directed=False)
    return np.moveaxis(np.where(labels > 0, whole[labels], 0), 2, axis), number - 1


def _bridged(
    mask: BoolArray, labels: IntArray, count: int, spacing: FloatArray
) -> tuple[BoolArray, tuple[float, ...]]:
    """Return a mask with all pieces joined by the shortest bridges, and their lengths [mm]."""
    rims = np.argwhere(mask & ~ndimage.binary_erosion(mask, _ANY_NEIGHBOUR))
    owners = labels[tuple(rims.T)]
    far, nearest = np.full(len(rims), np.inf), np.zeros(len(rims), np.intp)
    added, lengths = np.zeros_like(mask), []
    last, left = 1 + int(np.argmax(np.bincount(labels.ravel())[1:])), owners > 0
    for _ in range(count - 1):
        joined = np.flatnonzero(owners == last)
        left &= owners != last
        tree = KDTree(rims[joined] * spacing)
        apart, there = (np.asarray(item) for item in tree.query(rims[left] * spacing))
        closer = np.flatnonzero(left)[apart < far[left]]
        nearest[closer], far[closer] = joined[there[apart < far[left]]], apart[apart < far[left]]
        end = int(np.flatnonzero(left)[np.argmin(far[left])])
        steps = 1 + 2 * int(np.abs(rims[end] - rims[nearest[end]]).max())
        line = np.rint(np.linspace(rims[end], rims[nearest[end]], steps)).astype(int)
        added[tuple(line.T)] = True
        lengths.append(float(far[end]))
        last = int(owners[end])
    finest = float(spacing.min())
    away = ndimage.distance_transform_edt(~added, np.minimum(spacing, _BRIDGE * finest))
    return mask | (away <= _BRIDGE * finest), tuple(lengths)


def is_pair(mask: BoolArray) -> bool:
    """Return whether exactly two pieces of a mask are of similar size, as both lungs are.

    A piece of less than half the largest one's size is nearer to nothing than to it.
    """
    sizes = np.bincount(ndimage.label(mask, _ANY_NEIGHBOUR)[0].ravel())[1:]
    return int(np.count_nonzero(2 * sizes >= sizes.max(initial=0))) == 2
