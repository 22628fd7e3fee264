"""Merging the ends of a closed mesh's edges, which keeps its topology."""

from dataclasses import dataclass

import numpy as np
import warp as wp
from scipy.sparse import coo_array

from homolog.arrays import Array, FloatArray, IntArray
from homolog.errors import NumericalError
from homolog.surfaces.kernels import collapses as kernels

__all__ = ["MergedMesh"]

_WEIGHTS = 10  # terms of a quadric


@dataclass(frozen=True, slots=True, eq=False)
class MergedMesh:
    """A closed mesh in which the ends of edges are merged one by one; all arrays change.

    Attributes
    ----------
    vertices : (V, 3) float64 array
        Positions [mm], of merged vertices too.
    origins : (3F,) int32 array
        The vertex that each side of a face leaves; -1 once the face is gone.
    twins : (3F,) int32 array
        The same edge in the face beyond.
    quadrics : (V, 10) float64 array
        Distance² to the planes of the faces around, times their areas; zeros where edges meet at their
        middle.
    longest : (V,) float64 array
        No merging makes an edge longer than this [mm].
    """

    vertices: FloatArray
    origins: IntArray
    twins: IntArray
    quadrics: FloatArray
    longest: FloatArray

    @classmethod
    def of(cls, vertices: FloatArray, faces: IntArray, longest: FloatArray | None = None) -> "MergedMesh":
        """Return a mesh to merge: at the middle of edges, or by quadrics where no longest edge is given.

        Raises
        ------
        NumericalError
            If an edge has not two faces of one orientation.
        """
        quadrics = _quadrics(vertices, faces) if longest is None else np.zeros((len(vertices), _WEIGHTS))
        return cls(
            np.array(vertices, np.float64),
            np.array(faces, np.int32).ravel(),
            _twins(faces),
            quadrics,
            np.full(len(vertices), np.inf) if longest is None else longest.copy(),
        )

    @property
    def ends(self) -> tuple[IntArray, IntArray]:
        """Return one side of each edge that is left, (E,), and the edge's two ends, (E, 2)."""
        ends = np.roll(self.origins.reshape(-1, 3), -1, axis=1).ravel()
        sides = np.flatnonzero((self.origins >= 0) & (self.origins < ends))
        return sides, np.stack([self.origins[sides], ends[sides]], axis=1)

    def costs(self) -> tuple[IntArray, FloatArray]:
        """Return one side of each edge that is left, (E,), and what merging its ends costs, (E,)."""
        costs = np.empty(len(self.origins))
        given = [_shared(self.origins), _shared(self.vertices, wp.vec3d), _shared(self.quadrics)]
        wp.launch(kernels.cost_of_edges, len(costs), [*given, _shared(costs)], device="cpu")
        sides = np.flatnonzero(np.isfinite(costs))
        return sides, costs[sides]

    def merge(self, sides: IntArray, most: int | None = None) -> int:
        """Merge the ends of edges, in this order, and return of how many.

        An edge stays as it is if an end was merged before, or if the topology or the faces around would
        suffer.
        """
        merged = np.zeros(1, np.int32)
        marks = np.zeros(len(self.vertices), np.int32)
        given = [_shared(array) for array in (self.origins, self.twins)]
        given += [_shared(self.vertices, wp.vec3d), _shared(self.quadrics), _shared(self.longest)]
        given += [_shared(marks), _shared(marks.astype(bool)), _shared(merged)]
        candidates = _shared(np.ascontiguousarray(sides, np.int32))
        most = len(self.vertices) if most is None else most
        wp.launch(kernels.merge_edges, 1, [candidates, most, *given], device="cpu")
        return int(merged[0])

    def compact(self) -> tuple[FloatArray, IntArray, IntArray]:
        """Return the vertices that are left (V, 3), faces (F, 3), and the former numbers of the vertices."""
        faces = self.origins.reshape(-1, 3)
        faces = faces[faces[:, 0] >= 0]
        used = np.zeros(len(self.vertices), dtype=bool)
        used[faces] = True
        number = np.cumsum(used) - 1
        return self.vertices[used], number[faces], np.flatnonzero(used)


def _shared(array: Array, dtype: object = None) -> wp.array:
    """Return a Warp array on the memory of one that may be written to."""
    return wp.array(array, dtype=dtype or wp.dtype_from_numpy(array.dtype), device="cpu", copy=False)


def _twins(faces: IntArray) -> IntArray:
    start = faces.ravel().astype(np.int64)
    end = np.roll(faces, -1, axis=1).ravel().astype(np.int64)
    count = int(faces.max()) + 1
    codes = np.minimum(start, end) * count + np.maximum(start, end)
    order = np.argsort(codes, kind="stable")
    if len(order) % 2:
        raise NumericalError("its surface is open or pinched; use another grid spacing")
    first, second = order.reshape(-1, 2).T
    if (start[first] != end[second]).any() or (end[first] != start[second]).any():
        raise NumericalError("its surface is open or pinched; use another grid spacing")
    twins = np.empty(len(codes), np.int32)
    twins[first], twins[second] = second, first
    return twins


def _quadrics(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return the sum of the squared distances to the planes of each vertex's faces, times areas, (V, 10)."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    across = 0.5 * np.cross(b - a, c - a)
    area = np.linalg.norm(across, axis=1)
    normal = across / np.maximum(area, 1e-300)[:, None]
    plane = np.column_stack([normal, -np.einsum("ij,ij->i", normal, a)])
    rows, columns = [0, 0, 0, 1, 1, 2, 0, 1, 2, 3], [0, 1, 2, 1, 2, 2, 3, 3, 3, 3]
    terms = area[:, None] * plane[:, rows] * plane[:, columns]
    owners = np.repeat(np.arange(len(faces)), 3)
    around = coo_array((np.ones(len(owners)), (faces.ravel(), owners)), shape=(len(vertices), len(faces)))
    return np.asarray(around.tocsr() @ terms)
