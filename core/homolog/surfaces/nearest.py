"""The nearest particle of a surface point on its own side of a thin wall."""

import numpy as np
from scipy.spatial import KDTree

from homolog.arrays import FloatArray, IntArray
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["areas_of_particles", "nearest_particles"]

_LOOKED_AT = 12
"""Number of nearest particles that are tested."""
_OPPOSITE = -0.5
"""Least cosine between the normals of two points on the same side of a wall."""


def nearest_particles(mesh: TriangleMesh, particles: FloatArray) -> IntArray:
    """Return the nearest particle of each vertex, (V,), on the vertex's side of a wall.

    Parameters
    ----------
    mesh : TriangleMesh
        The surface.
    particles : (N, 3) array
        Points on the surface [mm].
    """
    tried = min(_LOOKED_AT, len(particles))
    near = np.asarray(KDTree(particles).query(mesh.vertices, k=tried)[1], np.int64).reshape(-1, tried)
    normals = mesh.vertex_normals
    of_particles = normals[KDTree(mesh.vertices).query(particles)[1]]
    own_side = np.einsum("vi,vki->vk", normals, of_particles[near]) > _OPPOSITE
    chosen: IntArray = near[np.arange(len(near)), own_side.argmax(axis=1)]  # the nearest one if none is
    return chosen


def areas_of_particles(mesh: TriangleMesh, nearest: IntArray, count: int) -> FloatArray:
    """Return the area of the surface that belongs to each of N particles, (N,) [mm²]."""
    shares = np.repeat(mesh.face_areas / 3.0, 3)
    return np.asarray(np.bincount(nearest[mesh.faces].ravel(), shares, minlength=count), np.float64)
