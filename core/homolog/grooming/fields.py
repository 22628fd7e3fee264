"""From a level function to the distance field of one solid."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from homolog.arrays import Array, Float32Array
from homolog.errors import InputError
from homolog.grooming.antialias import smoothed
from homolog.grooming.levels import NEAR, Level
from homolog.grooming.tunnels import euler_numbers, fill_tunnels
from homolog.surfaces.distance_field import DistanceField
from homolog.surfaces.isosurface import zero_level
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.redistance import redistanced
from homolog.surfaces.topology import without_cavities

__all__ = ["ENOUGH", "SmoothField", "distance_field", "restored"]

_FINAL = 0.85  # fraction of the smoothing that is applied to the distances
ENOUGH = 0.95
"""Fraction of a structure's volume; a surface that encloses less is moved outward."""
_FARTHEST = 0.4  # voxels: largest such displacement
_ROUNDS, _EXACT = 4, 0.02  # iterations of the displacement; tolerance as a fraction of the volume
_OF_PATCHES = -0.3  # nodes: level of the nodes that fill a tunnel
_KEPT = 0.2  # nodes: least distance from zero of nodes kept on their side to preserve the topology


@dataclass(frozen=True, slots=True, eq=False)
class SmoothField:
    """The distance to one solid without cavities, smooth enough for second derivatives.

    Attributes
    ----------
    field : DistanceField
        On the grid of the level function.
    surface : TriangleMesh
        Its zero level, by marching cubes.
    notes : tuple of str
        Notes for the user, those of the level function first.
    pieces_dropped : int
        Number of pieces that smoothing separated and that were dropped.
    """

    field: DistanceField
    surface: TriangleMesh
    notes: tuple[str, ...]
    pieces_dropped: int


def distance_field(level: Level, smoothing: float, tunnels: float = 0.0) -> SmoothField:
    """Return the signed distance to the zero level.

    Parameters
    ----------
    level : Level
        Its scale away from the surface does not matter.
    smoothing : float
        Standard deviation [nodes].
    tunnels : float
        Width below which tunnels are filled [nodes].

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
    if max(filled) > 0:
        patched = np.where(inside & (solid > 0.0), _OF_PATCHES, solid)
        number = min(filled)
        if number <= 0:  # nodes along a sharp edge touch only at corners; the surface between them is closed
            number = min(max(filled), (_euler_number(_zero(patched)) - _euler_number(_zero(solid))) // 2)
        if number > 0:
            notes = (*notes, f"tunnels narrower than {tunnels:g} nodes of the grid were filled: {number}")
        solid = patched
    distances = redistanced(solid, reach=NEAR)
    values = smoothed(distances, _FINAL * smoothing)
    whole = _is_whole(values)
    result = _smooth_field(level, values, notes, loose) if whole else None
    if result is None or not _is_alike(result.surface, distances):
        result = _smooth_field(level, _on_own_side(values, distances), notes, loose)
    return result


def _smooth_field(level: Level, values: Array, notes: tuple[str, ...], loose: int) -> SmoothField:
    """Return a field of values [nodes]."""
    field = DistanceField(values * np.float32(level.step), level.index_to_world)
    return SmoothField(field, zero_level(field), notes, loose)


def restored(smooth: SmoothField, volume: float, voxel: float) -> SmoothField:
    """Return a field whose surface is moved outward until it encloses enough of a structure's volume.

    Smoothing shrinks structures of few voxels. The surface is moved by less than half a voxel, and only if
    this does not change its topology.

    Parameters
    ----------
    smooth : SmoothField
    volume : float
        Volume of the structure's voxels [mm³].
    voxel : float
        Edge of a voxel [mm].

    Returns
    -------
    SmoothField
        The input field if it encloses enough.
    """
    moved, result = 0.0, smooth
    for _ in range(_ROUNDS):
        missing = ENOUGH * volume - result.surface.volume
        if -_EXACT * volume < missing <= 0.0:
            break
        moved = float(np.clip(moved + missing / result.surface.area, 0.0, _FARTHEST * voxel))
        field = DistanceField(smooth.field.values - np.float32(moved), smooth.field.index_to_world)
        result = replace(smooth, field=field, surface=zero_level(field))
    alike = _euler_number(result.surface) == _euler_number(smooth.surface)
    return result if moved > 0.0 and alike and _is_whole(result.field.values) else smooth


def _is_whole(values: Array) -> bool:
    """Return whether the nodes below zero are one piece, and those above zero, too."""
    return all(ndimage.label(side)[1] == 1 for side in (values < 0.0, values > 0.0))


def _is_alike(surface: TriangleMesh, distances: Float32Array) -> bool:
    """Return whether a surface has the topology of the zero level of distances, before they were smoothed.

    It may have fewer handles where they are doubtful: depend on nodes that touch only at an edge or corner.
    """
    low, high = sorted(2 * number for number in euler_numbers(distances < 0.0))
    after = _euler_number(surface)
    if low == high:
        return after == low
    before = _euler_number(_zero(distances))
    return before <= after <= max(before, high)


def _zero(values: Array) -> TriangleMesh:
    """Return the zero level of values on a grid, in nodes."""
    return zero_level(DistanceField(values.astype(np.float32, copy=False), np.eye(4)))


def _euler_number(surface: TriangleMesh) -> int:
    """Return the Euler number of a closed surface."""
    return len(surface.vertices) - len(surface.faces) // 2


def _on_own_side(result: Float32Array, distances: Float32Array) -> Float32Array:
    """Return smoothed values constrained so that every node stays on its side of the zero level."""
    return np.where((result < 0.0) == (distances < 0.0), result, np.clip(distances, -_KEPT, _KEPT))


def _one_solid(level: Array) -> tuple[Array, int]:
    """Keep the largest component of the inside and fill its cavities; also return how many were dropped."""
    inside = level < 0.0
    labels, count = ndimage.label(inside)
    if count > 1:
        inside = labels == 1 + int(np.argmax(np.bincount(labels[inside])[1:]))
    size = np.maximum(np.abs(level), 1e-3)
    return np.negative(size, out=size, where=without_cavities(inside)), count - 1
