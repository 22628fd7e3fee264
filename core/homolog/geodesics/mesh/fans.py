"""The fan of triangles around every vertex, and clusters of source vertices."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from homolog.arrays import IntArray, frozen
from homolog.device import launch_on_cores, shared
from homolog.geodesics.kernels.fans import Growth, fill_corners, find_margins, grow_clusters
from homolog.geodesics.kernels.local_solver import Corner
from homolog.geodesics.kernels.lookup import LANES
from homolog.geodesics.mesh.intrinsic import Triangulation
from homolog.surfaces.kernels.sides import Sides as PairedSides
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["Clusters", "Fans", "build_fans", "find_clusters"]

MAX_VISITS = 40
"""Vertices visited to grow a full cluster: about three rings."""
MAX_VISITS_FOR_REST = 120
"""Vertices visited to group the remaining ones; wider clusters would have larger patches."""


@dataclass(frozen=True, slots=True, eq=False)
class Fans:
    """The fans of one or more shapes, one shape after another, in arrays on one device.

    Attributes
    ----------
    first : (S + 1,) int64 array
        First vertex of each shape, and the number of all vertices; on the host.
    position : (N,) vec3 wp.array
        Vertices of the centred shapes.
    start : (N + 1,) int32 wp.array
        First corner of each vertex.
    corners : (K,) Corner wp.array
        Triangles as seen from each vertex; vertex indices are local to their shape.
    margin : (K,) float wp.array
        Decides which neighbours a decrease can affect (see `find_margins`).
    """

    first: IntArray
    position: Any
    start: Any
    corners: Any
    margin: Any


def build_fans(meshes: Sequence[TriangleMesh], delaunay: Triangulation, device: str) -> Fans:
    """Build the fans of checked meshes (see `homolog.surfaces.topology.check_mesh`).

    Parameters
    ----------
    meshes : sequence of TriangleMesh
        Checked meshes.
    delaunay : Triangulation
        Their intrinsic Delaunay triangulation.
    device : str
        Warp device.

    Returns
    -------
    Fans
    """
    first = delaunay.first
    centred = np.concatenate([mesh.vertices - mesh.vertices.mean(axis=0) for mesh in meshes])
    face_first = np.repeat(first[:-1], [len(mesh.faces) for mesh in meshes])
    sides = delaunay.on_device(device)
    with wp.ScopedDevice(device):
        start = wp.array(delaunay.starts(), dtype=wp.int32)
        corners = wp.empty(len(delaunay.tail), dtype=Corner)
        faces_first = wp.array(face_first.astype(np.int32), dtype=wp.int32)
        wp.launch(fill_corners, len(corners), inputs=[sides, faces_first, start, corners])
        margin = wp.empty(len(corners), dtype=wp.float32)
        wp.launch(find_margins, len(centred), inputs=[start, corners, margin])
        position = wp.array(centred.astype(np.float32), dtype=wp.vec3)
    return Fans(first, position, start, corners, margin)


@dataclass(frozen=True, slots=True, eq=False)
class Clusters:
    """A partition of all vertices into clusters of neighbours, numbered through all shapes.

    Attributes
    ----------
    members : (C, LANES) int32 array
        Vertices of each cluster, numbered within their shape; -1 in unused lanes.
    shape : (C,) int32 array
        Shape of each cluster, ascending.
    slot : (N,) int32 array
        LANES * cluster + lane of every vertex.
    """

    members: IntArray
    shape: IntArray
    slot: IntArray


def find_clusters(delaunay: Triangulation) -> Clusters:
    """Group vertices into clusters of at most LANES, grown along edges, on the host.

    Clusters grown in space would join the two walls of a thin shape.
    """
    n_shapes, n = len(delaunay.first) - 1, int(delaunay.first[-1])
    sides, growth = PairedSides(), Growth()
    sides.first_vertex, sides.first_face = (
        shared(delaunay.first.astype(np.int32)),
        shared(delaunay.first_face),
    )
    sides.tail, sides.leaving = shared(delaunay.tail), shared(np.empty_like(delaunay.tail))
    slot, count = np.empty(n, np.int32), np.zeros(n_shapes, np.int32)
    sides.start, growth.seen, growth.queue, growth.front = map(shared, np.empty((4, n), np.int32))
    growth.slot, growth.members = shared(slot), shared(np.empty((n_shapes, LANES), np.int32))
    given = [MAX_VISITS, MAX_VISITS_FOR_REST, sides, growth, shared(count)]
    launch_on_cores(grow_clusters, n_shapes, given)
    before = np.cumsum(count) - count
    slot += np.repeat(LANES * before, np.diff(delaunay.first)).astype(np.int32)
    members = np.full((count.sum(), LANES), -1, np.int32)
    members.ravel()[slot] = np.arange(n) - np.repeat(delaunay.first[:-1], np.diff(delaunay.first))
    shape = np.repeat(np.arange(n_shapes, dtype=np.int32), count)
    return Clusters(frozen(members), frozen(shape), frozen(slot))
