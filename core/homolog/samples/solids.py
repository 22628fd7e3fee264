"""Distances to simple solids and their smooth union, to build bones; all lengths in mm."""

import numpy as np

from homolog.arrays import FloatArray
from homolog.surfaces.isosurface import marching_cubes
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.simplify import simplified

__all__ = ["cylinder", "ellipsoid", "rod", "surface_of", "united"]


def ellipsoid(points: FloatArray, centre: tuple[float, ...], axes: tuple[float, ...]) -> FloatArray:
    """Return the approximate distance to an ellipsoid, negative inside.

    Parameters
    ----------
    points : (..., 3) array
        Points of evaluation [mm].
    centre, axes : tuple of 3 float
        Centre and half axes [mm].

    Returns
    -------
    (...) array [mm]
    """
    inside = (points - np.array(centre)) / np.array(axes)
    length = np.linalg.norm(inside, axis=-1)
    slope = np.linalg.norm(inside / np.array(axes), axis=-1)
    return np.asarray(length * (length - 1.0) / np.maximum(slope, 1e-9))


def rod(
    points: FloatArray, start: tuple[float, ...], end: tuple[float, ...], radii: tuple[float, float]
) -> FloatArray:
    """Return the approximate distance to a rod with round ends whose radius changes from start to end.

    Parameters
    ----------
    points : (..., 3) array
        Points of evaluation [mm].
    start, end : tuple of 3 float
        Ends of the axis [mm].
    radii : (float, float)
        Radius at the start and at the end [mm].

    Returns
    -------
    (...) array [mm]
    """
    a, b = np.array(start), np.array(end)
    along = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
    axis = a + along[..., None] * (b - a)
    return np.asarray(np.linalg.norm(points - axis, axis=-1) - (radii[0] + along * (radii[1] - radii[0])))


def cylinder(points: FloatArray, axes: tuple[float, float], half_height: float) -> FloatArray:
    """Return the approximate distance to an upright elliptic cylinder around the origin.

    Parameters
    ----------
    points : (..., 3) array
        Points of evaluation [mm].
    axes : (float, float)
        Half axes [mm].
    half_height : float
        Half of the height [mm].

    Returns
    -------
    (...) array [mm]
    """
    across = np.array(axes)
    scaled = points[..., :2] / across
    length = np.linalg.norm(scaled, axis=-1)
    side = length * (length - 1.0) / np.maximum(np.linalg.norm(scaled / across, axis=-1), 1e-9)
    above = np.abs(points[..., 2]) - half_height
    outside = np.hypot(np.maximum(side, 0.0), np.maximum(above, 0.0))  # so that an offset rounds the edges
    return np.asarray(np.minimum(np.maximum(side, above), 0.0) + outside)


def united(*levels: FloatArray, blend: float) -> FloatArray:
    """Return the union of solids, rounded where they meet over a length `blend`."""
    result = levels[0]
    for level in levels[1:]:
        share = np.clip(0.5 + 0.5 * (level - result) / blend, 0.0, 1.0)
        result = level + share * (result - level) - blend * share * (1.0 - share)
    return result


def surface_of(level: FloatArray, low: FloatArray, spacing: float, n_vertices: int) -> TriangleMesh:
    """Return the largest piece of the zero level of values on a grid as a closed mesh.

    Parameters
    ----------
    level : (I, J, K) array
        Values, negative inside, positive at the border.
    low : (3,) array
        Position of the first node [mm].
    spacing : float
        Distance of the nodes [mm].
    n_vertices : int
        Target number of vertices.
    """
    nodes, faces = marching_cubes(level)
    return simplified(TriangleMesh(low + spacing * nodes, faces), n_vertices)
