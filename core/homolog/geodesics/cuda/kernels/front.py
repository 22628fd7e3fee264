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
    block_sync,
    compact_active,
    memory_fence,
    scan_buckets,
)
from homolog.geodesics.kernels.fans import Fans
from homolog.geodesics.kernels.local_solver import (
    DECREASE_TOLERANCE,
    DistanceLimits,
    corner_b,
    path_lower_bound,
    straight_path_squared,
)
from homolog.geodesics.kernels.memory import load, load_int, load_int_2d, store

wp.set_module_options({"enable_backward": False, "max_unroll": 8, "fast_math": True})


@wp.kernel
def build_patches(front: Front, sources: Sources, offset: int, threads: int):
    """List each cluster's patch, near to far, and set its sources; thread (cluster, thread of the block).

    All distances are UNREACHED before, and no vertex is active.
    """
    b, thread = wp.tid()
    shape = sources.shape[offset + b]
    base = sources.first[shape]
    n = sources.first[shape + 1] - base
    centre = sources.groups.centre[offset + b]
    radius = sources.groups.radius[offset + b] + sources.limits[shape].propagation_limit
    scale = 0.9999 * float(N_BUCKETS) / radius
    for bucket in range(thread, N_BUCKETS, threads):
        front.bucket_count[b, bucket] = 0
    block_sync()
    for v in range(thread, n, threads):
        distance = wp.length(sources.fans.position[base + v] - centre)
        if distance <= radius:
            wp.atomic_add(front.bucket_count, b, int(scale * distance), 1)
    scan_buckets(front, b, thread)
    for v in range(thread, n, threads):
        distance = wp.length(sources.fans.position[base + v] - centre)
        if distance <= radius:
            front.patch[b, wp.atomic_add(front.bucket_count, b, int(scale * distance), 1)] = v
    block_sync()
    front.size[b] = front.bucket_count[b, N_BUCKETS - 1]
    for lane in range(thread, front.u.shape[2], threads):
        m = sources.groups.members[offset + b, lane]
        if m >= 0:
            front.u[b, m, lane] = 0.0
            for k in range(sources.fans.start[base + m], sources.fans.start[base + m + 1]):
                front.active[b, sources.fans.corners[k].b] = 1


@wp.func_native("flags.data[index] = 1;")
def set_flag(flags: wp.array2d(dtype=wp.int32), index: int):
    """Set a flag by its linear index; threads may set the same one."""
    ...


@wp.func
def relax_vertex(front: Front, fans: Fans, limits: DistanceLimits, base: int, row: int, v: int, lane: int):
    """Update a vertex in one lane; if it decreases, activate the neighbours that may follow.

    `base` is the first vertex of the shape, `row` that of the cluster in arrays by cluster and vertex. Two
    neighbours may decrease at the same time. Each writes its distance before it reads the other's, with a
    memory fence between, so that at least one of them sees the other's new distance.
    """
    lanes = front.u.shape[2]
    origin = row * lanes + lane
    old = load(front.u, origin + v * lanes)
    begin = load_int(fans.start, base + v)
    end = load_int(fans.start, base + v + 1)
    best = old
    da = load(front.u, origin + corner_b(fans.corners, end - 1) * lanes)
    for c in range(begin, end):
        corner = fans.corners[c]
        db = load(front.u, origin + corner.b * lanes)
        best = wp.min(best, db + corner.bc)
        if path_lower_bound(corner, da, db) < best:
            best = wp.min(best, wp.sqrt(straight_path_squared(corner, da, db)))
        da = db  # the next triangle's
    if DECREASE_TOLERANCE * best < old:
        store(front.u, origin + v * lanes, best)
        memory_fence()
        if best <= limits.propagation_limit:
            for c in range(begin, end):
                b = corner_b(fans.corners, c)
                if load(front.u, origin + b * lanes) > best - fans.margin[c]:
                    set_flag(front.active, row + b)


@wp.kernel(launch_bounds=(BLOCK_DIM, 4))
def advance_front(front: Front, sources: Sources, offset: int, threads: int):
    """Lower each cluster's distances until no vertex is active; thread (cluster, thread of the block).

    Neighbouring threads take neighbouring lanes of one vertex.
    """
    b, thread = wp.tid()
    shape = sources.shape[offset + b]
    limits = sources.limits[shape]
    base = sources.first[shape]
    row = b * front.u.shape[1]
    size = front.size[b]
    lanes = front.u.shape[2]
    lane_step = wp.min(threads, lanes)
    changed = int(1)
    while changed != 0:
        changed = int(0)
        for first in range(0, size, BAND_SIZE):
            n = int(1)
            while n != 0:
                n = compact_active(front, b, first, wp.min(first + BAND_SIZE, size))
                changed = wp.max(changed, n)
                for k in range(thread // lane_step, n, threads // lane_step):
                    v = load_int_2d(front.active_vertex, b * BAND_SIZE + k)
                    for lane in range(thread % lane_step, lanes, lane_step):
                        relax_vertex(front, sources.fans, limits, base, row, v, lane)
                block_sync()
