"""Level functions on isotropic grids: negative inside, zero on the surface, in nodes."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from homolog.arrays import Array, BoolArray, Float32Array, FloatArray
from homolog.errors import InputError
from homolog.grooming.antialias import along_axis, antialiased
from homolog.grooming.slices import interpolated
from homolog.io.images import Segmentation
from homolog.surfaces.closest import thickness
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.mesh_level import BETWEEN, REACH, mesh_level, mesh_sides
from homolog.surfaces.noise import without_noise
from homolog.surfaces.redistance import redistanced
from homolog.surfaces.solid import Solid

__all__ = [
    "AUTOMATIC_NODES",
    "MANY_CROSSED",
    "MAX_NODES",
    "Level",
    "edges_crossed",
    "level_of_mesh",
    "level_of_solid",
    "level_of_voxels",
]

NEAR = 4
"""Nodes from the surface up to which distances are exact (eikonal equation)."""
PADDING = NEAR + 2
"""Nodes between the structure and the border of the grid: a cubic interpolation reads two more."""
MAX_NODES = 2**26
"""Larger grids are refused: they need several gigabytes per subject."""
AUTOMATIC_NODES = 2**24
"""Largest grid where the spacing is automatic."""
MANY_CROSSED = 1_000_000
"""Largest number of grid edges that the surface crosses, where the spacing is automatic."""
MANY_NODES = 2**21
"""Larger automatic grids are made coarser: those of label maps as far as their thinnest parts allow.

Twice as many nodes bring neither skulls nor mandibles or scapulae nearer to their landmarks and true points.
"""
NODES_ACROSS_VOXELS = 4.0
"""Nodes across a part of a label map that resolve it."""
SAMPLED_VOXELS = 250_000
"""Approximate number of voxels at which the thickness of a label map is measured."""
UNRESOLVED_SHARE = 0.005
"""Largest share of a label map's volume that need not be resolved."""
LEAST_COARSENING = 1.15
"""Least ratio of a large grid's spacing to the finest voxel spacing, or to a voxel's cube root if smaller."""
NODES_ACROSS_MESH = 2.5
"""Nodes across a thin part of a mesh that resolve it: with fewer its walls get holes."""
THIN_SHARE = 0.05
"""Share of a mesh's surface whose thickness is not considered: rims are thin on every shape."""
WALL_NODES = float(np.sqrt(3.0))
"""Nodes across a wall without holes on the grid, in any direction (Andres, Acharya and Sibata 1997).

Thinner walls are made as thick: those of a mesh, and those around a hole between slices.
"""
SAMPLED_FACES = 400_000
"""Largest number of faces at which the thickness of a mesh is measured; larger meshes are sampled evenly."""
RIM_SHARE = 0.01
"""Largest share of thin walls in the surface for which no wall is thickened."""
STACK_RATIO = 2.001
"""Distance between slices, in pixels, above which outlines are interpolated.

Voxels of 0.5 x 0.5 x 1 mm are no stack. The limit is a little above 2, since files round their sizes: all
subjects of such a cohort are treated alike.
"""

NEGLIGIBLE = 1e-9
"""Largest weight of a distant voxel in a spline that does not count: below the digits of the result."""


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """A level function with its grid.

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
        Distance between nodes [mm]; that of the finest axis if None, or more for very large structures.
    sigma : float
        Standard deviation of the smoothing [voxels].

    Raises
    ------
    InputError
        If the grid would be too large or too coarse.
    """
    finest = float(segmentation.spacing.min())
    extent = np.array(segmentation.mask.shape) * segmentation.spacing
    is_large = _count(extent, min(finest, spacing or finest)) > MANY_NODES
    step = spacing or (_sparing_step(segmentation) if is_large else finest)
    notes: tuple[str, ...] = ()
    if not spacing and step > finest:
        notes = (f"the grid was made coarser than the image: {step:.3g} mm",)
    segmentation = _turned(_coarsened(segmentation, step, is_large))
    margin = np.maximum(0.5 * (segmentation.spacing - step), 0.0)
    shape, start = _grid((np.array(segmentation.mask.shape) - 1) * segmentation.spacing, margin, step)
    is_stack = segmentation.spacing[2] > STACK_RATIO * segmentation.spacing[:2].max()
    make = _from_stack if is_stack else _from_volume
    values, further = make(segmentation, step, shape, start, sigma)
    affine = np.eye(4)
    affine[:3, :3] = segmentation.rotation * step
    affine[:3, 3] = segmentation.origin + segmentation.rotation @ start
    return Level(_closed_at_border(values), affine, step, notes + further)


def edges_crossed(segmentation: Segmentation, step: float) -> float:
    """Return how many edges of a grid a structure's surface crosses, for a distance between nodes [mm]."""
    area, padded = 0.0, np.pad(segmentation.mask, 1)
    for axis in range(3):
        along = np.moveaxis(padded, axis, 0)
        area += np.count_nonzero(along[1:] != along[:-1]) * np.delete(segmentation.spacing, axis).prod()
    return float(area / step**2)


def level_of_mesh(mesh: TriangleMesh, spacing: float | None) -> Level:
    """Return the distance to a closed mesh, near its surface.

    Parameters
    ----------
    mesh : TriangleMesh
        Closed, outward.
    spacing : float or None
        Distance between nodes [mm]; from the mesh's edges and size if None.

    Raises
    ------
    InputError
        If the grid would be too large.
    """
    shape, start, step, affine = _grid_around(mesh, spacing)
    thicker, notes = _thickened(mesh, step)
    return Level(mesh_level(thicker, start, step, shape), affine, step, notes)


def level_of_solid(solid: Solid, spacing: float | None) -> Level:
    """Return the distance to the boundary of the region with winding numbers of at least 1/2.

    Where no face is near that boundary, it is smoothed like that of voxels.

    Parameters
    ----------
    solid : Solid
        The repaired triangles, at least one.
    spacing : float or None
        As for `level_of_mesh`.
    """
    boundary = TriangleMesh(solid.mesh.vertices, solid.mesh.faces[solid.bounds])
    shape, start, step, affine = _grid_around(boundary, spacing)
    values = mesh_level(solid.mesh, start, step, shape, bounds=solid.bounds, is_closed=solid.is_closed)
    inside = values < 0.0 if solid.is_closed else mesh_sides(solid.mesh, start, step, values)
    if solid.is_closed and not _turns_far_from_faces(inside, values):
        return Level(values, affine, step)
    if inside.any():
        apart = np.clip(np.abs(values) - 1.0, 0.0, 1.0)
        even = np.clip(antialiased(inside, near_only=True), -REACH, REACH)
        exact = np.where(inside, -1.0, 1.0) * np.abs(values)
        values = ((1.0 - apart) * exact + apart * even).astype(np.float32)
    return Level(_closed_at_border(values), affine, step)


def _turns_far_from_faces(inside: BoolArray, values: Float32Array) -> bool:
    """Return whether the side changes between two nodes that no face separates."""
    for axis in range(3):
        sides, apart = (np.moveaxis(item, axis, 0) for item in (inside, np.abs(values)))
        if ((sides[1:] != sides[:-1]) & (apart[1:] + apart[:-1] > BETWEEN)).any():
            return True
    return False


def _grid_around(
    mesh: TriangleMesh, spacing: float | None
) -> tuple[tuple[int, ...], FloatArray, float, FloatArray]:
    """Return shape, first node [mm], distance of nodes [mm] and affine of a grid around a mesh."""
    corners = mesh.vertices[np.unique(mesh.faces)]
    low, high = corners.min(axis=0), corners.max(axis=0)
    diagonal = float(np.linalg.norm(high - low))
    step = spacing or float(np.clip(0.75 * mesh.mean_edge, diagonal / 250.0, diagonal / 120.0))
    if not spacing:
        finest = float(((high - low).prod() / MANY_NODES) ** (1 / 3))
        step = min(step, max(_thin_part(mesh, step) / NODES_ACROSS_MESH, finest))
    shape, start = _grid(high - low, np.zeros(3), step)
    affine = np.diag([step, step, step, 1.0])
    affine[:3, 3] = low + start
    return shape, low + start, step, affine


def _closed_at_border(values: Array) -> Array:
    """Make the border nodes outside, since open meshes and interpolated slices may reach it."""
    result = np.full_like(values, REACH)
    inner = (slice(PADDING // 2, -(PADDING // 2)),) * 3
    result[inner] = values[inner]
    return result


def _count(extent: FloatArray, step: float) -> float:
    """Return the approximate number of nodes of a grid around a structure."""
    return float(np.prod(extent / step + 2 * PADDING))


def _sparing_step(segmentation: Segmentation) -> float:
    """Return the largest spacing [mm] of nodes that resolves the thinnest parts of a large label map."""
    spacing = segmentation.spacing
    extent = np.array(segmentation.mask.shape) * spacing
    finest = float(spacing.min())
    of_voxel = float(min(spacing.prod() ** (1 / 3), LEAST_COARSENING * finest))
    of_surface = float(np.sqrt(edges_crossed(segmentation, 1.0) / MANY_CROSSED))
    step = least = max(of_voxel, of_surface, float((extent.prod() / AUTOMATIC_NODES) ** (1 / 3)))
    while _count(extent, step) > MANY_NODES:
        step *= 1.02
    every = max(1, round((segmentation.mask.size / SAMPLED_VOXELS) ** (1 / 3)))
    some = np.pad(segmentation.mask[::every, ::every, ::every], 1)
    depth = ndimage.distance_transform_edt(some, every * spacing)
    while step > least:
        radius = 0.5 * NODES_ACROSS_VOXELS * step
        opened = ndimage.distance_transform_edt(depth < radius, every * spacing) <= radius
        if np.count_nonzero(some & ~opened) <= UNRESOLVED_SHARE * np.count_nonzero(some):
            return step
        step *= 0.8
    return least


def _thickened(mesh: TriangleMesh, step: float) -> tuple[TriangleMesh, tuple[str, ...]]:
    """Return a mesh with walls of a minimum thickness, and a note on the changes.

    A wall thinner than the grid resolves would have holes. Rims, which are thin on every shape, are not
    changed.
    """
    least = WALL_NODES * step
    even = without_noise(mesh, 0.5 * step)
    every = -(-len(mesh.faces) // SAMPLED_FACES)
    areas, through = mesh.face_areas[::every], thickness(even, every)
    if areas[through < least].sum() <= RIM_SHARE * areas.sum():
        return mesh, ()
    thinnest = np.full(len(mesh.vertices), np.inf)
    np.minimum.at(thinnest, mesh.faces.ravel(), np.repeat(through if every == 1 else thickness(even), 3))
    shift = 0.5 * np.maximum(least - thinnest, 0.0)
    share = 100.0 * np.mean(shift > 0.0)
    note = (
        f"walls thinner than the grid resolves were made {least:.2g} mm thick: {share:.0f} % of the surface "
        f"moved outward by {shift[shift > 0.0].mean():.2g} mm on average and {shift.max():.2g} mm at most"
    )
    return TriangleMesh(mesh.vertices + shift[:, None] * even.vertex_normals, mesh.faces), (note,)


def _thin_part(mesh: TriangleMesh, step: float) -> float:
    """Return the thickness [mm] that all but `THIN_SHARE` of the surface's area exceeds."""
    every = -(-len(mesh.faces) // SAMPLED_FACES)
    through, areas = thickness(without_noise(mesh, 0.5 * step), every), mesh.face_areas[::every]
    order = np.argsort(through)
    share = np.cumsum(areas[order]) / max(float(areas.sum()), 1e-300)
    return float(through[order[min(int(np.searchsorted(share, THIN_SHARE)), len(order) - 1)]])


def _turned(segmentation: Segmentation) -> Segmentation:
    """Permute the axes cyclically, so that the frame stays right-handed, to put the coarsest last."""
    turn = (np.arange(3) + int(np.argmax(segmentation.spacing)) + 1) % 3
    return Segmentation(
        segmentation.mask.transpose(turn),
        segmentation.rotation[:, turn],
        segmentation.spacing[turn],
        segmentation.origin,
    )


def _coarsened(segmentation: Segmentation, step: float, is_large: bool) -> Segmentation:
    """Merge voxels where the grid is at least twice as coarse as the image.

    Blocks that are exactly half inside become inside. In a large structure only every second one does, which
    preserves the volume.
    """
    from skimage.measure import block_reduce

    factor = np.maximum(1, np.floor(step / segmentation.spacing + 1e-6)).astype(int)
    if (factor == 1).all():
        return segmentation
    share = block_reduce(segmentation.mask.astype(np.float32), tuple(factor), np.mean)
    mask = np.asarray(share >= 0.5)
    if is_large:
        i, j, k = np.ogrid[tuple(map(slice, share.shape))]
        mask &= (share > 0.5) | ((i + j + k) % 2 == 0)
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
    """Return the number of nodes and the position of the first one [mm from the structure's corner]."""
    shape = np.ceil((extent + 2.0 * margin) / step - 1e-6) + 1 + 2 * PADDING
    if shape.prod() > MAX_NODES:
        least = step * (shape.prod() / MAX_NODES) ** (1 / 3)
        raise InputError(
            f"needs a grid of {shape.prod():.2g} nodes at {step:g} mm; "
            f"set the grid spacing to {least:.2g} mm or more"
        )
    return tuple(shape.astype(int).tolist()), -margin - PADDING * step


def _from_volume(
    segmentation: Segmentation,
    step: float,
    shape: tuple[int, ...],
    start: FloatArray,
    smoothing: float,
) -> tuple[Array, tuple[str, ...]]:
    padded, first = _padded(segmentation, start, (0, 1, 2))
    level = antialiased(padded, smoothing, near_only=True)
    return _resampled(level, segmentation.spacing, step, shape, start, first), ()


def _from_stack(
    segmentation: Segmentation,
    step: float,
    shape: tuple[int, ...],
    start: FloatArray,
    smoothing: float,
) -> tuple[Array, tuple[str, ...]]:
    spacing = segmentation.spacing
    padded, first = _padded(segmentation, start, (0, 1))
    heights = (start[2] + step * np.arange(shape[2])) / spacing[2]
    stack = interpolated(padded, spacing[2] / spacing[:2].mean(), heights, smoothing)
    place = np.array([*spacing[:2], step]), step, shape, start, np.array([*first[:2], start[2]])
    outline = _resampled(stack.outline, *place)
    level = np.maximum(outline, stack.ends)
    if stack.hole is not None:
        wall = redistanced(outline, reach=NEAR) + WALL_NODES
        level = np.maximum(level, -np.maximum(_resampled(stack.hole, *place), wall))
    notes = [f"slices {spacing[2]:g} mm apart were interpolated as outlines"]
    if stack.closed:
        notes.append("the hole through the slices was closed at its narrow end")
    return level, tuple(notes)


def _padded(
    segmentation: Segmentation, start: FloatArray, axes: tuple[int, ...]
) -> tuple[BoolArray, FloatArray]:
    """Pad the mask so that it covers the grid; return it and the position of its first voxel [mm]."""
    width = np.zeros(3, int)
    width[list(axes)] = np.ceil(-start / segmentation.spacing - 1e-6)[list(axes)]
    padded = np.pad(segmentation.mask, [(int(item), int(item)) for item in width])
    return padded, -width * segmentation.spacing


def _resampled(
    level: Float32Array,
    spacing: FloatArray,
    step: float,
    shape: tuple[int, ...],
    start: FloatArray,
    first: FloatArray,
) -> Array:
    """Interpolate a level function at the nodes of the grid with cubic splines, axis by axis."""
    offset = (start - first) / spacing
    if level.shape == shape and np.allclose(spacing, step) and np.allclose(offset, 0.0):
        return level
    for axis in range(3):
        count, ratio = level.shape[axis], step / spacing[axis]
        splines: Array = ndimage.affine_transform(
            np.eye(count), [ratio, 1.0], [offset[axis], 0.0], (shape[axis], count), order=3, mode="nearest"
        )
        splines[np.abs(splines) < NEGLIGIBLE] = 0.0
        level = along_axis(splines.astype(np.float32), level, axis)
    return level
