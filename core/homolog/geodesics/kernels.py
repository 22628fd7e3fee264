"""The fast iterative method on triangle fans: local solvers, and the sweep over one cluster on a CPU core.

Distances of a cluster's sources are solved side by side, one source a lane; see docs/geodesics.md.
"""

# mypy: disable-error-code="valid-type"
import warp as wp

from homolog.geodesics.lookup import LANES, MISSING

# A lane loop has to stay a loop: the compiler then turns it into vector instructions.
wp.set_module_options({"enable_backward": False, "max_unroll": 4})

FAR = wp.constant(1.0e18)
LAST = wp.constant(64249)
"""Code of d_max: codes up to 65534 leave headroom of 2 %, until both directions of a pair are averaged."""
BUCKETS = wp.constant(256)
Lanes = wp.types.vector(length=LANES, dtype=wp.float32)


@wp.struct
class Corner:
    """A triangle seen from its corner c: side ab laid from (0, 0) to (length, 0), c at (x, y), y > 0."""

    a: int
    b: int
    length: float
    half: float  # 1 / (2 length)
    x: float
    y: float
    ac: float  # |ac|
    bc: float


@wp.struct
class Reach:
    """How far one shape's distances are followed, and how exactly."""

    stored: float  # longest distance that is stored
    slack: float  # a mean edge more is followed, since a value just inside may come from just outside
    changed: float  # smaller improvements are not passed on
    unit: float  # length of one code step


@wp.func
def point_front(corner: Corner, da: float, db: float) -> float:
    """Distance at c, from the point below ab that explains both da and db (Novotni and Klein 2002).

    Exact on flat regions, for acute and obtuse triangles alike; monotone in da and db.
    """
    best = wp.min(da + corner.ac, db + corner.bc)
    # factored: less cancellation on slivers
    along = ((da - db) * (da + db) + corner.length * corner.length) * corner.half
    squared = da * da - along * along
    below = wp.sqrt(wp.max(squared, 0.0))
    crossing = along * corner.y + corner.x * below
    inside = squared >= 0.0 and crossing >= 0.0 and crossing <= corner.length * (below + corner.y)
    dx = corner.x - along
    dy = corner.y + below
    return wp.where(inside, wp.min(best, wp.sqrt(dx * dx + dy * dy)), best)


@wp.func
def plane_front(corner: Corner, da: float, db: float) -> float:
    """Distance at c from a planar front through da and db: the element of the paper (Fu et al. 2011)."""
    best = wp.min(da + corner.ac, db + corner.bc)
    slope_x = (db - da) * 2.0 * corner.half
    squared = 1.0 - slope_x * slope_x
    slope_y = wp.sqrt(wp.max(squared, 0.0))
    crossing = corner.x * slope_y - slope_x * corner.y
    inside = squared > 0.0 and crossing >= 0.0 and crossing <= corner.length * slope_y
    return wp.where(inside, wp.min(best, da + slope_x * corner.x + slope_y * corner.y), best)


@wp.func
def encode(distance: float, reach: Reach) -> wp.uint16:
    """Return the code of a distance, MISSING beyond what is stored."""
    return wp.uint16(wp.where(distance <= reach.stored, int(distance / reach.unit + 0.5), MISSING))


@wp.func
def mean_code(there: int, back: int) -> wp.uint16:
    """Return the mean of the codes of both directions, MISSING if one is or the mean lies beyond d_max.

    The two differ by less than a percent of d_max: with the headroom, no pair within d_max is one-sided.
    """
    mean = (there + back + 1) // 2
    return wp.uint16(wp.where(there == MISSING or back == MISSING or mean > LAST, MISSING, mean))


@wp.struct
class Scratch:
    """What one thread needs to solve one cluster after another."""

    u: wp.array(dtype=Lanes)  # (V,) distances, FAR outside the patch
    dirty: wp.array(dtype=wp.int32)  # (V,) number of the cluster for which the vertex awaits an update
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
            scratch.bucket[k] += 1
    return scratch.bucket[BUCKETS]


@wp.func
def update(
    scratch: Scratch, v: int, fan: wp.array(dtype=wp.int32), corners: wp.array(dtype=Corner), element: int
) -> Lanes:
    """Return the distances at v that its triangles yield."""
    best = Lanes(FAR)
    for k in range(fan[v], fan[v + 1]):
        corner = corners[k]
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
    """Solve the distances from one cluster's sources: Gauss-Seidel sweeps over dirty vertices, near to far."""
    for k in range(scratch.size[0]):
        scratch.u[scratch.patch[k]] = Lanes(FAR)

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

    stamp = cluster + 1
    for lane in range(LANES):
        m = members[cluster, lane]
        if m >= 0:
            value = scratch.u[m]
            value[lane] = 0.0
            scratch.u[m] = value
            for k in range(fan[m], fan[m + 1]):
                scratch.dirty[corners[k].a] = stamp

    limit = reach.stored + reach.slack
    pending = int(1)
    while pending != 0:
        pending = int(0)
        for p in range(size):
            v = scratch.patch[p]
            if scratch.dirty[v] == stamp:
                scratch.dirty[v] = 0
                old = scratch.u[v]
                new = update(scratch, v, fan, corners, element)
                gain = float(0.0)
                near = float(0.0)
                for lane in range(LANES):
                    gain = wp.max(gain, old[lane] - new[lane])
                    near = wp.max(near, wp.where(new[lane] <= limit, old[lane] - new[lane], 0.0))
                    new[lane] = wp.min(new[lane], old[lane])
                if gain > reach.changed:
                    scratch.u[v] = new
                if near > reach.changed:
                    pending = int(1)
                    for k in range(fan[v], fan[v + 1]):
                        scratch.dirty[corners[k].a] = stamp


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
def symmetrize_dense(codes: wp.array2d(dtype=wp.uint16), offset: int):
    """Replace both directions of every pair by their mean."""
    i = offset + wp.tid()
    for j in range(i):
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
    offset: int,
):
    """Replace both directions of every pair by their mean; the thread of the later vertex writes both."""
    t, v = wp.tid()
    cluster = offset + t
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
