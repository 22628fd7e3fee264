"""The fast iterative method as a front of all clusters at once, one launch a step: for CUDA.

Arrays of a batch of clusters: u (B, V, QUADS) distances, four lanes an entry; changed (B, V) step in which
each vertex fell last; queued (B, V) last step that it is listed for; lists (2, B, V) the vertices of this
step and the next; counts (3, B) their numbers. Distances only ever fall, so that reading a neighbour while it
is being lowered is harmless: lowering lists its neighbours for the next step.
"""

import warp as wp

from homolog.geodesics.kernels import FAR, Corner, Reach, encode, mean_code, plane_front, point_front
from homolog.geodesics.lookup import LANES, MISSING

wp.set_module_options({"enable_backward": False, "max_unroll": 4})

WALKERS = wp.constant(32)
"""Threads that share the vertices of one cluster, for each quad of lanes."""
QUADS = wp.constant(LANES // 4)


@wp.struct
class Front:
    """The state of a batch of clusters."""

    u: wp.array3d(dtype=wp.vec4)
    changed: wp.array2d(dtype=wp.int32)
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


@wp.func
def front_update(
    front: Front,
    sources: Sources,
    b: int,
    quad: int,
    begin: int,
    end: int,
    element: int,
    step: int,
    old: wp.vec4,
) -> wp.vec4:
    """Return the distances that a vertex' corners yield, those that changed since it was looked at."""
    new = wp.vec4(old[0], old[1], old[2], old[3])
    for c in range(begin, end):
        a = sources.corners[c].a
        other = sources.corners[c].b
        if front.changed[b, a] >= step - 1 or front.changed[b, other] >= step - 1:
            corner = sources.corners[c]
            da = front.u[b, a, quad]
            db = front.u[b, other, quad]
            for lane in range(4):
                if element == 0:
                    new[lane] = wp.min(new[lane], point_front(corner, da[lane], db[lane]))
                else:
                    new[lane] = wp.min(new[lane], plane_front(corner, da[lane], db[lane]))
    return new


@wp.kernel
def seed_front(front: Front, sources: Sources, offset: int):
    """Set the sources to 0 and list their neighbours for step 1."""
    b, lane = wp.tid()
    cluster = offset + b
    m = sources.members[cluster, lane]
    if m >= 0:
        value = wp.vec4(FAR, FAR, FAR, FAR)
        value[lane % 4] = 0.0
        front.u[b, m, lane // 4] = value
        vertex = sources.first[sources.shape[cluster]] + m
        for k in range(sources.fan[vertex], sources.fan[vertex + 1]):
            enqueue(front, b, sources.corners[k].a, 1)


@wp.kernel
def step_front(front: Front, sources: Sources, offset: int, element: int, step: int):
    """Update the vertices listed for a step; list the neighbours of those that fell for the next."""
    b, walker, quad = wp.tid()
    shape = sources.shape[offset + b]
    reach = sources.reaches[shape]
    base = sources.first[shape]
    if walker == 0 and quad == 0:
        front.counts[(step + 2) % 3, b] = 0  # that of the step before: spent, and the next but one's
    for k in range(walker, front.counts[step % 3, b], WALKERS):
        v = front.lists[step % 2, b, k]
        begin = sources.fan[base + v]
        end = sources.fan[base + v + 1]
        old = front.u[b, v, quad]
        new = front_update(front, sources, b, quad, begin, end, element, step, old)
        gain = float(0.0)
        near = float(0.0)
        for lane in range(4):
            gain = wp.max(gain, old[lane] - new[lane])
            near = wp.max(near, wp.where(new[lane] <= reach.stored + reach.slack, old[lane] - new[lane], 0.0))
        if gain > reach.changed:
            front.u[b, v, quad] = new
            front.changed[b, v] = step
        if near > reach.changed:
            for c in range(begin, end):
                enqueue(front, b, sources.corners[c].a, step + 1)


@wp.kernel
def store_front_dense(
    u: wp.array3d(dtype=wp.vec4),
    members: wp.array2d(dtype=wp.int32),
    reach: Reach,
    codes: wp.array2d(dtype=wp.uint16),
):
    """Write the rows of some clusters' sources; thread (cluster, quad, vertex)."""
    b, quad, v = wp.tid()
    distances = u[b, v, quad]
    for lane in range(4):
        m = members[b, 4 * quad + lane]
        if m >= 0:
            codes[m, v] = encode(distances[lane], reach)


@wp.kernel
def mark_reached(u: wp.array3d(dtype=wp.vec4), reach: Reach, reached: wp.array2d(dtype=wp.int32)):
    """Mark the vertices that any source of a cluster reaches; thread (cluster, vertex)."""
    b, v = wp.tid()
    nearest = float(FAR)
    for quad in range(QUADS):
        nearest = wp.min(nearest, wp.min(u[b, v, quad]))
    reached[b, v] = wp.where(nearest <= reach.stored, 1, 0)


@wp.kernel
def store_front_blocks(
    u: wp.array3d(dtype=wp.vec4),
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
        for quad in range(QUADS):
            distances = u[b, v, quad]
            for lane in range(4):
                blocks[previous, 4 * quad + lane] = encode(distances[lane], reach)


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
