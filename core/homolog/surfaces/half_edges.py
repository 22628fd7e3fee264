"""A mesh with topology-preserving edge splits, collapses and flips."""

import numpy as np
import warp as wp

from homolog.arrays import Array, FloatArray, IntArray
from homolog.errors import NumericalError
from homolog.surfaces.kernels import half_edges as kernels
from homolog.surfaces.kernels.quadrics import add_quadrics
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import rim_numbers, rim_sides

__all__ = ["HalfEdges", "ascending"]

_WEIGHTS = 10  # terms of a quadric


class HalfEdges:
    """A mesh as half-edges, each with its twin in the neighbouring face.

    Beyond each rim lies a fan of faces around a vertex without a place (nan), so that every edge has two
    faces: what looks at the geometry of such a face finds nothing, and leaves it. For quadrics a wall stands
    on each edge of a rim, as high as the edge is long, so that the rim counts as the surface does.

    Parameters
    ----------
    vertices : (V, 3) float64 array
        Positions [mm].
    faces : (F, 3) int array
        Faces of an oriented manifold; closed if `longest` is given.
    longest : (V,) float64 array, optional
        Largest edge length around each vertex [mm]. Collapsed edges then become their midpoints; without it,
        the minima of the quadrics.

    Attributes
    ----------
    vertices : (V, 3) float64 array
        Positions [mm], including those of merged vertices.
    longest : (V,) float64 array
        Largest edge length [mm]; infinite by default.

    Raises
    ------
    NumericalError
        If an edge has more than two faces, or two of opposite orientation.
    """

    def __init__(self, vertices: FloatArray, faces: IntArray, longest: FloatArray | None = None) -> None:
        n_faces, walls, twins = len(faces), None, _twins(faces)
        if twins is None and longest is None:
            rim, owners = rim_sides(faces)
            walls = rim, faces[owners]
            apexes = len(vertices) + rim_numbers(rim)
            faces = np.concatenate([faces, np.column_stack([rim[:, ::-1], apexes])])
            rows = np.full((int(apexes.max(initial=len(vertices) - 1)) + 1 - len(vertices), 3), np.nan)
            vertices, twins = np.concatenate([vertices, rows]), _twins(faces)
        if twins is None:
            raise NumericalError("its surface is open or pinched; use another grid spacing")
        n = len(vertices)
        self.vertices: FloatArray = np.array(vertices, np.float64)
        self.longest: FloatArray = np.full(n, np.inf) if longest is None else longest.copy()
        self._origins: IntArray = np.array(faces, np.int32).ravel()  # start vertex of each side, or -1
        self._twins = twins  # the same edge in the neighbouring face
        self._quadrics = np.zeros((n, _WEIGHTS))
        if longest is None:
            given = [_shared(self._origins), _shared(self.vertices, wp.vec3d), _shared(self._quadrics)]
            wp.launch(add_quadrics, n_faces, given, device="cpu")
            if walls is not None:
                self._add_walls(*walls)

    def _add_walls(self, rim: IntArray, faces: IntArray) -> None:
        """Add the squared distance to a wall on each side of a rim, times the square of the side's length."""
        a, b, c = (self.vertices[faces[:, corner]] for corner in range(3))
        along = self.vertices[rim[:, 1]] - self.vertices[rim[:, 0]]
        outward = np.cross(along, np.cross(b - a, c - a))
        outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-300)
        offset = -(outward * self.vertices[rim[:, 0]]).sum(axis=1)
        (x, y, z), squared = outward.T, (along**2).sum(axis=1)
        products = [x * x, x * y, x * z, y * y, y * z, z * z]
        products += [x * offset, y * offset, z * offset, offset * offset]
        terms = squared[:, None] * np.stack(products, axis=1)
        for ends in rim.T:
            np.add.at(self._quadrics, ends, terms)

    @property
    def mesh(self) -> TriangleMesh:
        """The mesh of the remaining faces; all vertices must be in use (see `compact`)."""
        n = int(np.count_nonzero(~np.isnan(self.vertices[:, 0])))
        faces = self._origins.reshape(-1, 3)
        return TriangleMesh(self.vertices[:n], faces[(faces[:, 0] >= 0) & (faces.max(axis=1) < n)])

    def costs(self) -> tuple[IntArray, FloatArray]:
        """Return one side of each remaining edge, (E,), and the cost of its collapse, (E,)."""
        return self._run_kernel(kernels.cost_of_edges, _shared(self._quadrics))

    def lengths(self) -> tuple[IntArray, FloatArray]:
        """Return one side of each remaining edge, (E,), and its length relative to the largest one, (E,)."""
        return self._run_kernel(kernels.length_of_edges, _shared(self.longest))

    def turns(self) -> tuple[IntArray, FloatArray]:
        """Return one side of each remaining edge, (E,), and the excess of its opposite angles over 180°.

        The excess is 0 [rad] if both faces are not nearly coplanar.
        """
        return self._run_kernel(kernels.excess_of_edges, _shared(self._twins))

    def split(self, sides: IntArray) -> int:
        """Split edges in this order, at most one per face, and return their number."""
        n_vertices, n_sides = len(self.vertices), len(self._origins)
        self.vertices = np.concatenate([self.vertices, np.empty((len(sides), 3))])
        self.longest = np.concatenate([self.longest, np.empty(len(sides))])
        more = np.full(6 * len(sides), -1, np.int32)
        self._origins, self._twins = (np.concatenate([item, more]) for item in (self._origins, self._twins))
        given = [_shared(self.vertices, wp.vec3d), _shared(self.longest)]
        done = self._changed(kernels.split_edges, sides, n_vertices, n_sides // 3, *given)
        self.vertices, self.longest = self.vertices[: n_vertices + done], self.longest[: n_vertices + done]
        self._origins, self._twins = self._origins[: n_sides + 6 * done], self._twins[: n_sides + 6 * done]
        self._quadrics = np.zeros((len(self.vertices), _WEIGHTS))
        return done

    def merge(self, sides: IntArray, most: int | None = None) -> int:
        """Collapse edges in this order, and return their number.

        An edge is not collapsed if an end was merged before, or if this would change the topology or degrade
        adjacent faces.
        """
        marks = np.zeros(len(self.vertices), np.int32)
        given = [_shared(self.vertices, wp.vec3d), _shared(self._quadrics), _shared(self.longest)]
        given += [_shared(marks), _shared(marks.astype(bool))]
        return self._changed(kernels.merge_edges, sides, len(self.vertices) if most is None else most, *given)

    def flip(self, sides: IntArray) -> int:
        """Flip edges in this order, at most one per face, if no face flips over; return their number."""
        return self._changed(kernels.flip_edges, sides, _shared(self.vertices, wp.vec3d))

    def around(self) -> FloatArray:
        """Return the mean of each vertex's neighbours, (V, 3) [mm]; all vertices must be in use."""
        ends = np.roll(self._origins.reshape(-1, 3), -1, axis=1).ravel()
        alive = self._origins >= 0
        starts, ends = self._origins[alive], ends[alive]
        n = len(self.vertices)
        sums = [np.bincount(starts, column[ends], minlength=n) for column in self.vertices.T]
        return np.stack(sums, axis=1) / np.bincount(starts, minlength=n)[:, None]

    def compact(self) -> None:
        """Remove unused vertices and deleted faces."""
        alive = self._origins[::3] >= 0
        number = np.cumsum(alive) - 1
        self._origins = self._origins.reshape(-1, 3)[alive].ravel()
        twins = self._twins.reshape(-1, 3)[alive].ravel()
        self._twins = (3 * number[twins // 3] + twins % 3).astype(np.int32)
        used = np.zeros(len(self.vertices), dtype=bool)
        used[self._origins] = True
        self._origins = (np.cumsum(used, dtype=np.int32) - 1)[self._origins]
        self.vertices, self.longest = self.vertices[used], self.longest[used]
        self._quadrics = self._quadrics[used]

    def _run_kernel(self, kernel: wp.Kernel, *given: wp.array) -> tuple[IntArray, FloatArray]:
        """Return one side of each remaining edge, and the result of a kernel for it."""
        result = np.empty(len(self._origins))
        inputs = [_shared(self._origins), _shared(self.vertices, wp.vec3d), *given, _shared(result)]
        wp.launch(kernel, len(result), inputs, device="cpu")
        sides = np.flatnonzero(np.isfinite(result))
        return sides, result[sides]

    def _changed(self, kernel: wp.Kernel, sides: IntArray, *given: wp.array | int) -> int:
        """Return the number of edges that a sequential kernel changed."""
        done = np.zeros(1, np.int32)
        candidates = _shared(np.ascontiguousarray(sides, np.int32))
        changed = _shared(np.zeros(len(self._origins) // 3, dtype=bool))
        inputs = [candidates, _shared(self._origins), _shared(self._twins), *given, changed, _shared(done)]
        wp.launch(kernel, 1, inputs, device="cpu")
        return int(done[0])


def _shared(array: Array, dtype: object = None) -> wp.array:
    """Return a Warp array that shares the memory of a writable array."""
    return wp.array(array, dtype=dtype or wp.dtype_from_numpy(array.dtype), device="cpu", copy=False)


def _twins(faces: IntArray) -> IntArray | None:
    """Return the opposite of each side; None unless there is one of each."""
    start = faces.ravel().astype(np.int64)
    end = np.roll(faces, -1, axis=1).ravel().astype(np.int64)
    count = int(faces.max()) + 1
    codes = np.minimum(start, end) * count + np.maximum(start, end)
    order = _stable_order(codes)
    if len(order) % 2:
        return None
    first, second = order.reshape(-1, 2).T
    if (start[first] != end[second]).any() or (end[first] != start[second]).any():
        return None
    twins = np.empty(len(codes), np.int32)
    twins[first], twins[second] = second, first
    return twins


def ascending(values: FloatArray) -> IntArray:
    """Return the order of values rounded to single precision; equal ones keep theirs.

    Bits of positive numbers have the order of the numbers, those of negative ones the opposite order.
    """
    bits = values.astype(np.float32).view(np.int32).astype(np.int64)
    return _stable_order(np.where(bits < 0, -(bits & 0x7FFFFFFF), bits) + 2**31)


def _stable_order(codes: IntArray) -> IntArray:
    """Return the result of a stable ``argsort``, but several times as fast by vectorized sorting."""
    bits = len(codes).bit_length()
    if len(codes) and int(codes.max()).bit_length() + bits > 63:
        return np.argsort(codes, kind="stable")
    packed: IntArray = np.sort((codes << bits) | np.arange(len(codes)))
    return packed & ((1 << bits) - 1)
