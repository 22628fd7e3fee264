"""The fast iterative method as a front of all clusters at once: for CUDA, and single fields on a CPU.

On CUDA each cluster has a block of threads, its crew, so that its steps wait for no other cluster's. On a CPU
the crew is one thread. Arrays of a batch of clusters: u (B, V, LANES) distances, queued (B, V) last step that
each vertex is listed for, lists (3, B, V) the vertices of this step, of the next, and all ever listed, counts
(4, B) their numbers, the first three by step. Distances only ever fall, so that reading a neighbour while it
is being lowered is harmless: lowering lists it for the next step.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.kernels import FAR, Corner, Reach, plane_front, point_front

wp.set_module_options({"enable_backward": False, "max_unroll": 4})

ALL = wp.constant(2)
"""Row of the lists that holds all vertices ever listed."""
N_ALL = wp.constant(3)
"""Row of the counts that holds how many these are."""


@wp.struct
class Front:
    """The state of a batch of clusters."""

    u: wp.array3d(dtype=wp.float32)
    queued: wp.array2d(dtype=wp.int32)
    lists: wp.array3d(dtype=wp.int32)
    counts: wp.array2d(dtype=wp.int32)


@wp.struct
class Sources:
    """All clusters of a cohort and the meshes that they lie on."""

    members: wp.array2d(dtype=wp.int32)
    shape: wp.array(dtype=wp.int32)
    first: wp.array(dtype=wp.int32)
    reaches: wp.array(dtype=Reach)
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
    if (lanes == 16) {
        const unsigned half = 0xffffu << (threadIdx.x & 16);
        return (__ballot_sync(half, flag) & half) != 0;
    }
#endif
    return flag;
""")
def in_any_lane(flag: int, lanes: int) -> int:
    """Return whether a flag is set in any of sixteen lanes that are side by side."""
    ...


@wp.func
def enqueue(front: Front, b: int, vertex: int, step: int):
    """List a vertex for a step, once."""
    if front.queued[b, vertex] >= step:  # mostly so: spare the atomic
        return
    before = wp.atomic_max(front.queued, b, vertex, step)
    if before < step:
        front.lists[step % 2, b, wp.atomic_add(front.counts, step % 3, b, 1)] = vertex
    if before == 0:
        front.lists[ALL, b, wp.atomic_add(front.counts, N_ALL, b, 1)] = vertex


@wp.kernel
def seed_front(front: Front, sources: Sources, offset: int):
    """Set the sources to 0 and list them and their neighbours for step 1; thread (cluster, lane)."""
    b, lane = wp.tid()
    cluster = offset + b
    m = sources.members[cluster, lane]
    if m >= 0:
        front.u[b, m, lane] = 0.0
        enqueue(front, b, m, 1)
        vertex = sources.first[sources.shape[cluster]] + m
        for k in range(sources.fan[vertex], sources.fan[vertex + 1]):
            enqueue(front, b, sources.corners[k].a, 1)


@wp.func
def lower(front: Front, sources: Sources, hand: Hand, reach: Reach, v: int, lane: int, element: int) -> int:
    """Update the distance of a vertex in one lane; return whether it fell and its neighbours have to know."""
    b = hand.cluster
    best = float(FAR)
    for c in range(sources.fan[hand.base + v], sources.fan[hand.base + v + 1]):
        corner = sources.corners[c]
        da = front.u[b, corner.a, lane]
        db = front.u[b, corner.b, lane]
        if element == 0:
            best = wp.min(best, point_front(corner, da, db))
        else:
            best = wp.min(best, plane_front(corner, da, db))
    if best < front.u[b, v, lane] - reach.changed:
        front.u[b, v, lane] = best
        return wp.where(best <= reach.stored + reach.slack, 1, 0)
    return 0


@wp.kernel
def advance_front(front: Front, sources: Sources, offset: int, element: int, threads: int):
    """Advance each cluster's front until nothing changes; thread (cluster, member of its crew)."""
    b, thread = wp.tid()
    hand = hand_of(front, sources, b, offset, thread, threads)
    reach = sources.reaches[sources.shape[offset + b]]
    step = int(1)
    busy = front.counts[1, b]
    while busy > 0:
        if thread == 0:
            front.counts[(step + 2) % 3, b] = 0  # that of the step before: spent, and the next but one's
        for k in range(hand.walker, busy, hand.walkers):
            v = front.lists[step % 2, b, k]
            for lane in range(hand.lane, hand.lanes, hand.lane_step):
                fell = lower(front, sources, hand, reach, v, lane, element)
                if in_any_lane(fell, hand.lane_step) != 0:
                    first = sources.fan[hand.base + v] + hand.lane
                    for c in range(first, sources.fan[hand.base + v + 1], hand.lane_step):
                        enqueue(front, b, sources.corners[c].a, step + 1)
        meet()
        step += 1
        busy = front.counts[step % 3, b]
