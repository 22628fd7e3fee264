"""Meshes made ready for the solver: the triangles around every vertex, and clusters of neighbouring sources."""

# mypy: disable-error-code="valid-type"
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from homolog.arrays import FloatArray, IntArray, frozen
from homolog.geodesics.kernels import Corner
from homolog.geodesics.lookup import LANES
from homolog.surfaces.mesh import TriangleMesh

wp.set_module_options({"enable_backward": False})

__all__ = ["Clusters", "Fans", "build_fans", "find_clusters"]

UNSEEN = wp.constant(-1)
IN_FRONT = wp.constant(-2)
NEAR_VISITS = 40
"""Vertices looked at for a full cluster: about three rings."""
FAR_VISITS = 120
"""Vertices looked at to group what was left over: one wide cluster would make all others wait."""


@dataclass(frozen=True, slots=True, eq=False)
class Fans:
    """All shapes of a call, one after another, as arrays on one device.

    Attributes
    ----------
    first : (S + 1,) int64 array
        First vertex of each shape, on the host.
    mean_edge : (S,) float64 array
        Mean edge length of each shape [mm], on the host.
    position : (N,) vec3 wp.array
        Vertices, each shape centred.
    start : (N + 1,) int32 wp.array
        First corner of each vertex.
    corners : (3F,) Corner wp.array
        Triangles as seen from each vertex; they count vertices within their shape.
    """

    first: IntArray
    mean_edge: FloatArray
    position: Any
    start: Any
    corners: Any


@wp.kernel
def count_corners(faces: wp.array2d(dtype=wp.int32), start: wp.array(dtype=wp.int32)):
    face, side = wp.tid()
    wp.atomic_add(start, faces[face, side] + 1, 1)


@wp.kernel
def fill_corners(
    faces: wp.array2d(dtype=wp.int32),
    first: wp.array(dtype=wp.int32),
    vertices: wp.array(dtype=wp.vec3d),
    free: wp.array(dtype=wp.int32),
    corners: wp.array(dtype=Corner),
):
    face, side = wp.tid()
    c = faces[face, side]
    a = faces[face, (side + 1) % 3]
    b = faces[face, (side + 2) % 3]
    ab = vertices[b] - vertices[a]
    ac = vertices[c] - vertices[a]
    bc = vertices[c] - vertices[b]
    length = wp.length(ab)
    corner = Corner()
    corner.a = a - first[face]
    corner.b = b - first[face]
    corner.length = float(length)
    corner.half = float(wp.float64(0.5) / length)
    corner.x = float(wp.dot(ab, ac) / length)
    corner.y = float(wp.length(wp.cross(ab, ac)) / length)
    corner.ac = float(wp.length(ac))
    corner.bc = float(wp.length(bc))
    corners[wp.atomic_add(free, c, 1)] = corner


def build_fans(meshes: Sequence[TriangleMesh], device: str) -> Fans:
    """Return the fans of checked meshes (see `homolog.surfaces.topology.check_mesh`)."""
    counts = [len(mesh.vertices) for mesh in meshes]
    first = np.concatenate([[0], np.cumsum(counts)])
    centred = np.concatenate([mesh.vertices - mesh.vertices.mean(axis=0) for mesh in meshes])
    faces = np.concatenate([mesh.faces + offset for mesh, offset in zip(meshes, first[:-1], strict=True)])
    face_first = np.repeat(first[:-1], [len(mesh.faces) for mesh in meshes])
    with wp.ScopedDevice(device):
        faces_there = wp.array(faces.astype(np.int32), dtype=wp.int32, ndim=2)
        start = wp.zeros(len(centred) + 1, dtype=wp.int32)
        corners = wp.empty(faces.size, dtype=Corner)
        wp.launch(count_corners, faces.shape, inputs=[faces_there, start])
        wp.utils.array_scan(start, start, inclusive=True)
        wp.launch(
            fill_corners,
            faces.shape,
            inputs=[
                faces_there,
                wp.array(face_first.astype(np.int32), dtype=wp.int32),
                wp.array(centred, dtype=wp.vec3d),
                wp.clone(start),
                corners,
            ],
        )
        position = wp.array(centred.astype(np.float32), dtype=wp.vec3)
    mean_edge = np.array([mesh.mean_edge for mesh in meshes])
    return Fans(first, mean_edge, position, start, corners)


@wp.func
def gather(
    seed: int,
    visits: int,
    base: int,
    cluster: int,
    fan: wp.array(dtype=wp.int32),
    corners: wp.array(dtype=Corner),
    slot: wp.array(dtype=wp.int32),
    seen: wp.array(dtype=wp.int32),
    queue: wp.array(dtype=wp.int32),
    members: wp.array2d(dtype=wp.int32),
) -> wp.vec2i:
    """Walk over the mesh from a seed; list the first LANES vertices without a cluster among those visited.

    Returns how many there are and how many vertices the queue holds.
    """
    stamp = seen[0] + 1
    seen[0] = stamp
    queue[0] = seed
    seen[seed + 1] = stamp
    tail = int(1)
    found = int(0)
    head = int(0)
    while head < tail and head < visits and found < LANES:
        v = queue[head]
        head += 1
        if slot[v] < 0:
            members[cluster, found] = v - base
            found += 1
        for k in range(fan[v], fan[v + 1]):
            y = corners[k].a + base
            if seen[y + 1] != stamp:
                seen[y + 1] = stamp
                queue[tail] = y
                tail += 1
    return wp.vec2i(found, tail)


@wp.kernel
def grow_clusters(
    first: wp.array(dtype=wp.int32),
    near: int,
    far: int,
    fan: wp.array(dtype=wp.int32),
    corners: wp.array(dtype=Corner),
    slot: wp.array(dtype=wp.int32),
    seen: wp.array(dtype=wp.int32),
    queue: wp.array(dtype=wp.int32),
    front: wp.array(dtype=wp.int32),
    members: wp.array2d(dtype=wp.int32),
    shape: wp.array(dtype=wp.int32),
    size: wp.array(dtype=wp.int32),
):
    """Group vertices along an advancing front; then group what was left over, from a little farther around."""
    n_clusters = int(0)
    for s in range(first.shape[0] - 1):
        base = first[s]
        front[0] = base
        slot[base] = IN_FRONT
        head = int(0)
        tail = int(1)
        while head < tail:
            seed = front[head]
            head += 1
            if slot[seed] < 0:
                got = gather(seed, near, base, n_clusters, fan, corners, slot, seen, queue, members)
                if got[0] == LANES:
                    for lane in range(LANES):
                        slot[members[n_clusters, lane] + base] = n_clusters * LANES + lane
                    shape[n_clusters] = s
                    n_clusters += 1
                for k in range(got[1]):
                    v = queue[k]
                    if slot[v] == UNSEEN:
                        slot[v] = IN_FRONT
                        front[tail] = v
                        tail += 1
        for v in range(base, first[s + 1]):
            if slot[v] < 0:
                got = gather(v, far, base, n_clusters, fan, corners, slot, seen, queue, members)
                for lane in range(LANES):
                    if lane < got[0]:
                        slot[members[n_clusters, lane] + base] = n_clusters * LANES + lane
                    else:
                        members[n_clusters, lane] = -1
                shape[n_clusters] = s
                n_clusters += 1
    size[0] = n_clusters


@dataclass(frozen=True, slots=True, eq=False)
class Clusters:
    """Every vertex in one cluster of neighbours, numbered through all shapes.

    Attributes
    ----------
    members : (C, LANES) int32 array
        Vertices of each cluster, counted within their shape; -1 in lanes without one.
    shape : (C,) int32 array
        Shape of each cluster; ascending.
    slot : (N,) int32 array
        LANES * cluster + lane of every vertex.
    """

    members: IntArray
    shape: IntArray
    slot: IntArray


def find_clusters(fans: Fans) -> Clusters:
    """Return clusters of at most LANES vertices each, grown over edges; fans are on the CPU.

    In space the two walls of a thin shape would fall into one cluster; over edges they don't.
    """
    n_vertices = int(fans.first[-1])
    members = np.empty((n_vertices, LANES), np.int32)
    shape = np.empty(n_vertices, np.int32)
    slot = np.full(n_vertices, UNSEEN, np.int32)
    size = np.zeros(1, np.int32)
    seen = np.zeros(n_vertices + 1, np.int32)
    queue, front = np.empty((2, n_vertices), np.int32)
    wp.launch(
        grow_clusters,
        1,
        inputs=[
            fans.first.astype(np.int32), NEAR_VISITS, FAR_VISITS, fans.start, fans.corners,
            slot, seen, queue, front, members, shape, size,
        ],
        device="cpu",
    )  # fmt: skip
    return Clusters(frozen(members[: size[0]]), frozen(shape[: size[0]]), frozen(slot))
