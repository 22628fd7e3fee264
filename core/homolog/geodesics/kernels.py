"""What the fast iterative method on triangles is made of: local solvers, codes, symmetry."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.lookup import MISSING

wp.set_module_options({"enable_backward": False})

FAR = wp.constant(1.0e18)
LAST = wp.constant(64249)
"""Code of d_max: codes up to 65534 leave headroom of 2 %, until both directions of a pair are averaged."""

FALL = wp.constant(1.0000006)
"""A distance has fallen if it was longer than this times the new one: by less, rounding alone makes it."""


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
class Tell:
    """What a corner's vertex c tells a and b of when it has fallen (see `crew_kernels.news_for`)."""

    to_a: float  # height of a over bc, less half of |bc|
    to_b: float  # height of b over ac, less half of |ac|
    bc: float
    places: int  # of this triangle around a, and 256 times that around b; up to LAST_BIT


@wp.struct
class Reach:
    """How far one shape's distances are followed, and how exactly."""

    stored: float  # longest distance that is stored
    limit: float  # to there it is followed, a mean edge beyond d_max: a value inside may come from outside
    edge: float  # mean edge
    unit: float  # length of one code step


@wp.struct
class Ray:
    """The straight way to a corner's c, from the source that explains the distances of a and b."""

    distance: float  # at c
    crossing: float  # where the way meets ab, measured from a
    before: float  # length of the straight way up to there
    along: float  # place of that source: along ab …
    below: float  # … and off it
    direct: int  # 0; or, if no straight way crosses ab, 1 for the way along ac and 2 for that along bc


@wp.func
def trace(corner: Corner, da: float, db: float) -> Ray:
    """Find the way from the point below ab that explains both da and db (Novotni and Klein 2002).

    Exact on flat regions, for acute and obtuse triangles alike; the distance is monotone in da and db.
    """
    ray = Ray()
    by_a = da + corner.ac
    by_b = db + corner.bc
    side = wp.min(by_a, by_b)
    # factored: less cancellation on slivers
    ray.along = ((da - db) * (da + db) + corner.length * corner.length) * corner.half
    squared = da * da - ray.along * ray.along
    ray.below = wp.sqrt(wp.max(squared, 0.0))
    height = wp.max(ray.below + corner.y, 1.0e-30)
    crossing = ray.along * corner.y + corner.x * ray.below
    inside = squared >= 0.0 and crossing >= 0.0 and crossing <= corner.length * height
    inside = inside and wp.min(da, db) > 0.0  # from a source the way goes along the side
    inverse = 1.0 / height
    dx = corner.x - ray.along
    straight = wp.where(inside, wp.sqrt(dx * dx + height * height), FAR)
    # Not "straight < side", which rounding would decide where the way passes an end: bearings would jump.
    ray.direct = wp.where(inside, 0, wp.where(by_a <= by_b, 1, 2))
    ray.distance = wp.min(straight, side)
    ray.before = straight * ray.below * inverse
    ray.crossing = wp.where(inside, crossing * inverse, wp.where(by_a <= by_b, 0.0, corner.length))
    return ray


@wp.func
def side_way(corner: Corner, da: float, db: float) -> float:
    """Distance at c along the shorter of two sides."""
    return wp.min(da + corner.ac, db + corner.bc)


@wp.func
def straight_squared(corner: Corner, da: float, db: float) -> float:
    """Square of the distance at c straight from the point below ab; FAR squared if no such way crosses ab.

    With `side_way` the same as `trace`, but for all triangles around c with one root less each.
    """
    along = ((da - db) * (da + db) + corner.length * corner.length) * corner.half
    below = wp.sqrt(da * da - along * along)  # not a number, and so not inside, where nothing explains both
    height = below + corner.y
    crossing = along * corner.y + corner.x * below
    inside = crossing >= 0.0 and crossing <= corner.length * height
    dx = corner.x - along
    return wp.where(inside, dx * dx + height * height, FAR * FAR)


@wp.func
def least_way(corner: Corner, da: float, db: float) -> float:
    """Return a distance that no straight way through a triangle falls short of, if |da - db| <= |ab|."""
    return 0.5 * (da + db - corner.length) + corner.y


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
