"""Intrinsic Delaunay triangulations: the same surface, the same vertices, better triangles.

The distance within a surface of flat triangles does not depend on how it is cut into triangles. Edges are
flipped within the surface, straight lines over former edges included, until the angles that face each edge
sum to at most 180 degrees (Bobenko and Springborn 2007; Fisher et al. 2007). The fast iterative method is
then both quicker and more exact: slivers are what it has to go over again, and where it errs.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from homolog.arrays import FloatArray, IntArray
from homolog.device import cores
from homolog.geodesics.intrinsic_kernels import Sides, add_angles, flip_to_delaunay, list_sides, pair_sides
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["Triangulation", "triangulate"]


@dataclass(frozen=True, slots=True, eq=False)
class Triangulation:
    """Triangles of several shapes, one shape after another; side 3f + k leaves corner k of face f.

    Attributes
    ----------
    tail : (3F,) int32 array
        Vertex that each side starts from, counted through all shapes.
    twin : (3F,) int32 array
        The same edge as a side of the neighbouring face.
    length : (3F,) float64 array
        Length of each side [mm].
    turn : (N,) float64 array
        Sum of the angles around each vertex; a full turn where the surface is flat.
    """

    tail: IntArray
    twin: IntArray
    length: FloatArray
    turn: FloatArray

    def on_device(self, device: str) -> Any:  # noqa: ANN401 - a wp.struct has no type
        """Return the `Sides` for kernels."""
        sides = Sides()
        for name, kind in (("tail", wp.int32), ("twin", wp.int32), ("length", wp.float64)):
            setattr(sides, name, wp.array(getattr(self, name), dtype=kind, device=device))
        return sides


def triangulate(meshes: Sequence[TriangleMesh]) -> Triangulation:
    """Return the intrinsic Delaunay triangulations of checked meshes.

    Vertices stay where they are. Two of them may come to be joined by several edges, or one to itself.
    """
    first = np.concatenate([[0], np.cumsum([len(mesh.vertices) for mesh in meshes])])
    ends = np.concatenate([[0], np.cumsum([3 * len(mesh.faces) for mesh in meshes])])
    tail = np.concatenate(
        [mesh.faces.ravel() + at for mesh, at in zip(meshes, first[:-1], strict=True)], dtype=np.int32
    )
    length = np.concatenate([_lengths(mesh) for mesh in meshes])
    result = Triangulation(tail, _twins(tail, int(first[-1])), length, np.zeros(first[-1]))
    sides = result.on_device("cpu")
    waiting, stack = (wp.zeros(len(tail), dtype=wp.int32, device="cpu") for _ in range(2))

    def flip(shape: int) -> None:
        begin, end = int(ends[shape]), int(ends[shape + 1])
        wp.launch(flip_to_delaunay, 1, inputs=[sides, begin, end, waiting, stack[begin:end]], device="cpu")

    wp.load_module(flip_to_delaunay.module, device="cpu")  # before the threads, which would each load it
    with ThreadPoolExecutor(min(cores(), len(meshes))) as pool:
        list(pool.map(flip, range(len(meshes))))
    wp.launch(add_angles, len(tail), inputs=[sides, result.turn], device="cpu")
    return Triangulation(sides.tail.numpy(), sides.twin.numpy(), sides.length.numpy(), result.turn)


def _lengths(mesh: TriangleMesh) -> FloatArray:
    corners = mesh.vertices[mesh.faces]
    return np.asarray(np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).ravel())


def _twins(tail: IntArray, n_vertices: int) -> IntArray:
    start = np.concatenate([[0], np.cumsum(np.bincount(tail, minlength=n_vertices))]).astype(np.int32)
    listed, twin = np.empty((2, len(tail)), np.int32)
    wp.launch(list_sides, len(tail), inputs=[tail, start[:-1].copy(), listed], device="cpu")
    wp.launch(pair_sides, len(tail), inputs=[tail, start, listed, twin], device="cpu")
    return twin
