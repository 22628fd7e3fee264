"""Find the bearings of a batch of clusters at once (see `homolog.geodesics.bearing_kernels`): for CUDA."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.bearing_kernels import (
    RIVAL,
    Turns,
    begin_with,
    find_way,
    share_of,
    trust_in,
    turn_between,
    within,
)
from homolog.geodesics.crew_kernels import (
    BINS,
    Front,
    Hand,
    Sources,
    end_rings,
    hand_of,
    in_any_lane,
    meet,
)
from homolog.geodesics.kernels import FAR, least_way
from homolog.geodesics.memory_kernels import (
    a_of,
    b_of,
    corner_at,
    int_at,
    int_in,
    read,
    write,
    write_word,
)

wp.set_module_options({"enable_backward": False, "max_unroll": 8, "fast_math": True})

KEPT = wp.constant(6)
"""Ties that are kept of a vertex in one lane, each by a word with the place of its corner in the fan: nearly
all have one or two."""
NONE = wp.constant(32767)
"""In place of a corner: no way comes here, as to a source …"""
MANY = wp.constant(32766)
"""… or ways may come through more corners than are kept."""
Words = wp.types.vector(length=6, dtype=wp.uint32)


@wp.struct
class FrontAmendments:
    """What is needed beside `Front` to amend a batch of clusters."""

    bearing: wp.array3d(dtype=wp.float32)  # (B, V, L)
    trust: wp.array3d(dtype=wp.float32)  # (B, V, L) of bearings
    amendment: wp.array3d(dtype=wp.float32)  # (B, V, L)
    gain: wp.array3d(dtype=wp.float32)  # (B, P, KEPT L) of ties, by place in the order: read in a row
    word: wp.array3d(dtype=wp.uint32)  # (B, P, KEPT L) their shares and corners, likewise
    order: wp.array2d(dtype=wp.int32)  # (B, P) vertices in reach, near to far
    reached: wp.array(dtype=wp.int32)  # (B,) how many


@wp.kernel
def order_front(front: Front, amends: FrontAmendments, sources: Sources, offset: int, threads: int):
    """List the vertices within reach of any source, near to far; thread (cluster, member of its crew)."""
    b, thread = wp.tid()
    reach = sources.reaches[sources.shape[offset + b]]
    limit = reach.limit
    scale = 0.9999 * float(BINS) / limit
    hand = hand_of(front, sources, b, offset, thread, threads)
    for ring in range(thread, BINS, threads):
        front.filled[b, ring] = 0
    meet()
    size = front.size[b]
    for k in range(hand.walker, size + hand.walker, hand.walkers):  # as often for all threads
        v = front.patch[b, wp.min(k, size - 1)]
        near = int(0)
        for lane in range(hand.lane, hand.lanes, hand.lane_step):
            near = near | wp.where(read(front.u, hand.origin + v * hand.lanes + lane) <= limit, 1, 0)
        near = in_any_lane(near)
        for lane in range(hand.lane, hand.lanes, hand.lane_step):
            at = hand.origin + v * hand.lanes + lane
            if near == 0:  # the others are about to get theirs
                write(amends.amendment, at, 0.0)
                write(amends.trust, at, 0.0)
                write(amends.bearing, at, 0.0)
        if hand.lane == 0 and k < size:
            front.dirty[b, v] = near
            if near != 0:
                wp.atomic_add(front.filled, b, int(wp.min(front.u[b, v, 0], limit) * scale), 1)
    end_rings(front, b, thread)
    for k in range(thread, front.size[b], threads):
        v = front.patch[b, k]
        if front.dirty[b, v] != 0:
            ring = int(wp.min(front.u[b, v, 0], limit) * scale)
            amends.order[b, wp.atomic_add(front.filled, b, ring, 1)] = v
    meet()
    amends.reached[b] = front.filled[b, BINS - 1]


@wp.func
def find_bearing(
    front: Front,
    amends: FrontAmendments,
    sources: Sources,
    turns: wp.array(dtype=Turns),
    hand: Hand,
    edge: float,
    place: int,
    v: int,
    lane: int,
):
    """Find the bearing of a vertex in one lane, and the corner that its shortest way comes through."""
    b = hand.cluster
    u = read(front.u, hand.origin + v * hand.lanes + lane)
    best = float(FAR)
    first = float(0.0)
    total = float(0.0)
    mean = float(0.0)
    square = float(0.0)
    by_b = int(0)
    rivals = Words(wp.uint32(NONE))
    begin = int_at(sources.fan, hand.base + v)
    last = int_at(sources.fan, hand.base + v + 1) - 1
    around = turns[begin].around_c
    origin = hand.origin + lane
    da = read(front.u, origin + a_of(sources.corners, begin) * hand.lanes)
    db = read(front.u, origin + b_of(sources.corners, begin) * hand.lanes)  # the next corner's a
    for c in range(begin, last + 1):
        ahead = read(front.u, origin + b_of(sources.corners, wp.min(c + 1, last)) * hand.lanes)
        corner = corner_at(sources.corners, c)
        if least_way(corner, da, db) < u + RIVAL * edge:
            way = find_way(corner, turns[c], da, db, edge)
            best = wp.min(best, way.distance)
            share = way.standing * share_of(way.distance, u, edge)
            first = wp.where(total == 0.0, way.bearing, first)
            turn = turn_between(first, way.bearing, around)
            total += share
            mean += share * turn
            square += share * (turn * turn + way.doubt)
            if way.distance - u < RIVAL * edge and way.by_a * by_b == 0:  # else the corner before has it
                many = rivals[KEPT - 1] != wp.uint32(NONE) or c - begin >= MANY
                for k in range(KEPT - 1):
                    rivals[KEPT - 1 - k] = rivals[KEPT - 2 - k]
                rivals[0] = wp.uint32(wp.where(many, MANY, c - begin))
            by_b = way.by_b
        else:
            by_b = 0
        da = db
        db = ahead
    mean = mean / wp.max(total, 1.0e-30)
    at = hand.origin + v * hand.lanes + lane
    write(amends.amendment, at, begin_with(read(sources.shortest, hand.base + v), edge))
    write(amends.bearing, at, within(first + mean, around))
    found = total > 0.0 and best - u < RIVAL * edge  # else a source
    write(amends.trust, at, wp.where(found, trust_in(square / wp.max(total, 1.0e-30), mean), 0.0))
    if u == 0.0:
        rivals = Words(wp.uint32(NONE))
    words = (b * amends.word.shape[1] + place) * KEPT * hand.lanes + lane
    for k in range(KEPT):
        if k < 2 or rivals[wp.max(k - 1, 0)] != wp.uint32(NONE):  # two are always read, then up to a NONE
            write_word(amends.word, words + k * hand.lanes, rivals[k])


@wp.kernel
def find_front_bearings(
    front: Front,
    amends: FrontAmendments,
    sources: Sources,
    turns: wp.array(dtype=Turns),
    offset: int,
    threads: int,
):
    """Find the bearings of each cluster's vertices; thread (cluster, member of its crew)."""
    b, thread = wp.tid()
    hand = hand_of(front, sources, b, offset, thread, threads)
    edge = sources.reaches[sources.shape[offset + b]].edge
    last = amends.reached[b] - 1
    near = b * amends.order.shape[1]
    next_v = int_in(amends.order, near + wp.min(hand.walker, last))
    for k in range(hand.walker, last + 1, hand.walkers):
        v = next_v
        next_v = int_in(amends.order, near + wp.min(k + hand.walkers, last))
        for lane in range(hand.lane, hand.lanes, hand.lane_step):
            find_bearing(front, amends, sources, turns, hand, edge, k, v, lane)
