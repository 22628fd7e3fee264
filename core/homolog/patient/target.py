"""The target surface of a fit: closest points by position and normal, and distances along normals."""

import numpy as np

from homolog.arrays import BoolArray, FloatArray
from homolog.geometry import rms_radius
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.nearest import NearestPoints

__all__ = ["NORMAL_WEIGHT", "Target"]

NORMAL_WEIGHT = 0.2
"""Additional distance of points with normals at 60°, relative to the root mean square radius."""
_LEAST_COSINE = 0.5
"""Least cosine between the line along which a distance is measured and the normal where it meets the
surface."""
_ROUNDS = 5
"""Number of iterations of following a line to the surface."""
_REACH = 2.5
"""Largest distance of the met point from the vertex, in mean edges."""


class Target(NearestPoints):
    """A patient's surface, searched by position and normal.

    Parameters
    ----------
    mesh : TriangleMesh
        Closed surface [mm].
    """

    def __init__(self, mesh: TriangleMesh) -> None:
        self.mesh, self.size = mesh, float(rms_radius(mesh.vertices))
        self._edge = mesh.mean_edge
        super().__init__(mesh.vertices, mesh.vertex_normals, NORMAL_WEIGHT * self.size)

    def along_normals(self, points: FloatArray, normals: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return the distances of the surface from points along their normals.

        Parameters
        ----------
        points, normals : (n, 3) arrays
            Positions [mm] and unit normals.

        Returns
        -------
        distances : (n,) array
            Distances [mm], positive if the surface lies outward.
        met : (n,) bool array
            Whether the line meets the surface. Otherwise the distance is that to the nearest point of the
            surface, negative outside it, where a part of the shape is missing.
        """
        distances = np.zeros(len(points))
        for _ in range(_ROUNDS):
            reached = points + distances[:, None] * normals
            nearest = self.nearest(reached, normals)[1]
            plane = self.normals[nearest]
            cosine = np.einsum("ni,ni->n", normals, plane)
            along = np.einsum("ni,ni->n", self.points[nearest] - points, plane)
            step = along / np.maximum(cosine, _LEAST_COSINE)
            distances = np.clip(step, -self.size, self.size)
        reached = points + distances[:, None] * normals
        nearest = self.nearest(reached, normals)[1]
        gaps = np.linalg.norm(self.points[nearest] - reached, axis=1)
        cosine = np.einsum("ni,ni->n", normals, self.normals[nearest])
        met: BoolArray = (cosine > _LEAST_COSINE) & (gaps < _REACH * self._edge)
        if not met.all():
            distances[~met] = self._signed(points[~met])
        return distances, met

    def _signed(self, points: FloatArray) -> FloatArray:
        """Return signed distances (n,) of points from the surface: negative outside."""
        gaps, nearest = NearestPoints(self.points, self.normals).nearest(points)
        outside = np.einsum("ni,ni->n", points - self.points[nearest], self.normals[nearest]) > 0.0
        signed: FloatArray = np.where(outside, -1.0, 1.0) * gaps
        return signed
