"""The fast iterative method for many clusters at once, near to far: for CUDA, and single fields on a CPU.

On CUDA each cluster has a block of threads, its crew, so that its steps wait for no other cluster's. On a CPU
the crew is one thread. As in `homolog.geodesics.sweep_kernels` a patch is gone through in bands, from near to
far, each of which settles before the next; a vertex is dirty if a neighbour fell since its last update.
Each pass over a band lists what is dirty and makes it clean, then shares the list out among the crew.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.bearing_kernels import LAST_BIT
from homolog.geodesics.kernels import (
    Corner,
    Reach,
    least_way,
    plane_front,
    side_way,
    straight_squared,
)

wp.set_module_options({"enable_backward": False, "max_unroll": 8, "fast_math": True})

BINS = wp.constant(256)
"""Rings, by distance, that vertices are listed in."""
CREW = 256
"""Threads that share one cluster on a GPU: sixteen vertices at a time."""
CREW_BAND = wp.constant(256)
"""Vertices, in the order of the patch, that are settled together."""


FROM_EIGHT = wp.constant(~255)
"""The bits of all neighbours from the ninth on."""
Eight = wp.types.vector(length=8, dtype=wp.float32)
"""Values of a vertex' neighbours: nearly no vertex has more. Reads that wait for each other take most of the
time, so all are on their way at once."""


@wp.struct
class Front:
    """The state of a batch of clusters."""

    u: wp.array3d(dtype=wp.float32)  # (B, V, L) distances, FAR where there are none yet
    dirty: wp.array2d(dtype=wp.int32)  # (B, V) 1 if the vertex awaits an update
    patch: wp.array2d(dtype=wp.int32)  # (B, P) vertices, near to far
    size: wp.array(dtype=wp.int32)  # (B,) vertices in the patch
    filled: wp.array2d(dtype=wp.int32)  # (B, BINS) how many vertices a ring holds; then where it ends
    listed: wp.array(dtype=wp.int32)  # (B * CREW_BAND,) places of the dirty vertices of each cluster's band


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
    margin: wp.array(dtype=wp.float32)


@wp.struct
class Hand:
    """What one thread of a cluster's crew does: one vertex in so many, and of these one lane in so many."""

    cluster: int  # in the batch
    origin: int  # of the cluster in all arrays by cluster, vertex and lane
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
    hand.origin = cluster * front.u.shape[1] * hand.lanes
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
    return static_cast<int>(__reduce_or_sync(side_by_side, unsigned(flags)));
#else
    return flags;
#endif
""")
def in_any_lane(flags: int, together: int) -> int:
    """Return the flags set in any of the threads side by side that share a vertex, 16 at most."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __shared__ int counts[32];
    const int warp = threadIdx.x >> 5, lane = threadIdx.x & 31;
    const unsigned votes = __ballot_sync(0xffffffffu, flag);
    if (lane == 0)
        counts[warp] = __popc(votes);
    __syncthreads();
    int at = n + __popc(votes & ((1u << lane) - 1u));
    for (int w = 0; w < static_cast<int>(blockDim.x >> 5); ++w) {
        at += w < warp ? counts[w] : 0;
        n += counts[w];
    }
    if (flag)
        listed.data[first + at] = value;
    __syncthreads();
    return n;
#else
    if (flag)
        listed.data[first + n] = value;
    return n + flag;
#endif
""")
def enlist(flag: int, value: int, listed: wp.array(dtype=wp.int32), first: int, n: int) -> int:
    """Append the values of threads whose flag is 1, not 0, to a list of n so far; return how many it has."""
    ...


# Arrays are read as they lie in memory: Warp's own indexing, which allows for any strides and negative
# indices, takes as many instructions as what is computed from the values.
@wp.func_native("return values.data[at];")
def read(values: wp.array3d(dtype=wp.float32), at: int) -> float:
    """Return a value of an array by its place in memory."""
    ...


@wp.func_native("return margins.data[at];")
def margin_at(margins: wp.array(dtype=wp.float32), at: int) -> float:
    """Return one of the margins."""
    ...


@wp.func_native("return corners.data[at].a;")
def a_of(corners: wp.array(dtype=Corner), at: int) -> int:
    """Return the a of one of the corners."""
    ...


@wp.func_native("return corners.data[at].b;")
def b_of(corners: wp.array(dtype=Corner), at: int) -> int:
    """Return the b of one of the corners."""
    ...


@wp.func_native("""
    const wp::float32* values = reinterpret_cast<const wp::float32*>(corners.data + at) + 4 * half;
#if defined(__CUDA_ARCH__)
    const float4 four = *reinterpret_cast<const float4*>(values);
    return wp::vec_t<4, wp::float32>(four.x, four.y, four.z, four.w);
#else
    return wp::vec_t<4, wp::float32>(values[0], values[1], values[2], values[3]);
#endif
""")
def half_corner(corners: wp.array(dtype=Corner), at: int, half: int) -> wp.vec4:
    """Return the first or second four values of a corner, in one read."""
    ...


@wp.func
def corner_at(corners: wp.array(dtype=Corner), at: int) -> Corner:
    """Return one of the corners."""
    low = half_corner(corners, at, 0)
    high = half_corner(corners, at, 1)
    corner = Corner()
    corner.a = wp.cast(low[0], wp.int32)
    corner.b = wp.cast(low[1], wp.int32)
    corner.length = low[2]
    corner.half = low[3]
    corner.x = high[0]
    corner.y = high[1]
    corner.ac = high[2]
    corner.bc = high[3]
    return corner


@wp.func
def list_dirty(
    front: Front, order: wp.array2d(dtype=wp.int32), b: int, first: int, end: int, thread: int, threads: int
) -> int:
    """List the places, first … end in an order, of dirty vertices and make these clean; return how many."""
    n = int(0)
    for k in range(first, end, threads):
        dirty = int(0)
        if k + thread < end:
            v = order[b, k + thread]
            dirty = front.dirty[b, v]
            if dirty != 0:
                front.dirty[b, v] = 0
        n = enlist(dirty, k + thread, front.listed, b * CREW_BAND, n)
    return n


@wp.func
def mark_around(front: Front, sources: Sources, hand: Hand, v: int, told: int):
    """Mark those neighbours of a vertex dirty whose bits are set in any thread that shares it."""
    bits = in_any_lane(told, hand.lane_step)
    begin = sources.fan[hand.base + v]
    for c in range(begin + hand.lane, sources.fan[hand.base + v + 1], hand.lane_step):
        if ((bits >> wp.min(c - begin, LAST_BIT)) & 1) != 0:
            front.dirty[hand.cluster, sources.corners[c].b] = 1


@wp.func
def read_around(
    values: wp.array3d(dtype=wp.float32), sources: Sources, hand: Hand, v: int, lane: int
) -> Eight:
    """Return the values at b of a vertex' first eight corners; the last one's again if there are fewer."""
    around = Eight()
    begin = sources.fan[hand.base + v]
    last = sources.fan[hand.base + v + 1] - 1
    for k in range(8):
        around[k] = read(
            values, hand.origin + b_of(sources.corners, wp.min(begin + k, last)) * hand.lanes + lane
        )
    return around


@wp.func
def beyond(sources: Sources, hand: Hand, v: int, u: float, around: Eight) -> int:
    """Return the bits of those neighbours whose distance may follow from that of a vertex.

    No straight way through a triangle (v, w, x) to x is shorter than (u(v) + u(w) - |vw|) / 2 + y, with y the
    height of x over vw; and u(w) >= u(v) - |vw|. So x, if nearer than u(v) by more than |vw| - y, need not
    be told.
    """
    bits = int(0)
    begin = sources.fan[hand.base + v]
    last = sources.fan[hand.base + v + 1] - 1
    for k in range(8):
        margin = margin_at(sources.margin, wp.min(begin + k, last))
        bits = bits | wp.where(around[k] > u - margin, 1 << k, 0)
    return wp.where(last - begin < 8, bits, bits | FROM_EIGHT)


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
    return wp.vec4(centre[0], centre[1], centre[2], radius + reach.stored + reach.slack)


@wp.kernel
def measure_patches(sources: Sources, threads: int, size: wp.array(dtype=wp.int32)):
    """Count the vertices that each cluster may reach; thread (cluster, member of its crew)."""
    cluster, thread = wp.tid()
    shape = sources.shape[cluster]
    ball = ball_around(sources, cluster)
    n = int(0)
    for v in range(sources.first[shape] + thread, sources.first[shape + 1], threads):
        if wp.length(sources.position[v] - wp.vec3(ball[0], ball[1], ball[2])) <= ball[3]:
            n += 1
    wp.atomic_add(size, cluster, n)


@wp.kernel
def lay_patches(front: Front, sources: Sources, offset: int, threads: int):
    """List what each cluster may reach, near to far in space, and set out; thread (cluster, of its crew)."""
    b, thread = wp.tid()
    shape = sources.shape[offset + b]
    base = sources.first[shape]
    ball = ball_around(sources, offset + b)
    centre = wp.vec3(ball[0], ball[1], ball[2])
    radius = ball[3]
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
def through(corner: Corner, da: float, db: float, best: float, element: int) -> float:
    """Return the shortest of the ways through a triangle and the best one known."""
    if element != 0:
        return wp.min(best, plane_front(corner, da, db))
    best = wp.min(best, side_way(corner, da, db))
    if least_way(corner, da, db) < best:
        best = wp.min(best, wp.sqrt(straight_squared(corner, da, db)))
    return best


@wp.func
def lower(front: Front, sources: Sources, hand: Hand, reach: Reach, v: int, lane: int, element: int) -> int:
    """Update the distance of a vertex in one lane; return the bits of the neighbours that have to know."""
    origin = hand.origin + lane
    old = read(front.u, origin + v * hand.lanes)
    begin = sources.fan[hand.base + v]
    end = sources.fan[hand.base + v + 1]
    da = read(front.u, origin + a_of(sources.corners, begin) * hand.lanes)
    around = read_around(front.u, sources, hand, v, lane)
    best = old
    for k in range(8):
        if begin + k < end:
            best = through(corner_at(sources.corners, begin + k), da, around[k], best, element)
        da = around[k]
    for c in range(begin + 8, end):
        corner = corner_at(sources.corners, c)
        db = read(front.u, origin + corner.b * hand.lanes)
        best = through(corner, da, db, best, element)
        da = db
    if best < old - reach.changed:
        front.u[hand.cluster, v, lane] = best
        if best <= reach.stored + reach.slack:
            return beyond(sources, hand, v, best, around)
    return 0


@wp.kernel(launch_bounds=(CREW, 4))
def advance_front(front: Front, sources: Sources, offset: int, element: int, threads: int):
    """Lower each cluster's distances until nothing is dirty; thread (cluster, member of its crew)."""
    b, thread = wp.tid()
    hand = hand_of(front, sources, b, offset, thread, threads)
    reach = sources.reaches[sources.shape[offset + b]]
    size = front.size[b]
    pending = int(1)
    while pending != 0:
        pending = int(0)
        for first in range(0, size, CREW_BAND):
            n = int(1)
            while n != 0:
                n = list_dirty(front, front.patch, b, first, wp.min(first + CREW_BAND, size), thread, threads)
                pending = wp.max(pending, n)
                for k in range(hand.walker, n, hand.walkers):
                    v = front.patch[b, front.listed[b * CREW_BAND + k]]
                    told = int(0)
                    for lane in range(hand.lane, hand.lanes, hand.lane_step):
                        told = told | lower(front, sources, hand, reach, v, lane, element)
                    mark_around(front, sources, hand, v, told)
                meet()
