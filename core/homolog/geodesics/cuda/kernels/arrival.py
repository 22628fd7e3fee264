"""Arrival directions of a batch of clusters on CUDA (see `homolog.geodesics.kernels.second_order`)."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.cuda.kernels.block import (
    N_BUCKETS,
    Front,
    Sources,
    ThreadContext,
    block_sync,
    half_warp_or,
    scan_buckets,
    thread_context,
)
from homolog.geodesics.kernels.local_solver import UNREACHED, path_lower_bound
from homolog.geodesics.kernels.memory import (
    corner_a,
    corner_b,
    load,
    load_corner,
    load_int,
    load_int_2d,
    store,
    store_word,
)
from homolog.geodesics.kernels.second_order import (
    CANDIDATE_TOLERANCE,
    CornerAngles,
    angle_between,
    arrival_confidence,
    blend_weight,
    find_path,
    initial_correction,
    wrap_angle,
)

wp.set_module_options({"enable_backward": False, "max_unroll": 8, "fast_math": True})

MAX_STENCILS = wp.constant(6)
"""Stencils cached for a vertex in one lane, each with the index of its corner in the fan. Most vertices have
one or two."""
NO_STENCIL = wp.constant(32767)
"""In place of a corner index: no path arrives here, as at a source."""
STENCIL_OVERFLOW = wp.constant(32766)
"""In place of a corner index: there are more candidates than cached stencils."""
StencilWords = wp.types.vector(length=6, dtype=wp.uint32)


@wp.struct
class FrontCorrections:
    """Second-order state of a batch of clusters, in addition to `Front`; P is the capacity of a patch."""

    arrival: wp.array3d(dtype=wp.float32)  # (B, V, L)
    confidence: wp.array3d(dtype=wp.float32)  # (B, V, L) in arrivals
    correction: wp.array3d(dtype=wp.float32)  # (B, V, L)
    # Stencils by position in `order`, in which they are read: (B, P, MAX_STENCILS * L).
    stencil_offset: wp.array3d(dtype=wp.float32)
    stencil_word: wp.array3d(dtype=wp.uint32)  # weight and corner index, packed
    order: wp.array2d(dtype=wp.int32)  # (B, P) vertices in range, near to far
    n_reached: wp.array(dtype=wp.int32)  # (B,) how many


@wp.kernel
def sort_reached(front: Front, corrections: FrontCorrections, sources: Sources, offset: int, threads: int):
    """List the vertices within range of any source, near to far; thread (cluster, thread of the block)."""
    b, thread = wp.tid()
    limits = sources.limits[sources.shape[offset + b]]
    limit = limits.propagation_limit
    scale = 0.9999 * float(N_BUCKETS) / limit
    ctx = thread_context(front, sources, b, offset, thread, threads)
    for bucket in range(thread, N_BUCKETS, threads):
        front.bucket_count[b, bucket] = 0
    block_sync()
    size = front.size[b]
    # The same number of iterations in all threads.
    for k in range(ctx.vertex_slot, size + ctx.vertex_slot, ctx.vertex_stride):
        v = front.patch[b, wp.min(k, size - 1)]
        in_reach = int(0)
        for lane in range(ctx.lane, ctx.lanes, ctx.lane_step):
            in_reach = in_reach | wp.where(load(front.u, ctx.origin + v * ctx.lanes + lane) <= limit, 1, 0)
        in_reach = half_warp_or(in_reach)
        for lane in range(ctx.lane, ctx.lanes, ctx.lane_step):
            at = ctx.origin + v * ctx.lanes + lane
            if in_reach == 0:  # `find_arrivals` sets the others
                store(corrections.correction, at, 0.0)
                store(corrections.confidence, at, 0.0)
                store(corrections.arrival, at, 0.0)
        if ctx.lane == 0 and k < size:
            front.pending[b, v] = in_reach
            if in_reach != 0:
                wp.atomic_add(front.bucket_count, b, int(wp.min(front.u[b, v, 0], limit) * scale), 1)
    scan_buckets(front, b, thread)
    for k in range(thread, front.size[b], threads):
        v = front.patch[b, k]
        if front.pending[b, v] != 0:
            bucket = int(wp.min(front.u[b, v, 0], limit) * scale)
            corrections.order[b, wp.atomic_add(front.bucket_count, b, bucket, 1)] = v
    block_sync()
    corrections.n_reached[b] = front.bucket_count[b, N_BUCKETS - 1]


@wp.func
def find_arrival(
    front: Front,
    corrections: FrontCorrections,
    sources: Sources,
    angles: wp.array(dtype=CornerAngles),
    ctx: ThreadContext,
    edge: float,
    item: int,
    v: int,
    lane: int,
):
    """Find the arrival direction at a vertex in one lane, and the corners of its candidate paths."""
    b = ctx.cluster
    u = load(front.u, ctx.origin + v * ctx.lanes + lane)
    shortest = float(UNREACHED)
    first = float(0.0)
    total = float(0.0)
    mean = float(0.0)
    square = float(0.0)
    along_b = int(0)
    candidates = StencilWords(wp.uint32(NO_STENCIL))
    begin = load_int(sources.fan, ctx.base + v)
    last = load_int(sources.fan, ctx.base + v + 1) - 1
    cone_angle = angles[begin].cone_angle_c
    origin = ctx.origin + lane
    da = load(front.u, origin + corner_a(sources.corners, begin) * ctx.lanes)
    db = load(front.u, origin + corner_b(sources.corners, begin) * ctx.lanes)  # the next corner's a
    for c in range(begin, last + 1):
        ahead = load(front.u, origin + corner_b(sources.corners, wp.min(c + 1, last)) * ctx.lanes)
        corner = load_corner(sources.corners, c)
        if path_lower_bound(corner, da, db) < u + CANDIDATE_TOLERANCE * edge:
            path = find_path(corner, angles[c], da, db, edge)
            shortest = wp.min(shortest, path.distance)
            weight = path.weight * blend_weight(path.distance, u, edge)
            first = wp.where(total == 0.0, path.arrival, first)
            deviation = angle_between(first, path.arrival, cone_angle)
            total += weight
            mean += weight * deviation
            square += weight * (deviation * deviation + path.degenerate)
            # A path along ac that the previous corner has as its bc counts once.
            if path.distance - u < CANDIDATE_TOLERANCE * edge and path.along_a * along_b == 0:
                overflow = (
                    candidates[MAX_STENCILS - 1] != wp.uint32(NO_STENCIL) or c - begin >= STENCIL_OVERFLOW
                )
                for k in range(MAX_STENCILS - 1):
                    candidates[MAX_STENCILS - 1 - k] = candidates[MAX_STENCILS - 2 - k]
                candidates[0] = wp.uint32(wp.where(overflow, STENCIL_OVERFLOW, c - begin))
            along_b = path.along_b
        else:
            along_b = 0
        da = db
        db = ahead
    mean = mean / wp.max(total, 1.0e-30)
    at = ctx.origin + v * ctx.lanes + lane
    store(corrections.correction, at, initial_correction(load(sources.shortest_side, ctx.base + v), edge))
    store(corrections.arrival, at, wrap_angle(first + mean, cone_angle))
    has_path = total > 0.0 and shortest - u < CANDIDATE_TOLERANCE * edge  # else a source
    store(
        corrections.confidence,
        at,
        wp.where(has_path, arrival_confidence(square / wp.max(total, 1.0e-30), mean), 0.0),
    )
    if u == 0.0:
        candidates = StencilWords(wp.uint32(NO_STENCIL))
    first_word = (b * corrections.stencil_word.shape[1] + item) * MAX_STENCILS * ctx.lanes + lane
    for k in range(MAX_STENCILS):
        # Two words are always read, further ones up to the first NO_STENCIL.
        if k < 2 or candidates[wp.max(k - 1, 0)] != wp.uint32(NO_STENCIL):
            store_word(corrections.stencil_word, first_word + k * ctx.lanes, candidates[k])


@wp.kernel
def find_arrivals(
    front: Front,
    corrections: FrontCorrections,
    sources: Sources,
    angles: wp.array(dtype=CornerAngles),
    offset: int,
    threads: int,
):
    """Find the arrival directions at each cluster's vertices; thread (cluster, thread of the block)."""
    b, thread = wp.tid()
    ctx = thread_context(front, sources, b, offset, thread, threads)
    edge = sources.limits[sources.shape[offset + b]].mean_edge
    last = corrections.n_reached[b] - 1
    order_row = b * corrections.order.shape[1]
    next_v = load_int_2d(corrections.order, order_row + wp.min(ctx.vertex_slot, last))
    for k in range(ctx.vertex_slot, last + 1, ctx.vertex_stride):
        v = next_v
        next_v = load_int_2d(corrections.order, order_row + wp.min(k + ctx.vertex_stride, last))
        for lane in range(ctx.lane, ctx.lanes, ctx.lane_step):
            find_arrival(front, corrections, sources, angles, ctx, edge, k, v, lane)
