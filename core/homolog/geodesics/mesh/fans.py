"""The fan of triangles around every vertex, and clusters of source vertices."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from homolog.arrays import Float32Array, IntArray, frozen
from homolog.device import launch_on_cores, shared
from homolog.geodesics.kernels.fans import Fans, Groups, Growth, fill_corners, find_margins, grow_clusters
from homolog.geodesics.kernels.local_solver import Corner
from homolog.geodesics.kernels.lookup import LANES
from homolog.geodesics.mesh.intrinsic import Triangulation
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["Clusters", "build_fans", "find_clusters", "group_members"]

MAX_VISITS = 40
"""Vertices visited to grow a full cluster: about three rings."""
MAX_VISITS_FOR_REST = 120
"""Vertices visited to group the remaining ones; wider clusters would have larger patches."""


def build_fans(meshes: Sequence[TriangleMesh], delaunay: Triangulation, device: str) -> Any:  # noqa: ANN401
    """Return the `Fans` of checked meshes and their intrinsic triangulations, on a device."""
    centred = np.concatenate([mesh.vertices - mesh.vertices.mean(axis=0) for mesh in meshes])
    tail, twin = delaunay.sides.tail, delaunay.sides.twin
    owners = np.concatenate([tail, tail[twin < 0]])
    start = np.append(0, np.cumsum(np.bincount(owners, minlength=len(centred)))).astype(np.int32)
    first = np.repeat(delaunay.sides.first_vertex[:-1], [len(mesh.faces) for mesh in meshes])
    fans = Fans()
    sides = [wp.array(item, device=device) for item in (tail, twin, delaunay.length, delaunay.rank, first)]
    fans.position = wp.array(centred.astype(np.float32), dtype=wp.vec3, device=device)
    fans.start = wp.array(start, device=device)
    fans.corners = wp.empty(len(owners), dtype=Corner, device=device)
    fans.margin = wp.empty(len(owners), dtype=wp.float32, device=device)
    wp.launch(fill_corners, len(tail), inputs=[*sides, fans], device=device)
    wp.launch(find_margins, len(centred), inputs=[fans], device=device)
    return fans


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

    They do not grow in space, because this would join the two walls of a thin shape.
    """
    sides, growth = delaunay.sides, Growth()
    sizes = np.diff(sides.first_vertex)
    slot, count = np.empty(sizes.sum(), np.int32), np.zeros(len(sizes), np.int32)
    growth.seen, growth.queue, growth.front = map(shared, np.empty((3, len(slot)), np.int32))
    growth.slot, growth.members = shared(slot), shared(np.empty((len(sizes), LANES), np.int32))
    inputs = [MAX_VISITS, MAX_VISITS_FOR_REST, sides.for_kernels(), growth, shared(count)]
    launch_on_cores(grow_clusters, len(sizes), inputs)
    slot += np.repeat(LANES * (np.cumsum(count) - count), sizes).astype(np.int32)
    members = np.full((count.sum(), LANES), -1, np.int32)
    members.ravel()[slot] = np.arange(len(slot)) - np.repeat(sides.first_vertex[:-1], sizes)
    shape = np.repeat(np.arange(len(sizes), dtype=np.int32), count)
    return Clusters(frozen(members), frozen(shape), frozen(slot))


def group_members(members: IntArray, positions: Float32Array, device: str) -> Any:  # noqa: ANN401
    """Return the `Groups` of clusters on a device, from their members and the positions of these."""
    is_member = members >= 0
    centres = np.sum(positions, axis=1, where=is_member[..., None]) / is_member.sum(axis=1, keepdims=True)
    distances = np.linalg.norm(positions - centres[:, None], axis=2)
    radii = np.max(distances, axis=1, where=is_member, initial=0.0)
    groups = Groups()
    groups.members = wp.array(members, dtype=wp.int32, device=device)
    groups.centre = wp.array(centres, dtype=wp.vec3, device=device)
    groups.radius = wp.array(radii, dtype=wp.float32, device=device)
    return groups
