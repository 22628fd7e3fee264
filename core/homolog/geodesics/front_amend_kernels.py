"""Amend the distances of a batch of clusters at once: for CUDA (see `homolog.geodesics.bearing_kernels`).

Each cluster's vertices in reach are listed near to far, so that one pass over a list carries amendments far;
passes are repeated until nothing moves. What is curved is computed again in each pass: to keep it would take
more memory than it saves time.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.bearing_kernels import (
    LAST_BIT,
    RIVAL,
    SETTLED,
    TIE,
    UNKNOWN,
    Turns,
    doubtful,
    tie_corner,
    turn_from_side,
)
from homolog.geodesics.front_kernels import Front, Sources
from homolog.geodesics.kernels import FAR, trace

wp.set_module_options({"enable_backward": False, "max_unroll": 4})

BINS = wp.constant(256)
"""Rings, by distance, that a cluster's vertices are listed in."""


@wp.struct
class FrontAmendments:
    """What is needed beside `Front` to amend a batch of clusters; lists[0] of the front holds the order."""

    bearing: wp.array3d(dtype=wp.float32)  # (B, V, L)
    amendment: wp.array3d(dtype=wp.float32)  # (B, V, L)
    filled: wp.array2d(dtype=wp.int32)  # (B, BINS) how many vertices a ring holds; then where it ends
    rivals: wp.array3d(dtype=wp.int32)  # (B, V, L) corners that the shortest way may come through, as bits
    moved: wp.array(dtype=wp.int32)  # (B,) last round in which anything of a cluster moved
    last: wp.array(dtype=wp.int32)  # (1,) the last of all these


@wp.kernel
def bin_reached(front: Front, amends: FrontAmendments, sources: Sources, offset: int):
    """Find the ring of each vertex in reach, -1 for others, and count; thread (cluster, vertex)."""
    b, v = wp.tid()
    reach = sources.reaches[sources.shape[offset + b]]
    limit = reach.stored + reach.slack
    nearest = float(FAR)
    for lane in range(front.u.shape[2]):
        nearest = wp.min(nearest, front.u[b, v, lane])
    ring = int(-1)
    if nearest <= limit:
        ring = int(nearest * (0.9999 * float(BINS) / limit))
        wp.atomic_add(amends.filled, b, ring, 1)
    front.queued[b, v] = ring


@wp.kernel
def end_rings(front: Front, amends: FrontAmendments):
    """Turn the numbers in each ring into where it begins in the list; thread (cluster)."""
    b = wp.tid()
    total = int(0)
    for ring in range(BINS):
        n = amends.filled[b, ring]
        amends.filled[b, ring] = total
        total += n
    front.counts[0, b] = total


@wp.kernel
def list_reached(front: Front, amends: FrontAmendments):
    """List vertices ring after ring; thread (cluster, vertex)."""
    b, v = wp.tid()
    ring = front.queued[b, v]
    if ring >= 0:
        front.lists[0, b, wp.atomic_add(amends.filled, b, ring, 1)] = v


@wp.kernel
def find_front_bearings(
    front: Front,
    amends: FrontAmendments,
    sources: Sources,
    turns: wp.array(dtype=Turns),
    offset: int,
    walkers: int,
):
    """Find the bearings and rivals of listed vertices; thread (cluster, walker, lane)."""
    b, walker, lane = wp.tid()
    shape = sources.shape[offset + b]
    base = sources.first[shape]
    edge = sources.reaches[shape].slack
    for k in range(walker, front.counts[0, b], walkers):
        v = front.lists[0, b, k]
        u = front.u[b, v, lane]
        best = float(FAR)
        bearing = float(UNKNOWN)
        rivals = int(0)
        bit = int(1)
        begin = sources.fan[base + v]
        for c in range(begin, sources.fan[base + v + 1]):
            corner = sources.corners[c]
            ray = trace(corner, front.u[b, corner.a, lane], front.u[b, corner.b, lane])
            doubt = doubtful(corner, edge)
            distance = ray.distance + wp.where(doubt, 2.0 * TIE * edge, 0.0)
            if distance < best - TIE * edge:
                best = distance
                run = corner.ac * corner.ac - corner.x * ray.crossing
                bearing = turns[c].at_c + turn_from_side(corner.y * ray.crossing, run)
                if doubt:
                    bearing = UNKNOWN
            if ray.distance - u < RIVAL * edge:
                rivals = rivals | bit
            bit = wp.where(c - begin < LAST_BIT, bit << 1, bit)
        if best - u < RIVAL * edge:  # else a source
            amends.bearing[b, v, lane] = bearing
        amends.rivals[b, v, lane] = wp.where(u == 0.0, 0, rivals)


@wp.kernel
def settle_front(
    front: Front,
    amends: FrontAmendments,
    sources: Sources,
    turns: wp.array(dtype=Turns),
    offset: int,
    walkers: int,
    round: int,
):
    """Compute the amendments of listed vertices from those of others; thread (cluster, walker, lane).

    Clusters in which nothing moved in the round before are left alone.
    """
    b, walker, lane = wp.tid()
    if amends.moved[b] + 1 < round:
        return
    shape = sources.shape[offset + b]
    base = sources.first[shape]
    edge = sources.reaches[shape].slack
    for k in range(walker, front.counts[0, b], walkers):
        v = front.lists[0, b, k]
        rivals = amends.rivals[b, v, lane]
        u = front.u[b, v, lane]
        best = float(FAR)
        begin = sources.fan[base + v]
        for c in range(begin, sources.fan[base + v + 1]):
            if (rivals & 1) != 0:
                corner = sources.corners[c]
                da = front.u[b, corner.a, lane]
                db = front.u[b, corner.b, lane]
                at_a = amends.bearing[b, corner.a, lane]
                at_b = amends.bearing[b, corner.b, lane]
                tie = tie_corner(corner, turns[c], da, db, at_a, at_b, u, edge)
                of_a = amends.amendment[b, corner.a, lane]
                of_b = amends.amendment[b, corner.b, lane]
                best = wp.min(best, tie.gain + of_a + tie.share * (of_b - of_a))
            rivals = wp.where(c - begin < LAST_BIT, rivals >> 1, rivals)
        if best < 0.5 * FAR:  # neither a source, nor out of reach
            if wp.abs(best - amends.amendment[b, v, lane]) > SETTLED * edge:
                amends.moved[b] = round
                amends.last[0] = round
            amends.amendment[b, v, lane] = best


@wp.kernel
def add_amendments(front: Front, amends: FrontAmendments):
    """Add amendments to the distances; thread (cluster, vertex, lane)."""
    b, v, lane = wp.tid()
    front.u[b, v, lane] = front.u[b, v, lane] + amends.amendment[b, v, lane]
