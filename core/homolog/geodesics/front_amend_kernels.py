"""Amend the distances of a batch of clusters at once (see `homolog.geodesics.bearing_kernels`): for CUDA.

Each cluster's vertices in reach are listed near to far and gone through in bands, each of which settles
before the next: amendments follow from those of nearer vertices. Most shortest ways can only come through
one corner, either of two or of three: these ties are kept, share and corner packed into a word. Where there
are more, ties are computed anew each time.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.bearing_kernels import (
    RIVAL,
    ROUNDS,
    SETTLED,
    Tie,
    Turns,
    find_way,
    share_of,
    tie_corner,
    trust_in,
    turn_between,
    within,
)
from homolog.geodesics.front_kernels import (
    BINS,
    CREW,
    CREW_BAND,
    Front,
    Hand,
    Sources,
    a_of,
    b_of,
    beyond,
    corner_at,
    end_rings,
    hand_of,
    in_any_lane,
    list_dirty,
    mark_around,
    meet,
    read,
    read_around,
)
from homolog.geodesics.kernels import FAR, Corner, least_way

wp.set_module_options({"enable_backward": False, "max_unroll": 8, "fast_math": True})

WHOLE = wp.constant(65535)
"""A share of one, in the upper half of a tie's word; the lower half is the corner's place in the fan …"""
NONE = wp.constant(65535)
"""… or this: no way comes here, as to a source …"""
MANY = wp.constant(65534)
"""… or this: ways may come through more corners than are kept."""


KEPT = wp.constant(6)
"""Ties that are kept of a vertex in one lane: nearly all have one or two."""
Words = wp.types.vector(length=6, dtype=wp.uint32)


@wp.func_native("return values.data[at];")
def read_word(values: wp.array3d(dtype=wp.uint32), at: int) -> wp.uint32:
    """Return a value of an array by its place in memory."""
    ...


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
    limit = reach.stored + reach.slack
    scale = 0.9999 * float(BINS) / limit
    hand = hand_of(front, sources, b, offset, thread, threads)
    for ring in range(thread, BINS, threads):
        front.filled[b, ring] = 0
    meet()
    for k in range(hand.walker, front.size[b], hand.walkers):
        v = front.patch[b, k]
        near = int(0)
        for lane in range(hand.lane, hand.lanes, hand.lane_step):
            near = wp.where(front.u[b, v, lane] <= limit, 1, near)
        near = in_any_lane(near, hand.lane_step)
        for lane in range(hand.lane, hand.lanes, hand.lane_step):
            amends.amendment[b, v, lane] = 0.0
            if near == 0:  # the others are about to get theirs
                amends.trust[b, v, lane] = 0.0
                amends.bearing[b, v, lane] = 0.0
        if hand.lane == 0:
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
    lane: int,
):
    """Find the bearing of a vertex in one lane, and the corner that its shortest way comes through."""
    b = hand.cluster
    v = amends.order[b, place]
    u = front.u[b, v, lane]
    best = float(FAR)
    first = float(0.0)
    total = float(0.0)
    mean = float(0.0)
    square = float(0.0)
    by_b = int(0)
    rivals = Words(wp.uint32(NONE))
    begin = sources.fan[hand.base + v]
    last = sources.fan[hand.base + v + 1] - 1
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
    amends.bearing[b, v, lane] = within(first + mean, around)
    found = total > 0.0 and best - u < RIVAL * edge  # else a source
    amends.trust[b, v, lane] = wp.where(found, trust_in(square / wp.max(total, 1.0e-30), mean), 0.0)
    if u == 0.0:
        rivals = Words(wp.uint32(NONE))
    for k in range(KEPT):
        amends.word[b, place, k * hand.lanes + lane] = rivals[k]


@wp.func
def tie_of(
    front: Front,
    amends: FrontAmendments,
    sources: Sources,
    turns: wp.array(dtype=Turns),
    hand: Hand,
    c: int,
    u: float,
    edge: float,
    lane: int,
) -> Tie:
    """Return the tie of one corner in one lane."""
    corner = corner_at(sources.corners, c)
    a = hand.origin + corner.a * hand.lanes + lane
    b = hand.origin + corner.b * hand.lanes + lane
    return tie_corner(
        corner,
        turns[c],
        read(front.u, a),
        read(front.u, b),
        read(amends.bearing, a),
        read(amends.bearing, b),
        read(amends.trust, a),
        read(amends.trust, b),
        u,
        edge,
    )


@wp.func
def mix(amends: FrontAmendments, corner: Corner, b: int, lane: int, share: float) -> float:
    """Return the amendment on a corner's side, between those of its ends."""
    of_a = amends.amendment[b, corner.a, lane]
    return of_a + share * (amends.amendment[b, corner.b, lane] - of_a)


@wp.func
def carry_anew(
    front: Front,
    amends: FrontAmendments,
    sources: Sources,
    turns: wp.array(dtype=Turns),
    hand: Hand,
    edge: float,
    v: int,
    lane: int,
) -> float:
    """Return the amendment of a vertex in one lane from ties that are computed anew."""
    b = hand.cluster
    best = float(FAR)
    u = front.u[b, v, lane]
    for c in range(sources.fan[hand.base + v], sources.fan[hand.base + v + 1]):
        corner = sources.corners[c]
        da = front.u[b, corner.a, lane]
        db = front.u[b, corner.b, lane]
        if least_way(corner, da, db) < u + RIVAL * edge:
            tie = tie_of(front, amends, sources, turns, hand, c, u, edge, lane)
            best = wp.min(best, tie.gain + mix(amends, corner, b, lane, tie.share))
    return best


@wp.func
def follow(
    amends: FrontAmendments, sources: Sources, hand: Hand, begin: int, lane: int, word: wp.uint32, gain: float
) -> float:
    """Return the amendment that follows by a kept tie; FAR by none."""
    corner = int(word & wp.uint32(NONE))
    tied = corner < MANY
    c = begin + wp.where(tied, corner, 0)
    of_a = read(amends.amendment, hand.origin + a_of(sources.corners, c) * hand.lanes + lane)
    of_b = read(amends.amendment, hand.origin + b_of(sources.corners, c) * hand.lanes + lane)
    share = float(word >> wp.uint32(16)) * (1.0 / float(WHOLE))
    return wp.where(tied, gain + of_a + share * (of_b - of_a), FAR)


@wp.func
def carry_on(
    front: Front,
    amends: FrontAmendments,
    sources: Sources,
    turns: wp.array(dtype=Turns),
    hand: Hand,
    edge: float,
    place: int,
    lane: int,
) -> int:
    """Carry amendments to a vertex, in one lane; return the bits of the neighbours that have to know."""
    v = amends.order[hand.cluster, place]
    begin = sources.fan[hand.base + v]
    origin = hand.origin + lane
    at = origin + v * hand.lanes
    before = read(amends.amendment, at)
    first = (hand.cluster * amends.word.shape[1] + place) * KEPT * hand.lanes + lane
    word = read_word(amends.word, first)
    amendment = float(FAR)
    if word == wp.uint32(MANY):
        amendment = carry_anew(front, amends, sources, turns, hand, edge, v, lane)
    else:
        # nearly always one or two, which are read at once; the corner of none is as good as any
        second = first + hand.lanes
        other = read_word(amends.word, second)
        one = follow(amends, sources, hand, begin, lane, word, read(amends.gain, first))
        two = follow(amends, sources, hand, begin, lane, other, read(amends.gain, second))
        amendment = wp.min(one, two)
        k = int(2)
        while other != wp.uint32(NONE) and k < KEPT:
            other = read_word(amends.word, first + k * hand.lanes)
            gain = read(amends.gain, first + k * hand.lanes)
            amendment = wp.min(amendment, follow(amends, sources, hand, begin, lane, other, gain))
            k += 1
    if amendment > 0.5 * FAR:  # a source, or out of reach
        return 0
    amends.amendment[hand.cluster, v, lane] = amendment
    if wp.abs(amendment - before) > SETTLED * edge:
        around = read_around(front.u, sources, hand, v, lane)
        return beyond(sources, hand, v, read(front.u, at) - RIVAL * edge, around)
    return 0


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
    edge = sources.reaches[sources.shape[offset + b]].slack
    for k in range(hand.walker, amends.reached[b], hand.walkers):
        for lane in range(hand.lane, hand.lanes, hand.lane_step):
            find_bearing(front, amends, sources, turns, hand, edge, k, lane)


@wp.kernel
def tie_front(
    front: Front,
    amends: FrontAmendments,
    sources: Sources,
    turns: wp.array(dtype=Turns),
    offset: int,
    threads: int,
):
    """Keep the ties of each cluster's vertices; thread (cluster, member of its crew)."""
    b, thread = wp.tid()
    hand = hand_of(front, sources, b, offset, thread, threads)
    edge = sources.reaches[sources.shape[offset + b]].slack
    for k in range(hand.walker, amends.reached[b], hand.walkers):
        v = amends.order[b, k]
        begin = sources.fan[hand.base + v]
        for lane in range(hand.lane, hand.lanes, hand.lane_step):
            u = front.u[b, v, lane]
            n = int(0)
            place = int(amends.word[b, k, lane])
            while place < MANY:
                at = n * hand.lanes + lane
                tie = tie_of(front, amends, sources, turns, hand, begin + place, u, edge, lane)
                share = wp.uint32(tie.share * float(WHOLE) + 0.5)
                amends.gain[b, k, at] = tie.gain
                amends.word[b, k, at] = wp.uint32(place) | (share << wp.uint32(16))
                n += 1
                place = NONE
                if n < KEPT:
                    place = int(amends.word[b, k, at + hand.lanes])


@wp.kernel(launch_bounds=(CREW, 4))
def settle_front(
    front: Front,
    amends: FrontAmendments,
    sources: Sources,
    turns: wp.array(dtype=Turns),
    offset: int,
    threads: int,
):
    """Carry amendments from vertex to vertex until nothing moves, and add them; thread as above."""
    b, thread = wp.tid()
    hand = hand_of(front, sources, b, offset, thread, threads)
    edge = sources.reaches[sources.shape[offset + b]].slack
    reached = amends.reached[b]
    rounds = int(0)
    pending = int(1)
    while pending != 0 and rounds < ROUNDS:
        rounds += 1
        pending = int(0)
        for first in range(0, reached, CREW_BAND):
            passes = int(0)
            n = int(1)
            while n != 0 and passes < ROUNDS:
                passes += 1
                n = list_dirty(
                    front, amends.order, b, first, wp.min(first + CREW_BAND, reached), thread, threads
                )
                pending = wp.max(pending, n)
                for k in range(hand.walker, n, hand.walkers):
                    place = front.listed[b * CREW_BAND + k]
                    told = int(0)
                    for lane in range(hand.lane, hand.lanes, hand.lane_step):
                        told = told | carry_on(front, amends, sources, turns, hand, edge, place, lane)
                    mark_around(front, sources, hand, amends.order[b, place], told)
                meet()
    for k in range(hand.walker, reached, hand.walkers):
        v = amends.order[b, k]
        for lane in range(hand.lane, hand.lanes, hand.lane_step):
            front.u[b, v, lane] = front.u[b, v, lane] + amends.amendment[b, v, lane]
