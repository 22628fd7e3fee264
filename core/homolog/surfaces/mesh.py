"""Closed triangle surfaces."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from itertools import pairwise
from typing import Any

import numpy as np

from homolog.arrays import FloatArray, IntArray, frozen
from homolog.errors import InputError
from homolog.geometry import transform_points
from homolog.memory import Store

__all__ = ["TriangleMesh", "joined"]


@dataclass(frozen=True, eq=False)  # without slots, for cached properties
class TriangleMesh:
    """A triangle surface in LPS millimetres, faces counter-clockwise seen from outside.

    Attributes
    ----------
    vertices : (V, 3) float64 array
        Positions [mm], read-only.
    faces : (F, 3) int32 array
        Vertex indices, read-only.
    ends : tuple of int
        Where the vertices of each of several structures end, one after another; empty for a single one.

    Raises
    ------
    InputError
        If an array has another shape, vertices are not numbers, or faces are not whole numbers.

    Examples
    --------
    >>> import homolog as hl
    >>> vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    >>> faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]
    >>> mesh = hl.TriangleMesh(vertices, faces)
    >>> mesh, round(mesh.area, 3)
    (TriangleMesh(4 vertices, 4 faces), 2.366)
    """

    vertices: FloatArray
    faces: IntArray
    ends: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        try:
            vertices, faces = np.asarray(self.vertices, np.float64), np.asarray(self.faces)
            if not np.issubdtype(faces.dtype, np.integer):
                faces = faces.astype(np.float64)
        except (TypeError, ValueError) as error:
            raise InputError(f"a mesh needs numbers, vertices (V, 3) and faces (F, 3): {error}") from error
        if not np.issubdtype(faces.dtype, np.integer) and not np.all(np.mod(faces, 1.0) == 0.0):
            raise InputError("the faces of a mesh must be whole numbers, the indices of its vertices")
        object.__setattr__(self, "vertices", frozen(vertices))
        object.__setattr__(self, "faces", frozen(faces, np.int32))
        shapes = self.vertices.shape, self.faces.shape
        if any(len(shape) != 2 or shape[1] != 3 for shape in shapes):
            raise InputError(
                f"a mesh needs vertices (V, 3) and faces (F, 3), not {shapes[0]} and {shapes[1]}; "
                "triangulate it"
            )

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return f"TriangleMesh({len(self.vertices)} vertices, {len(self.faces)} faces)"

    def __reduce__(self) -> tuple[object, ...]:
        """Stay read-only through pickling."""
        return TriangleMesh, (self.vertices, self.faces, self.ends)

    def to_pyvista(self) -> Any:  # noqa: ANN401 - the core does not depend on pyvista
        """Return the surface as a `pyvista.PolyData`, to draw it: ``mesh.to_pyvista().plot()``."""
        return import_module("pyvista").PolyData.from_regular_faces(self.vertices, self.faces)

    def stored(self, store: Store) -> "TriangleMesh":
        """Return the surface with its arrays in a store."""
        return TriangleMesh(store(self.vertices), store(self.faces), self.ends)

    def placed(self, matrix: FloatArray) -> "TriangleMesh":
        """Return the surface transformed by a (4, 4) matrix; its faces still point outward."""
        mirrored = np.linalg.det(matrix[:3, :3]) < 0.0
        faces = self.faces[:, ::-1] if mirrored else self.faces
        return TriangleMesh(transform_points(matrix, self.vertices), faces, self.ends)

    def moved(self, vertices: FloatArray) -> "TriangleMesh":
        """Return the surface with other places of its vertices (V, 3) [mm]."""
        return TriangleMesh(vertices, self.faces, self.ends)

    @cached_property
    def parts(self) -> "tuple[TriangleMesh, ...]":
        """The surfaces of its structures; the surface itself if it is of a single one."""
        if not self.ends:
            return (self,)
        owner = np.searchsorted(self.ends, self.faces[:, 0], side="right")
        return tuple(
            TriangleMesh(self.vertices[begin:end], self.faces[owner == number] - begin)
            for number, (begin, end) in enumerate(pairwise((0, *self.ends)))
        )

    @property
    def face_areas(self) -> FloatArray:
        """Area of each face [mm²], shape (F,)."""
        corners = (column[self.faces.T] for column in self._columns())
        (x, u), (y, v), (z, w) = ((c[1] - c[0], c[2] - c[0]) for c in corners)
        squares = (y * w - z * v) ** 2 + (z * u - x * w) ** 2 + (x * v - y * u) ** 2
        return np.asarray(0.5 * np.sqrt(squares))

    @property
    def vertex_areas(self) -> FloatArray:
        """Area of each vertex, a third of that of its faces [mm²], shape (V,)."""
        thirds = np.repeat(self.face_areas / 3.0, 3)
        return np.bincount(self.faces.ravel(), thirds, len(self.vertices)).astype(np.float64)

    def _columns(self) -> list[FloatArray]:
        """Return the coordinates as contiguous arrays, which halves the time of computations over faces."""
        return [np.ascontiguousarray(column) for column in self.vertices.T]

    @cached_property
    def area(self) -> float:
        """Surface area [mm²]."""
        return float(self.face_areas.sum())

    @cached_property
    def volume(self) -> float:
        """Enclosed volume [mm³], by the divergence theorem; positive if the faces point outward."""
        x, y, z = (column[self.faces.T] for column in self._columns())
        across = x[0] * (y[1] * z[2] - z[1] * y[2])
        across += y[0] * (z[1] * x[2] - x[1] * z[2])
        across += z[0] * (x[1] * y[2] - y[1] * x[2])
        return float(across.sum() / 6.0)

    @cached_property
    def mean_edge(self) -> float:
        """Mean edge length [mm] over the sides of faces."""
        squares = np.zeros(self.faces.shape)
        for column in self._columns():
            corners = column[self.faces]
            squares += (corners - corners[:, [2, 0, 1]]) ** 2
        return float(np.sqrt(squares).mean())

    @property
    def vertex_normals(self) -> FloatArray:
        """Outward unit normals at the vertices, weighted by face area, shape (V, 3); 0 without any area."""
        a, b, c = (self.vertices[self.faces[:, corner]] for corner in range(3))
        across = np.cross(b - a, c - a)
        corners, n = self.faces.T.ravel(), len(self.vertices)
        sums = np.stack([np.bincount(corners, np.tile(item, 3), n) for item in across.T], axis=1)
        return np.asarray(sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-300))


def joined(meshes: Sequence[TriangleMesh]) -> TriangleMesh:
    """Return several surfaces as one of separate pieces, in their order."""
    ends = np.cumsum([len(mesh.vertices) for mesh in meshes]).tolist()
    faces = [mesh.faces + start for mesh, start in zip(meshes, (0, *ends), strict=False)]
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    return TriangleMesh(vertices, np.concatenate(faces), tuple(ends) if len(meshes) > 1 else ())
