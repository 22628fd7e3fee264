"""From a level function to the distance field of one solid."""

import numpy as np
from scipy import ndimage

from homolog.arrays import Array, BoolArray, Float32Array
from homolog.errors import InputError
from homolog.grooming.antialias import smoothed
from homolog.grooming.levels import NEAR, Level
from homolog.grooming.tunnels import euler_numbers, fill_tunnels
from homolog.surfaces.distance_field import DistanceField
from homolog.surfaces.isosurface import marching_cubes
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.redistance import redistanced
from homolog.surfaces.topology import without_cavities

__all__ = ["ENOUGH", "distance_field", "restored", "volume_inside"]

_FINAL = 0.85  # fraction of the smoothing that is applied to the distances
ENOUGH = 0.95
"""Fraction of a structure's volume; a surface that encloses less is moved outward."""
_FARTHEST = 0.4  # voxels: largest such displacement
_ROUNDS, _EXACT = 4, 0.02  # iterations of the displacement; tolerance as a fraction of the volume
_OF_PATCHES = -0.3  # nodes: level of the nodes that fill a tunnel
_KEPT = 0.2  # nodes: least distance from zero of nodes kept on their side to preserve the topology


def distance_field(
    level: Level, smoothing: float, tunnels: float = 0.0
) -> tuple[DistanceField, tuple[str, ...], int]:
    """Return the signed distance to the zero level, smooth enough for second derivatives.

    Parameters
    ----------
    level : Level
        Its scale away from the surface does not matter.
    smoothing : float
        Standard deviation [nodes].
    tunnels : float
        Width below which tunnels are filled [nodes].

    Returns
    -------
    DistanceField
        On the grid of the level function; one solid without cavities.
    tuple of str
        Notes for the user, those of the level function first.
    int
        Number of pieces that smoothing separated and that were dropped.

    Raises
    ------
    InputError
        If no node is inside.
    """
    if not (level.values < 0.0).any():
        raise InputError("the shape vanishes on this grid; use a finer grid spacing")
    solid, loose = _one_solid(level.values)
    notes = level.notes
    inside, filled = fill_tunnels(solid < 0.0, tunnels)
    if filled:
        solid = np.where(inside & (solid > 0.0), _OF_PATCHES, solid)
        notes = (*notes, f"tunnels narrower than {tunnels:g} nodes of the grid were filled: {filled}")
    distances = redistanced(solid, reach=NEAR)
    values = _smoothed_alike(distances, _FINAL * smoothing)
    return DistanceField(values * np.float32(level.step), level.index_to_world), notes, loose


def volume_inside(field: DistanceField) -> float:
    """Return the volume within the largest piece of a field's zero level [mm³]."""
    if not (field.values < 0.0).any():
        return 0.0
    return TriangleMesh(*marching_cubes(field.values)).volume * field.spacing**3


def restored(field: DistanceField, volume: float, voxel: float) -> DistanceField:
    """Return a field whose surface is moved outward until it encloses enough of a structure's volume.

    Smoothing shrinks structures of few voxels. The surface is moved by less than half a voxel, and only if
    this does not change its topology.

    Parameters
    ----------
    field : DistanceField
    volume : float
        Volume of the structure's voxels [mm³].
    voxel : float
        Edge of a voxel [mm].

    Returns
    -------
    DistanceField
        The input field if it encloses enough.
    """
    moved = 0.0
    for _ in range(_ROUNDS):
        surface = TriangleMesh(*marching_cubes(field.values - np.float32(moved)))
        missing = ENOUGH * volume - surface.volume * field.spacing**3
        if -_EXACT * volume < missing <= 0.0:
            break
        change = missing / (surface.area * field.spacing**2)
        moved = float(np.clip(moved + change, 0.0, _FARTHEST * voxel))
    values = field.values - np.float32(moved)
    if moved == 0.0 or not _alike(values, field.values):
        return field
    return DistanceField(values, field.index_to_world)


def _alike(values: Array, others: Array) -> bool:
    """Return whether two level functions have one zero level each, of the same topology."""
    whole = all(_pieces(item) == 1 for item in (values, -values))
    return whole and _euler_number(values) == _euler_number(others)


def _smoothed_alike(distances: Float32Array, sigma: float) -> Float32Array:
    """Smooth; if this changes the topology, keep every node on its own side of the zero level."""
    result = smoothed(distances, sigma)
    if ndimage.label(result < 0.0)[1] != 1 or ndimage.label(result > 0.0)[1] != 1:
        return _on_own_side(result, distances)
    before, after = _euler_number(distances), _euler_number(result)
    if after == before or (after > before and _doubtful(distances < 0.0, after)):
        return result
    return _on_own_side(result, distances)


def _pieces(values: Array) -> int:
    """Return the number of components of the nodes below zero."""
    return int(ndimage.label(values < 0.0)[1])


def _on_own_side(result: Float32Array, distances: Float32Array) -> Float32Array:
    """Return smoothed values constrained so that every node stays on its side of the zero level."""
    return np.where((result < 0.0) == (distances < 0.0), result, np.clip(distances, -_KEPT, _KEPT))


def _euler_number(values: Array) -> int:
    if not (values < 0.0).any():  # smoothed away
        return 0
    vertices, faces = marching_cubes(values)
    return len(vertices) - len(faces) // 2


def _doubtful(inside: BoolArray, euler: int) -> bool:
    """Whether a handle may be spurious: it depends on nodes that touch only at an edge or corner."""
    bounds = sorted(2 * number for number in euler_numbers(inside))
    return bounds[0] <= euler <= bounds[1]


def _one_solid(level: Array) -> tuple[Array, int]:
    """Keep the largest component of the inside and fill its cavities; also return how many were dropped."""
    labels, count = ndimage.label(level < 0.0)
    solid = without_cavities(labels == 1 + int(np.argmax(np.bincount(labels.ravel())[1:])))
    size = np.maximum(np.abs(level), 1e-3)
    return np.where(solid, -size, size), count - 1
