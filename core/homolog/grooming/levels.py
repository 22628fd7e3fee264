"""Level functions on isotropic grids: negative inside, zero on the surface, in nodes."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from homolog.arrays import Array, BoolArray, Float32Array, FloatArray
from homolog.errors import InputError
from homolog.grooming.antialias import antialiased
from homolog.grooming.images import Segmentation
from homolog.grooming.slices import interpolated
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.mesh_level import mesh_level
from homolog.surfaces.redistance import redistanced

__all__ = ["MAX_NODES", "Level", "level_of_mesh", "level_of_voxels"]

PADDING = 6
"""Nodes between the structure and the border of the grid."""
MAX_NODES = 2**26
"""Larger grids are refused: they ask for several gigabytes per subject."""
USUAL_NODES = 2**24
"""Where the user gives no spacing, it is chosen so that the grid is not larger."""
STACK_FROM = 2.0
"""Slices this many times further apart than the pixels are interpolated as outlines."""
THINNEST = 2.0
"""Nodes across the wall around a hole between slices: less would be lost on the grid."""


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """A level function and where its grid is.

    Attributes
    ----------
    values : (I, J, K) array
        Negative inside, about the distance near the surface [nodes]; the border is outside.
    index_to_world : (4, 4) float64 array
        From grid indices to LPS millimetres.
    step : float
        Distance between nodes [mm].
    notes : tuple of str
        Sentences for the user on how it was made.
    """

    values: Array
    index_to_world: FloatArray
    step: float
    notes: tuple[str, ...] = ()


def level_of_voxels(segmentation: Segmentation, spacing: float | None, sigma: float) -> Level:
    """Return a smooth level function of a segmentation, grid axes along those of the image.

    Parameters
    ----------
    segmentation : Segmentation
        One piece, cropped.
    spacing : float or None
        Distance between nodes [mm]; that of the finest axis if None, more for very large structures.
    sigma : float
        Standard deviation of the smoothing [voxels].

    Raises
    ------
    InputError
        If the grid would be too large or too coarse.
    """
    extent = np.array(segmentation.mask.shape) * segmentation.spacing
    finest = float(segmentation.spacing.min())
    step = spacing or max(finest, float((extent.prod() / USUAL_NODES) ** (1 / 3)))
    notes: tuple[str, ...] = ()
    if not spacing and step > finest:
        notes = (f"the grid was made coarser than the image: {step:.3g} mm",)
    segmentation = _turned(_coarsened(segmentation, step))
    margin = np.maximum(0.5 * (segmentation.spacing - step), 0.0)
    shape, start = _grid((np.array(segmentation.mask.shape) - 1) * segmentation.spacing, margin, step)
    is_stack = segmentation.spacing[2] > STACK_FROM * segmentation.spacing[:2].max()
    make = _from_stack if is_stack else _from_volume
    values, further = make(segmentation, step, shape, start, sigma)
    affine = np.eye(4)
    affine[:3, :3] = segmentation.rotation * step
    affine[:3, 3] = segmentation.origin + segmentation.rotation @ start
    return Level(values, affine, step, notes + further)


def level_of_mesh(mesh: TriangleMesh, spacing: float | None) -> Level:
    """Return the distance to a closed mesh, as far as it is needed.

    Parameters
    ----------
    mesh : TriangleMesh
        Closed.
    spacing : float or None
        Distance between nodes [mm]; from the mesh's edges and size if None.

    Raises
    ------
    InputError
        If the grid would be too large.
    """
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    diagonal = float(np.linalg.norm(high - low))
    step = spacing or float(np.clip(0.75 * mesh.mean_edge, diagonal / 250.0, diagonal / 120.0))
    shape, start = _grid(high - low, np.zeros(3), step)
    affine = np.diag([step, step, step, 1.0])
    affine[:3, 3] = low + start
    return Level(mesh_level(mesh, low + start, step, shape), affine, step)


def _turned(segmentation: Segmentation) -> Segmentation:
    """Permute the axes cyclically, so that the frame stays right-handed, to put the coarsest last."""
    turn = (np.arange(3) + int(np.argmax(segmentation.spacing)) + 1) % 3
    return Segmentation(
        segmentation.mask.transpose(turn),
        segmentation.rotation[:, turn],
        segmentation.spacing[turn],
        segmentation.origin,
    )


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


def _grid(extent: FloatArray, margin: FloatArray, step: float) -> tuple[tuple[int, ...], FloatArray]:
    """Return number of nodes and place of the first one [mm from the structure's corner]."""
    shape = np.ceil((extent + 2.0 * margin) / step - 1e-6) + 1 + 2 * PADDING
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
