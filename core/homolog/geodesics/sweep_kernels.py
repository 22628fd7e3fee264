"""The fast iterative method for one cluster on one CPU core: sweeps from near to far.

Distances from the sources of a cluster are solved side by side, one source a lane; see docs/geodesics.md.
"""

import warp as wp

from homolog.geodesics.kernels import FAR, Corner, Reach, encode, mean_code, plane_front, point_front
from homolog.geodesics.lookup import LANES, MISSING

# A lane loop has to stay a loop: the compiler then turns it into vector instructions.
wp.set_module_options({"enable_backward": False, "max_unroll": 4})

BUCKETS = wp.constant(256)
Lanes = wp.types.vector(length=LANES, dtype=wp.float32)


@wp.struct
class Scratch:
    """What one thread needs to solve one cluster after another."""

    u: wp.array(dtype=Lanes)  # (V,) distances, FAR outside the patch
    dirty: wp.array(dtype=wp.int32)  # (V,) 1 if the vertex awaits an update
    changed: wp.array(dtype=wp.int32)  # (V,) clock of the vertex' last change, 0 outside the patch
    seen: wp.array(dtype=wp.int32)  # (V,) clock of its last update
    patch: wp.array(dtype=wp.int32)  # (V,) vertices of the patch, near to far
    bucket: wp.array(dtype=wp.int32)  # (BUCKETS + 1,)
    size: wp.array(dtype=wp.int32)  # (1,) vertices in the patch


@wp.func
def lay_patch(scratch: Scratch, position: wp.array(dtype=wp.vec3), centre: wp.vec3, radius: float) -> int:
    """List the vertices within radius of the centre, near to far; return how many."""
    for k in range(BUCKETS + 1):
        scratch.bucket[k] = 0
    scale = 0.9999 * float(BUCKETS) / radius
    for v in range(position.shape[0]):
        distance = wp.length(position[v] - centre)
        if distance <= radius:
            scratch.bucket[int(distance * scale) + 1] += 1
    for k in range(BUCKETS):
        scratch.bucket[k + 1] += scratch.bucket[k]
    for v in range(position.shape[0]):
        distance = wp.length(position[v] - centre)
        if distance <= radius:
            k = int(distance * scale)
            scratch.patch[scratch.bucket[k]] = v
            scratch.dirty[v] = 0
            scratch.seen[v] = 0
            scratch.bucket[k] += 1
    return scratch.bucket[BUCKETS]


@wp.func
def update(
    scratch: Scratch, v: int, fan: wp.array(dtype=wp.int32), corners: wp.array(dtype=Corner), element: int
) -> Lanes:
    """Return the distances at v that its triangles yield, those that changed since v's last update."""
    best = Lanes(FAR)
    since = scratch.seen[v]
    for k in range(fan[v], fan[v + 1]):
        corner = corners[k]
        if scratch.changed[corner.a] > since or scratch.changed[corner.b] > since:
            da = scratch.u[corner.a]
            db = scratch.u[corner.b]
            if element == 0:
                for lane in range(LANES):
                    best[lane] = wp.min(best[lane], point_front(corner, da[lane], db[lane]))
            else:
                for lane in range(LANES):
                    best[lane] = wp.min(best[lane], plane_front(corner, da[lane], db[lane]))
    return best


@wp.kernel
def sweep_cluster(
    scratch: Scratch,
    position: wp.array(dtype=wp.vec3),
    fan: wp.array(dtype=wp.int32),
    corners: wp.array(dtype=Corner),
    reach: Reach,
    members: wp.array2d(dtype=wp.int32),
    element: int,
    cluster: int,
):
    """Solve the distances from one cluster's sources: sweeps over dirty vertices, near to far."""
    for k in range(scratch.size[0]):
        scratch.u[scratch.patch[k]] = Lanes(FAR)
        scratch.changed[scratch.patch[k]] = 0

    centre = wp.vec3(0.0, 0.0, 0.0)
    n_members = float(0.0)
    for lane in range(LANES):
        m = members[cluster, lane]
        if m >= 0:
            centre += position[m]
            n_members += 1.0
    centre = centre / n_members
    extent = float(0.0)
    for lane in range(LANES):
        m = members[cluster, lane]
        if m >= 0:
            extent = wp.max(extent, wp.length(position[m] - centre))
    size = lay_patch(scratch, position, centre, extent + reach.stored + reach.slack)
    scratch.size[0] = size

    for lane in range(LANES):
        m = members[cluster, lane]
        if m >= 0:
            value = scratch.u[m]
            value[lane] = 0.0
            scratch.u[m] = value
            scratch.changed[m] = 1
            for k in range(fan[m], fan[m + 1]):
                scratch.dirty[corners[k].a] = 1

    limit = reach.stored + reach.slack
    clock = int(1)
    pending = int(1)
    while pending != 0:
        pending = int(0)
        for p in range(size):
            v = scratch.patch[p]
            if scratch.dirty[v] != 0:
                scratch.dirty[v] = 0
                old = scratch.u[v]
                new = update(scratch, v, fan, corners, element)
                scratch.seen[v] = clock
                gain = float(0.0)
                near = float(0.0)
                for lane in range(LANES):
                    gain = wp.max(gain, old[lane] - new[lane])
                    near = wp.max(near, wp.where(new[lane] <= limit, old[lane] - new[lane], 0.0))
                    new[lane] = wp.min(new[lane], old[lane])
                if gain > reach.changed:
                    scratch.u[v] = new
                    clock += 1
                    scratch.changed[v] = clock
                if near > reach.changed:
                    pending = int(1)
                    for k in range(fan[v], fan[v + 1]):
                        scratch.dirty[corners[k].a] = 1


@wp.kernel
def store_dense(
    scratch: Scratch,
    reach: Reach,
    members: wp.array2d(dtype=wp.int32),
    codes: wp.array2d(dtype=wp.uint16),
    cluster: int,
):
    """Write the rows of one cluster's sources, which hold MISSING so far."""
    for lane in range(LANES):
        m = members[cluster, lane]
        if m >= 0:
            for p in range(scratch.size[0]):
                v = scratch.patch[p]
                codes[m, v] = encode(scratch.u[v][lane], reach)


@wp.kernel
def store_block(
    scratch: Scratch,
    reach: Reach,
    row: wp.array2d(dtype=wp.uint16),
    block: wp.array2d(dtype=wp.uint16),
    n_rows: wp.array(dtype=wp.int32),
    cluster: int,
):
    """Write the block of one cluster: a row for every vertex that one of its sources reaches."""
    n = int(0)
    for p in range(scratch.size[0]):
        v = scratch.patch[p]
        nearest = float(FAR)
        for lane in range(LANES):
            nearest = wp.min(nearest, scratch.u[v][lane])
        if nearest <= reach.stored:
            for lane in range(LANES):
                block[n, lane] = encode(scratch.u[v][lane], reach)
            row[cluster, v] = wp.uint16(n)
            n += 1
    n_rows[0] = n


@wp.kernel
def symmetrize_strip(codes: wp.array2d(dtype=wp.uint16), strip: int):
    """Replace both directions of every pair by their mean, for 16 rows and what mirrors them."""
    n = wp.min(16 * strip + 16, codes.shape[0])
    for tile in range(strip + 1):
        for i in range(16 * strip, n):
            for j in range(16 * tile, wp.min(16 * tile + 16, i)):
                there = int(codes[i, j])
                back = int(codes[j, i])
                if there != MISSING or back != MISSING:
                    mean = mean_code(there, back)
                    codes[i, j] = mean
                    codes[j, i] = mean
