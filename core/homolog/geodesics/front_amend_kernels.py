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
    end_rings,
    hand_of,
    in_any_lane,
    meet,
    pass_on,
    take,
)
from homolog.geodesics.kernels import FAR, Corner, least_way

wp.set_module_options({"enable_backward": False})

WHOLE = wp.constant(65535)
"""A share of one, in the upper half of a tie's word; the lower half is the corner's place in the fan …"""
NONE = wp.constant(65535)
"""… or this: no way comes here, as to a source …"""
MANY = wp.constant(65534)
"""… or this: ways may come through more corners than are kept."""


@wp.struct
class FrontAmendments:
    """What is needed beside `Front` to amend a batch of clusters."""

    bearing: wp.array3d(dtype=wp.float32)  # (B, V, L)
    trust: wp.array3d(dtype=wp.float32)  # (B, V, L) of bearings
    amendment: wp.array3d(dtype=wp.float32)  # (B, V, L)
    gain: wp.array3d(dtype=wp.vec3)  # (B, V, L) of up to three ties
    word: wp.array3d(dtype=wp.vec3ui)  # (B, V, L) their shares and corners
    order: wp.array2d(dtype=wp.int32)  # (B, V) vertices in reach, near to far
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
            amends.trust[b, v, lane] = 0.0
            amends.bearing[b, v, lane] = 0.0
            amends.amendment[b, v, lane] = 0.0
        near = in_any_lane(near, hand.lane_step)
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
    v: int,
    lane: int,
):
    """Find the bearing of a vertex in one lane, and the corner that its shortest way comes through."""
    b = hand.cluster
    u = front.u[b, v, lane]
    best = float(FAR)
    first = float(0.0)
    total = float(0.0)
    mean = float(0.0)
    square = float(0.0)
    by_b = int(0)
    rivals = wp.vec3ui(wp.uint32(NONE), wp.uint32(NONE), wp.uint32(NONE))
    begin = sources.fan[hand.base + v]
    around = turns[begin].around_c
    da = front.u[b, sources.corners[begin].a, lane]
    for c in range(begin, sources.fan[hand.base + v + 1]):
        corner = sources.corners[c]
        db = front.u[b, corner.b, lane]  # the next corner's a
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
                many = rivals[2] != wp.uint32(NONE) or c - begin >= MANY
                rivals = wp.vec3ui(
                    wp.where(many, wp.uint32(MANY), wp.uint32(c - begin)), rivals[0], rivals[1]
                )
            by_b = way.by_b
        else:
            by_b = 0
        da = db
    mean = mean / wp.max(total, 1.0e-30)
    if total > 0.0 and best - u < RIVAL * edge:  # else a source
        amends.bearing[b, v, lane] = within(first + mean, around)
        amends.trust[b, v, lane] = trust_in(square / total, mean)
    if u == 0.0:
        rivals = wp.vec3ui(wp.uint32(NONE), wp.uint32(NONE), wp.uint32(NONE))
    amends.word[b, v, lane] = rivals


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
def mix(amends: FrontAmendments, corner: Corner, b: int, lane: int, share: float) -> float:
    """Return the amendment on a corner's side, between those of its ends."""
    of_a = amends.amendment[b, corner.a, lane]
    return of_a + share * (amends.amendment[b, corner.b, lane] - of_a)


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
    words = amends.word[b, v, lane]
    begin = sources.fan[hand.base + v]
    best = float(FAR)
    if words[0] == wp.uint32(MANY):
        u = front.u[b, v, lane]
        for c in range(begin, sources.fan[hand.base + v + 1]):
            corner = sources.corners[c]
            da = front.u[b, corner.a, lane]
            db = front.u[b, corner.b, lane]
            if least_way(corner, da, db) < u + RIVAL * edge:
                tie = tie_of(front, amends, sources, turns, b, c, u, edge, lane)
                best = wp.min(best, tie.gain + mix(amends, corner, b, lane, tie.share))
        return best
    gains = amends.gain[b, v, lane]
    for k in range(3):
        place = int(words[k] & wp.uint32(NONE))
        if place < MANY:
            share = float(words[k] >> wp.uint32(16)) / float(WHOLE)
            best = wp.min(best, gains[k] + mix(amends, sources.corners[begin + place], b, lane, share))
    return best


@wp.func
def mark_beyond(front: Front, sources: Sources, hand: Hand, v: int, lane: int, moved: int, edge: float):
    """Mark the neighbours dirty that may follow a vertex in a lane where it moved.

    Those that lie much nearer do not: ends of a side count less the farther they are.
    """
    b = hand.cluster
    u = front.u[b, v, lane] - 0.5 * edge
    for c in range(sources.fan[hand.base + v], sources.fan[hand.base + v + 1]):
        a = sources.corners[c].a
        if in_any_lane(wp.where(front.u[b, a, lane] > u, moved, 0), hand.lane_step) != 0:
            front.dirty[b, a] = 1


@wp.func
def carry_all(
    front: Front,
    amends: FrontAmendments,
    sources: Sources,
    turns: wp.array(dtype=Turns),
    hand: Hand,
    edge: float,
    v: int,
):
    """Carry amendments to a vertex, in all lanes; where it moves, others have to know."""
    for lane in range(hand.lane, hand.lanes, hand.lane_step):
        amendment = carry(front, amends, sources, turns, hand, edge, v, lane)
        moved = int(0)
        if amendment < 0.5 * FAR:  # neither a source, nor out of reach
            if wp.abs(amendment - amends.amendment[hand.cluster, v, lane]) > SETTLED * edge:
                moved = 1
            amends.amendment[hand.cluster, v, lane] = amendment
        if in_any_lane(moved, hand.lane_step) != 0:
            pass_on(hand.lane_step)
            mark_beyond(front, sources, hand, v, lane, moved, edge)


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
        v = amends.order[b, k]
        for lane in range(hand.lane, hand.lanes, hand.lane_step):
            find_bearing(front, amends, sources, turns, hand, edge, v, lane)


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
            words = amends.word[b, v, lane]
            gains = wp.vec3(FAR, FAR, FAR)
            for n in range(3):
                place = int(words[n])
                if place < MANY:
                    tie = tie_of(front, amends, sources, turns, b, begin + place, u, edge, lane)
                    gains[n] = tie.gain
                    words[n] = wp.uint32(place) | (wp.uint32(tie.share * float(WHOLE) + 0.5) << wp.uint32(16))
            amends.gain[b, v, lane] = gains
            amends.word[b, v, lane] = words


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
    turn = int(0)
    for k in range(thread, 3, threads):
        front.busy[b, k] = 0
    meet()
    rounds = int(0)
    pending = int(1)
    while pending != 0 and rounds < ROUNDS:
        rounds += 1
        pending = int(0)
        for first in range(0, reached, CREW_BAND):
            passes = int(0)
            moving = int(1)
            while moving != 0 and passes < ROUNDS:
                passes += 1
                turn += 1
                for k in range(first + hand.walker, wp.min(first + CREW_BAND, reached), hand.walkers):
                    v = amends.order[b, k]
                    if take(front, hand, v) != 0:
                        front.busy[b, turn % 3] = turn
                        carry_all(front, amends, sources, turns, hand, edge, v)
                meet()
                moving = wp.where(front.busy[b, turn % 3] == turn, 1, 0)
                pending = wp.max(pending, moving)
    for k in range(hand.walker, reached, hand.walkers):
        v = amends.order[b, k]
        for lane in range(hand.lane, hand.lanes, hand.lane_step):
            front.u[b, v, lane] = front.u[b, v, lane] + amends.amendment[b, v, lane]
