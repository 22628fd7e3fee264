"""Amend the distances of one cluster on one CPU core (see `homolog.geodesics.bearing_kernels`).

Everything curved is computed once, from the first-order distances; amendments then follow from each other
through a few multiplications, from near to far, until they settle.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.bearing_kernels import (
    LAST_BIT,
    RIVAL,
    ROUNDS,
    Turns,
    begin_with,
    find_way,
    is_news,
    share_of,
    step_of,
    tie_corner,
    trust_in,
    turn_between,
    within,
)
from homolog.geodesics.kernels import FAR, Corner, Reach, least_way
from homolog.geodesics.lookup import LANES
from homolog.geodesics.memory_kernels import b_of, int_at
from homolog.geodesics.patch_kernels import (
    BUCKETS,
    Counts,
    Lanes,
    Scratch,
    float_at,
    lanes_at,
    put_lanes,
    sort_into_buckets,
)

# A lane loop has to stay a loop: the compiler then turns it into vector instructions.
wp.set_module_options({"enable_backward": False, "max_unroll": 4})


@wp.struct
class Amendments:
    """What one thread needs beside `Scratch` to amend one cluster after another."""

    bearing: wp.array(dtype=Lanes)  # (V,)
    trust: wp.array(dtype=Lanes)  # (V,) of bearings, 0 but for vertices in reach
    amendment: wp.array(dtype=Lanes)  # (V,) 0 but for vertices in reach
    found: wp.array(dtype=wp.int32)  # (V,) vertices in reach
    order: wp.array(dtype=wp.int32)  # (V,) vertices in reach, near to far
    rivals: wp.array(dtype=wp.int32)  # (V,) corners that shortest ways may come through, as bits
    moved: wp.array(dtype=wp.int32)  # (V,) clock of the last time that a vertex' amendments moved
    settled: wp.array(dtype=wp.int32)  # (V,) clock of the last time that they were computed
    end: wp.array(dtype=wp.int32)  # (V,) last tie of each vertex in order, one beyond
    a: wp.array(dtype=wp.int32)  # (K,) of each tie
    b: wp.array(dtype=wp.int32)
    share: wp.array(dtype=Lanes)
    gain: wp.array(dtype=Lanes)
    shortest: wp.array(dtype=float)  # side at each vertex


@wp.func
def order_reached(scratch: Scratch, amends: Amendments, limit: float) -> int:
    """List the vertices of the patch within a limit of any source, near to far; return how many."""
    for k in range(BUCKETS + 1):
        scratch.bucket[k] = 0
    scale = 0.9999 * float(BUCKETS) / limit
    n = int(0)
    for p in range(scratch.size[0]):
        v = int_at(scratch.patch, p)
        u = lanes_at(scratch.u, v)
        near = int(0)
        for lane in range(LANES):
            near |= wp.where(u[lane] <= limit, 1, 0)
        # without a branch, which would be mispredicted
        k = int(wp.min(u[0], limit) * scale)
        amends.found[n] = v
        scratch.bin[n] = k
        scratch.bucket[k + 1] += near
        n += near
    sort_into_buckets(scratch, n, amends.found, amends.order)
    return n


@wp.func
def find_bearings(
    scratch: Scratch,
    amends: Amendments,
    v: int,
    fan: wp.array(dtype=wp.int32),
    corners: wp.array(dtype=Corner),
    turns: wp.array(dtype=Turns),
    reach: Reach,
):
    """Find the bearings of a vertex, and the corners that its shortest ways may come through.

    A bearing is the mean of those of all ways that are equally long.
    """
    u = lanes_at(scratch.u, v)
    edge = reach.edge
    k = int_at(fan, v)
    end = int_at(fan, v + 1)
    around = turns[k].around_c
    best = Lanes(FAR)
    first = Lanes(0.0)
    total = Lanes(0.0)
    mean = Lanes(0.0)
    square = Lanes(0.0)
    by_b = Counts(0)
    rivals = int(0)
    bit = int(1)
    da = lanes_at(scratch.u, b_of(corners, end - 1))
    while k < end:
        corner = corners[k]
        db = lanes_at(scratch.u, corner.b)
        hopes = int(0)
        for lane in range(LANES):
            hopes |= wp.where(least_way(corner, da[lane], db[lane]) < u[lane] + RIVAL * edge, 1, 0)
        if hopes > 0:
            turning = turns[k]
            count = int(0)
            for lane in range(LANES):
                way = find_way(corner, turning, da[lane], db[lane], edge)
                best[lane] = wp.min(best[lane], way.distance)
                share = way.standing * share_of(way.distance, u[lane], edge)
                first[lane] = wp.where(total[lane] == 0.0, way.bearing, first[lane])
                turn = turn_between(first[lane], way.bearing, around)
                total[lane] += share
                mean[lane] += share * turn
                square[lane] += share * (turn * turn + way.doubt)
                near = u[lane] <= reach.limit and way.distance - u[lane] < RIVAL * edge
                again = way.by_a * by_b[lane]  # the way along a side that the corner before has already
                count |= wp.where(near, 1 - again, 0)
                by_b[lane] = way.by_b
            if count > 0:
                rivals = rivals | bit
        else:
            by_b = Counts(0)
        bit = wp.where(bit < 1 << LAST_BIT, bit << 1, bit)
        da = db
        k += 1
    for lane in range(LANES):
        inverse = 1.0 / wp.max(total[lane], 1.0e-30)
        mean[lane] *= inverse
        trust = trust_in(square[lane] * inverse, mean[lane])
        # without a way, or only longer ones: a source
        trust = wp.where(total[lane] > 0.0, trust, 0.0)
        square[lane] = wp.where(best[lane] - u[lane] < RIVAL * edge, trust, 0.0)
        mean[lane] = within(first[lane] + mean[lane], around)
    put_lanes(amends.bearing, v, mean)
    put_lanes(amends.amendment, v, Lanes(begin_with(float_at(amends.shortest, v), edge)))
    put_lanes(amends.trust, v, square)
    amends.rivals[v] = rivals


@wp.func
def tie_vertex(
    scratch: Scratch,
    amends: Amendments,
    v: int,
    n: int,
    fan: wp.array(dtype=wp.int32),
    corners: wp.array(dtype=Corner),
    turns: wp.array(dtype=Turns),
    reach: Reach,
) -> int:
    """Write a vertex' ties, the n-th of all and those after it; return the next n."""
    rivals = int_at(amends.rivals, v)
    u = lanes_at(scratch.u, v)
    first = int_at(fan, v)
    for k in range(first, int_at(fan, v + 1)):
        if (rivals & 1) != 0:
            corner = corners[k]
            turn = turns[k]
            da = lanes_at(scratch.u, corner.a)
            db = lanes_at(scratch.u, corner.b)
            at_a = lanes_at(amends.bearing, corner.a)
            at_b = lanes_at(amends.bearing, corner.b)
            trust_a = lanes_at(amends.trust, corner.a)
            trust_b = lanes_at(amends.trust, corner.b)
            share = Lanes(0.0)
            gain = Lanes(0.0)
            for lane in range(LANES):
                tie = tie_corner(
                    corner,
                    turn,
                    da[lane],
                    db[lane],
                    at_a[lane],
                    at_b[lane],
                    trust_a[lane],
                    trust_b[lane],
                    u[lane],
                    reach.edge,
                )
                share[lane] = tie.share
                gain[lane] = tie.gain
            amends.a[n] = corner.a
            amends.b[n] = corner.b
            put_lanes(amends.share, n, share)
            put_lanes(amends.gain, n, gain)
            n += 1
        rivals = wp.where(k - first < LAST_BIT, rivals >> 1, rivals)
    return n


@wp.func
def amend_vertex(scratch: Scratch, amends: Amendments, v: int, first: int, end: int, edge: float) -> int:
    """Compute a vertex' amendments from its ties first … end; return how many moved."""
    best = Lanes(FAR)
    for n in range(first, end):
        of_a = lanes_at(amends.amendment, int_at(amends.a, n))
        of_b = lanes_at(amends.amendment, int_at(amends.b, n))
        share = lanes_at(amends.share, n)
        gain = lanes_at(amends.gain, n)
        for lane in range(LANES):
            value = gain[lane] + of_a[lane] + share[lane] * (of_b[lane] - of_a[lane])
            best[lane] = wp.where(value < best[lane], value, best[lane])
    old = lanes_at(amends.amendment, v)
    u = lanes_at(scratch.u, v)
    step = step_of(float_at(amends.shortest, v), edge)
    moved = int(0)
    for lane in range(LANES):
        kept = u[lane] == 0.0 or best[lane] > 0.5 * FAR  # a source, or out of reach
        best[lane] = wp.where(kept, 0.0, best[lane])
        moved |= wp.where(is_news(old[lane], best[lane], step), 1, 0)
    put_lanes(amends.amendment, v, best)
    return moved


@wp.func
def settle(scratch: Scratch, amends: Amendments, reached: int, clock: int, edge: float) -> int:
    """Compute anew, near to far, what follows from amendments that moved; return how many vertices did."""
    total = int(0)
    first = int(0)
    for p in range(reached):
        v = int_at(amends.order, p)
        end = int_at(amends.end, p)
        latest = int(0)
        for n in range(first, end):
            latest = wp.max(
                latest,
                wp.max(int_at(amends.moved, int_at(amends.a, n)), int_at(amends.moved, int_at(amends.b, n))),
            )
        if clock == 0 or latest > int_at(amends.settled, v):
            amends.settled[v] = clock + p + 1
            if amend_vertex(scratch, amends, v, first, end, edge) > 0:
                amends.moved[v] = clock + p + 1
                total += 1
        first = end
    return total


@wp.kernel
def amend_cluster(
    scratch: Scratch,
    amends: Amendments,
    fan: wp.array(dtype=wp.int32),
    corners: wp.array(dtype=Corner),
    turns: wp.array(dtype=Turns),
    reach: Reach,
):
    """Amend the distances that `sweep_cluster` has left in scratch."""
    reached = order_reached(scratch, amends, reach.limit)
    for p in range(reached):
        find_bearings(scratch, amends, amends.order[p], fan, corners, turns, reach)
    n = int(0)
    for p in range(reached):
        n = tie_vertex(scratch, amends, amends.order[p], n, fan, corners, turns, reach)
        amends.end[p] = n
    moving = int(1)
    round = int(0)
    while moving > 0 and round < ROUNDS:
        moving = settle(scratch, amends, reached, round * reached, reach.edge)
        round += 1
    for p in range(reached):
        v = amends.order[p]
        scratch.u[v] = scratch.u[v] + amends.amendment[v]
        amends.trust[v] = Lanes(0.0)
        amends.amendment[v] = Lanes(0.0)
        amends.moved[v] = 0
