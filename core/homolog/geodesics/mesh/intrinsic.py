"""Intrinsic Delaunay triangulations: the same surface, the same vertices, better triangles.

Distances within a surface of flat triangles do not depend on its triangulation. Edges are flipped within the
surface, where new edges are straight lines across former ones, until the two angles opposite to each edge
sum to at most 180 degrees (Bobenko and Springborn 2007; Fisher et al. 2007). The fast iterative method is
then faster and more accurate, because slivers need repeated updates and cause its largest errors.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from homolog.arrays import FloatArray, IntArray
from homolog.device import launch_on_cores, shared
from homolog.geodesics.kernels.intrinsic import Sides, triangulate_meshes
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.sides import MeshSides

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
    first_face : (S + 1,) int32 array
        First face of each shape.
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
    first_face: IntArray
    tail: IntArray
    twin: IntArray
    length: FloatArray
    rank: IntArray

    def starts(self) -> IntArray:
        """Return the first entry of each vertex, (N + 1,), in a list of sides sorted by tail."""
        counts = np.bincount(self.tail, minlength=int(self.first[-1]))
        return np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)

    def on_device(self, device: str) -> Any:  # noqa: ANN401 - a wp.struct has no type
        """Return the `Sides` for kernels, on the CPU on the same memory."""
        sides = Sides()
        for name, kind in SIDES.items():
            array = wp.array(getattr(self, name), dtype=kind, device=device, copy=device != "cpu")
            setattr(sides, name, array)
        return sides


def triangulate(meshes: Sequence[TriangleMesh]) -> Triangulation:
    """Compute the intrinsic Delaunay triangulations of checked meshes.

    Vertices do not change. Several edges may join the same two vertices, and an edge may be a loop.
    """
    paired = MeshSides.of(meshes)
    first, n = paired.first_vertex.astype(np.int64), len(paired.tail)
    rank, queued, stack = np.zeros((3, n), np.int32)
    result = Triangulation(first, paired.first_face, paired.tail, paired.twin, np.empty(n), rank)
    inputs = [shared(paired.first_face), paired.positions(), result.on_device("cpu")]
    inputs += [shared(item) for item in (queued, stack, paired.leaving)]
    launch_on_cores(triangulate_meshes, len(meshes), inputs)
    return result
