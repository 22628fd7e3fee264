"""Nearest points of a surface: by position, or by position and normal, which tells the sides of a thin wall.

Surfaces are represented by their vertices; `surfaces.closest` has points within triangles.
"""

import numpy as np
from scipy.spatial import KDTree

from homolog.arrays import FloatArray, IntArray
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["NearestPoints", "areas_of_particles", "nearest_faces", "nearest_particles", "normals_at"]

_NEAR_PARTICLES, _OPPOSITE = 12, -0.5
"""Number of nearest particles that are tested, and least cosine of normals of the same side of a wall."""
_NEAR_FACES, _SIMILAR = 24, 0.2
"""The same of faces from which a walk begins."""


class NearestPoints:
    """Points with normals, and a search tree.

    Parameters
    ----------
    points, normals : (N, 3) arrays
        Points of a surface and its unit normals there.
    normal_length : float
        The distance that counts as much as a difference of one between unit normals; with 0 only positions
        count.
    """

    def __init__(self, points: FloatArray, normals: FloatArray, normal_length: float = 0.0) -> None:
        self.points, self.normals, self._length = points, normals, normal_length
        plain = normal_length == 0.0  # in six dimensions, large unbalanced leaves are fastest
        features = self._features(points, normals)
        self._tree = KDTree(features, leafsize=10 if plain else 32, balanced_tree=plain)

    @classmethod
    def of(cls, mesh: TriangleMesh, normal_length: float = 0.0) -> "NearestPoints":
        """Return the vertices of a mesh."""
        return NearestPoints(mesh.vertices, mesh.vertex_normals, normal_length)

    def nearest(
        self, points: FloatArray, normals: FloatArray | None = None, *, count: int = 1
    ) -> tuple[FloatArray, IntArray]:
        """Return distances in position and normal, and indices, of the nearest points.

        Parameters
        ----------
        points : (..., 3) array
        normals : (..., 3) array, optional
            Unit normals that the surface should have there; needed if normals count.
        count : int
            Number of nearest points, K; at most N are returned.

        Returns
        -------
        distances, indices : (...) arrays, or (..., K) if K is larger than 1
        """
        wanted = self._features(points, normals)
        distances, indices = self._tree.query(wanted, k=min(count, len(self.points)))
        return np.asarray(distances), np.asarray(indices)

    def on_own_side(
        self, points: FloatArray, normals: FloatArray, *, least_cosine: float, count: int
    ) -> IntArray:
        """Return the nearest point (n,) whose normal agrees, of some; the nearest of all if none does."""
        near = self.nearest(points, normals, count=count)[1].reshape(len(points), -1)
        agree = np.einsum("nkd,nd->nk", self.normals[near], normals) > least_cosine
        chosen: IntArray = near[np.arange(len(near)), agree.argmax(axis=1)]
        return chosen

    def touched(
        self, points: FloatArray, normals: FloatArray, reach: float
    ) -> tuple[FloatArray, FloatArray, IntArray]:
        """Return points (n, 3) moved onto the tangent planes of the nearest points.

        Parameters
        ----------
        points, normals : (n, 3) arrays
        reach : float
            Largest distance from the nearest points.

        Returns
        -------
        points : (n, 3) array
        normals : (n, 3) array
        indices : (n,) array
            Of the nearest points, in whose planes they are.
        """
        indices = self.nearest(points, normals)[1]
        planes, along = self.normals[indices], points - self.points[indices]
        along -= np.einsum("ni,ni->n", along, planes)[:, None] * planes
        far = np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
        return self.points[indices] + along * np.minimum(1.0, reach / far), planes, indices

    def _features(self, points: FloatArray, normals: FloatArray | None) -> FloatArray:
        if self._length == 0.0 or normals is None:
            return points
        return np.concatenate([points, self._length * normals], axis=-1)


def normals_at(mesh: TriangleMesh, points: FloatArray) -> FloatArray:
    """Return the unit normals of a mesh at points (n, 3) on it, those of the nearest vertices."""
    normals: FloatArray = mesh.vertex_normals[np.asarray(KDTree(mesh.vertices).query(points)[1])]
    return normals


def nearest_faces(mesh: TriangleMesh, points: FloatArray, normals: FloatArray) -> IntArray:
    """Return a face (n,) near each point (n, 3) whose normal agrees with a given one; a walk begins there."""
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    across = np.cross(b - a, c - a)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-30)
    faces = NearestPoints((a + b + c) / 3.0, across)
    return faces.on_own_side(points, normals, least_cosine=_SIMILAR, count=_NEAR_FACES).astype(np.int32)


def nearest_particles(mesh: TriangleMesh, particles: FloatArray) -> IntArray:
    """Return the nearest particle of each vertex, (V,), on the vertex's side of a wall.

    Parameters
    ----------
    mesh : TriangleMesh
        The surface.
    particles : (N, 3) array
        Points on the surface [mm].
    """
    points = NearestPoints(particles, normals_at(mesh, particles))
    return points.on_own_side(
        mesh.vertices, mesh.vertex_normals, least_cosine=_OPPOSITE, count=_NEAR_PARTICLES
    )


def areas_of_particles(mesh: TriangleMesh, nearest: IntArray, count: int) -> FloatArray:
    """Return the area of the surface that belongs to each of N particles, (N,) [mm²]."""
    shares = np.repeat(mesh.face_areas / 3.0, 3)
    return np.asarray(np.bincount(nearest[mesh.faces].ravel(), shares, minlength=count), np.float64)
