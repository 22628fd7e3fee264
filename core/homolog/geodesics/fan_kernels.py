"""Kernels that lay out the triangles around every vertex and group neighbouring vertices."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.intrinsic_kernels import TURN, Sides, apex, next_side
from homolog.geodesics.kernels import Corner
from homolog.geodesics.lookup import LANES

wp.set_module_options({"enable_backward": False})

UNSEEN = wp.constant(-1)
IN_FRONT = wp.constant(-2)


BENT = wp.constant(wp.float64(0.03))
"""Curvature of a vertex [rad] from which its surroundings are looked at two triangles deep."""


@wp.func
def beyond(sides: Sides, turn: wp.array(dtype=wp.float64), base: int) -> wp.vec3d:
    """Return the corner beyond a side, laid in the plane of the side's face, and 1 if it is to be looked at.

    It is near curved places, if the two faces together are convex, so that all straight ways stay within.
    """
    twin = sides.twin[base]
    length = sides.length[base]
    c = apex(sides, base)
    e = apex(sides, twin)
    x = length - e[0]
    crossing = c[0] + (x - c[0]) * c[1] / (c[1] + e[1])
    bent = wp.max(wp.abs(turn[sides.tail[base]] - TURN), wp.abs(turn[sides.tail[twin]] - TURN))
    wanted = bent > BENT and crossing > wp.float64(0.0) and crossing < length and base // 3 != twin // 3
    return wp.vec3d(x, -e[1], wp.where(wanted, wp.float64(1.0), wp.float64(0.0)))


@wp.func
def make_corner(a: int, b: int, at_a: wp.vec2d, at_b: wp.vec2d, c: wp.vec2d) -> Corner:
    """Lay a triangle as its corner c sees it."""
    ab = at_b - at_a
    ac = c - at_a
    length = wp.length(ab)
    corner = Corner()
    corner.a = a
    corner.b = b
    corner.length = float(length)
    corner.half = float(wp.float64(0.5) / length)
    corner.x = float(wp.dot(ab, ac) / length)
    corner.y = float(wp.abs(ab[0] * ac[1] - ab[1] * ac[0]) / length)
    corner.ac = float(wp.length(ac))
    corner.bc = float(wp.length(c - at_b))
    return corner


@wp.kernel
def count_corners(sides: Sides, turn: wp.array(dtype=wp.float64), start: wp.array(dtype=wp.int32)):
    """Count the corners of each vertex, one place on."""
    side = wp.tid()
    e = beyond(sides, turn, next_side(side))
    wp.atomic_add(start, sides.tail[side] + 1, wp.where(e[2] > wp.float64(0.0), 3, 1))


@wp.kernel
def fill_corners(
    sides: Sides,
    turn: wp.array(dtype=wp.float64),
    first: wp.array(dtype=wp.int32),
    free: wp.array(dtype=wp.int32),
    corners: wp.array(dtype=Corner),
):
    """Lay each triangle's corner next to the others of its vertex, and what lies beyond it where wanted.

    The two triangles beyond reach from the corner across the opposite side ab to ea and to eb.
    """
    side = wp.tid()
    base = next_side(side)
    before = first[side // 3]
    a = sides.tail[base] - before
    b = sides.tail[next_side(base)] - before
    c = apex(sides, base)
    at_a = wp.vec2d(wp.float64(0.0), wp.float64(0.0))
    at_b = wp.vec2d(sides.length[base], wp.float64(0.0))
    owner = sides.tail[side]
    corners[wp.atomic_add(free, owner, 1)] = make_corner(a, b, at_a, at_b, c)
    far = beyond(sides, turn, base)
    if far[2] > wp.float64(0.0):
        e = sides.tail[next_side(next_side(sides.twin[base]))] - before
        at_e = wp.vec2d(far[0], far[1])
        corners[wp.atomic_add(free, owner, 1)] = make_corner(e, a, at_e, at_a, c)
        corners[wp.atomic_add(free, owner, 1)] = make_corner(e, b, at_e, at_b, c)


@wp.func
def gather(
    seed: int,
    visits: int,
    base: int,
    cluster: int,
    fan: wp.array(dtype=wp.int32),
    neighbour: wp.array(dtype=wp.int32),
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
            y = neighbour[k]
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
    neighbour: wp.array(dtype=wp.int32),
    slot: wp.array(dtype=wp.int32),
    seen: wp.array(dtype=wp.int32),
    queue: wp.array(dtype=wp.int32),
    front: wp.array(dtype=wp.int32),
    members: wp.array2d(dtype=wp.int32),
    shape: wp.array(dtype=wp.int32),
    size: wp.array(dtype=wp.int32),
):
    """Group vertices along an advancing front; then group what was left over, from farther around."""
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
                got = gather(seed, near, base, n_clusters, fan, neighbour, slot, seen, queue, members)
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
                got = gather(v, far, base, n_clusters, fan, neighbour, slot, seen, queue, members)
                for lane in range(LANES):
                    if lane < got[0]:
                        slot[members[n_clusters, lane] + base] = n_clusters * LANES + lane
                    else:
                        members[n_clusters, lane] = -1
                shape[n_clusters] = s
                n_clusters += 1
    size[0] = n_clusters
