"""The fast iterative method for one cluster on one CPU core: sweeps from near to far.

Distances from the sources of a cluster are solved side by side, one source a lane; see docs/geodesics.md.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.kernels import (
    FAR,
    Corner,
    Reach,
    encode,
    mean_code,
    plane_front,
    side_way,
    straight_squared,
)
from homolog.geodesics.lookup import LANES, MISSING

# A lane loop has to stay a loop: the compiler then turns it into vector instructions.
wp.set_module_options({"enable_backward": False, "max_unroll": 4})

BUCKETS = wp.constant(256)
BAND = wp.constant(128)
"""Vertices, in the order of the patch, that are settled together."""
Lanes = wp.types.vector(length=LANES, dtype=wp.float32)
Codes = wp.types.vector(length=LANES, dtype=wp.uint16)
Counts = wp.types.vector(length=LANES, dtype=wp.int32)


@wp.struct
class Scratch:
    """What one thread needs to solve one cluster after another."""

    u: wp.array(dtype=Lanes)  # (V,) distances, FAR outside the patch
    dirty: wp.array(dtype=wp.int32)  # (V,) 1 if the vertex awaits an update
    changed: wp.array(dtype=wp.int32)  # (V,) clock of the vertex' last change, 0 outside the patch
    seen: wp.array(dtype=wp.int32)  # (V,) clock of its last update
    bin: wp.array(dtype=wp.int32)  # (V,) bucket of the vertex' distance, -1 outside the patch
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
        scratch.bin[v] = wp.where(distance <= radius, int(distance * scale), -1)
        if distance <= radius:
            scratch.bucket[scratch.bin[v] + 1] += 1
    for k in range(BUCKETS):
        scratch.bucket[k + 1] += scratch.bucket[k]
    for v in range(position.shape[0]):
        k = scratch.bin[v]
        if k >= 0:
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
    squared = Lanes(FAR * FAR)
    since = scratch.seen[v]
    for k in range(fan[v], fan[v + 1]):
        corner = corners[k]
        if scratch.changed[corner.a] > since or scratch.changed[corner.b] > since:
            da = scratch.u[corner.a]
            db = scratch.u[corner.b]
            if element == 0:
                for lane in range(LANES):
                    best[lane] = wp.min(best[lane], side_way(corner, da[lane], db[lane]))
                    squared[lane] = wp.min(squared[lane], straight_squared(corner, da[lane], db[lane]))
            else:
                for lane in range(LANES):
                    best[lane] = wp.min(best[lane], plane_front(corner, da[lane], db[lane]))
    for lane in range(LANES):
        best[lane] = wp.min(best[lane], wp.sqrt(squared[lane]))
    return best


@wp.func
def lower(
    scratch: Scratch,
    v: int,
    fan: wp.array(dtype=wp.int32),
    corners: wp.array(dtype=Corner),
    reach: Reach,
    element: int,
    clock: int,
) -> int:
    """Update a vertex and mark its neighbours if it fell; return how far the clock goes on."""
    scratch.dirty[v] = 0
    old = scratch.u[v]
    new = update(scratch, v, fan, corners, element)
    scratch.seen[v] = clock
    # Counted in integers: the largest of floats is not reduced by vector instructions.
    gained = int(0)
    near = int(0)
    limit = reach.stored + reach.slack
    for lane in range(LANES):
        fell = wp.where(old[lane] - new[lane] > reach.changed, 1, 0)
        gained += fell
        near += wp.where(new[lane] <= limit, fell, 0)
        new[lane] = wp.min(new[lane], old[lane])
    if near > 0:
        for k in range(fan[v], fan[v + 1]):
            scratch.dirty[corners[k].a] = 1
    if gained > 0:
        scratch.u[v] = new
        scratch.changed[v] = clock + 1
        return 1
    return 0


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

    # A band is settled before the next: what lies beyond is not computed from values that still fall.
    clock = int(1)
    pending = int(1)
    while pending != 0:
        pending = int(0)
        for first in range(0, size, BAND):
            moving = int(1)
            while moving != 0:
                moving = int(0)
                for p in range(first, wp.min(first + BAND, size)):
                    v = scratch.patch[p]
                    if scratch.dirty[v] != 0:
                        moving = int(1)
                        pending = int(1)
                        clock += lower(scratch, v, fan, corners, reach, element, clock)


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
    slot: wp.array(dtype=wp.int32),
    row: wp.array2d(dtype=wp.uint16),
    near: wp.array2d(dtype=wp.uint8),
    block: wp.array(dtype=Codes),
    n_rows: wp.array(dtype=wp.int32),
    cluster: int,
):
    """Write the block of one cluster, a row for every vertex that one of its sources reaches.

    Marks the clusters of these vertices as near.
    """
    n = int(0)
    for p in range(scratch.size[0]):
        v = scratch.patch[p]
        u = scratch.u[v]
        codes = Codes()
        some = int(0)
        for lane in range(LANES):
            stored = u[lane] <= reach.stored
            some += wp.where(stored, 1, 0)
            codes[lane] = encode(u[lane], reach)
        if some > 0:
            block[n] = codes
            row[cluster, v] = wp.uint16(n)
            near[cluster, slot[v] // LANES] = wp.uint8(1)
            n += 1
    n_rows[0] = n


@wp.kernel
def symmetrize_tiles(
    members: wp.array2d(dtype=wp.int32),
    start: wp.array(dtype=wp.int32),
    row: wp.array2d(dtype=wp.uint16),
    near: wp.array2d(dtype=wp.uint8),
    blocks: wp.array(dtype=Codes),
    cluster: int,
):
    """Replace both directions of every pair of a cluster and those before it by their mean."""
    for other in range(cluster + 1):
        if near[cluster, other] == wp.uint8(0) and near[other, cluster] == wp.uint8(0):
            continue
        rows = Counts(MISSING)
        for i in range(LANES):
            if members[cluster, i] >= 0:
                rows[i] = int(row[other, members[cluster, i]])
        for j in range(LANES):
            there = members[other, j]
            if there >= 0:
                row_there = int(row[cluster, there])
                codes = Codes(wp.uint16(MISSING))
                if row_there != MISSING:
                    codes = blocks[start[cluster] + row_there]
                for i in range(LANES):
                    if rows[i] != MISSING:
                        back = blocks[start[other] + rows[i]]
                        mean = mean_code(int(codes[i]), int(back[j]))
                        codes[i] = mean
                        back[j] = mean
                        blocks[start[other] + rows[i]] = back
                    else:
                        codes[i] = wp.uint16(MISSING)
                if row_there != MISSING:
                    blocks[start[cluster] + row_there] = codes


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
