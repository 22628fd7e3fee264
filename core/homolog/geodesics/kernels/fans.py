"""Kernels that build the fan of triangles around every vertex and cluster neighbouring vertices."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.kernels.intrinsic import apex
from homolog.geodesics.kernels.local_solver import Corner
from homolog.geodesics.kernels.lookup import LANES
from homolog.surfaces.kernels.sides import Sides, leaving_end, next_side, sort_by_tail

wp.set_module_options({"enable_backward": False})

UNVISITED = wp.constant(-1)
IN_QUEUE = wp.constant(-2)


@wp.struct
class Fans:
    """The triangles around each vertex of one or more shapes, one shape after another."""

    position: wp.array(dtype=wp.vec3)  # (N,) vertices of the centred shapes
    start: wp.array(dtype=wp.int32)  # (N + 1,) first corner of each vertex
    corners: wp.array(dtype=Corner)  # (K,) counterclockwise; vertices are numbered within their shape
    margin: wp.array(dtype=wp.float32)  # (K,) see `find_margins`


@wp.struct
class Groups:
    """All clusters of some meshes."""

    members: wp.array2d(dtype=wp.int32)  # (C, LANES) vertices within their shape, -1 in lanes without one
    centre: wp.array(dtype=wp.vec3)  # (C,)
    radius: wp.array(dtype=wp.float32)  # (C,) distance of the farthest member from the centre


@wp.kernel
def fill_corners(
    tail: wp.array(dtype=wp.int32),
    twin: wp.array(dtype=wp.int32),
    length: wp.array(dtype=wp.float64),
    rank: wp.array(dtype=wp.int32),
    first: wp.array(dtype=wp.int32),
    fans: Fans,
):
    """Write the corners of every vertex contiguously and counterclockwise; thread (side of a triangle).

    The first corner at a rim stands for the opening: no path crosses it, but one comes along its edge.
    """
    side = wp.tid()
    base = next_side(side)
    after = next_side(base)
    before = first[side // 3]
    c = apex(length, base)
    corner = Corner()
    corner.a = tail[base] - before
    corner.b = tail[after] - before
    corner.length = float(length[base])
    corner.half = float(wp.float64(0.5) / length[base])
    corner.x = float(c[0])
    corner.y = float(c[1])
    corner.ac = float(length[side])
    corner.bc = float(length[after])
    fans.corners[fans.start[tail[side]] + rank[side]] = corner
    if twin[side] < 0:
        opening = Corner()
        opening.a = corner.a
        opening.b = corner.a
        opening.x = wp.nan
        opening.ac = corner.ac
        opening.bc = corner.ac
        fans.corners[fans.start[tail[side]]] = opening


@wp.kernel
def find_margins(fans: Fans):
    """Find how much closer than v each corner's b may be and still depend on v; thread (vertex v).

    No straight path through a triangle (v, w, b) to b is shorter than (u(v) + u(w) - |vw|) / 2 + y, where y
    is the height of b over vw, nor than u(v) - |vw| + y. The margin is the larger |vw| - y of the triangles
    on both sides of vb.
    """
    v = wp.tid()
    begin = fans.start[v]
    end = fans.start[v + 1]
    for c in range(begin, end):
        here = fans.corners[c]
        there = fans.corners[wp.where(c + 1 < end, c + 1, begin)]
        fans.margin[c] = wp.max(
            here.ac - here.length * here.y / here.ac, there.bc - there.length * there.y / there.bc
        )


@wp.struct
class Growth:
    """Memory for the growth of clusters, an entry for each vertex of all shapes."""

    slot: wp.array(dtype=wp.int32)  # LANES * cluster + lane within the shape, UNVISITED or IN_QUEUE
    seen: wp.array(dtype=wp.int32)  # number of the search that last met a vertex
    queue: wp.array(dtype=wp.int32)
    front: wp.array(dtype=wp.int32)
    members: wp.array2d(dtype=wp.int32)  # (S, LANES) of the cluster that grows


@wp.func
def grow_cluster(shape: int, seed: int, search: int, visits: int, sides: Sides, growth: Growth) -> wp.vec2i:
    """Grow a cluster from a seed by breadth-first search: the first LANES unassigned vertices.

    Returns the number of its members and of the vertices in the queue.
    """
    first = sides.first_vertex[shape]
    growth.queue[first] = seed
    growth.seen[seed] = search
    tail = int(1)
    n_members = int(0)
    head = int(0)
    while head < tail and head < visits and n_members < LANES:
        v = growth.queue[first + head]
        head += 1
        if growth.slot[v] < 0:
            growth.members[shape, n_members] = v
            n_members += 1
        for k in range(sides.start[v], leaving_end(sides, shape, v)):
            y = sides.tail[next_side(sides.leaving[k])]
            if growth.seen[y] != search:
                growth.seen[y] = search
                growth.queue[first + tail] = y
                tail += 1
    return wp.vec2i(n_members, tail)


@wp.kernel
def grow_clusters(
    first_shape: int,
    near: int,
    far: int,
    sides: Sides,
    growth: Growth,
    size: wp.array(dtype=wp.int32),
):
    """Cluster the vertices of shapes; thread (shape, counted from `first_shape`).

    Clusters grow along an advancing front; then the remaining vertices are clustered in wider searches.
    """
    shape = first_shape + wp.tid()
    first = sides.first_vertex[shape]
    end = sides.first_vertex[shape + 1]
    sort_by_tail(sides, shape)
    for v in range(first, end):
        growth.slot[v] = UNVISITED
        growth.seen[v] = 0
    n_clusters = int(0)
    n_searches = int(0)
    growth.front[first] = first
    growth.slot[first] = IN_QUEUE
    head = int(0)
    tail = int(1)
    while head < tail:
        seed = growth.front[first + head]
        head += 1
        if growth.slot[seed] < 0:
            n_searches += 1
            grown = grow_cluster(shape, seed, n_searches, near, sides, growth)
            if grown[0] == LANES:
                for lane in range(LANES):
                    growth.slot[growth.members[shape, lane]] = n_clusters * LANES + lane
                n_clusters += 1
            for k in range(grown[1]):
                v = growth.queue[first + k]
                if growth.slot[v] == UNVISITED:
                    growth.slot[v] = IN_QUEUE
                    growth.front[first + tail] = v
                    tail += 1
    for v in range(first, end):
        if growth.slot[v] < 0:
            n_searches += 1
            grown = grow_cluster(shape, v, n_searches, far, sides, growth)
            for lane in range(grown[0]):
                growth.slot[growth.members[shape, lane]] = n_clusters * LANES + lane
            n_clusters += 1
    size[shape] = n_clusters
