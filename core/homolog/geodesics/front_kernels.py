"""The fast iterative method as a front of all clusters at once, one launch a step: for CUDA.

Arrays of a batch of clusters: u (B, V, LANES) distances, queued (B, V) last step that each vertex is listed
for, lists (2, B, V) the vertices of this step and the next, counts (3, B) their numbers. Distances only ever
fall, so that reading a neighbour while it is being lowered is harmless: lowering lists it for the next step.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.kernels import FAR, Corner, Reach, encode, mean_code, plane_front, point_front
from homolog.geodesics.lookup import LANES, MISSING

wp.set_module_options({"enable_backward": False, "max_unroll": 4})

WALKERS = wp.constant(16)
"""Threads that share the vertices of one cluster, for each lane."""


@wp.struct
class Front:
    """The state of a batch of clusters."""

    u: wp.array3d(dtype=wp.float32)
    queued: wp.array2d(dtype=wp.int32)
    lists: wp.array3d(dtype=wp.int32)
    counts: wp.array2d(dtype=wp.int32)
    last: wp.array(dtype=wp.int32)  # (1,) last step that has anything to do


@wp.struct
class Sources:
    """All clusters of a cohort and the meshes that they lie on."""

    members: wp.array2d(dtype=wp.int32)
    shape: wp.array(dtype=wp.int32)
    first: wp.array(dtype=wp.int32)
    reaches: wp.array(dtype=Reach)
    fan: wp.array(dtype=wp.int32)
    corners: wp.array(dtype=Corner)


@wp.func
def enqueue(front: Front, b: int, vertex: int, step: int):
    """List a vertex for a step, once."""
    if front.queued[b, vertex] >= step:  # mostly so: spare the atomic
        return
    if wp.atomic_max(front.queued, b, vertex, step) < step:
        k = wp.atomic_add(front.counts, step % 3, b, 1)
        front.lists[step % 2, b, k] = vertex
        front.last[0] = step


@wp.kernel
def seed_front(front: Front, sources: Sources, offset: int):
    """Set the sources to 0 and list their neighbours for step 1."""
    b, lane = wp.tid()
    cluster = offset + b
    m = sources.members[cluster, lane]
    if m >= 0:
        front.u[b, m, lane] = 0.0
        vertex = sources.first[sources.shape[cluster]] + m
        for k in range(sources.fan[vertex], sources.fan[vertex + 1]):
            enqueue(front, b, sources.corners[k].a, 1)


@wp.kernel
def step_front(front: Front, sources: Sources, offset: int, element: int, step: int):
    """Update the vertices listed for a step; list the neighbours of those that improved for the next."""
    b, walker, lane = wp.tid()
    shape = sources.shape[offset + b]
    reach = sources.reaches[shape]
    base = sources.first[shape]
    if walker == 0 and lane == 0:
        front.counts[(step + 2) % 3, b] = 0  # that of the step before: spent, and the next but one's
    for k in range(walker, front.counts[step % 3, b], WALKERS):
        v = front.lists[step % 2, b, k]
        begin = sources.fan[base + v]
        end = sources.fan[base + v + 1]
        best = float(FAR)
        for c in range(begin, end):
            corner = sources.corners[c]
            da = front.u[b, corner.a, lane]
            db = front.u[b, corner.b, lane]
            if element == 0:
                best = wp.min(best, point_front(corner, da, db))
            else:
                best = wp.min(best, plane_front(corner, da, db))
        if best < front.u[b, v, lane] - reach.changed:
            front.u[b, v, lane] = best
            if best <= reach.stored + reach.slack:
                for c in range(begin, end):
                    enqueue(front, b, sources.corners[c].a, step + 1)


@wp.kernel
def store_front_dense(
    u: wp.array3d(dtype=wp.float32),
    members: wp.array2d(dtype=wp.int32),
    reach: Reach,
    codes: wp.array2d(dtype=wp.uint16),
):
    """Write the rows of some clusters' sources; thread (cluster, lane, vertex)."""
    b, lane, v = wp.tid()
    m = members[b, lane]
    if m >= 0:
        codes[m, v] = encode(u[b, v, lane], reach)


@wp.kernel
def mark_reached(u: wp.array3d(dtype=wp.float32), reach: Reach, reached: wp.array2d(dtype=wp.int32)):
    """Mark the vertices that any source of a cluster reaches; thread (cluster, vertex)."""
    b, v = wp.tid()
    nearest = float(FAR)
    for lane in range(LANES):
        nearest = wp.min(nearest, u[b, v, lane])
    reached[b, v] = wp.where(nearest <= reach.stored, 1, 0)


@wp.kernel
def store_front_blocks(
    u: wp.array3d(dtype=wp.float32),
    reach: Reach,
    upto: wp.array2d(dtype=wp.int32),
    offset: int,
    start: wp.array(dtype=wp.int32),
    row: wp.array2d(dtype=wp.uint16),
    blocks: wp.array2d(dtype=wp.uint16),
):
    """Write the blocks of some clusters; upto counts the reached vertices, running through all of them."""
    b, v = wp.tid()
    n = upto.shape[1]
    before = int(0)
    if b > 0:
        before = upto[b - 1, n - 1]
    if v == 0:
        start[b] = offset + before
    here = upto[b, v]
    previous = before
    if v > 0:
        previous = upto[b, v - 1]
    if here == previous:
        row[b, v] = wp.uint16(MISSING)
    else:
        row[b, v] = wp.uint16(previous - before)
        for lane in range(LANES):
            blocks[previous, lane] = encode(u[b, v, lane], reach)


@wp.kernel
def symmetrize_dense(codes: wp.array2d(dtype=wp.uint16)):
    """Replace both directions of every pair by their mean; threads are (strip, tile, entry of 16 x 16)."""
    strip, tile, k = wp.tid()
    i = 16 * strip + k // 16
    j = 16 * tile + k % 16
    if j < i and i < codes.shape[0]:
        mean = mean_code(int(codes[i, j]), int(codes[j, i]))
        codes[i, j] = mean
        codes[j, i] = mean


@wp.kernel
def symmetrize_blocks(
    members: wp.array2d(dtype=wp.int32),
    slot: wp.array(dtype=wp.int32),
    start: wp.array(dtype=wp.int32),
    row: wp.array2d(dtype=wp.uint16),
    blocks: wp.array2d(dtype=wp.uint16),
):
    """Replace both directions of every pair by their mean; the thread of the later vertex writes both."""
    cluster, v = wp.tid()
    here = int(row[cluster, v])
    if here == MISSING:
        return
    back_cluster = slot[v] // LANES
    back_lane = slot[v] % LANES
    for lane in range(LANES):
        m = members[cluster, lane]
        if m >= 0:
            back = int(row[back_cluster, m])
            k = start[cluster] + here
            if back == MISSING:
                blocks[k, lane] = wp.uint16(MISSING)
            elif m < v:
                back_k = start[back_cluster] + back
                mean = mean_code(int(blocks[k, lane]), int(blocks[back_k, back_lane]))
                blocks[k, lane] = mean
                blocks[back_k, back_lane] = mean
