"""From the voxels of one structure to its distance field on an isotropic grid."""

import numpy as np
from scipy import ndimage

from homolog.arrays import Array, BoolArray, Float32Array, FloatArray
from homolog.errors import InputError
from homolog.grooming.antialias import antialiased, smoothed
from homolog.grooming.images import Segmentation
from homolog.grooming.slices import interpolated
from homolog.surfaces.distance_field import DistanceField
from homolog.surfaces.isosurface import marching_cubes
from homolog.surfaces.redistance import redistanced
from homolog.surfaces.topology import euler_number

__all__ = ["MAX_NODES", "distance_field"]

PADDING = 6
"""Nodes between the structure and the border of the grid."""
MAX_NODES = 2**26
"""Larger grids are refused: they ask for several gigabytes per subject."""
STACK_FROM = 2.0
"""Slices this many times further apart than the pixels are interpolated as outlines."""
THINNEST = 2.0
"""Nodes across the wall around a hole between slices: less would be lost on the grid."""
_FINAL = 0.85  # of the smoothing, after the distances are made
_KEPT = 0.2  # nodes: how far from zero a node on its own side is kept, if the topology would change


def distance_field(
    segmentation: Segmentation, spacing: float | None, smoothing: float
) -> tuple[DistanceField, tuple[str, ...]]:
    """Return the signed distance to the smooth surface of a segmentation.

    Parameters
    ----------
    segmentation : Segmentation
        One piece, cropped.
    spacing : float or None
        Node spacing [mm]; that of the finest axis if None.
    smoothing : float
        Standard deviation [voxels].

    Returns
    -------
    DistanceField
        In the frame of the file, grid axes along those of the image.
    tuple of str
        Notes for the user.

    Raises
    ------
    InputError
        If the grid would be too large.
    """
    step = spacing or float(segmentation.spacing.min())
    segmentation = _coarsened(segmentation, step)
    order = np.argsort(segmentation.spacing, kind="stable")
    if segmentation.spacing[order[2]] > STACK_FROM * segmentation.spacing[order[1]]:
        axis = int(order[2])
        turned = (np.arange(3) + axis + 1) % 3  # a cyclic permutation, so that the frame stays right-handed
        mask = segmentation.mask.transpose(turned)
        rotation, spacings = segmentation.rotation[:, turned], segmentation.spacing[turned]
        segmentation = Segmentation(mask, rotation, spacings, segmentation.origin)
        make = _from_stack
    else:
        make = _from_volume
    shape, start = _grid(segmentation, step)
    level, notes = make(segmentation, step, shape, start, smoothing)
    level, dropped = _one_solid(level)
    if dropped:
        notes = (*notes, f"{dropped} small piece(s) came loose in smoothing and were dropped")
    values = step * _smoothed_alike(redistanced(level), _FINAL * smoothing)
    affine = np.eye(4)
    affine[:3, :3] = segmentation.rotation * step
    affine[:3, 3] = segmentation.origin + segmentation.rotation @ start
    return DistanceField(values, affine), notes


def _coarsened(segmentation: Segmentation, step: float) -> Segmentation:
    """Merge voxels where the grid is at least twice as coarse as the image."""
    from skimage.measure import block_reduce

    factor = np.maximum(1, np.floor(step / segmentation.spacing + 1e-6)).astype(int)
    if (factor == 1).all():
        return segmentation
    share = block_reduce(segmentation.mask.astype(np.float32), tuple(factor), np.mean)
    mask = np.asarray(share >= 0.5)
    if not mask.any():
        raise InputError(f"is smaller than the grid spacing of {step:g} mm; choose a finer one")
    shift = 0.5 * (factor - 1) * segmentation.spacing
    return Segmentation(
        mask,
        segmentation.rotation,
        segmentation.spacing * factor,
        segmentation.origin + segmentation.rotation @ shift,
    )


def _grid(segmentation: Segmentation, step: float) -> tuple[tuple[int, ...], FloatArray]:
    """Return number of nodes and place of the first one [mm from voxel (0, 0, 0), along the axes]."""
    margin = np.maximum(0.5 * (segmentation.spacing - step), 0.0)
    extent = (np.array(segmentation.mask.shape) - 1) * segmentation.spacing + 2.0 * margin
    shape = np.ceil(extent / step - 1e-6) + 1 + 2 * PADDING
    if shape.prod() > MAX_NODES:
        least = step * (shape.prod() / MAX_NODES) ** (1 / 3)
        raise InputError(
            f"needs a grid of {shape.prod():.2g} nodes at {step:g} mm; "
            f"set the grid spacing to {least:.2g} mm or more"
        )
    return tuple(shape.astype(int).tolist()), -margin - PADDING * step


def _from_volume(
    segmentation: Segmentation, step: float, shape: tuple[int, ...], start: FloatArray, smoothing: float
) -> tuple[Array, tuple[str, ...]]:
    padded, first = _padded(segmentation, start, (0, 1, 2))
    return _resampled(antialiased(padded, smoothing), segmentation.spacing, step, shape, start, first), ()


def _from_stack(
    segmentation: Segmentation, step: float, shape: tuple[int, ...], start: FloatArray, smoothing: float
) -> tuple[Array, tuple[str, ...]]:
    spacing = segmentation.spacing
    padded, first = _padded(segmentation, start, (0, 1))
    heights = (start[2] + step * np.arange(shape[2])) / spacing[2]
    stack = interpolated(padded, spacing[2] / spacing[:2].mean(), heights, smoothing)
    place = np.array([*spacing[:2], step]), step, shape, start, np.array([*first[:2], start[2]])
    outline = _resampled(stack.outline, *place)
    level = np.maximum(outline, stack.ends)
    if stack.hole is not None:
        wall = redistanced(outline) + THINNEST
        level = np.maximum(level, -np.maximum(_resampled(stack.hole, *place), wall))
    notes = [f"slices {spacing[2]:g} mm apart were interpolated as outlines"]
    if stack.closed:
        notes.append("the hole through the slices was closed at its narrow end")
    return level, tuple(notes)


def _padded(
    segmentation: Segmentation, start: FloatArray, axes: tuple[int, ...]
) -> tuple[BoolArray, FloatArray]:
    """Pad the mask so that it covers the grid; return it and the place of its first voxel [mm]."""
    width = np.zeros(3, int)
    width[list(axes)] = np.ceil(-start / segmentation.spacing - 1e-6)[list(axes)]
    padded = np.pad(segmentation.mask, [(int(one), int(one)) for one in width])
    return padded, -width * segmentation.spacing


def _resampled(
    level: Float32Array,
    spacing: FloatArray,
    step: float,
    shape: tuple[int, ...],
    start: FloatArray,
    first: FloatArray,
) -> Array:
    """Interpolate a level function at the nodes of the grid with cubic splines."""
    offset = (start - first) / spacing
    if level.shape == shape and np.allclose(spacing, step) and np.allclose(offset, 0.0):
        return level
    resampled: Array = ndimage.affine_transform(
        level, step / spacing, offset, output_shape=shape, order=3, mode="nearest", output=np.float32
    )
    return resampled


def _smoothed_alike(distances: Float32Array, sigma: float) -> Array:
    """Smooth; where that would open or close holes, keep every node on its own side of the zero level."""
    result = smoothed(distances, sigma)
    if euler_number(marching_cubes(result)[1]) == euler_number(marching_cubes(distances)[1]):
        return result
    side = np.where(distances < 0.0, -1.0, 1.0)
    return np.asarray(side * np.maximum(side * result, np.minimum(np.abs(distances), _KEPT)))


def _one_solid(level: Array) -> tuple[Array, int]:
    """Keep the largest component of the inside, without cavities; return how many were dropped."""
    labels, count = ndimage.label(level < 0.0)
    solid = ndimage.binary_fill_holes(labels == 1 + int(np.argmax(np.bincount(labels.ravel())[1:])))
    return np.where(solid, -1.0, 1.0) * np.maximum(np.abs(level), 1e-3), count - 1
