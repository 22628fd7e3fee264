"""Planes and dabs of a brush, and the part of a mesh that they keep."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from homolog.arrays import BoolArray, FloatArray
from homolog.errors import InputError
from homolog.geometry import scale_of, transform_points
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import edges

__all__ = ["Ball", "Cut", "Plane", "clipped", "covering", "kept_heights", "where_positive"]

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


@dataclass(frozen=True, slots=True, eq=False)
class Ball:
    """A dab of a brush: the part of a surface around a point, as far as it is connected within the ball.

    Attributes
    ----------
    centre : (3,) array
        A point of the surface [mm, LPS].
    radius : float
        [mm].
    keeps : bool
        Whether the part is put back, instead of left out.
    """

    centre: FloatArray
    radius: float
    keeps: bool = False

    def placed(self, matrix: FloatArray) -> "Ball":
        """Return the ball transformed by a similarity (4, 4)."""
        centre, radius = transform_points(matrix, self.centre[None])[0], self.radius * float(scale_of(matrix))
        return Ball(centre, radius, self.keeps)


Cut = Plane | Ball
"""What leaves out a part of a surface."""


def kept_heights(mesh: TriangleMesh, balls: Sequence[Ball]) -> FloatArray:
    """Return a function of the vertices (V,) that is positive where balls, one after another, keep a surface.

    Its zero level is the border of what is left out: the distance from the balls' spheres [mm].
    """
    sides = edges(mesh.faces)
    graph = coo_array((np.ones(len(sides), bool), tuple(sides.T)), shape=(len(mesh.vertices),) * 2).tocsr()
    kept = np.full(len(mesh.vertices), np.inf)
    for ball in balls:
        outside = np.linalg.norm(mesh.vertices - ball.centre, axis=1) - ball.radius
        inside = np.flatnonzero(outside < 0.0)
        if len(inside):
            pieces = connected_components(graph[inside][:, inside], directed=False)[1]
            apart = inside[pieces != pieces[outside[inside].argmin()]]  # such as the other side of a wall
            outside[apart] = -outside[apart]
            kept = np.maximum(kept, -outside) if ball.keeps else np.minimum(kept, outside)
    return kept


def covering(points: FloatArray, kept: BoolArray) -> list[Ball]:
    """Return balls that cover the points (n, 3) that are not kept, and none that is.

    They reach half a spacing of the points beyond those that they cover, as the nearest point tells it.
    """
    left_out, others = points[~kept], points[kept]
    if not len(left_out):
        return []
    if not len(others):
        raise InputError("excludes every point; nothing would remain")
    room = KDTree(others).query(left_out)[0]
    spacing = float(np.median(np.asarray(KDTree(points).query(points, k=2)[0])[:, 1]))
    radii = np.maximum(room - 0.5 * spacing, 0.5 * room)
    tree, is_left, balls = KDTree(left_out), np.ones(len(left_out), bool), []
    for place in np.argsort(-radii).tolist():
        if is_left[place] and radii[place] > 0.0:
            balls.append(Ball(left_out[place], float(radii[place])))
            is_left[tree.query_ball_point(left_out[place], radii[place])] = False
    return balls


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
    if (on_plane | (heights > 0.0))[mesh.faces].all():
        return mesh
    vertices = mesh.vertices - np.where(on_plane, heights, 0.0)[:, None] * plane.direction
    return where_positive(TriangleMesh(vertices, mesh.faces), np.where(on_plane, 0.0, heights))


def where_positive(mesh: TriangleMesh, heights: FloatArray) -> TriangleMesh:
    """Return the part of a mesh where a function of its vertices (V,) is positive; its rim is the zero level.

    Vertices within a thousandth of a mean edge of the zero level are on it.
    """
    heights = np.where(np.abs(heights) < _ON_PLANE * mesh.mean_edge, 0.0, heights)
    vertices, corners = mesh.vertices, heights[mesh.faces]
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
