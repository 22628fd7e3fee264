"""Kernels that build the fan of triangles around every vertex and cluster neighbouring vertices."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.kernels.intrinsic import Sides, apex, next_side
from homolog.geodesics.kernels.local_solver import Corner
from homolog.geodesics.kernels.lookup import LANES

wp.set_module_options({"enable_backward": False})

UNVISITED = wp.constant(-1)
IN_QUEUE = wp.constant(-2)


@wp.kernel
def fill_corners(
    sides: Sides,
    first: wp.array(dtype=wp.int32),
    start: wp.array(dtype=wp.int32),
    corners: wp.array(dtype=Corner),
):
    """Write the corners of every vertex contiguously and counterclockwise; thread (side of a triangle)."""
    side = wp.tid()
    base = next_side(side)
    after = next_side(base)
    before = first[side // 3]
    a = sides.tail[base]
    b = sides.tail[after]
    c = apex(sides, base)
    length = sides.length[base]
    corner = Corner()
    corner.a = a - before
    corner.b = b - before
    corner.length = float(length)
    corner.half = float(wp.float64(0.5) / length)
    corner.x = float(c[0])
    corner.y = float(c[1])
    corner.ac = float(sides.length[side])
    corner.bc = float(sides.length[after])
    corners[start[sides.tail[side]] + sides.rank[side]] = corner


@wp.kernel
def find_margins(
    fan: wp.array(dtype=wp.int32), corners: wp.array(dtype=Corner), margin: wp.array(dtype=float)
):
    """Find how much closer than v each corner's b may be and still depend on v; thread (vertex v).

    No straight path through a triangle (v, w, b) to b is shorter than (u(v) + u(w) - |vw|) / 2 + y, where y
    is the height of b over vw, nor than u(v) - |vw| + y. The margin is the larger |vw| - y of the triangles
    on both sides of vb.
    """
    v = wp.tid()
    begin = fan[v]
    end = fan[v + 1]
    for c in range(begin, end):
        here = corners[c]
        there = corners[wp.where(c + 1 < end, c + 1, begin)]
        margin[c] = wp.max(
            here.ac - here.length * here.y / here.ac, there.bc - there.length * there.y / there.bc
        )


@wp.func
def grow_cluster(
    seed: int,
    visits: int,
    cluster: int,
    fan: wp.array(dtype=wp.int32),
    neighbour: wp.array(dtype=wp.int32),
    slot: wp.array(dtype=wp.int32),
    seen: wp.array(dtype=wp.int32),
    queue: wp.array(dtype=wp.int32),
    members: wp.array2d(dtype=wp.int32),
) -> wp.vec2i:
    """Grow a cluster from a seed by breadth-first search: the first LANES unassigned vertices.

    Returns the number of its members and of the vertices in the queue.
    """
    stamp = seen[0] + 1
    seen[0] = stamp
    queue[0] = seed
    seen[seed + 1] = stamp
    tail = int(1)
    n_members = int(0)
    head = int(0)
    while head < tail and head < visits and n_members < LANES:
        v = queue[head]
        head += 1
        if slot[v] < 0:
            members[cluster, n_members] = v
            n_members += 1
        for k in range(fan[v], fan[v + 1]):
            y = neighbour[k]
            if seen[y + 1] != stamp:
                seen[y + 1] = stamp
                queue[tail] = y
                tail += 1
    return wp.vec2i(n_members, tail)


@wp.kernel
def grow_clusters(
    near: int,
    far: int,
    fan: wp.array(dtype=wp.int32),
    neighbour: wp.array(dtype=wp.int32),
    slot: wp.array(dtype=wp.int32),
    seen: wp.array(dtype=wp.int32),
    queue: wp.array(dtype=wp.int32),
    front: wp.array(dtype=wp.int32),
    members: wp.array2d(dtype=wp.int32),
    size: wp.array(dtype=wp.int32),
):
    """Cluster vertices along an advancing front; then cluster the remaining ones in wider searches."""
    n_clusters = int(0)
    front[0] = 0
    slot[0] = IN_QUEUE
    head = int(0)
    tail = int(1)
    while head < tail:
        seed = front[head]
        head += 1
        if slot[seed] < 0:
            grown = grow_cluster(seed, near, n_clusters, fan, neighbour, slot, seen, queue, members)
            if grown[0] == LANES:
                for lane in range(LANES):
                    slot[members[n_clusters, lane]] = n_clusters * LANES + lane
                n_clusters += 1
            for k in range(grown[1]):
                v = queue[k]
                if slot[v] == UNVISITED:
                    slot[v] = IN_QUEUE
                    front[tail] = v
                    tail += 1
    for v in range(slot.shape[0]):
        if slot[v] < 0:
            grown = grow_cluster(v, far, n_clusters, fan, neighbour, slot, seen, queue, members)
            for lane in range(LANES):
                if lane < grown[0]:
                    slot[members[n_clusters, lane]] = n_clusters * LANES + lane
                else:
                    members[n_clusters, lane] = -1
            n_clusters += 1
    size[0] = n_clusters
