"""Amend the distances of a batch of clusters at once (see `homolog.geodesics.bearing_kernels`): for CUDA.

Each cluster's vertices in reach are listed near to far and gone through in bands, each of which settles
before the next: amendments follow from those of nearer vertices. Most shortest ways can only come through
one corner, or either of two or three: these ties are kept, share and corner packed into a word. Where there
are more than are kept, ties are computed anew each time.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.bearing_kernels import RIVAL, ROUNDS, Tie, Turns, is_news, step_of, tie_corner
from homolog.geodesics.crew_kernels import (
    AMEND_BAND,
    CREW,
    Front,
    Hand,
    Sources,
    fall_in,
    hand_of,
    list_dirty,
    listed,
    mark_around,
    meet,
    news_for,
)
from homolog.geodesics.front_bearing_kernels import (
    KEPT,
    MANY,
    NONE,
    FrontAmendments,
)
from homolog.geodesics.kernels import FAR, Corner, least_way
from homolog.geodesics.memory_kernels import (
    a_of,
    b_of,
    corner_at,
    fetch,
    fetch_word,
    int_at,
    int_in,
    read,
    read_word,
    write,
    write_word,
)

wp.set_module_options({"enable_backward": False, "max_unroll": 8, "fast_math": True})

WHOLE = wp.constant(65535)
"""A share of one, in the upper half of a tie's word; its lower half is the corner's place in the fan …"""
MORE = wp.constant(32768)
"""… and whether a third, fourth … tie follows, from the second word on."""


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
    corner = int(word & wp.uint32(NONE))  # without MORE
    tied = corner < MANY
    c = begin + wp.where(tied, corner, 0)
    of_a = read(amends.amendment, hand.origin + a_of(sources.corners, c) * hand.lanes + lane)
    of_b = read(amends.amendment, hand.origin + b_of(sources.corners, c) * hand.lanes + lane)
    share = float(word >> wp.uint32(16)) * (1.0 / float(WHOLE))
    return wp.where(tied, gain + of_a + share * (of_b - of_a), FAR)


@wp.func
def fetch_ties(amends: FrontAmendments, hand: Hand, place: int):
    """Begin to fetch the first two ties of the vertex at a place."""
    first = (hand.cluster * amends.word.shape[1] + place) * KEPT * hand.lanes + hand.lane
    fetch_word(amends.word, first)
    fetch_word(amends.word, first + hand.lanes)
    fetch(amends.gain, first)
    fetch(amends.gain, first + hand.lanes)


@wp.func
def carry_on(
    front: Front,
    amends: FrontAmendments,
    sources: Sources,
    turns: wp.array(dtype=Turns),
    hand: Hand,
    edge: float,
    place: int,
    v: int,
    lane: int,
) -> wp.vec2i:
    """Carry amendments to a vertex, in one lane; return what it tells its neighbours (`news_for`)."""
    begin = int_at(sources.fan, hand.base + v)
    at = hand.origin + v * hand.lanes + lane
    before = read(amends.amendment, at)
    first = (hand.cluster * amends.word.shape[1] + place) * KEPT * hand.lanes + lane
    # nearly always one or two ties, which are read at once
    second = first + hand.lanes
    word = read_word(amends.word, first)
    last = read_word(amends.word, second)
    gain = read(amends.gain, first)
    gain_of_last = read(amends.gain, second)
    one = follow(amends, sources, hand, begin, lane, word, gain)
    two = follow(amends, sources, hand, begin, lane, last, gain_of_last)
    amendment = wp.min(one, two)
    k = int(2)
    while (last & wp.uint32(MORE)) != wp.uint32(0):
        last = read_word(amends.word, first + k * hand.lanes)
        gain = read(amends.gain, first + k * hand.lanes)
        amendment = wp.min(amendment, follow(amends, sources, hand, begin, lane, last, gain))
        k += 1
    if word == wp.uint32(MANY):
        amendment = carry_anew(front, amends, sources, turns, hand, edge, v, lane)
    if amendment > 0.5 * FAR:  # a source, or out of reach
        amendment = 0.0
    write(amends.amendment, at, amendment)
    if is_news(before, amendment, step_of(read(sources.shortest, hand.base + v), edge)):
        return news_for(front, sources, hand, v, lane, read(front.u, at), 1.01 * RIVAL * edge)
    return wp.vec2i(0, 0)


@wp.func
def keep_ties(
    front: Front,
    amends: FrontAmendments,
    sources: Sources,
    turns: wp.array(dtype=Turns),
    hand: Hand,
    edge: float,
    first: int,
    end: int,
):
    """Keep the ties of a cluster's vertices from place to place."""
    near = hand.cluster * amends.order.shape[1]
    next_v = int_in(amends.order, near + wp.min(first + hand.walker, end - 1))
    for k in range(first + hand.walker, end, hand.walkers):
        v = next_v
        next_v = int_in(amends.order, near + wp.min(k + hand.walkers, end - 1))
        begin = int_at(sources.fan, hand.base + v)
        fetch_word(amends.word, (near + wp.min(k + hand.walkers, end - 1)) * KEPT * hand.lanes + hand.lane)
        for lane in range(hand.lane, hand.lanes, hand.lane_step):
            u = read(front.u, hand.origin + v * hand.lanes + lane)
            n = int(0)
            at = (near + k) * KEPT * hand.lanes + lane
            place = int(read_word(amends.word, at))
            while place < MANY:
                n += 1
                following = int(NONE)
                if n < KEPT:
                    following = int(read_word(amends.word, at + hand.lanes))
                tie = tie_of(front, amends, sources, turns, hand, begin + place, u, edge, lane)
                share = wp.uint32(tie.share * float(WHOLE) + 0.5)
                more = wp.uint32(wp.where(n > 1 and following != NONE, MORE, 0))
                write(amends.gain, at, tie.gain)
                write_word(amends.word, at, wp.uint32(place) | more | (share << wp.uint32(16)))
                place = following
                at += hand.lanes


@wp.kernel(launch_bounds=(CREW, 4))
def settle_front(
    front: Front,
    amends: FrontAmendments,
    sources: Sources,
    turns: wp.array(dtype=Turns),
    offset: int,
    threads: int,
):
    """Carry amendments from vertex to vertex until nothing moves; add them; thread (cluster, of its crew).

    The ties of a band are kept just before it settles, while they are at hand.
    """
    b, thread = wp.tid()
    hand = hand_of(front, sources, b, offset, thread, threads)
    edge = sources.reaches[sources.shape[offset + b]].edge
    reached = amends.reached[b]
    near = b * amends.order.shape[1]
    rounds = int(0)
    pending = int(1)
    while pending != 0 and rounds < ROUNDS:
        rounds += 1
        pending = int(0)
        for first in range(0, reached, AMEND_BAND):
            end = wp.min(first + AMEND_BAND, reached)
            if rounds == 1:
                keep_ties(front, amends, sources, turns, hand, edge, first, end)
                meet()
            passes = int(0)
            n = int(1)
            while n != 0 and passes < ROUNDS:
                passes += 1
                n = list_dirty(front, amends.order, b, first, end)
                pending = wp.max(pending, n)
                next_place = listed(front, b, hand.walker, n)
                next_v = int_in(amends.order, near + next_place)
                done = int(0)
                while done < n:  # as often for all threads, side by side
                    place = next_place
                    v = next_v
                    next_place = listed(front, b, done + hand.walker + hand.walkers, n)
                    next_v = int_in(amends.order, near + next_place)
                    told = wp.vec2i(0, 0)
                    fetch_ties(amends, hand, next_place)
                    lane = wp.where(done + hand.walker < n, hand.lane, hand.lanes)
                    while lane < hand.lanes:
                        own = carry_on(front, amends, sources, turns, hand, edge, place, v, lane)
                        told = wp.vec2i(told[0] | own[0], told[1] | own[1])
                        lane += hand.lane_step
                    fall_in()
                    mark_around(front, sources, hand, v, told)
                    done += hand.walkers
                    fall_in()
                meet()
    next_v = int_in(amends.order, near + wp.min(hand.walker, reached - 1))
    for k in range(hand.walker, reached, hand.walkers):
        at = hand.origin + next_v * hand.lanes
        next_v = int_in(amends.order, near + wp.min(k + hand.walkers, reached - 1))
        fetch(front.u, hand.origin + next_v * hand.lanes + hand.lane)
        for lane in range(hand.lane, hand.lanes, hand.lane_step):
            write(front.u, at + lane, read(front.u, at + lane) + read(amends.amendment, at + lane))
