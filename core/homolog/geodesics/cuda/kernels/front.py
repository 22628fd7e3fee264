"""The fast iterative method, one thread block a cluster: for CUDA, and for single fields on a CPU.

Blocks are independent (`homolog.geodesics.cuda.kernels.block`): no cluster waits for another. As in
`homolog.geodesics.cpu.kernels.sweep` a patch is processed in bands, near to far; each band converges before
the next one starts.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.cuda.kernels.block import (
    BAND_SIZE,
    BLOCK_DIM,
    N_BUCKETS,
    Front,
    Sources,
    ThreadContext,
    block_sync,
    compact_active,
    memory_fence,
    scan_buckets,
    thread_context,
)
from homolog.geodesics.kernels.local_solver import (
    DECREASE_TOLERANCE,
    DistanceLimits,
    corner_b,
    path_lower_bound,
    straight_path_squared,
)
from homolog.geodesics.kernels.memory import load, load_int, load_int_2d, store

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
def build_patches(front: Front, sources: Sources, offset: int, threads: int):
    """List each cluster's patch, near to far, and set its sources; thread (cluster, thread of the block).

    All distances are UNREACHED before, and no vertex is active.
    """
    b, thread = wp.tid()
    shape = sources.shape[offset + b]
    base = sources.first[shape]
    n = sources.first[shape + 1] - base
    ball = bounding_ball(sources, offset + b)
    centre = wp.vec3(ball[0], ball[1], ball[2])
    scale = 0.9999 * float(N_BUCKETS) / ball[3]
    for bucket in range(thread, N_BUCKETS, threads):
        front.bucket_count[b, bucket] = 0
    block_sync()
    for v in range(thread, n, threads):
        distance = wp.length(sources.position[base + v] - centre)
        if distance <= ball[3]:
            wp.atomic_add(front.bucket_count, b, int(scale * distance), 1)
    scan_buckets(front, b, thread)
    for v in range(thread, n, threads):
        distance = wp.length(sources.position[base + v] - centre)
        if distance <= ball[3]:
            front.patch[b, wp.atomic_add(front.bucket_count, b, int(scale * distance), 1)] = v
    block_sync()
    front.size[b] = front.bucket_count[b, N_BUCKETS - 1]
    for lane in range(thread, front.u.shape[2], threads):
        m = sources.members[offset + b, lane]
        if m >= 0:
            front.u[b, m, lane] = 0.0
            for k in range(sources.fan[base + m], sources.fan[base + m + 1]):
                front.active[b, sources.corners[k].b] = 1


@wp.func_native("flags.data[index] = 1;")
def set_flag(flags: wp.array2d(dtype=wp.int32), index: int):
    """Set a flag by its linear index; threads may set the same one."""
    ...


@wp.func
def relax_vertex(
    front: Front, sources: Sources, ctx: ThreadContext, limits: DistanceLimits, v: int, lane: int
):
    """Update a vertex in one lane; if it decreases, activate the neighbours that may follow.

    Two neighbours may decrease at the same time. Each writes its distance before it reads the other's, with a
    memory fence between, so that at least one of them sees the other's new distance.
    """
    origin = ctx.origin + lane
    old = load(front.u, origin + v * ctx.lanes)
    begin = load_int(sources.fan, ctx.base + v)
    end = load_int(sources.fan, ctx.base + v + 1)
    best = old
    da = load(front.u, origin + corner_b(sources.corners, end - 1) * ctx.lanes)
    for c in range(begin, end):
        corner = sources.corners[c]
        db = load(front.u, origin + corner.b * ctx.lanes)
        best = wp.min(best, db + corner.bc)
        if path_lower_bound(corner, da, db) < best:
            best = wp.min(best, wp.sqrt(straight_path_squared(corner, da, db)))
        da = db  # the next triangle's
    if DECREASE_TOLERANCE * best < old:
        store(front.u, origin + v * ctx.lanes, best)
        memory_fence()
        if best <= limits.propagation_limit:
            for c in range(begin, end):
                b = corner_b(sources.corners, c)
                if load(front.u, origin + b * ctx.lanes) > best - sources.margin[c]:
                    set_flag(front.active, ctx.row + b)


@wp.kernel(launch_bounds=(BLOCK_DIM, 4))
def advance_front(front: Front, sources: Sources, offset: int, threads: int):
    """Lower each cluster's distances until no vertex is active; thread (cluster, thread of the block)."""
    b, thread = wp.tid()
    ctx = thread_context(front, sources, b, offset, thread, threads)
    limits = sources.limits[sources.shape[offset + b]]
    size = front.size[b]
    changed = int(1)
    while changed != 0:
        changed = int(0)
        for first in range(0, size, BAND_SIZE):
            n = int(1)
            while n != 0:
                n = compact_active(front, b, first, wp.min(first + BAND_SIZE, size))
                changed = wp.max(changed, n)
                for k in range(ctx.vertex_slot, n, ctx.vertex_stride):
                    v = load_int_2d(front.active_vertex, b * BAND_SIZE + k)
                    for lane in range(ctx.lane, ctx.lanes, ctx.lane_step):
                        relax_vertex(front, sources, ctx, limits, v, lane)
                block_sync()
