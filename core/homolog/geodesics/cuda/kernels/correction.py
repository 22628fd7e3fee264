"""Second-order corrections of a batch of clusters on CUDA (see `homolog.geodesics.kernels.second_order`).

Corrections depend on those of nearer vertices. Each cluster's vertices in range are therefore processed near
to far, in bands that converge one after another. Most vertices have one to three candidate corners, whose
update stencils are cached with weight and corner packed into one word. Vertices with more candidates than
cached stencils recompute theirs in each update.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.cuda.kernels.arrival import (
    MAX_STENCILS,
    NO_STENCIL,
    STENCIL_OVERFLOW,
    FrontCorrections,
)
from homolog.geodesics.cuda.kernels.block import (
    BLOCK_DIM,
    CORRECTION_BAND_SIZE,
    Front,
    Sources,
    ThreadContext,
    active_item,
    affected_triangles,
    block_sync,
    compact_active,
    mark_neighbours,
    thread_context,
    warp_sync,
)
from homolog.geodesics.kernels.local_solver import UNREACHED, Corner, path_lower_bound
from homolog.geodesics.kernels.memory import (
    corner_a,
    corner_b,
    load,
    load_corner,
    load_int,
    load_int_2d,
    load_word,
    prefetch,
    prefetch_word,
    store,
    store_word,
)
from homolog.geodesics.kernels.second_order import (
    CANDIDATE_TOLERANCE,
    MAX_ROUNDS,
    CornerAngles,
    UpdateStencil,
    corner_stencil,
    correction_step,
    has_changed,
)

wp.set_module_options({"enable_backward": False, "max_unroll": 8, "fast_math": True})

WEIGHT_SCALE = wp.constant(65535)
"""A weight of 1 in the upper half of a stencil's word; the lower half is the corner's index in the fan."""
HAS_NEXT = wp.constant(32768)
"""Flag in the lower half, from the second word on: another stencil follows."""


@wp.func
def compute_stencil(
    front: Front,
    corrections: FrontCorrections,
    sources: Sources,
    angles: wp.array(dtype=CornerAngles),
    ctx: ThreadContext,
    c: int,
    u: float,
    edge: float,
    lane: int,
) -> UpdateStencil:
    """Return the stencil of one corner in one lane."""
    corner = load_corner(sources.corners, c)
    a = ctx.origin + corner.a * ctx.lanes + lane
    b = ctx.origin + corner.b * ctx.lanes + lane
    return corner_stencil(
        corner,
        angles[c],
        load(front.u, a),
        load(front.u, b),
        load(corrections.arrival, a),
        load(corrections.arrival, b),
        load(corrections.confidence, a),
        load(corrections.confidence, b),
        u,
        edge,
    )


@wp.func
def interpolate(corrections: FrontCorrections, corner: Corner, b: int, lane: int, weight_b: float) -> float:
    """Interpolate the correction along a corner's edge ab."""
    of_a = corrections.correction[b, corner.a, lane]
    return of_a + weight_b * (corrections.correction[b, corner.b, lane] - of_a)


@wp.func
def recompute_correction(
    front: Front,
    corrections: FrontCorrections,
    sources: Sources,
    angles: wp.array(dtype=CornerAngles),
    ctx: ThreadContext,
    edge: float,
    v: int,
    lane: int,
) -> float:
    """Return the correction of a vertex in one lane, without its cached stencils."""
    b = ctx.cluster
    best = float(UNREACHED)
    u = front.u[b, v, lane]
    for c in range(sources.fan[ctx.base + v], sources.fan[ctx.base + v + 1]):
        corner = sources.corners[c]
        da = front.u[b, corner.a, lane]
        db = front.u[b, corner.b, lane]
        if path_lower_bound(corner, da, db) < u + CANDIDATE_TOLERANCE * edge:
            stencil = compute_stencil(front, corrections, sources, angles, ctx, c, u, edge, lane)
            best = wp.min(best, stencil.offset + interpolate(corrections, corner, b, lane, stencil.weight_b))
    return best


@wp.func
def apply_stencil(
    corrections: FrontCorrections,
    sources: Sources,
    ctx: ThreadContext,
    begin: int,
    lane: int,
    word: wp.uint32,
    stencil_offset: float,
) -> float:
    """Return the correction that a cached stencil gives; UNREACHED without one."""
    corner = int(word & wp.uint32(NO_STENCIL))  # masks HAS_NEXT
    is_stencil = corner < STENCIL_OVERFLOW
    c = begin + wp.where(is_stencil, corner, 0)
    of_a = load(corrections.correction, ctx.origin + corner_a(sources.corners, c) * ctx.lanes + lane)
    of_b = load(corrections.correction, ctx.origin + corner_b(sources.corners, c) * ctx.lanes + lane)
    weight_b = float(word >> wp.uint32(16)) * (1.0 / float(WEIGHT_SCALE))
    return wp.where(is_stencil, stencil_offset + of_a + weight_b * (of_b - of_a), UNREACHED)


@wp.func
def prefetch_stencils(corrections: FrontCorrections, ctx: ThreadContext, item: int):
    """Prefetch the first two stencils of the vertex at a position."""
    first = (ctx.cluster * corrections.stencil_word.shape[1] + item) * MAX_STENCILS * ctx.lanes + ctx.lane
    prefetch_word(corrections.stencil_word, first)
    prefetch_word(corrections.stencil_word, first + ctx.lanes)
    prefetch(corrections.stencil_offset, first)
    prefetch(corrections.stencil_offset, first + ctx.lanes)


@wp.func
def update_correction(
    front: Front,
    corrections: FrontCorrections,
    sources: Sources,
    angles: wp.array(dtype=CornerAngles),
    ctx: ThreadContext,
    edge: float,
    item: int,
    v: int,
    lane: int,
) -> wp.vec2i:
    """Update a vertex's correction in one lane.

    Returns the triangles that its change affects (see `affected_triangles`).
    """
    begin = load_int(sources.fan, ctx.base + v)
    at = ctx.origin + v * ctx.lanes + lane
    old = load(corrections.correction, at)
    first = (ctx.cluster * corrections.stencil_word.shape[1] + item) * MAX_STENCILS * ctx.lanes + lane
    # Nearly all vertices have one or two stencils: both are loaded together.
    second = first + ctx.lanes
    word = load_word(corrections.stencil_word, first)
    last = load_word(corrections.stencil_word, second)
    stencil_offset = load(corrections.stencil_offset, first)
    last_offset = load(corrections.stencil_offset, second)
    first_value = apply_stencil(corrections, sources, ctx, begin, lane, word, stencil_offset)
    second_value = apply_stencil(corrections, sources, ctx, begin, lane, last, last_offset)
    correction = wp.min(first_value, second_value)
    k = int(2)
    while (last & wp.uint32(HAS_NEXT)) != wp.uint32(0):
        last = load_word(corrections.stencil_word, first + k * ctx.lanes)
        stencil_offset = load(corrections.stencil_offset, first + k * ctx.lanes)
        correction = wp.min(
            correction, apply_stencil(corrections, sources, ctx, begin, lane, last, stencil_offset)
        )
        k += 1
    if word == wp.uint32(STENCIL_OVERFLOW):
        correction = recompute_correction(front, corrections, sources, angles, ctx, edge, v, lane)
    if correction > 0.5 * UNREACHED:  # a source, or out of range
        correction = 0.0
    store(corrections.correction, at, correction)
    if has_changed(old, correction, correction_step(load(sources.shortest_side, ctx.base + v), edge)):
        return affected_triangles(
            front, sources, ctx, v, lane, load(front.u, at), 1.01 * CANDIDATE_TOLERANCE * edge
        )
    return wp.vec2i(0, 0)


@wp.func
def cache_stencils(
    front: Front,
    corrections: FrontCorrections,
    sources: Sources,
    angles: wp.array(dtype=CornerAngles),
    ctx: ThreadContext,
    edge: float,
    first: int,
    end: int,
):
    """Compute and cache the stencils of a cluster's vertices at positions first … end."""
    order_row = ctx.cluster * corrections.order.shape[1]
    next_v = load_int_2d(corrections.order, order_row + wp.min(first + ctx.vertex_slot, end - 1))
    for k in range(first + ctx.vertex_slot, end, ctx.vertex_stride):
        v = next_v
        next_v = load_int_2d(corrections.order, order_row + wp.min(k + ctx.vertex_stride, end - 1))
        begin = load_int(sources.fan, ctx.base + v)
        prefetch_word(
            corrections.stencil_word,
            (order_row + wp.min(k + ctx.vertex_stride, end - 1)) * MAX_STENCILS * ctx.lanes + ctx.lane,
        )
        for lane in range(ctx.lane, ctx.lanes, ctx.lane_step):
            u = load(front.u, ctx.origin + v * ctx.lanes + lane)
            n = int(0)
            at = (order_row + k) * MAX_STENCILS * ctx.lanes + lane
            item = int(load_word(corrections.stencil_word, at))
            while item < STENCIL_OVERFLOW:
                n += 1
                next_item = int(NO_STENCIL)
                if n < MAX_STENCILS:
                    next_item = int(load_word(corrections.stencil_word, at + ctx.lanes))
                stencil = compute_stencil(
                    front, corrections, sources, angles, ctx, begin + item, u, edge, lane
                )
                weight_b = wp.uint32(stencil.weight_b * float(WEIGHT_SCALE) + 0.5)
                has_next = wp.uint32(wp.where(n > 1 and next_item != NO_STENCIL, HAS_NEXT, 0))
                store(corrections.stencil_offset, at, stencil.offset)
                store_word(
                    corrections.stencil_word, at, wp.uint32(item) | has_next | (weight_b << wp.uint32(16))
                )
                item = next_item
                at += ctx.lanes


@wp.kernel(launch_bounds=(BLOCK_DIM, 4))
def relax_corrections(
    front: Front,
    corrections: FrontCorrections,
    sources: Sources,
    angles: wp.array(dtype=CornerAngles),
    offset: int,
    threads: int,
):
    """Iterate the corrections to convergence and add them; thread (cluster, thread of the block).

    The stencils of a band are computed when it is first processed, so that they are still in cache.
    """
    b, thread = wp.tid()
    ctx = thread_context(front, sources, b, offset, thread, threads)
    edge = sources.limits[sources.shape[offset + b]].mean_edge
    n_reached = corrections.n_reached[b]
    order_row = b * corrections.order.shape[1]
    rounds = int(0)
    changed = int(1)
    while changed != 0 and rounds < MAX_ROUNDS:
        rounds += 1
        changed = int(0)
        for first in range(0, n_reached, CORRECTION_BAND_SIZE):
            end = wp.min(first + CORRECTION_BAND_SIZE, n_reached)
            if rounds == 1:
                cache_stencils(front, corrections, sources, angles, ctx, edge, first, end)
                block_sync()
            passes = int(0)
            n = int(1)
            while n != 0 and passes < MAX_ROUNDS:
                passes += 1
                n = compact_active(front, corrections.order, b, first, end)
                changed = wp.max(changed, n)
                next_active = active_item(front, b, ctx.vertex_slot, n)
                next_v = load_int_2d(corrections.order, order_row + next_active)
                done = int(0)
                while done < n:  # the same number of iterations in all threads
                    item = next_active
                    v = next_v
                    next_active = active_item(front, b, done + ctx.vertex_slot + ctx.vertex_stride, n)
                    next_v = load_int_2d(corrections.order, order_row + next_active)
                    affected = wp.vec2i(0, 0)
                    prefetch_stencils(corrections, ctx, next_active)
                    lane = wp.where(done + ctx.vertex_slot < n, ctx.lane, ctx.lanes)
                    while lane < ctx.lanes:
                        own = update_correction(front, corrections, sources, angles, ctx, edge, item, v, lane)
                        affected = wp.vec2i(affected[0] | own[0], affected[1] | own[1])
                        lane += ctx.lane_step
                    warp_sync()
                    mark_neighbours(front, sources, ctx, v, affected)
                    done += ctx.vertex_stride
                    warp_sync()
                block_sync()
    next_v = load_int_2d(corrections.order, order_row + wp.min(ctx.vertex_slot, n_reached - 1))
    for k in range(ctx.vertex_slot, n_reached, ctx.vertex_stride):
        at = ctx.origin + next_v * ctx.lanes
        next_v = load_int_2d(corrections.order, order_row + wp.min(k + ctx.vertex_stride, n_reached - 1))
        prefetch(front.u, ctx.origin + next_v * ctx.lanes + ctx.lane)
        for lane in range(ctx.lane, ctx.lanes, ctx.lane_step):
            store(front.u, at + lane, load(front.u, at + lane) + load(corrections.correction, at + lane))
