"""The fast iterative method for many clusters at once, near to far: for CUDA, and single fields on a CPU.

On CUDA each cluster has a block of threads, its crew, so that its steps wait for no other cluster's. On a CPU
the crew is one thread. As in `homolog.geodesics.sweep_kernels` a patch is gone through in bands, from near to
far, each of which settles before the next; a vertex is dirty if a neighbour fell since its last update.
Distances only ever fall, so that reading a neighbour while it is being lowered is harmless: who lowers it
marks its neighbours dirty afterwards, and who updates a vertex marks it clean before reading.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.kernels import (
    Corner,
    Reach,
    least_way,
    plane_front,
    side_way,
    straight_squared,
)

wp.set_module_options({"enable_backward": False, "max_unroll": 4})

BINS = wp.constant(256)
"""Rings, by distance, that vertices are listed in."""
CREW = 256
"""Threads that share one cluster on a GPU: sixteen vertices at a time."""
CREW_BAND = wp.constant(256)
"""Vertices, in the order of the patch, that are settled together."""


@wp.struct
class Front:
    """The state of a batch of clusters."""

    u: wp.array3d(dtype=wp.float32)  # (B, V, L) distances, FAR where there are none yet
    dirty: wp.array2d(dtype=wp.int32)  # (B, V) 1 if the vertex awaits an update
    patch: wp.array2d(dtype=wp.int32)  # (B, V) vertices, near to far
    size: wp.array(dtype=wp.int32)  # (B,) vertices in the patch
    filled: wp.array2d(dtype=wp.int32)  # (B, BINS) how many vertices a ring holds; then where it ends
    busy: wp.array2d(dtype=wp.int32)  # (B, 3) the last passes, by turns, with anything to do


@wp.struct
class Sources:
    """All clusters of a cohort and the meshes that they lie on."""

    members: wp.array2d(dtype=wp.int32)
    shape: wp.array(dtype=wp.int32)
    first: wp.array(dtype=wp.int32)
    reaches: wp.array(dtype=Reach)
    position: wp.array(dtype=wp.vec3)
    fan: wp.array(dtype=wp.int32)
    corners: wp.array(dtype=Corner)


@wp.struct
class Hand:
    """What one thread of a cluster's crew does: one vertex in so many, and of these one lane in so many."""

    cluster: int  # in the batch
    base: int  # first vertex of its shape
    lanes: int
    lane: int
    lane_step: int
    walker: int
    walkers: int


@wp.func
def hand_of(front: Front, sources: Sources, cluster: int, offset: int, thread: int, threads: int) -> Hand:
    """Return the part of a thread in a cluster's crew; lanes side by side if there are threads enough."""
    hand = Hand()
    hand.cluster = cluster
    hand.base = sources.first[sources.shape[offset + cluster]]
    hand.lanes = front.u.shape[2]
    hand.lane_step = wp.min(threads, hand.lanes)
    hand.lane = thread % hand.lane_step
    hand.walker = thread // hand.lane_step
    hand.walkers = threads // hand.lane_step
    return hand


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __syncthreads();
#endif
""")
def meet():
    """Wait for all threads of the crew, and see what they wrote."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const unsigned side_by_side = ((1u << together) - 1u) << (threadIdx.x & 31u & ~(unsigned(together) - 1u));
    return (__ballot_sync(side_by_side, flag) & side_by_side) != 0;
#else
    return flag;
#endif
""")
def in_any_lane(flag: int, together: int) -> int:
    """Return whether a flag is set in any of the threads side by side that share a vertex, 16 at most."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __threadfence_block();
    __syncwarp(((1u << together) - 1u) << (threadIdx.x & 31u & ~(unsigned(together) - 1u)));
#endif
""")
def pass_on(together: int):
    """Show the crew what the threads that share a vertex wrote, before they read or write anything more."""
    ...


@wp.func
def take(front: Front, hand: Hand, v: int) -> int:
    """Return whether a vertex is dirty, and make it clean."""
    dirty = in_any_lane(front.dirty[hand.cluster, v], hand.lane_step)
    if dirty != 0:
        if hand.lane == 0:
            front.dirty[hand.cluster, v] = 0
        pass_on(hand.lane_step)
    return dirty


@wp.func
def mark_around(front: Front, sources: Sources, hand: Hand, v: int):
    """Mark the neighbours of a vertex dirty; each of the threads that share it marks some."""
    pass_on(hand.lane_step)
    first = sources.fan[hand.base + v] + hand.lane
    for c in range(first, sources.fan[hand.base + v + 1], hand.lane_step):
        front.dirty[hand.cluster, sources.corners[c].a] = 1


@wp.func
def end_rings(front: Front, b: int, thread: int):
    """Turn the numbers in each ring into where it begins in the list."""
    meet()
    if thread == 0:
        total = int(0)
        for ring in range(BINS):
            n = front.filled[b, ring]
            front.filled[b, ring] = total
            total += n
    meet()


@wp.kernel
def lay_patches(front: Front, sources: Sources, offset: int, threads: int):
    """List what each cluster may reach, near to far in space, and set out; thread (cluster, of its crew)."""
    b, thread = wp.tid()
    shape = sources.shape[offset + b]
    base = sources.first[shape]
    reach = sources.reaches[shape]
    centre = wp.vec3(0.0, 0.0, 0.0)
    n_members = float(0.0)
    for lane in range(sources.members.shape[1]):
        m = sources.members[offset + b, lane]
        if m >= 0:
            centre += sources.position[base + m]
            n_members += 1.0
    centre = centre / n_members
    radius = float(0.0)
    for lane in range(sources.members.shape[1]):
        m = sources.members[offset + b, lane]
        if m >= 0:
            radius = wp.max(radius, wp.length(sources.position[base + m] - centre))
    radius += reach.stored + reach.slack
    for ring in range(thread, BINS, threads):
        front.filled[b, ring] = 0
    meet()
    scale = 0.9999 * float(BINS) / radius
    n = sources.first[shape + 1] - base
    for v in range(thread, n, threads):
        distance = wp.length(sources.position[base + v] - centre)
        if distance <= radius:
            wp.atomic_add(front.filled, b, int(distance * scale), 1)
    end_rings(front, b, thread)
    for v in range(thread, n, threads):
        distance = wp.length(sources.position[base + v] - centre)
        if distance <= radius:
            front.patch[b, wp.atomic_add(front.filled, b, int(distance * scale), 1)] = v
    meet()
    front.size[b] = front.filled[b, BINS - 1]
    for lane in range(thread, sources.members.shape[1], threads):
        m = sources.members[offset + b, lane]
        if m >= 0:
            front.u[b, m, lane] = 0.0
            for k in range(sources.fan[base + m], sources.fan[base + m + 1]):
                front.dirty[b, sources.corners[k].a] = 1


@wp.func
def lower(front: Front, sources: Sources, hand: Hand, reach: Reach, v: int, lane: int, element: int) -> int:
    """Update the distance of a vertex in one lane; return whether it fell and its neighbours have to know."""
    b = hand.cluster
    old = front.u[b, v, lane]
    best = old
    begin = sources.fan[hand.base + v]
    da = front.u[b, sources.corners[begin].a, lane]
    for c in range(begin, sources.fan[hand.base + v + 1]):
        corner = sources.corners[c]
        db = front.u[b, corner.b, lane]  # the next corner's a
        if element == 0:
            best = wp.min(best, side_way(corner, da, db))
            if least_way(corner, da, db) < best:
                best = wp.min(best, wp.sqrt(straight_squared(corner, da, db)))
        else:
            best = wp.min(best, plane_front(corner, da, db))
        da = db
    if best < old - reach.changed:
        front.u[b, v, lane] = best
        return wp.where(best <= reach.stored + reach.slack, 1, 0)
    return 0


@wp.kernel(launch_bounds=(CREW, 4))
def advance_front(front: Front, sources: Sources, offset: int, element: int, threads: int):
    """Lower each cluster's distances until nothing is dirty; thread (cluster, member of its crew)."""
    b, thread = wp.tid()
    hand = hand_of(front, sources, b, offset, thread, threads)
    reach = sources.reaches[sources.shape[offset + b]]
    size = front.size[b]
    turn = int(0)
    pending = int(1)
    while pending != 0:
        pending = int(0)
        for first in range(0, size, CREW_BAND):
            moving = int(1)
            while moving != 0:
                turn += 1
                for k in range(first + hand.walker, wp.min(first + CREW_BAND, size), hand.walkers):
                    v = front.patch[b, k]
                    if take(front, hand, v) != 0:
                        front.busy[b, turn % 3] = turn
                        fell = int(0)
                        for lane in range(hand.lane, hand.lanes, hand.lane_step):
                            fell = wp.max(fell, lower(front, sources, hand, reach, v, lane, element))
                        if in_any_lane(fell, hand.lane_step) != 0:
                            mark_around(front, sources, hand, v)
                meet()
                moving = wp.where(front.busy[b, turn % 3] == turn, 1, 0)
                pending = wp.max(pending, moving)
