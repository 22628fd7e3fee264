"""Where a surface has no particles near."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from homolog.arrays import FloatArray, IntArray
from homolog.geodesics import distances_from
from homolog.progress import Tick, no_tick
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import edges

__all__ = ["BEYOND", "FAR", "Gap", "gaps_of", "reach_of"]

FAR = 1.4
"""Distance to the nearest particle, in spacings, from which a place is uncovered; an even layout has 0.6 …"""
BEYOND = 3.0
"""… and from so many times the median distance."""
_AROUND = 6
"""Particles that are named for a region."""
_EDGE = 1.0
"""Where the region around such a place ends, in spacings."""


@dataclass(frozen=True, slots=True, eq=False)
class Gap:
    """A region of a surface that is far from every particle.

    Attributes
    ----------
    centre : int
        Its vertex that is farthest from all particles.
    distance : float
        How far that is [mm].
    area : float
        Of what is more than a spacing away from every particle [mm²].
    around : (k,) int array
        The particles nearest to the centre along the surface.
    """

    centre: int
    distance: float
    area: float
    around: IntArray


def reach_of(
    mesh: TriangleMesh, feet: IntArray, points: FloatArray, *, name: str = "mesh", tick: Tick = no_tick
) -> FloatArray:
    """Return the geodesic distance of every vertex from the nearest particle [mm], (V,).

    Parameters
    ----------
    mesh : TriangleMesh
        A closed surface.
    feet : (N,) int array
        The face that each particle is on.
    points : (N, 3) array
        The particles [mm].
    """
    corners = mesh.faces[feet]
    away = np.linalg.norm(mesh.vertices[corners] - points[:, None], axis=2)
    sources, start = corners.ravel().tolist(), away.ravel().tolist()
    return distances_from(mesh, sources, start, name=name, tick=tick).astype(np.float64)


def gaps_of(
    mesh: TriangleMesh, reach: FloatArray, feet: IntArray, points: FloatArray, limit: float
) -> list[Gap]:
    """Return the regions around the vertices that are farther than a limit [mm] from every particle."""
    spacing = float(np.sqrt(mesh.area / len(points)))
    if not (reach > limit).any():
        return []
    shares = np.bincount(mesh.faces.ravel(), np.repeat(mesh.face_areas / 3.0, 3), len(mesh.vertices))
    sides = edges(mesh.faces)
    sides = sides[(reach[sides] > _EDGE * spacing).all(axis=1)]
    graph = coo_array((np.ones(len(sides)), tuple(sides.T)), shape=(len(reach),) * 2)
    labels = connected_components(graph, directed=False)[1]
    gaps = []
    for label in np.unique(labels[reach > limit]):
        region = np.flatnonzero(labels == label)
        centre = int(region[reach[region].argmax()])
        from_centre = distances_from(mesh, [centre])
        corners = mesh.faces[feet]
        away = np.linalg.norm(mesh.vertices[corners] - points[:, None], axis=2)
        order = (from_centre[corners] + away).min(axis=1).argsort(kind="stable")
        gaps.append(Gap(centre, float(reach[centre]), float(shares[region].sum()), order[:_AROUND]))
    return gaps
