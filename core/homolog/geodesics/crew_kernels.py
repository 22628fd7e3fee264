"""What the crew of a cluster works with: its state, its hands, lists of what is dirty, and its news.

On CUDA each cluster has a block of threads, its crew; on a CPU the crew is one thread. A vertex is dirty if a
neighbour fell since its last update; which of its triangles have to be looked at again is kept in bits. Each
pass over a band of vertices lists what is dirty and makes it clean, and then shares the list out among the
crew; whoever falls marks its neighbours dirty, after it has written its distance. Distances only ever fall,
so that reading a neighbour while it is being lowered is harmless.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.kernels import Corner, Reach, Tell
from homolog.geodesics.memory_kernels import (
    a_of,
    b_of,
    int_at,
    places_of,
    read,
    set_bits,
    tell_at,
)

wp.set_module_options({"enable_backward": False, "max_unroll": 8, "fast_math": True})

BINS = wp.constant(256)
"""Rings, by distance, that vertices are listed in."""
CREW = 256
"""Threads that share one cluster on a GPU: sixteen vertices at a time."""
CREW_BAND = wp.constant(512)
"""Vertices, in the order of the patch, that are settled together, a multiple of the crew …"""
AMEND_BAND = wp.constant(256)
"""… when amendments are: they follow from each other less."""
LAST_BIT = wp.constant(14)
"""Triangles around a vertex are bits; this one stands for all from here on: poles may have any number."""
ALL = wp.constant(2**15 - 1)
"""The bits of all triangles."""


@wp.struct
class Front:
    """The state of a batch of clusters."""

    u: wp.array3d(dtype=wp.float32)  # (B, V, L) distances, FAR where there are none yet
    dirty: wp.array2d(dtype=wp.int32)  # (B, V) bits of the triangles that have news for a vertex
    patch: wp.array2d(dtype=wp.int32)  # (B, P) vertices, near to far
    size: wp.array(dtype=wp.int32)  # (B,) vertices in the patch
    filled: wp.array2d(dtype=wp.int32)  # (B, BINS) how many vertices a ring holds; then where it ends
    listed: wp.array(dtype=wp.int32)  # (B * CREW_BAND,) places of the dirty vertices of each cluster's band
    news: wp.array(dtype=wp.int32)  # (B * CREW_BAND,) and the triangles that have news for them


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
    tells: wp.array(dtype=Tell)
    shortest: wp.array(dtype=float)  # side at each vertex


@wp.struct
class Hand:
    """What one thread of a cluster's crew does: one vertex in so many, and of these one lane in so many."""

    cluster: int  # in the batch
    row: int  # of the cluster in arrays by cluster and vertex …
    origin: int  # … and by cluster, vertex and lane
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
    hand.row = cluster * front.u.shape[1]
    hand.origin = hand.row * hand.lanes
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
    __syncwarp();
#endif
""")
def fall_in():
    """Go on side by side, where each thread may have gone its own way; all have to come here."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
    const unsigned half = threadIdx.x & 16u;
    return __reduce_or_sync(0xffffffffu, unsigned(flags) << half) >> half & 0xffffu;
#elif defined(__CUDA_ARCH__)
    for (int step = 8; step > 0; step /= 2)
        flags |= __shfl_xor_sync(0xffffffffu, flags, step);
    return flags;
#else
    return flags;
#endif
""")
def in_any_lane(flags: int) -> int:
    """Return the flags, 16 at most, set in any of the 16 threads that share a vertex; all ask at once."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    // Each warp looks at every so many-th piece of 32 places, keeps what it finds, and puts it into the list
    // where the counts of the pieces before end. The list stays in order: out of order there are a fifth more
    // updates.
    constexpr int MOST = 2;
    __shared__ int counts[32];
    const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5, warps = blockDim.x >> 5;
    int news[MOST];
    unsigned votes[MOST];
    #pragma unroll
    for (int i = 0; i < MOST; ++i) {
        const int piece = warp + i * warps, k = first + 32 * piece + lane;
        news[i] = k < end ? dirty.data[row + order.data[near + k]] : 0;
        votes[i] = __ballot_sync(0xffffffffu, news[i]);
        if (lane == 0 && piece < 32)
            counts[piece] = __popc(votes[i]);
    }
    __syncthreads();
    int upto = lane < MOST * warps ? counts[lane] : 0;
    for (int step = 1; step < 32; step *= 2) {
        const int before = __shfl_up_sync(0xffffffffu, upto, step);
        upto += lane < step ? 0 : before;
    }
    const int n = __shfl_sync(0xffffffffu, upto, 31);
    #pragma unroll
    for (int i = 0; i < MOST; ++i) {
        const int piece = warp + i * warps, k = first + 32 * piece + lane;
        const int before = __shfl_sync(0xffffffffu, upto, piece - 1 & 31);
        if (news[i]) {
            const int at = start + (piece ? before : 0) + __popc(votes[i] & ((1u << lane) - 1u));
            dirty.data[row + order.data[near + k]] = 0;
            listed.data[at] = k;
            told.data[at] = news[i];
        }
    }
    __syncthreads();
    return n;
#else
    int n = 0;
    for (int k = first; k < end; ++k) {
        const int at = row + order.data[near + k];
        if (dirty.data[at]) {
            listed.data[start + n] = k;
            told.data[start + n] = dirty.data[at];
            dirty.data[at] = 0;
            ++n;
        }
    }
    return n;
#endif
""")
def list_places(
    order: wp.array2d(dtype=wp.int32),
    near: int,
    first: int,
    end: int,
    dirty: wp.array2d(dtype=wp.int32),
    row: int,
    listed: wp.array(dtype=wp.int32),
    told: wp.array(dtype=wp.int32),
    start: int,
) -> int:
    """List the places, first … end in an order, of dirty vertices and make these clean; return how many."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __threadfence_block();
#endif
""")
def publish():
    """Let the crew see what was written before anything that is read after this is read."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return bits ? __ffs(bits) - 1 : 0;
#else
    return bits ? __builtin_ctz(bits) : 0;
#endif
""")
def lowest(bits: int) -> int:
    """Return the place of the lowest bit that is set; 0 if none is."""
    ...


@wp.func
def list_dirty(front: Front, order: wp.array2d(dtype=wp.int32), b: int, first: int, end: int) -> int:
    """List the places, first … end in an order, of dirty vertices and make these clean; return how many.

    There may be two places a thread, on CUDA; before the next list the crew has to meet.
    """
    row = b * front.dirty.shape[1]
    near = b * order.shape[1]
    return list_places(order, near, first, end, front.dirty, row, front.listed, front.news, b * CREW_BAND)


@wp.func
def listed(front: Front, b: int, k: int, n: int) -> int:
    """Return the k-th place of a list of n; the last one's for any beyond."""
    return int_at(front.listed, b * CREW_BAND + wp.max(wp.min(k, n - 1), 0))


@wp.func
def news_of(front: Front, b: int, k: int, n: int) -> int:
    """Return the triangles that have news for the k-th of a list of n; none for any beyond."""
    return wp.where(k < n, int_at(front.news, b * CREW_BAND + wp.min(k, n - 1)), 0)


@wp.func
def news_through(tell: wp.vec4, u: float, ua: float, ub: float, slack: float) -> int:
    """Return 1 if a may follow from u through this triangle, 2 if b may, 3 if both."""
    least_to_a = 0.5 * (u + ub) + tell[0]
    least_to_b = wp.min(0.5 * (u + ua) + tell[1], u + tell[2])
    return wp.where(least_to_a < ua + slack, 1, 0) | wp.where(least_to_b < ub + slack, 2, 0)


@wp.func
def news_for(
    front: Front, sources: Sources, hand: Hand, v: int, lane: int, u: float, slack: float
) -> wp.vec2i:
    """Return the bits of the triangles (v, a, b) through which a, and b, may follow from a vertex at u.

    No straight way through a triangle to b is shorter than (u(v) + u(a) - |va|) / 2 + y, with y the height of
    b over va; that along the side is u(v) + |vb|. Whoever has a distance below that, by slack, need not be
    told. If a falls later it tells b itself, from what u(v) is by then: so v must have been published.
    """
    to_a = int(0)
    to_b = int(0)
    begin = int_at(sources.fan, hand.base + v)
    last = int_at(sources.fan, hand.base + v + 1) - 1
    origin = hand.origin + lane
    ua = read(front.u, origin + a_of(sources.corners, begin) * hand.lanes)
    for k in range(6):  # all at once; the last one again if there are fewer
        c = wp.min(begin + k, last)
        ub = read(front.u, origin + b_of(sources.corners, c) * hand.lanes)  # the next corner's a
        news = news_through(tell_at(sources.tells, c), u, ua, ub, slack)
        to_a = to_a | wp.where((news & 1) != 0, 1 << k, 0)
        to_b = to_b | wp.where((news & 2) != 0, 1 << k, 0)
        ua = ub
    c = begin + 6
    while c <= last:
        ub = read(front.u, origin + b_of(sources.corners, c) * hand.lanes)
        news = news_through(tell_at(sources.tells, c), u, ua, ub, slack)
        bit = 1 << wp.min(c - begin, LAST_BIT)
        to_a = to_a | wp.where((news & 1) != 0, bit, 0)
        to_b = to_b | wp.where((news & 2) != 0, bit, 0)
        ua = ub
        c += 1
    return wp.vec2i(to_a, to_b)


@wp.func
def mark_around(front: Front, sources: Sources, hand: Hand, v: int, news: wp.vec2i):
    """Mark neighbours of a vertex dirty that any thread which shares it has news for."""
    for_a = in_any_lane(news[0])
    for_b = in_any_lane(news[1])
    if (for_a | for_b) != 0:
        begin = int_at(sources.fan, hand.base + v)
        for c in range(begin + hand.lane, int_at(sources.fan, hand.base + v + 1), hand.lane_step):
            bit = wp.min(c - begin, LAST_BIT)
            places = places_of(sources.tells, c)
            if ((for_a >> bit) & 1) != 0:
                set_bits(front.dirty, hand.row + a_of(sources.corners, c), 1 << (places & 255))
            if ((for_b >> bit) & 1) != 0:
                set_bits(front.dirty, hand.row + b_of(sources.corners, c), 1 << (places >> 8))


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
