"""The state that a thread block shares for one cluster: distances, active vertices, pending triangles.

On CUDA one thread block solves one cluster; on a CPU the block is one thread. A vertex is active if a
neighbour's distance decreased since its last update; the triangles to update it from are kept as bits. Each
pass compacts and clears the active vertices of a band and distributes them over the block's threads. A
vertex that decreases writes its distance and then activates its neighbours. Distances only ever decrease,
so that reading one while another thread lowers it is harmless.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.kernels.local_solver import (
    LAST_TRIANGLE_BIT,
    Corner,
    DistanceLimits,
    PropagationBound,
)
from homolog.geodesics.kernels.memory import (
    corner_a,
    corner_b,
    load,
    load_bound,
    load_int,
    load_ranks,
    set_bits,
)

wp.set_module_options({"enable_backward": False, "max_unroll": 8, "fast_math": True})

N_BUCKETS = wp.constant(256)
"""Buckets of the radix sort that orders vertices by distance."""
BLOCK_DIM = 256
"""Threads that share one cluster on a GPU: sixteen vertices at a time."""
BAND_SIZE = wp.constant(512)
"""Vertices, in patch order, that converge together; a multiple of BLOCK_DIM."""
ALL_TRIANGLES = wp.constant(2**15 - 1)
"""The bits of all triangles."""


@wp.struct
class Front:
    """The state of a batch of clusters."""

    u: wp.array3d(dtype=wp.float32)  # (B, V, L) distances, UNREACHED where there are none yet
    pending: wp.array2d(dtype=wp.int32)  # (B, V) bits of the triangles to update each vertex from
    patch: wp.array2d(dtype=wp.int32)  # (B, P) vertices, near to far
    size: wp.array(dtype=wp.int32)  # (B,) vertices in the patch
    bucket_count: wp.array2d(dtype=wp.int32)  # (B, N_BUCKETS) vertices in each bucket; then its end
    active_item: wp.array(dtype=wp.int32)  # (B * BAND_SIZE,) active vertices of each band, by position
    active_pending: wp.array(dtype=wp.int32)  # (B * BAND_SIZE,) their bits of `pending`


@wp.struct
class Sources:
    """All clusters of a cohort and their meshes."""

    members: wp.array2d(dtype=wp.int32)
    shape: wp.array(dtype=wp.int32)
    first: wp.array(dtype=wp.int32)
    limits: wp.array(dtype=DistanceLimits)
    position: wp.array(dtype=wp.vec3)
    fan: wp.array(dtype=wp.int32)
    corners: wp.array(dtype=Corner)
    bounds: wp.array(dtype=PropagationBound)


@wp.struct
class ThreadContext:
    """The share of one thread of a block: every `vertex_stride`-th vertex, every `lane_step`-th lane."""

    cluster: int  # in the batch
    row: int  # of the cluster in arrays by cluster and vertex …
    origin: int  # … and by cluster, vertex and lane
    base: int  # first vertex of its shape
    lanes: int
    lane: int
    lane_step: int
    vertex_slot: int
    vertex_stride: int


@wp.func
def thread_context(
    front: Front, sources: Sources, cluster: int, offset: int, thread: int, threads: int
) -> ThreadContext:
    """Return a thread's share of its cluster; neighbouring threads take neighbouring lanes of one vertex."""
    ctx = ThreadContext()
    ctx.cluster = cluster
    ctx.base = sources.first[sources.shape[offset + cluster]]
    ctx.lanes = front.u.shape[2]
    ctx.row = cluster * front.u.shape[1]
    ctx.origin = ctx.row * ctx.lanes
    ctx.lane_step = wp.min(threads, ctx.lanes)
    ctx.lane = thread % ctx.lane_step
    ctx.vertex_slot = thread // ctx.lane_step
    ctx.vertex_stride = threads // ctx.lane_step
    return ctx


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __syncthreads();
#endif
""")
def block_sync():
    """Wait for all threads of the block; their writes are visible afterwards."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __syncwarp();
#endif
""")
def warp_sync():
    """Reconverge the threads of a warp; all of them must reach this call."""
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
def half_warp_or(flags: int) -> int:
    """Return the bitwise or of up to 16 flags over the 16 threads that share a vertex; all must call it."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    // Stream compaction in order: ballot per warp, scan of the counts, scatter. An unordered list would need
    // a fifth more updates.
    constexpr int PIECES_PER_WARP = 2;
    __shared__ int counts[32];
    const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5, warps = blockDim.x >> 5;
    int flags[PIECES_PER_WARP];
    unsigned votes[PIECES_PER_WARP];
    #pragma unroll
    for (int i = 0; i < PIECES_PER_WARP; ++i) {
        const int piece = warp + i * warps, k = first + 32 * piece + lane;
        flags[i] = k < end ? pending.data[row + order.data[order_row + k]] : 0;
        votes[i] = __ballot_sync(0xffffffffu, flags[i]);
        if (lane == 0 && piece < 32)
            counts[piece] = __popc(votes[i]);
    }
    __syncthreads();
    int upto = lane < PIECES_PER_WARP * warps ? counts[lane] : 0;
    for (int step = 1; step < 32; step *= 2) {
        const int before = __shfl_up_sync(0xffffffffu, upto, step);
        upto += lane < step ? 0 : before;
    }
    const int n = __shfl_sync(0xffffffffu, upto, 31);
    #pragma unroll
    for (int i = 0; i < PIECES_PER_WARP; ++i) {
        const int piece = warp + i * warps, k = first + 32 * piece + lane;
        const int before = __shfl_sync(0xffffffffu, upto, piece - 1 & 31);
        if (flags[i]) {
            const int at = start + (piece ? before : 0) + __popc(votes[i] & ((1u << lane) - 1u));
            pending.data[row + order.data[order_row + k]] = 0;
            active_item.data[at] = k;
            item_pending.data[at] = flags[i];
        }
    }
    __syncthreads();
    return n;
#else
    int n = 0;
    for (int k = first; k < end; ++k) {
        const int at = row + order.data[order_row + k];
        if (pending.data[at]) {
            active_item.data[start + n] = k;
            item_pending.data[start + n] = pending.data[at];
            pending.data[at] = 0;
            ++n;
        }
    }
    return n;
#endif
""")
def compact_positions(
    order: wp.array2d(dtype=wp.int32),
    order_row: int,
    first: int,
    end: int,
    pending: wp.array2d(dtype=wp.int32),
    row: int,
    active_item: wp.array(dtype=wp.int32),
    item_pending: wp.array(dtype=wp.int32),
    start: int,
) -> int:
    """List the active vertices at positions first … end of an order and clear them; return their number."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __threadfence_block();
#endif
""")
def memory_fence():
    """Order this thread's earlier writes before its later reads, as seen by the block."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return bits ? __ffs(bits) - 1 : 0;
#else
    return bits ? __builtin_ctz(bits) : 0;
#endif
""")
def count_trailing_zeros(bits: int) -> int:
    """Return the index of the lowest set bit; 0 if none is set."""
    ...


@wp.func
def compact_active(front: Front, order: wp.array2d(dtype=wp.int32), b: int, first: int, end: int) -> int:
    """List the active vertices among positions first … end of an order, and clear them; return their number.

    On CUDA a thread handles at most two positions. The block must synchronize before the next call.
    """
    row = b * front.pending.shape[1]
    order_row = b * order.shape[1]
    return compact_positions(
        order,
        order_row,
        first,
        end,
        front.pending,
        row,
        front.active_item,
        front.active_pending,
        b * BAND_SIZE,
    )


@wp.func
def active_item(front: Front, b: int, k: int, n: int) -> int:
    """Return the position of the k-th of n active vertices; the last one's if k >= n."""
    return load_int(front.active_item, b * BAND_SIZE + wp.max(wp.min(k, n - 1), 0))


@wp.func
def pending_of(front: Front, b: int, k: int, n: int) -> int:
    """Return the pending triangles of the k-th of n active vertices; none if k >= n."""
    return wp.where(k < n, load_int(front.active_pending, b * BAND_SIZE + wp.min(k, n - 1)), 0)


@wp.func
def affected_ends(bound: wp.vec4, u: float, ua: float, ub: float, slack: float) -> int:
    """Return which distances u may lower through this triangle: 1 for a, 2 for b, 3 for both, else 0."""
    bound_a = 0.5 * (u + ub) + bound[0]
    bound_b = wp.min(0.5 * (u + ua) + bound[1], u + bound[2])
    return wp.where(bound_a < ua + slack, 1, 0) | wp.where(bound_b < ub + slack, 2, 0)


@wp.func
def affected_triangles(
    front: Front, sources: Sources, ctx: ThreadContext, v: int, lane: int, u: float, slack: float
) -> wp.vec2i:
    """Return the bits of the triangles (v, a, b) through which distance u at v may lower a's, and b's.

    No straight path through a triangle to b is shorter than (u(v) + u(a) - |va|) / 2 + y, where y is the
    height of b over va; the path along the edge has length u(v) + |vb|. A neighbour whose distance is below
    both bounds, by slack, cannot change. If a decreases later it activates b itself, from the newest u(v):
    a memory fence must lie between writing u(v) and this call.
    """
    mask_a = int(0)
    mask_b = int(0)
    begin = load_int(sources.fan, ctx.base + v)
    last = load_int(sources.fan, ctx.base + v + 1) - 1
    origin = ctx.origin + lane
    ua = load(front.u, origin + corner_a(sources.corners, begin) * ctx.lanes)
    for k in range(6):  # independent loads, in flight together; the last is repeated if there are fewer
        c = wp.min(begin + k, last)
        ub = load(front.u, origin + corner_b(sources.corners, c) * ctx.lanes)  # the next corner's a
        pending = affected_ends(load_bound(sources.bounds, c), u, ua, ub, slack)
        mask_a = mask_a | wp.where((pending & 1) != 0, 1 << k, 0)
        mask_b = mask_b | wp.where((pending & 2) != 0, 1 << k, 0)
        ua = ub
    c = begin + 6
    while c <= last:
        ub = load(front.u, origin + corner_b(sources.corners, c) * ctx.lanes)
        pending = affected_ends(load_bound(sources.bounds, c), u, ua, ub, slack)
        bit = 1 << wp.min(c - begin, LAST_TRIANGLE_BIT)
        mask_a = mask_a | wp.where((pending & 1) != 0, bit, 0)
        mask_b = mask_b | wp.where((pending & 2) != 0, bit, 0)
        ua = ub
        c += 1
    return wp.vec2i(mask_a, mask_b)


@wp.func
def mark_neighbours(front: Front, sources: Sources, ctx: ThreadContext, v: int, pending: wp.vec2i):
    """Set the pending bits of those neighbours of v that the decrease in any lane may lower."""
    any_a = half_warp_or(pending[0])
    any_b = half_warp_or(pending[1])
    if (any_a | any_b) != 0:
        begin = load_int(sources.fan, ctx.base + v)
        for c in range(begin + ctx.lane, load_int(sources.fan, ctx.base + v + 1), ctx.lane_step):
            bit = wp.min(c - begin, LAST_TRIANGLE_BIT)
            ranks = load_ranks(sources.bounds, c)
            if ((any_a >> bit) & 1) != 0:
                set_bits(front.pending, ctx.row + corner_a(sources.corners, c), 1 << (ranks & 255))
            if ((any_b >> bit) & 1) != 0:
                set_bits(front.pending, ctx.row + corner_b(sources.corners, c), 1 << (ranks >> 8))


@wp.func
def scan_buckets(front: Front, b: int, thread: int):
    """Replace the number of vertices in each bucket by the bucket's start (exclusive scan)."""
    block_sync()
    if thread == 0:
        total = int(0)
        for bucket in range(N_BUCKETS):
            n = front.bucket_count[b, bucket]
            front.bucket_count[b, bucket] = total
            total += n
    block_sync()
