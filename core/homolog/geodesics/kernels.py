"""What the fast iterative method on triangles is made of: local solvers, codes, symmetry."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.lookup import LANES, MISSING

wp.set_module_options({"enable_backward": False})

FAR = wp.constant(1.0e18)
LAST = wp.constant(64249)
"""Code of d_max: codes up to 65534 leave headroom of 2 %, until both directions of a pair are averaged."""


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
