"""The fast iterative method for many clusters at once, near to far: for CUDA, and single fields on a CPU.

Each cluster has a crew of its own (`homolog.geodesics.crew_kernels`), so that its steps wait for no other
cluster's. As in `homolog.geodesics.sweep_kernels` a patch is gone through in bands, from near to far, each
of which settles before the next.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.crew_kernels import (
    ALL,
    BINS,
    CREW,
    CREW_BAND,
    LAST_BIT,
    Front,
    Hand,
    Sources,
    end_rings,
    fall_in,
    hand_of,
    list_dirty,
    listed,
    lowest,
    mark_around,
    meet,
    news_for,
    news_of,
    publish,
)
from homolog.geodesics.kernels import (
    FALL,
    FAR,
    Corner,
    Reach,
    least_way,
    plane_front,
    side_way,
    straight_squared,
)
from homolog.geodesics.memory_kernels import (
    a_of,
    b_of,
    corner_at,
    int_at,
    int_in,
    read,
    write,
)

wp.set_module_options({"enable_backward": False, "max_unroll": 8, "fast_math": True})


@wp.func
def ball_around(sources: Sources, cluster: int) -> wp.vec4:
    """Return the centre of a cluster and the radius of the ball that holds all that it may reach."""
    shape = sources.shape[cluster]
    base = sources.first[shape]
    centre = wp.vec3(0.0, 0.0, 0.0)
    n_members = float(0.0)
    for lane in range(sources.members.shape[1]):
        m = sources.members[cluster, lane]
        if m >= 0:
            centre += sources.position[base + m]
            n_members += 1.0
    centre = centre / n_members
    radius = float(0.0)
    for lane in range(sources.members.shape[1]):
        m = sources.members[cluster, lane]
        if m >= 0:
            radius = wp.max(radius, wp.length(sources.position[base + m] - centre))
    reach = sources.reaches[shape]
    return wp.vec4(centre[0], centre[1], centre[2], radius + reach.limit)


@wp.kernel
def measure_patches(sources: Sources, skin: float, threads: int, size: wp.array(dtype=wp.int32)):
    """Count the vertices that each cluster may reach, and the skin; thread (cluster, member of its crew)."""
    cluster, thread = wp.tid()
    shape = sources.shape[cluster]
    ball = ball_around(sources, cluster)
    n = int(0)
    for v in range(sources.first[shape] + thread, sources.first[shape + 1], threads):
        if wp.length(sources.position[v] - wp.vec3(ball[0], ball[1], ball[2])) <= ball[3] + skin:
            n += 1
    wp.atomic_add(size, cluster, n)


@wp.func
def ring_at(distance: float, radius: float) -> int:
    """Return the ring of a vertex of a patch; the last one is the skin around it."""
    return wp.where(distance <= radius, int(0.9999 * float(BINS - 1) * distance / radius), BINS - 1)


@wp.kernel
def lay_patches(front: Front, sources: Sources, offset: int, skin: float, threads: int):
    """List what each cluster may reach, near to far in space, and set out; thread (cluster, of its crew).

    Distances are cleared there and in a skin around it: as far as they are read.
    """
    b, thread = wp.tid()
    shape = sources.shape[offset + b]
    base = sources.first[shape]
    hand = hand_of(front, sources, b, offset, thread, threads)
    ball = ball_around(sources, offset + b)
    centre = wp.vec3(ball[0], ball[1], ball[2])
    radius = ball[3]
    for ring in range(thread, BINS, threads):
        front.filled[b, ring] = 0
    meet()
    n = sources.first[shape + 1] - base
    for v in range(thread, n, threads):
        front.dirty[b, v] = 0
        distance = wp.length(sources.position[base + v] - centre)
        if distance <= radius + skin:
            wp.atomic_add(front.filled, b, ring_at(distance, radius), 1)
    end_rings(front, b, thread)
    front.size[b] = front.filled[b, BINS - 1]
    meet()
    for v in range(thread, n, threads):
        distance = wp.length(sources.position[base + v] - centre)
        if distance <= radius + skin:
            front.patch[b, wp.atomic_add(front.filled, b, ring_at(distance, radius), 1)] = v
    meet()
    for k in range(hand.walker, front.filled[b, BINS - 1], hand.walkers):
        row = hand.origin + front.patch[b, k] * hand.lanes
        for lane in range(hand.lane, hand.lanes, hand.lane_step):
            write(front.u, row + lane, FAR)
    meet()
    for lane in range(thread, hand.lanes, threads):
        m = sources.members[offset + b, lane]
        if m >= 0:
            front.u[b, m, lane] = 0.0
            for k in range(sources.fan[base + m], sources.fan[base + m + 1]):
                front.dirty[b, sources.corners[k].a] = ALL


@wp.func
def through(corner: Corner, da: float, db: float, best: float, element: int) -> float:
    """Return the shortest of the ways through a triangle and the best one known."""
    if element != 0:
        return wp.min(best, plane_front(corner, da, db))
    best = wp.min(best, side_way(corner, da, db))
    if least_way(corner, da, db) < best:
        best = wp.min(best, wp.sqrt(straight_squared(corner, da, db)))
    return best


@wp.func
def lower(
    front: Front, sources: Sources, hand: Hand, reach: Reach, v: int, lane: int, news: int, element: int
) -> wp.vec2i:
    """Update the distance of a vertex in one lane from triangles with news; return its own (`news_for`)."""
    origin = hand.origin + lane
    old = read(front.u, origin + v * hand.lanes)
    begin = int_at(sources.fan, hand.base + v)
    last = int_at(sources.fan, hand.base + v + 1) - 1
    left = news & (ALL >> (LAST_BIT - wp.min(last - begin, LAST_BIT)))
    best = old
    c = begin + lowest(left)
    da = read(front.u, origin + a_of(sources.corners, c) * hand.lanes)
    db = read(front.u, origin + b_of(sources.corners, c) * hand.lanes)
    while left != 0:
        left = left & (left - 1)
        ahead = wp.where(left != 0, begin + lowest(left), c)
        next_a = read(front.u, origin + a_of(sources.corners, ahead) * hand.lanes)
        next_b = read(front.u, origin + b_of(sources.corners, ahead) * hand.lanes)
        best = through(corner_at(sources.corners, c), da, db, best, element)
        c = ahead
        da = next_a
        db = next_b
    if ((news >> LAST_BIT) & 1) != 0:  # stands for those after it too
        for k in range(begin + LAST_BIT + 1, last + 1):
            da = read(front.u, origin + a_of(sources.corners, k) * hand.lanes)
            db = read(front.u, origin + b_of(sources.corners, k) * hand.lanes)
            best = through(corner_at(sources.corners, k), da, db, best, element)
    if FALL * best < old:
        write(front.u, origin + v * hand.lanes, best)
        publish()
        if best <= reach.limit:
            return news_for(front, sources, hand, v, lane, best, 0.0)
    return wp.vec2i(0, 0)


@wp.kernel(launch_bounds=(CREW, 4))
def advance_front(front: Front, sources: Sources, offset: int, element: int, threads: int):
    """Lower each cluster's distances until nothing is dirty; thread (cluster, member of its crew)."""
    b, thread = wp.tid()
    hand = hand_of(front, sources, b, offset, thread, threads)
    reach = sources.reaches[sources.shape[offset + b]]
    size = front.size[b]
    near = b * front.patch.shape[1]
    pending = int(1)
    while pending != 0:
        pending = int(0)
        for first in range(0, size, CREW_BAND):
            n = int(1)
            while n != 0:
                n = list_dirty(front, front.patch, b, first, wp.min(first + CREW_BAND, size))
                pending = wp.max(pending, n)
                ahead = int_in(front.patch, near + listed(front, b, hand.walker, n))
                done = int(0)
                while done < n:  # as often for all threads, side by side
                    v = ahead
                    news = news_of(front, b, done + hand.walker, n)
                    ahead = int_in(front.patch, near + listed(front, b, done + hand.walker + hand.walkers, n))
                    told = wp.vec2i(0, 0)
                    lane = hand.lane
                    while lane < hand.lanes:
                        own = lower(front, sources, hand, reach, v, lane, news, element)
                        told = wp.vec2i(told[0] | own[0], told[1] | own[1])
                        lane += hand.lane_step
                    fall_in()
                    mark_around(front, sources, hand, v, told)
                    done += hand.walkers
                    fall_in()
                meet()
