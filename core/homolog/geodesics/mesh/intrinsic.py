"""Intrinsic Delaunay triangulations: the same surface, the same vertices, better triangles.

Distances within a surface of flat triangles do not depend on its triangulation. Edges are flipped within the
surface, where new edges are straight lines across former ones, until the two angles opposite to each edge
sum to at most 180 degrees (Bobenko and Springborn 2007; Fisher et al. 2007). The fast iterative method is
then faster and more accurate, because slivers need repeated updates and cause its largest errors.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from homolog.arrays import FloatArray, IntArray
from homolog.device import cores
from homolog.geodesics.kernels.intrinsic import Sides, assign_ranks, flip_to_delaunay, pair_sides
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["Triangulation", "triangulate"]

SIDES = {
    "tail": wp.int32,
    "twin": wp.int32,
    "length": wp.float64,
    "rank": wp.int32,
}
"""Arrays of a triangulation, and their types in kernels."""


@dataclass(frozen=True, slots=True, eq=False)
class Triangulation:
    """Triangulation of several shapes, one after another; side 3f + k starts at corner k of face f.

    Attributes
    ----------
    first : (S + 1,) int64 array
        First vertex of each shape.
    tail : (3F,) int32 array
        Vertex at which each side starts, numbered through all shapes.
    twin : (3F,) int32 array
        The same edge as a side of the neighbouring face.
    length : (3F,) float64 array
        Length of each side [mm].
    rank : (3F,) int32 array
        Rank of each side among those that start at its tail, counterclockwise.
    """

    first: IntArray
    tail: IntArray
    twin: IntArray
    length: FloatArray
    rank: IntArray

    def starts(self) -> IntArray:
        """Return the first entry of each vertex, (N + 1,), in a list of sides sorted by tail."""
        return _starts(self.tail, int(self.first[-1]))

    def on_device(self, device: str) -> Any:  # noqa: ANN401 - a wp.struct has no type
        """Return the `Sides` for kernels."""
        sides = Sides()
        for name, kind in SIDES.items():
            setattr(sides, name, wp.array(getattr(self, name), dtype=kind, device=device))
        return sides


def triangulate(meshes: Sequence[TriangleMesh]) -> Triangulation:
    """Compute the intrinsic Delaunay triangulations of checked meshes.

    Vertices do not change. Several edges may join the same two vertices, and an edge may be a loop.
    """
    wp.load_module(flip_to_delaunay.module, device="cpu")  # otherwise each thread would load it
    with ThreadPoolExecutor(min(cores(), len(meshes))) as pool:
        parts = list(pool.map(_triangulate, meshes))
    first = np.concatenate([[0], np.cumsum([len(mesh.vertices) for mesh in meshes])])
    sides = np.concatenate([[0], np.cumsum([len(part.tail) for part in parts])])
    return Triangulation(
        first,
        np.concatenate([part.tail + at for part, at in zip(parts, first[:-1], strict=True)], dtype=np.int32),
        np.concatenate([part.twin + at for part, at in zip(parts, sides[:-1], strict=True)], dtype=np.int32),
        np.concatenate([part.length for part in parts]),
        np.concatenate([part.rank for part in parts]),
    )


def _triangulate(mesh: TriangleMesh) -> Triangulation:
    n = len(mesh.vertices)
    tail = np.array(mesh.faces.ravel())
    twin, queued, stack = np.zeros((3, len(tail)), np.int32)
    start = _starts(tail, n)
    leaving_sides = np.argsort(tail, kind="stable").astype(np.int32)
    wp.launch(pair_sides, len(tail), inputs=[tail, start, leaving_sides, twin], device="cpu")
    first = np.array([0, n])
    sides = Triangulation(first, tail, twin, _lengths(mesh), np.zeros_like(tail)).on_device("cpu")
    wp.launch(flip_to_delaunay, 1, inputs=[sides, queued, stack], device="cpu")
    leaving = np.zeros(n, np.int32)
    leaving[sides.tail.numpy()] = np.arange(len(tail))
    wp.launch(assign_ranks, n, inputs=[sides, leaving], device="cpu")
    return Triangulation(first, *(getattr(sides, name).numpy() for name in SIDES))


def _lengths(mesh: TriangleMesh) -> FloatArray:
    corners = mesh.vertices[mesh.faces]
    return np.asarray(np.linalg.norm(corners[:, [1, 2, 0]] - corners, axis=2).ravel())


def _starts(tail: IntArray, n_vertices: int) -> IntArray:
    return np.concatenate([[0], np.cumsum(np.bincount(tail, minlength=n_vertices))]).astype(np.int32)
