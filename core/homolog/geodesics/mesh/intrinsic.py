"""Intrinsic Delaunay triangulations: the same surface, the same vertices, better triangles.

Distances within a surface of flat triangles do not depend on its triangulation. Edges are flipped within the
surface, where new edges are straight lines across former ones, until the two angles opposite to each edge
sum to at most 180 degrees (Bobenko and Springborn 2007; Fisher et al. 2007). The fast iterative method is
then faster and more accurate, because slivers need repeated updates and cause its largest errors.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from homolog.arrays import FloatArray, IntArray
from homolog.device import launch_on_cores, shared
from homolog.geodesics.kernels.intrinsic import triangulate_meshes
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.sides import MeshSides

__all__ = ["Triangulation", "triangulate"]


@dataclass(frozen=True, slots=True, eq=False)
class Triangulation:
    """Triangulation of several shapes, one after another.

    Attributes
    ----------
    sides : MeshSides
        Its sides. Vertices are those of the meshes; several edges may join the same two vertices, and an edge
        may be a loop.
    length : (3F,) float64 array
        Length of each side [mm].
    rank : (3F,) int32 array
        Rank of each side among those that start at its tail, counterclockwise.
    """

    sides: MeshSides
    length: FloatArray
    rank: IntArray


def triangulate(meshes: Sequence[TriangleMesh]) -> Triangulation:
    """Compute the intrinsic Delaunay triangulations of checked meshes."""
    sides = MeshSides.of(meshes)
    length, (rank, queued, stack) = np.empty(len(sides.tail)), np.zeros((3, len(sides.tail)), np.int32)
    inputs = [sides.for_kernels(), sides.positions(), shared(length)]
    inputs += [shared(item) for item in (rank, queued, stack)]
    launch_on_cores(triangulate_meshes, len(meshes), inputs)
    return Triangulation(sides, length, rank)
