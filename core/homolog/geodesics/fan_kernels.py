"""Kernels that lay out the triangles around every vertex and group neighbouring vertices."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.bearing_kernels import Turns
from homolog.geodesics.crew_kernels import LAST_BIT
from homolog.geodesics.intrinsic_kernels import Sides, apex, next_side
from homolog.geodesics.kernels import Corner, Tell
from homolog.geodesics.lookup import LANES

wp.set_module_options({"enable_backward": False})

UNSEEN = wp.constant(-1)
IN_FRONT = wp.constant(-2)


@wp.kernel
def fill_corners(
    sides: Sides,
    first: wp.array(dtype=wp.int32),
    start: wp.array(dtype=wp.int32),
    corners: wp.array(dtype=Corner),
    turns: wp.array(dtype=Turns),
    tells: wp.array(dtype=Tell),
    shortest: wp.array(dtype=float),
):
    """Lay each triangle's corner next to the others of its vertex, counterclockwise."""
    side = wp.tid()
    base = next_side(side)
    after = next_side(base)
    twin = sides.twin[base]
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
    wp.atomic_min(shortest, sides.tail[side], corner.ac)
    at = start[sides.tail[side]] + sides.rank[side]
    corners[at] = corner
    twice_area = corner.length * corner.y
    tell = Tell()
    tell.to_a = twice_area / corner.bc - 0.5 * corner.bc
    tell.to_b = twice_area / corner.ac - 0.5 * corner.ac
    tell.bc = corner.bc
    place_a = wp.min(sides.rank[base], LAST_BIT)
    place_b = wp.min(sides.rank[after], LAST_BIT)
    tell.places = place_a + 256 * place_b
    tells[at] = tell
    turn = Turns()
    turn.at_a = float(sides.angle[base])
    turn.around_a = float(sides.turn[a])
    turn.at_b = float(sides.angle[twin])
    turn.around_b = float(sides.turn[b])
    turn.around_c = float(sides.turn[sides.tail[side]])
    turn.at_c = float(sides.angle[side])
    turns[at] = turn


@wp.kernel
def find_margins(
    fan: wp.array(dtype=wp.int32), corners: wp.array(dtype=Corner), margin: wp.array(dtype=float)
):
    """Find by how much each corner's b may be nearer than its vertex v and follow from it still.

    That is |vw| - y in the triangles (v, w, b) on both sides of vb, with y the height of b over vw.
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
def gather(
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
            members[cluster, found] = v
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
    """Group vertices along an advancing front; then group what was left over, from farther around."""
    n_clusters = int(0)
    front[0] = 0
    slot[0] = IN_FRONT
    head = int(0)
    tail = int(1)
    while head < tail:
        seed = front[head]
        head += 1
        if slot[seed] < 0:
            got = gather(seed, near, n_clusters, fan, neighbour, slot, seen, queue, members)
            if got[0] == LANES:
                for lane in range(LANES):
                    slot[members[n_clusters, lane]] = n_clusters * LANES + lane
                n_clusters += 1
            for k in range(got[1]):
                v = queue[k]
                if slot[v] == UNSEEN:
                    slot[v] = IN_FRONT
                    front[tail] = v
                    tail += 1
    for v in range(slot.shape[0]):
        if slot[v] < 0:
            got = gather(v, far, n_clusters, fan, neighbour, slot, seen, queue, members)
            for lane in range(LANES):
                if lane < got[0]:
                    slot[members[n_clusters, lane]] = n_clusters * LANES + lane
                else:
                    members[n_clusters, lane] = -1
            n_clusters += 1
    size[0] = n_clusters
