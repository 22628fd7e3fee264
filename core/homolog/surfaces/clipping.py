"""Planes, and the part of a mesh on one side of them."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from homolog.arrays import FloatArray
from homolog.errors import InputError
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["Plane", "clipped"]

_ON_PLANE = 1e-3
"""Distance, in mean edges, within which a vertex is moved onto the plane: faces cut there have an area."""


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """A plane that cuts a surface.

    Attributes
    ----------
    point : (3,) array
        A point of the plane [mm, LPS].
    direction : (3,) array
        The unit vector towards the part that is kept.
    """

    point: FloatArray
    direction: FloatArray

    @classmethod
    def of(cls, point: FloatArray, direction: FloatArray) -> Self:
        """Return the plane through a point; the direction may have any length but 0."""
        length = float(np.linalg.norm(direction))
        if not (np.isfinite(point).all() and np.isfinite(length) and length > 0.0):
            raise InputError("a cutting plane needs a point and a direction, six numbers that are not all 0")
        return cls(np.asarray(point, np.float64), np.asarray(direction, np.float64) / length)

    def heights(self, points: FloatArray) -> FloatArray:
        """Return the distances of points (..., 3) from the plane, positive where they are kept."""
        return np.asarray((points - self.point) @ self.direction)

    def placed(self, matrix: FloatArray) -> "Plane":
        """Return the plane transformed by an invertible affine map (4, 4)."""
        linear = matrix[:3, :3]
        return Plane.of(linear @ self.point + matrix[:3, 3], np.linalg.inv(linear).T @ self.direction)


def clipped(mesh: TriangleMesh, plane: Plane) -> TriangleMesh:
    """Return the part of a mesh on the side of a plane that is kept; its rim lies in the plane.

    Parameters
    ----------
    mesh : TriangleMesh
        An oriented manifold.
    plane : Plane

    Returns
    -------
    TriangleMesh
        Without faces if nothing is kept; the mesh itself if everything is.
    """
    heights = plane.heights(mesh.vertices)
    on_plane = np.abs(heights) < _ON_PLANE * mesh.mean_edge
    vertices = mesh.vertices - np.where(on_plane, heights, 0.0)[:, None] * plane.direction
    heights = np.where(on_plane, 0.0, heights)
    corners = heights[mesh.faces]
    if (corners >= 0.0).all():
        return mesh
    whole = (corners >= 0.0).all(axis=1) & (corners > 0.0).any(axis=1)
    crossed = (corners > 0.0).any(axis=1) & (corners < 0.0).any(axis=1)
    crossings: dict[tuple[int, int], int] = {}
    faces: list[tuple[int, ...]] = []
    for face in mesh.faces[crossed].tolist():
        kept: list[int] = []
        for start, end in zip(face, (*face[1:], face[0]), strict=True):
            if heights[start] >= 0.0:
                kept.append(start)
            if heights[start] * heights[end] < 0.0:
                side = (min(start, end), max(start, end))
                kept.append(crossings.setdefault(side, len(vertices) + len(crossings)))
        faces += [(kept[0], *kept[number : number + 2]) for number in range(1, len(kept) - 1)]
    ends = np.array(list(crossings), np.int64).reshape(-1, 2)
    low, high = heights[ends].T
    share = (low / np.where(low == high, 1.0, low - high))[:, None]
    between = vertices[ends[:, 0]] + share * (vertices[ends[:, 1]] - vertices[ends[:, 0]])
    every = np.concatenate([mesh.faces[whole], np.array(faces, np.int64).reshape(-1, 3)])
    used, numbers = np.unique(every, return_inverse=True)
    return TriangleMesh(np.concatenate([vertices, between])[used], numbers.reshape(-1, 3))
