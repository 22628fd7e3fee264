"""Amend the distances of a batch of clusters at once (see `homolog.geodesics.bearing_kernels`): for CUDA.

Each cluster's vertices in reach are listed near to far, so that one pass of its crew over the list carries
amendments far; passes are repeated until nothing moves. The tie of the one corner that most shortest ways can
only come through is kept, packed into a word; where several may, ties are computed again in each pass.
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
    least_way,
    share_of,
    tie_corner,
    trust_in,
    turn_between,
    within,
)
from homolog.geodesics.front_kernels import ALL, N_ALL, Front, Hand, Sources, hand_of, meet
from homolog.geodesics.kernels import FAR

wp.set_module_options({"enable_backward": False, "max_unroll": 4})

BINS = wp.constant(256)
"""Rings, by distance, that a cluster's vertices are listed in."""
WHOLE = wp.constant(65535)
"""A share of one, in the upper half of a tie's word; the lower half is the corner's place in the fan …"""
NONE = wp.constant(65535)
"""… or this: no way comes here, as to a source …"""
MANY = wp.constant(65534)
"""… or this: ways may come through several corners."""


@wp.struct
class FrontAmendments:
    """What is needed beside `Front` to amend a batch of clusters; lists[0] of the front holds the order."""

    bearing: wp.array3d(dtype=wp.float32)  # (B, V, L)
    trust: wp.array3d(dtype=wp.float32)  # (B, V, L) of bearings
    amendment: wp.array3d(dtype=wp.float32)  # (B, V, L)
    gain: wp.array3d(dtype=wp.float32)  # (B, V, L) of the only tie
    word: wp.array3d(dtype=wp.uint32)  # (B, V, L) its share and corner
    filled: wp.array2d(dtype=wp.int32)  # (B, BINS) how many vertices a ring holds; then where it ends
    moved: wp.array(dtype=wp.int32)  # (B,) last round in which anything of a cluster moved


@wp.func
def order_reached(
    front: Front, amends: FrontAmendments, b: int, limit: float, thread: int, threads: int
) -> int:
    """List the vertices within a limit of any source ring after ring; return how many."""
    touched = front.counts[N_ALL, b]
    lanes = front.u.shape[2]
    for ring in range(thread, BINS, threads):
        amends.filled[b, ring] = 0
    meet()
    for k in range(thread, touched, threads):
        v = front.lists[ALL, b, k]
        nearest = float(FAR)
        for lane in range(lanes):
            nearest = wp.min(nearest, front.u[b, v, lane])
            amends.trust[b, v, lane] = 0.0
            amends.bearing[b, v, lane] = 0.0
            amends.amendment[b, v, lane] = 0.0
        ring = wp.where(nearest <= limit, int(nearest * (0.9999 * float(BINS) / limit)), -1)
        front.queued[b, v] = ring
        if ring >= 0:
            wp.atomic_add(amends.filled, b, ring, 1)
    meet()
    if thread == 0:
        total = int(0)
        for ring in range(BINS):
            n = amends.filled[b, ring]
            amends.filled[b, ring] = total
            total += n
    meet()
    for k in range(thread, touched, threads):
        v = front.lists[ALL, b, k]
        ring = front.queued[b, v]
        if ring >= 0:
            front.lists[0, b, wp.atomic_add(amends.filled, b, ring, 1)] = v
    meet()
    return amends.filled[b, BINS - 1]


@wp.func
def find_bearing(
    front: Front,
    amends: FrontAmendments,
    sources: Sources,
    turns: wp.array(dtype=Turns),
    hand: Hand,
    edge: float,
    v: int,
    lane: int,
):
    """Find the bearing of a vertex in one lane, and the corner that its shortest way comes through."""
    b = hand.cluster
    u = front.u[b, v, lane]
    best = float(FAR)
    first = float(0.0)
    rivals = int(0)
    rival = int(NONE)
    begin = sources.fan[hand.base + v]
    end = sources.fan[hand.base + v + 1]
    for c in range(begin, end):
        corner = sources.corners[c]
        da = front.u[b, corner.a, lane]
        db = front.u[b, corner.b, lane]
        if least_way(corner, da, db) < u + RIVAL * edge:
            way = find_way(corner, turns[c], da, db, edge)
            if way.distance < best:
                best = way.distance
                first = way.bearing
            if way.distance - u < RIVAL * edge:
                rivals += 1
                rival = c - begin
    around = turns[begin].around_c
    total = float(1.0e-30)
    mean = float(0.0)
    square = float(0.0)
    for c in range(begin, end):
        corner = sources.corners[c]
        da = front.u[b, corner.a, lane]
        db = front.u[b, corner.b, lane]
        if least_way(corner, da, db) < u + RIVAL * edge:
            way = find_way(corner, turns[c], da, db, edge)
            share = way.standing * share_of(way.distance, best, edge)
            turn = turn_between(first, way.bearing, around)
            total += share
            mean += share * turn
            square += share * (turn * turn + way.doubt)
    mean = mean / total
    if best - u < RIVAL * edge:  # else a source
        amends.bearing[b, v, lane] = within(first + mean, around)
        amends.trust[b, v, lane] = trust_in(square / total, mean)
    if u == 0.0 or rivals == 0:
        rival = NONE
    elif rivals > 1 or rival >= MANY:
        rival = MANY
    amends.word[b, v, lane] = wp.uint32(rival)


@wp.func
def tie_of(
    front: Front,
    amends: FrontAmendments,
    sources: Sources,
    turns: wp.array(dtype=Turns),
    b: int,
    c: int,
    u: float,
    edge: float,
    lane: int,
) -> Tie:
    """Return the tie of one corner in one lane."""
    corner = sources.corners[c]
    a = corner.a
    e = corner.b
    return tie_corner(
        corner,
        turns[c],
        front.u[b, a, lane],
        front.u[b, e, lane],
        amends.bearing[b, a, lane],
        amends.bearing[b, e, lane],
        amends.trust[b, a, lane],
        amends.trust[b, e, lane],
        u,
        edge,
    )


@wp.func
def carry(
    front: Front,
    amends: FrontAmendments,
    sources: Sources,
    turns: wp.array(dtype=Turns),
    hand: Hand,
    edge: float,
    v: int,
    lane: int,
) -> float:
    """Return the amendment of a vertex in one lane that follows from those of others; FAR if none does."""
    b = hand.cluster
    word = amends.word[b, v, lane]
    place = int(word & wp.uint32(NONE))
    begin = sources.fan[hand.base + v]
    best = float(FAR)
    if place < MANY:
        corner = sources.corners[begin + place]
        of_a = amends.amendment[b, corner.a, lane]
        of_b = amends.amendment[b, corner.b, lane]
        share = float(word >> wp.uint32(16)) / float(WHOLE)
        best = amends.gain[b, v, lane] + of_a + share * (of_b - of_a)
    elif place == MANY:
        u = front.u[b, v, lane]
        for c in range(begin, sources.fan[hand.base + v + 1]):
            corner = sources.corners[c]
            da = front.u[b, corner.a, lane]
            db = front.u[b, corner.b, lane]
            if least_way(corner, da, db) < u + RIVAL * edge:
                tie = tie_of(front, amends, sources, turns, b, c, u, edge, lane)
                of_a = amends.amendment[b, corner.a, lane]
                of_b = amends.amendment[b, corner.b, lane]
                best = wp.min(best, tie.gain + of_a + tie.share * (of_b - of_a))
    return best


@wp.kernel
def amend_front(
    front: Front,
    amends: FrontAmendments,
    sources: Sources,
    turns: wp.array(dtype=Turns),
    offset: int,
    threads: int,
):
    """Amend the distances of each cluster whose front is at rest; thread (cluster, member of its crew)."""
    b, thread = wp.tid()
    hand = hand_of(front, sources, b, offset, thread, threads)
    reach = sources.reaches[sources.shape[offset + b]]
    edge = reach.slack
    reached = order_reached(front, amends, b, reach.stored + edge, thread, threads)
    for k in range(hand.walker, reached, hand.walkers):
        v = front.lists[0, b, k]
        for lane in range(hand.lane, hand.lanes, hand.lane_step):
            find_bearing(front, amends, sources, turns, hand, edge, v, lane)
    meet()
    for k in range(hand.walker, reached, hand.walkers):
        v = front.lists[0, b, k]
        for lane in range(hand.lane, hand.lanes, hand.lane_step):
            place = int(amends.word[b, v, lane])
            if place < MANY:
                c = sources.fan[hand.base + v] + place
                tie = tie_of(front, amends, sources, turns, b, c, front.u[b, v, lane], edge, lane)
                amends.gain[b, v, lane] = tie.gain
                amends.word[b, v, lane] = wp.uint32(place + int(tie.share * float(WHOLE) + 0.5) * (NONE + 1))
    amends.moved[b] = 0
    meet()
    round = int(0)
    while round < ROUNDS and amends.moved[b] == round:
        round += 1
        meet()  # all have seen what the round before left behind
        for k in range(hand.walker, reached, hand.walkers):
            v = front.lists[0, b, k]
            for lane in range(hand.lane, hand.lanes, hand.lane_step):
                amendment = carry(front, amends, sources, turns, hand, edge, v, lane)
                if amendment < 0.5 * FAR:  # neither a source, nor out of reach
                    if wp.abs(amendment - amends.amendment[b, v, lane]) > SETTLED * edge:
                        amends.moved[b] = round
                    amends.amendment[b, v, lane] = amendment
        meet()
    for k in range(hand.walker, reached, hand.walkers):
        v = front.lists[0, b, k]
        for lane in range(hand.lane, hand.lanes, hand.lane_step):
            front.u[b, v, lane] = front.u[b, v, lane] + amends.amendment[b, v, lane]
