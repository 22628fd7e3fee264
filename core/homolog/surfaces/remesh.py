"""Even triangles: split, collapse and flip edges, slide vertices along the surface, over and over.

After Botsch and Kobbelt, A Remeshing Approach to Multiresolution Modeling (SGP 2004). All steps act on
independent edges at once. Topology does not change.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from homolog.arrays import Array, BoolArray, FloatArray, IntArray
from homolog.errors import NumericalError
from homolog.surfaces.collapses import MergedMesh
from homolog.surfaces.distance_field import DistanceField
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["Sizes", "curvature_sizes", "remeshed"]

Sizes = Callable[[FloatArray], FloatArray]
"""Wished edge length [mm] at points (N, 3), shape (N,)."""

_LONG, _SHORT = 4.0 / 3.0, 3.0 / 4.0  # of the target edge length
_SWEEPS = 5
_COLLAPSES = 8  # rounds of a sweep, at most
_FEW = 0.003  # of the vertices: a round that would change less is left out
_SLIDE = 0.6
_SHARPEST = 0.3  # cosine between a face's normal before and after a change


def remeshed(mesh: TriangleMesh, field: DistanceField, sizes: float | Sizes) -> TriangleMesh:
    """Return a mesh of a field's zero level with edges of about the target length.

    Parameters
    ----------
    mesh : TriangleMesh
        A closed manifold near the zero level.
    field : DistanceField
        Whose zero level the vertices are put on.
    sizes : float or callable
        Wished edge length [mm], the same everywhere or at each place.

    Returns
    -------
    TriangleMesh

    Raises
    ------
    NumericalError
        If the mesh is not closed.
    """
    vertices: FloatArray = np.array(mesh.vertices)
    faces: IntArray = np.array(mesh.faces, dtype=np.int64)
    for _ in range(_SWEEPS):
        size = sizes(vertices) if callable(sizes) else np.full(len(vertices), sizes)
        vertices, faces, size = _split(vertices, faces, size)
        vertices, faces, size = _collapse(vertices, faces, size)
        faces = _flip(vertices, faces)
        vertices = _slide(vertices, faces, field)
    return TriangleMesh(vertices, faces)


@dataclass(frozen=True, slots=True, eq=False)
class _Edges:
    """Edges of a closed mesh: ends (E, 2), the two faces (E, 2) and the vertex opposite in each (E, 2)."""

    ends: IntArray
    faces: IntArray
    opposite: IntArray


def _edges(faces: IntArray) -> _Edges:
    a, b, c = faces.T
    start, end = np.concatenate([a, b, c]), np.concatenate([b, c, a])
    n_vertices = int(faces.max()) + 1
    codes = np.minimum(start, end) * n_vertices + np.maximum(start, end)
    order = _stable_order(codes)
    if len(order) % 2 or (codes[order[::2]] != codes[order[1::2]]).any():
        raise NumericalError("its surface is open or pinched; use another grid spacing")
    twice = order.reshape(-1, 2)
    low, high = np.divmod(codes[twice[:, 0]], n_vertices)
    apex = np.concatenate([c, a, b])
    return _Edges(np.stack([low, high], axis=1), twice % len(faces), apex[twice])


def _stable_order(codes: IntArray) -> IntArray:
    """Return what a stable ``argsort`` returns, several times as fast: numbers are sorted with vectors."""
    bits = len(codes).bit_length()
    if len(codes) and int(codes.max()).bit_length() + bits > 63:
        return np.argsort(codes, kind="stable")
    packed: IntArray = np.sort((codes << bits) | np.arange(len(codes)))
    return packed & ((1 << bits) - 1)


def _lengths(vertices: FloatArray, ends: IntArray) -> FloatArray:
    return np.asarray(np.linalg.norm(vertices[ends[:, 0]] - vertices[ends[:, 1]], axis=1))


def _normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300))


def _best_of_each_face(score: FloatArray, edges: _Edges, n_faces: int) -> BoolArray:
    """Choose edges that have the highest score, above 0, in both of their faces."""
    candidates = np.flatnonzero(score > 0.0)
    near = edges.faces[candidates]
    rank = np.empty(len(candidates), np.int64)
    rank[np.argsort(score[candidates], kind="stable")] = np.arange(len(candidates))
    best = np.full(n_faces, -1)
    np.maximum.at(best, near.ravel(), np.repeat(rank, 2))
    chosen = np.zeros(len(score), dtype=bool)
    chosen[candidates] = (best[near] == rank[:, None]).all(axis=1)
    return chosen


def _split(
    vertices: FloatArray, faces: IntArray, size: FloatArray
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Halve edges that are too long, at most one in each face, until there are none."""
    while True:
        vertices, faces, size, n_split = _split_once(vertices, faces, size)
        if n_split <= _FEW * len(vertices):
            return vertices, faces, size


def _split_once(
    vertices: FloatArray, faces: IntArray, size: FloatArray
) -> tuple[FloatArray, IntArray, FloatArray, int]:
    edges = _edges(faces)
    excess = _lengths(vertices, edges.ends) / (_LONG * size[edges.ends].mean(axis=1)) - 1.0
    chosen = _best_of_each_face(excess, edges, len(faces))
    ends, touched = edges.ends[chosen], edges.faces[chosen]
    middle = len(vertices) + np.arange(len(ends))
    vertices = np.concatenate([vertices, vertices[ends].mean(axis=1)])
    size = np.concatenate([size, size[ends].mean(axis=1)])
    added = []
    faces = faces.copy()
    for side in range(2):
        old = faces[touched[:, side]]
        far = np.where(old == ends[:, 1:], middle[:, None], old)
        added.append(np.where(old == ends[:, :1], middle[:, None], old))
        faces[touched[:, side]] = far
    return vertices, np.concatenate([faces, *added]), size, len(ends)


def _collapse(
    vertices: FloatArray, faces: IntArray, size: FloatArray
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Merge the ends of edges that are too short, where neither topology nor shape suffers."""
    merged = MergedMesh.of(vertices, faces, _LONG * size)
    for _ in range(_COLLAPSES):
        sides, ends = merged.ends
        ratio = _lengths(merged.vertices, ends) / (_SHORT * size[ends].mean(axis=1))
        short = np.flatnonzero(ratio < 1.0)
        if merged.merge(sides[short[np.argsort(ratio[short], kind="stable")]]) <= _FEW * len(vertices):
            break
    vertices, faces, kept = merged.compact()
    return vertices, faces, size[kept]


def _flip(vertices: FloatArray, faces: IntArray) -> IntArray:
    """Turn edges whose opposite angles sum to more than 180° (Delaunay), at most one in each face."""
    for _ in range(3):
        edges = _edges(faces)
        a, b, c, d = vertices[[*edges.ends.T, *edges.opposite.T]].reshape(4, -1, 3)
        excess = _angles(c, a, b) + _angles(d, a, b) - np.pi - 1e-6
        sheets = _normals(vertices, faces)[edges.faces]
        excess[(sheets[:, 0] * sheets[:, 1]).sum(axis=1) < 1.0 - 2.0 * _SHARPEST] = 0.0
        chosen = np.flatnonzero(_best_of_each_face(excess, edges, len(faces)))
        if len(chosen) < _FEW * len(vertices):
            break
        faces = _flipped(vertices, faces, edges, chosen)
    return faces


def _flipped(vertices: FloatArray, faces: IntArray, edges: _Edges, chosen: IntArray) -> IntArray:
    across = np.sort(edges.opposite[chosen], axis=1)
    base = int(faces.max()) + 1
    keys = across[:, 0] * base + across[:, 1]
    new = ~np.isin(keys, edges.ends[:, 0] * base + edges.ends[:, 1])
    first = np.zeros(len(keys), dtype=bool)
    first[np.unique(keys, return_index=True)[1]] = True
    pairs = []
    for side in range(2):
        old = faces[edges.faces[chosen, side]]
        after_apex = (np.argmax(old == edges.opposite[chosen, side, None], axis=1) + 1) % 3
        turned = old.copy()
        turned[np.arange(len(old)), after_apex] = edges.opposite[chosen, 1 - side]
        pairs.append((old, turned))
    normal = sum(_normals(vertices, old) for old, _ in pairs)
    sound = new & first
    for _, turned in pairs:
        sound &= (_normals(vertices, turned) * normal).sum(axis=1) > 2.0 * _SHARPEST
    result = faces.copy()
    for side, (_, turned) in enumerate(pairs):
        result[edges.faces[chosen[sound], side]] = turned[sound]
    return result


def _angles(apex: FloatArray, a: FloatArray, b: FloatArray) -> Array:
    """Angle at `apex` between the directions to `a` and `b`."""
    u, v = a - apex, b - apex
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), (u * v).sum(axis=1)))


def _slide(vertices: FloatArray, faces: IntArray, field: DistanceField) -> FloatArray:
    """Move each vertex towards the middle of its neighbours, and back onto the zero level."""
    ends = _edges(faces).ends
    both = np.concatenate([ends, ends[:, ::-1]])
    ones = np.ones(len(both))
    near = sparse.csr_array((ones, (both[:, 0], both[:, 1])), shape=(len(vertices),) * 2)
    step = near @ vertices / near.sum(axis=1)[:, None] - vertices
    normals = field.sample(vertices)[1]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    step -= (step * normals).sum(axis=1, keepdims=True) * normals
    return field.projected(vertices + _SLIDE * step)


def curvature_sizes(curvature: FloatArray, edge: float) -> FloatArray:
    """Return edge lengths [mm] that are short where the curvature is large; `edge` is the typical one."""
    return np.asarray(edge * np.clip(curvature / np.median(curvature), 0.4, 6.0) ** -0.5)
