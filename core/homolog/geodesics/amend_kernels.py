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
    SETTLED,
    Turns,
    find_way,
    share_of,
    tie_corner,
    trust_in,
    turn_between,
    within,
)
from homolog.geodesics.kernels import FAR, Corner, Reach, least_way
from homolog.geodesics.lookup import LANES
from homolog.geodesics.sweep_kernels import BUCKETS, Counts, Lanes, Scratch

# A lane loop has to stay a loop: the compiler then turns it into vector instructions.
wp.set_module_options({"enable_backward": False, "max_unroll": 4})


@wp.struct
class Amendments:
    """What one thread needs beside `Scratch` to amend one cluster after another."""

    bearing: wp.array(dtype=Lanes)  # (V,)
    trust: wp.array(dtype=Lanes)  # (V,) of bearings, 0 but for vertices in reach
    amendment: wp.array(dtype=Lanes)  # (V,) 0 but for vertices in reach
    order: wp.array(dtype=wp.int32)  # (V,) vertices in reach, near to far
    rivals: wp.array(dtype=wp.int32)  # (V,) corners that shortest ways may come through, as bits
    moved: wp.array(dtype=wp.int32)  # (V,) clock of the last time that a vertex' amendments moved
    settled: wp.array(dtype=wp.int32)  # (V,) clock of the last time that they were computed
    end: wp.array(dtype=wp.int32)  # (V,) last tie of each vertex in order, one beyond
    a: wp.array(dtype=wp.int32)  # (K,) of each tie
    b: wp.array(dtype=wp.int32)
    share: wp.array(dtype=Lanes)
    gain: wp.array(dtype=Lanes)


@wp.func
def order_reached(scratch: Scratch, amends: Amendments, limit: float) -> int:
    """List the vertices of the patch within a limit of any source, near to far; return how many."""
    for k in range(BUCKETS + 1):
        scratch.bucket[k] = 0
    scale = 0.9999 * float(BUCKETS) / limit
    for p in range(scratch.size[0]):
        v = scratch.patch[p]
        u = scratch.u[v]
        near = int(0)
        for lane in range(LANES):
            near += wp.where(u[lane] <= limit, 1, 0)
        k = wp.where(near > 0, int(wp.min(u[0], limit) * scale), -1)
        scratch.bin[v] = k
        if k >= 0:
            scratch.bucket[k + 1] += 1
    for k in range(BUCKETS):
        scratch.bucket[k + 1] += scratch.bucket[k]
    for p in range(scratch.size[0]):
        v = scratch.patch[p]
        k = scratch.bin[v]
        if k >= 0:
            amends.order[scratch.bucket[k]] = v
            scratch.bucket[k] += 1
    return scratch.bucket[BUCKETS]


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
    u = scratch.u[v]
    edge = reach.slack
    around = turns[fan[v]].around_c
    best = Lanes(FAR)
    first = Lanes(0.0)
    total = Lanes(0.0)
    mean = Lanes(0.0)
    square = Lanes(0.0)
    by_b = Counts(0)
    rivals = int(0)
    bit = int(1)
    for k in range(fan[v], fan[v + 1]):
        corner = corners[k]
        da = scratch.u[corner.a]
        db = scratch.u[corner.b]
        hopes = int(0)
        for lane in range(LANES):
            hopes += wp.where(least_way(corner, da[lane], db[lane]) < u[lane] + RIVAL * edge, 1, 0)
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
                near = u[lane] <= reach.stored + edge and way.distance - u[lane] < RIVAL * edge
                again = way.by_a * by_b[lane]  # the way along a side that the corner before has already
                count += wp.where(near, 1 - again, 0)
                by_b[lane] = way.by_b
            if count > 0:
                rivals = rivals | bit
        else:
            by_b = Counts(0)
        bit = wp.where(k - fan[v] < LAST_BIT, bit << 1, bit)
    for lane in range(LANES):
        inverse = 1.0 / wp.max(total[lane], 1.0e-30)
        mean[lane] *= inverse
        trust = trust_in(square[lane] * inverse, mean[lane])
        # without a way, or only longer ones: a source
        trust = wp.where(total[lane] > 0.0, trust, 0.0)
        square[lane] = wp.where(best[lane] - u[lane] < RIVAL * edge, trust, 0.0)
        mean[lane] = within(first[lane] + mean[lane], around)
    amends.bearing[v] = mean
    amends.trust[v] = square
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
    rivals = amends.rivals[v]
    u = scratch.u[v]
    for k in range(fan[v], fan[v + 1]):
        if (rivals & 1) != 0:
            corner = corners[k]
            turn = turns[k]
            da = scratch.u[corner.a]
            db = scratch.u[corner.b]
            at_a = amends.bearing[corner.a]
            at_b = amends.bearing[corner.b]
            trust_a = amends.trust[corner.a]
            trust_b = amends.trust[corner.b]
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
                    reach.slack,
                )
                share[lane] = tie.share
                gain[lane] = tie.gain
            amends.a[n] = corner.a
            amends.b[n] = corner.b
            amends.share[n] = share
            amends.gain[n] = gain
            n += 1
        rivals = wp.where(k - fan[v] < LAST_BIT, rivals >> 1, rivals)
    return n


@wp.func
def amend_vertex(scratch: Scratch, amends: Amendments, v: int, first: int, end: int, settled: float) -> int:
    """Compute a vertex' amendments from its ties first … end; return how many moved."""
    best = Lanes(FAR)
    for n in range(first, end):
        of_a = amends.amendment[amends.a[n]]
        of_b = amends.amendment[amends.b[n]]
        share = amends.share[n]
        gain = amends.gain[n]
        for lane in range(LANES):
            value = gain[lane] + of_a[lane] + share[lane] * (of_b[lane] - of_a[lane])
            best[lane] = wp.min(best[lane], value)
    old = amends.amendment[v]
    u = scratch.u[v]
    moved = int(0)
    for lane in range(LANES):
        kept = u[lane] == 0.0 or best[lane] > 0.5 * FAR  # a source, or out of reach
        best[lane] = wp.where(kept, 0.0, best[lane])
        moved += wp.where(wp.abs(best[lane] - old[lane]) > settled, 1, 0)
    amends.amendment[v] = best
    return moved


@wp.func
def settle(scratch: Scratch, amends: Amendments, reached: int, clock: int, settled: float) -> int:
    """Compute anew, near to far, what follows from amendments that moved; return how many vertices did."""
    total = int(0)
    first = int(0)
    for p in range(reached):
        v = amends.order[p]
        end = amends.end[p]
        latest = int(0)
        for n in range(first, end):
            latest = wp.max(latest, wp.max(amends.moved[amends.a[n]], amends.moved[amends.b[n]]))
        if clock == 0 or latest > amends.settled[v]:
            amends.settled[v] = clock + p + 1
            if amend_vertex(scratch, amends, v, first, end, settled) > 0:
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
    reached = order_reached(scratch, amends, reach.stored + reach.slack)
    for p in range(reached):
        find_bearings(scratch, amends, amends.order[p], fan, corners, turns, reach)
    n = int(0)
    for p in range(reached):
        n = tie_vertex(scratch, amends, amends.order[p], n, fan, corners, turns, reach)
        amends.end[p] = n
    moving = int(1)
    round = int(0)
    while moving > 0 and round < ROUNDS:
        moving = settle(scratch, amends, reached, round * reached, SETTLED * reach.slack)
        round += 1
    for p in range(reached):
        v = amends.order[p]
        scratch.u[v] = scratch.u[v] + amends.amendment[v]
        amends.trust[v] = Lanes(0.0)
        amends.amendment[v] = Lanes(0.0)
        amends.moved[v] = 0
