"""The fast iterative method, one thread block a cluster: for CUDA, and for single fields on a CPU.

Blocks are independent (`homolog.geodesics.cuda.kernels.block`): no cluster waits for another. As in
`homolog.geodesics.cpu.kernels.sweep` a patch is processed in bands, near to far; each band converges before
the next one starts.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.cuda.kernels.block import (
    ALL_TRIANGLES,
    BAND_SIZE,
    BLOCK_DIM,
    LAST_TRIANGLE_BIT,
    N_BUCKETS,
    Front,
    Sources,
    ThreadContext,
    active_item,
    affected_triangles,
    block_sync,
    compact_active,
    count_trailing_zeros,
    mark_neighbours,
    memory_fence,
    pending_of,
    scan_buckets,
    thread_context,
    warp_sync,
)
from homolog.geodesics.kernels.local_solver import (
    DECREASE_TOLERANCE,
    UNREACHED,
    Corner,
    DistanceLimits,
    edge_path,
    path_lower_bound,
    straight_path_squared,
)
from homolog.geodesics.kernels.memory import (
    corner_a,
    corner_b,
    load,
    load_corner,
    load_int,
    load_int_2d,
    store,
)

wp.set_module_options({"enable_backward": False, "max_unroll": 8, "fast_math": True})


@wp.func
def bounding_ball(sources: Sources, cluster: int) -> wp.vec4:
    """Return the centre of a cluster and the radius of the ball that contains its patch."""
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
    limits = sources.limits[shape]
    return wp.vec4(centre[0], centre[1], centre[2], radius + limits.propagation_limit)


@wp.kernel
def count_patch_vertices(sources: Sources, halo: float, threads: int, size: wp.array(dtype=wp.int32)):
    """Count the vertices in each cluster's patch and its halo; thread (cluster, thread of the block)."""
    cluster, thread = wp.tid()
    shape = sources.shape[cluster]
    ball = bounding_ball(sources, cluster)
    n = int(0)
    for v in range(sources.first[shape] + thread, sources.first[shape + 1], threads):
        if wp.length(sources.position[v] - wp.vec3(ball[0], ball[1], ball[2])) <= ball[3] + halo:
            n += 1
    wp.atomic_add(size, cluster, n)


@wp.func
def bucket_of(distance: float, radius: float) -> int:
    """Return the bucket of a vertex; the last one holds the halo."""
    return wp.where(distance <= radius, int(0.9999 * float(N_BUCKETS - 1) * distance / radius), N_BUCKETS - 1)


@wp.kernel
def build_patches(front: Front, sources: Sources, offset: int, halo: float, threads: int):
    """List each cluster's patch, near to far, and set its sources; thread (cluster, thread of the block).

    Distances are reset in the patch and in a halo around it, as far as they are read.
    """
    b, thread = wp.tid()
    shape = sources.shape[offset + b]
    base = sources.first[shape]
    ctx = thread_context(front, sources, b, offset, thread, threads)
    ball = bounding_ball(sources, offset + b)
    centre = wp.vec3(ball[0], ball[1], ball[2])
    radius = ball[3]
    for bucket in range(thread, N_BUCKETS, threads):
        front.bucket_count[b, bucket] = 0
    block_sync()
    n = sources.first[shape + 1] - base
    for v in range(thread, n, threads):
        front.pending[b, v] = 0
        distance = wp.length(sources.position[base + v] - centre)
        if distance <= radius + halo:
            wp.atomic_add(front.bucket_count, b, bucket_of(distance, radius), 1)
    scan_buckets(front, b, thread)
    front.size[b] = front.bucket_count[b, N_BUCKETS - 1]
    block_sync()
    for v in range(thread, n, threads):
        distance = wp.length(sources.position[base + v] - centre)
        if distance <= radius + halo:
            front.patch[b, wp.atomic_add(front.bucket_count, b, bucket_of(distance, radius), 1)] = v
    block_sync()
    for k in range(ctx.vertex_slot, front.bucket_count[b, N_BUCKETS - 1], ctx.vertex_stride):
        row = ctx.origin + front.patch[b, k] * ctx.lanes
        for lane in range(ctx.lane, ctx.lanes, ctx.lane_step):
            store(front.u, row + lane, UNREACHED)
    block_sync()
    for lane in range(thread, ctx.lanes, threads):
        m = sources.members[offset + b, lane]
        if m >= 0:
            front.u[b, m, lane] = 0.0
            for k in range(sources.fan[base + m], sources.fan[base + m + 1]):
                front.pending[b, sources.corners[k].a] = ALL_TRIANGLES


@wp.func
def triangle_update(corner: Corner, da: float, db: float, best: float) -> float:
    """Return the shorter of the best known distance and that through a triangle."""
    best = wp.min(best, edge_path(corner, da, db))
    if path_lower_bound(corner, da, db) < best:
        best = wp.min(best, wp.sqrt(straight_path_squared(corner, da, db)))
    return best


@wp.func
def relax_vertex(
    front: Front,
    sources: Sources,
    ctx: ThreadContext,
    limits: DistanceLimits,
    v: int,
    lane: int,
    pending_triangles: int,
) -> wp.vec2i:
    """Update a vertex's distance in one lane from its pending triangles.

    Returns the triangles that its decrease affects (see `affected_triangles`).
    """
    origin = ctx.origin + lane
    old = load(front.u, origin + v * ctx.lanes)
    begin = load_int(sources.fan, ctx.base + v)
    last = load_int(sources.fan, ctx.base + v + 1) - 1
    remaining = pending_triangles & (
        ALL_TRIANGLES >> (LAST_TRIANGLE_BIT - wp.min(last - begin, LAST_TRIANGLE_BIT))
    )
    best = old
    c = begin + count_trailing_zeros(remaining)
    da = load(front.u, origin + corner_a(sources.corners, c) * ctx.lanes)
    db = load(front.u, origin + corner_b(sources.corners, c) * ctx.lanes)
    while remaining != 0:
        remaining = remaining & (remaining - 1)
        next_c = wp.where(remaining != 0, begin + count_trailing_zeros(remaining), c)
        next_a = load(front.u, origin + corner_a(sources.corners, next_c) * ctx.lanes)
        next_b = load(front.u, origin + corner_b(sources.corners, next_c) * ctx.lanes)
        best = triangle_update(load_corner(sources.corners, c), da, db, best)
        c = next_c
        da = next_a
        db = next_b
    if ((pending_triangles >> LAST_TRIANGLE_BIT) & 1) != 0:  # stands for all later triangles too
        for k in range(begin + LAST_TRIANGLE_BIT + 1, last + 1):
            da = load(front.u, origin + corner_a(sources.corners, k) * ctx.lanes)
            db = load(front.u, origin + corner_b(sources.corners, k) * ctx.lanes)
            best = triangle_update(load_corner(sources.corners, k), da, db, best)
    if DECREASE_TOLERANCE * best < old:
        store(front.u, origin + v * ctx.lanes, best)
        memory_fence()
        if best <= limits.propagation_limit:
            return affected_triangles(front, sources, ctx, v, lane, best, 0.0)
    return wp.vec2i(0, 0)


@wp.kernel(launch_bounds=(BLOCK_DIM, 4))
def advance_front(front: Front, sources: Sources, offset: int, threads: int):
    """Lower each cluster's distances until no vertex is active; thread (cluster, thread of the block)."""
    b, thread = wp.tid()
    ctx = thread_context(front, sources, b, offset, thread, threads)
    limits = sources.limits[sources.shape[offset + b]]
    size = front.size[b]
    order_row = b * front.patch.shape[1]
    changed = int(1)
    while changed != 0:
        changed = int(0)
        for first in range(0, size, BAND_SIZE):
            n = int(1)
            while n != 0:
                n = compact_active(front, front.patch, b, first, wp.min(first + BAND_SIZE, size))
                changed = wp.max(changed, n)
                next_v = load_int_2d(front.patch, order_row + active_item(front, b, ctx.vertex_slot, n))
                done = int(0)
                while done < n:  # the same number of iterations in all threads
                    v = next_v
                    pending_triangles = pending_of(front, b, done + ctx.vertex_slot, n)
                    next_v = load_int_2d(
                        front.patch,
                        order_row + active_item(front, b, done + ctx.vertex_slot + ctx.vertex_stride, n),
                    )
                    affected = wp.vec2i(0, 0)
                    lane = ctx.lane
                    while lane < ctx.lanes:
                        own = relax_vertex(front, sources, ctx, limits, v, lane, pending_triangles)
                        affected = wp.vec2i(affected[0] | own[0], affected[1] | own[1])
                        lane += ctx.lane_step
                    warp_sync()
                    mark_neighbours(front, sources, ctx, v, affected)
                    done += ctx.vertex_stride
                    warp_sync()
                block_sync()
