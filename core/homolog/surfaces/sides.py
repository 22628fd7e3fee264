"""The sides of many meshes, paired by compiled code on all cores."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from homolog.arrays import BoolArray, IntArray
from homolog.device import launch_on_cores, shared
from homolog.surfaces.kernels import sides as kernels
from homolog.surfaces.mesh import TriangleMesh
from homolog.threads import cores

__all__ = ["MeshSides", "batches"]

MESHES_PER_CORE = 4
"""Number of meshes per core whose sides are paired at once: enough to distribute the work evenly."""


@dataclass(frozen=True, slots=True, eq=False)
class MeshSides:
    """The sides of some meshes, numbered consecutively; side 3f + k starts at corner k of face f.

    Attributes
    ----------
    meshes : sequence of TriangleMesh
        S meshes.
    first_vertex, first_face : (S + 1,) int32 arrays
        First vertex and face of each mesh, and the total numbers.
    tail : (3F,) int32 array
        Vertex at which each side starts, numbered over all meshes.
    twin : (3F,) int32 array
        The same edge as a side of the neighbouring face; -1 at a rim.
    start : (N,) int32 array
        First entry of each vertex in `leaving`.
    leaving : (3F,) int32 array
        Sides sorted by tail.
    is_paired : (S,) bool array
        Whether the twins of a mesh are valid: each side occurs once, and has at most one opposite side.
    """

    meshes: Sequence[TriangleMesh]
    first_vertex: IntArray
    first_face: IntArray
    tail: IntArray
    twin: IntArray
    start: IntArray
    leaving: IntArray
    is_paired: BoolArray

    @classmethod
    def of(cls, meshes: Sequence[TriangleMesh]) -> "MeshSides":
        """Pair the sides of meshes whose faces refer to their vertices."""
        first_vertex, first_face = (
            np.concatenate([[0], np.cumsum([len(item) for item in items])]).astype(np.int32)
            for items in ([mesh.vertices for mesh in meshes], [mesh.faces for mesh in meshes])
        )
        faces = np.concatenate([mesh.faces.ravel() for mesh in meshes])
        tail, twin, leaving = np.zeros((3, len(faces)), np.int32)
        start, is_paired = np.zeros(first_vertex[-1], np.int32), np.zeros(len(meshes), dtype=bool)
        made = cls(meshes, first_vertex, first_face, tail, twin, start, leaving, is_paired)
        inputs = [shared(faces), made.for_kernels(), shared(is_paired)]
        launch_on_cores(kernels.pair_sides, len(meshes), inputs)
        return made

    def for_kernels(self) -> Any:  # noqa: ANN401 - a wp.struct has no type
        """Return the kernels' struct `Sides` on the CPU, which shares the memory."""
        sides = kernels.Sides()
        for name in ("first_vertex", "first_face", "tail", "twin", "start", "leaving"):
            setattr(sides, name, shared(getattr(self, name)))
        return sides

    def positions(self) -> Any:  # noqa: ANN401 - a wp.array
        """Return the vertices of all meshes, (N,) vec3d, for kernels on the CPU."""
        joined = np.concatenate([mesh.vertices for mesh in self.meshes])
        return wp.array(joined, dtype=wp.vec3d, device="cpu", copy=False)


def batches(count: int) -> Iterator[slice]:
    """Yield slices of `count` meshes, large enough for all cores and small in memory."""
    size = MESHES_PER_CORE * cores()
    for begin in range(0, count, size):
        yield slice(begin, begin + size)
