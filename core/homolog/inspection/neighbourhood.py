"""The consensus neighbourhood of particles over subjects."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import Delaunay

from homolog.arrays import FloatArray, IntArray, frozen
from homolog.errors import InputError
from homolog.inspection.located_particles import REACH, LocatedParticles, mean_normals
from homolog.progress import Tick, no_tick

__all__ = ["NEIGHBOURS", "Neighbourhood", "flattened", "neighbourhood_of"]

NEIGHBOURS = 12
"""Number of consensus neighbours of a particle: the first ring and most of the second."""
_THINNEST = 0.01
"""Least ratio of twice a triangle's area to the squares of two sides; flatter triangles do not show folds."""
_FEWEST = 3
"""Least number of neighbours of most particles."""
_VOTES = 2
"""Least number of corners whose own triangulation contains a triangle."""


@dataclass(frozen=True, slots=True, eq=False)
class Neighbourhood:
    """The consensus neighbourhood of a cohort's particles; arrays are read-only.

    Attributes
    ----------
    neighbours : (N, K) int array
        The nearest neighbours of each particle, by median distance over subjects.
    distances : (N, K) float64 array
        Median distances to them, in spacings; inf if there are fewer than K.
    shape : (N, 3) float64 array
        Median positions [mm] in aligned coordinates: a mean that swapped particles do not shift.
    normals : (N, 3) float64 array
        Fréchet means of the normals.
    triangles : (T, 3) int array
        Local Delaunay triangles of the consensus, counter-clockwise seen from outside.
    """

    neighbours: IntArray
    distances: FloatArray
    shape: FloatArray
    normals: FloatArray
    triangles: IntArray

    def ring(self, particles: IntArray) -> IntArray:
        """Return given particles and those that share a triangle with them."""
        near = self.triangles[np.isin(self.triangles, particles).any(axis=1)]
        return np.union1d(near.ravel(), particles)


def neighbourhood_of(located: LocatedParticles, tick: Tick = no_tick) -> Neighbourhood:
    """Return the consensus of all subjects."""
    neighbours, consensus = _nearest(located.distances)
    shape = np.median(located.world, axis=0)
    normals = mean_normals(located.normals)
    triangles = _triangles(shape, normals, neighbours, consensus, tick)
    return Neighbourhood(*map(frozen, (neighbours, consensus, shape, normals, triangles)))


def _nearest(distances: Sequence[csr_array]) -> tuple[IntArray, FloatArray]:
    """Return each particle's nearest others by the median distance over subjects, and these medians."""
    n = distances[0].shape[0]
    keys = [_keys(distance) for distance in distances]
    pairs, counts = np.unique(np.concatenate(keys), return_counts=True)
    pairs = pairs[2 * counts > len(distances)]
    table = np.full((len(distances), len(pairs)), np.inf)
    for row, key, item in zip(table, keys, distances, strict=True):
        at = np.searchsorted(pairs, key).clip(max=len(pairs) - 1)
        is_known = pairs[at] == key
        row[at[is_known]] = item.data[is_known]
    median = np.median(table, axis=0)
    order = np.lexsort([median, pairs // n])
    particle, other, median = pairs[order] // n, pairs[order] % n, median[order]
    rank = np.arange(len(particle)) - np.searchsorted(particle, particle)
    near = (rank < NEIGHBOURS) & (median < REACH)
    neighbours = np.tile(np.arange(n)[:, None], NEIGHBOURS)
    consensus = np.full((n, NEIGHBOURS), np.inf)
    neighbours[particle[near], rank[near]] = other[near]
    consensus[particle[near], rank[near]] = median[near]
    if np.isfinite(consensus[:, _FEWEST]).mean() < 0.5:
        raise InputError(
            "the subjects hardly agree on which particles are neighbours along their surfaces: give surfaces "
            "to imported particles, or run again"
        )
    return neighbours, consensus


def _keys(distances: csr_array) -> IntArray:
    """Return one number for each stored pair, ascending."""
    n = distances.shape[0]
    distances.sort_indices()
    rows = np.repeat(np.arange(n), np.diff(distances.indptr))
    keys: IntArray = rows * n + distances.indices
    return keys


def _triangles(
    shape: FloatArray, normals: FloatArray, neighbours: IntArray, consensus: FloatArray, tick: Tick
) -> IntArray:
    """Return the triangles that the local Delaunay triangulations around their corners agree on.

    The neighbours of each particle are mapped to the plane of the mean normal: directions are those of the
    projections, distances are geodesic.
    """
    triangles_of = []
    for i, (others, far) in enumerate(zip(neighbours, consensus, strict=True)):
        tick(i / len(shape), "triangles of neighbours")
        is_known = np.isfinite(far)
        if is_known.sum() < 3:
            continue
        flat = plane_of(normals[i])
        seen = (shape[others[is_known]] - shape[i]) @ flat.T
        seen *= (far[is_known] / np.maximum(np.linalg.norm(seen, axis=1), 1e-12))[:, None]
        corners = Delaunay(np.vstack([np.zeros(2), seen])).simplices  # counter-clockwise
        triangles_of.append(np.concatenate([[i], others[is_known]])[corners[(corners == 0).any(axis=1)]])
    triangles = np.concatenate(triangles_of)
    first = triangles.argmin(axis=1)
    turned = triangles[np.arange(len(triangles))[:, None], (first[:, None] + np.arange(3)) % 3]
    unique, votes = np.unique(turned, axis=0, return_counts=True)
    agreed = unique[votes >= _VOTES]
    edges = flattened(shape[agreed], normals[agreed])
    sound: IntArray = agreed[np.linalg.det(edges) > _THINNEST * np.square(edges).sum(axis=(1, 2))]
    return sound


def plane_of(normals: FloatArray) -> FloatArray:
    """Return two unit vectors orthogonal to each normal, right-handed with it: (..., 3) to (..., 2, 3)."""
    least = np.eye(3)[np.abs(normals).argmin(axis=-1)]
    first = np.cross(normals, least)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return np.stack([first, np.cross(normals, first)], axis=-2)


def flattened(points: FloatArray, normals: FloatArray) -> FloatArray:
    """Return the edges from the first corners of triangles to the others, in the plane of the surface.

    Parameters
    ----------
    points, normals : (..., 3, 3) arrays
        The corners and the surface's normals there.

    Returns
    -------
    (..., 2, 2) array
        The two edges as columns, in a plane right-handed with the sum of the normals.
    """
    total = normals.sum(axis=-2)
    plane = plane_of(total / np.maximum(np.linalg.norm(total, axis=-1, keepdims=True), 1e-12))
    edges = points[..., 1:, :] - points[..., :1, :]
    return np.asarray(np.einsum("...ki,...ei->...ke", plane, edges))
