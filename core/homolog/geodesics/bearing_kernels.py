"""Second order: distances amended by the directions that shortest ways arrive from.

The first-order front takes both ends of a triangle's side to see one source. Behind a bump or a hollow they
see images of it whose directions differ by the curvature between them. The *bearing* of a vertex is the
direction that its shortest way arrives from, so the slope of the distance along every side there: with values
and slopes at both ends, the distance on the side is known to one order more.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.kernels import FAR, Corner, trace

wp.set_module_options({"enable_backward": False})

PI = wp.constant(3.14159265)
HALF_PI = wp.constant(1.57079633)
RIVAL = wp.constant(0.05)
"""Ways longer than the shortest by up to this part of a mean edge may turn out to be the shortest …"""
DETOUR = wp.constant(4.0)
"""… but from half of it on they count as longer by this times the rest: nothing jumps where they no
longer may."""
LAST_BIT = wp.constant(30)
"""Rivals are bits, one a corner; this bit stands for all corners from here on: poles may have any number."""
BLEND = wp.constant(0.01)
"""Ways longer than the shortest by less than this part of a mean edge have a share in the bearing: it does
not jump where rounding decides between two that are equally long."""
INNER = wp.constant(0.1)
"""Ways that cross a side nearer to its end than this part of it have less of a share …"""
LEAST = wp.constant(0.01)
"""… and those through the end itself, and by short sides, this one."""
SPREAD = wp.constant(0.04)
"""Mean square [rad²] by which ways that are equally long may differ in bearing without being two fronts."""
SHORT = wp.constant(0.03)
"""Triangles with a side shorter than this part of a mean edge give no bearings of their own."""
OTHER = wp.constant(0.4)
"""Images of the source farther apart than this [rad] begin to be another front's; twice as far, they are."""
MOST = wp.constant(0.1)
"""Largest amendment of a single triangle, as a part of the distance: more is no curvature, but two fronts."""
UPWIND = wp.constant(0.1)
"""An end of a side nearer than the vertex beyond by less than this part of the way between counts less."""
FARTHER = wp.constant(1.0e-2)
"""What an end counts that is farther: little, but far more than rounding does, if a way passes it closely."""
CLOSE = wp.constant(1.0e-3)
"""Ends closer to the vertex than this part of a mean edge count more, in the end fully: which of two that all
but coincide is nearer, rounding decides."""
GRAZE = wp.constant(5.0e-4)
"""Ways through a triangle and along its two sides that differ by less than this part of a mean edge share
what they carry: which of them is the shortest, rounding decides."""
STEP = wp.constant(1.0e-4)
"""Steps, as a part of a mean edge, that amendments are told in …"""
SMALL_STEP = wp.constant(1.0e-5)
"""… and those of vertices with a short side: among vertices that all but coincide amendments go round in
circles and move by little more each time."""
START = wp.constant(1.0)
"""Amendments of vertices with a short side begin with this part of a mean edge, more than they come to: from
below, they would creep up where the ways among vertices that all but coincide go round in circles."""
ROUNDS = wp.constant(100)
"""Rounds of amendments after which to be content: seven are usual, a globe's poles take some dozens."""


@wp.struct
class Turns:
    """How a corner's sides lie around their ends: directions [rad], counterclockwise."""

    at_a: float  # of b, seen from a
    around_a: float  # sum of all angles at a
    at_b: float  # of a, seen from b
    around_b: float
    at_c: float  # of a, seen from c
    around_c: float


@wp.struct
class Tie:
    """What a corner makes of amendments: c's is gain + (1 - share) * a's + share * b's."""

    gain: float
    share: float


@wp.func
def slope(direction: float, bearing: float, around: float) -> float:
    """Return the cosine of the angle between a side and a bearing, on its nearer side, at most half a turn.

    The series is exact to 4e-6.
    """
    apart = wp.abs(direction - bearing)
    angle = HALF_PI - wp.min(wp.min(apart, around - apart), PI)
    s = angle * angle
    return angle * (1.0 + s * (-0.166666567 + s * (8.33297e-3 + s * (-1.98096e-4 + s * 2.6e-6))))


@wp.func
def turn_from_side(rise: float, run: float) -> float:
    """Return the angle, up to half a turn, whose tangent is rise / run; rise >= 0.

    The series (Abramowitz and Stegun 4.4.49) is exact to 1e-5 rad.
    """
    size = wp.abs(run)
    t = wp.min(rise, size) / wp.max(wp.max(rise, size), 1.0e-30)
    s = t * t
    arc = t * (0.9998660 + s * (-0.3302995 + s * (0.1801410 + s * (-0.0851330 + s * 0.0208351))))
    arc = wp.where(rise > size, HALF_PI - arc, arc)
    return wp.where(run < 0.0, PI - arc, arc)


@wp.struct
class Way:
    """A way through a triangle to its corner c, as a candidate for the bearing of c."""

    distance: float  # at c
    bearing: float
    standing: float  # weight beside others equally long
    by_a: int  # 1 if it goes along ac …
    by_b: int  # … or bc
    doubt: float  # 1 if rounding decides


@wp.func
def find_way(corner: Corner, turns: Turns, da: float, db: float, edge: float) -> Way:
    """Return the shortest way through a triangle.

    Ways along a side, and those through triangles with a short side, where rounding decides which is
    shortest, give the bearing only if there is no other. Standing fades, so that nothing jumps.
    """
    way = Way()
    ray = trace(corner, da, db)
    run = corner.ac * corner.ac - corner.x * ray.crossing
    way.distance = ray.distance
    way.by_a = wp.where(ray.direct == 1, 1, 0)
    way.by_b = wp.where(ray.direct == 2, 1, 0)
    way.bearing = turns.at_c + turn_from_side(corner.y * ray.crossing, run)
    way.doubt = wp.where(wp.min(corner.length, wp.min(corner.ac, corner.bc)) < SHORT * edge, 1.0, 0.0)
    inner = wp.min(ray.crossing, corner.length - ray.crossing) * (2.0 * corner.half / INNER)
    way.standing = LEAST + wp.min(inner, 1.0 - way.doubt)
    return way


@wp.func
def begin_with(shortest: float, edge: float) -> float:
    """Return what the amendment of a vertex begins with, from its shortest side."""
    return wp.where(shortest < SHORT * edge, START * edge, 0.0)


@wp.func
def step_of(shortest: float, edge: float) -> float:
    """Return the step that the amendments of a vertex are told in, from its shortest side."""
    return wp.where(shortest < SHORT * edge, SMALL_STEP, STEP) * edge


@wp.func
def is_news(old: float, new: float, step: float) -> bool:
    """Return whether an amendment has come to another step, so that others have to follow.

    Steps, not a least difference: that would let vertices drift unheard that move by less many times.
    """
    inverse = 1.0 / step
    return wp.floor(new * inverse) != wp.floor(old * inverse)


@wp.func
def share_of(way: float, best: float, edge: float) -> float:
    """Return the weight of a way in the bearing: 1 … 0."""
    return wp.min(wp.max(1.0 - (way - best) * (1.0 / (BLEND * edge)), 0.0), 1.0)


@wp.func
def turn_between(bearing: float, other: float, around: float) -> float:
    """Return the turn from one bearing to another, at most half of all around."""
    turn = other - bearing
    turn = wp.where(turn > 0.5 * around, turn - around, turn)
    return wp.where(turn < -0.5 * around, turn + around, turn)


@wp.func
def within(bearing: float, around: float) -> float:
    """Return the same bearing in 0 … around."""
    turned = wp.where(bearing < 0.0, bearing + around, bearing)
    return wp.where(turned > around, turned - around, turned)


@wp.func
def trust_in(square: float, mean: float) -> float:
    """Return how far a mean of bearings is one, 1 … 0, from the mean square of the turns in it."""
    return wp.max(wp.min(2.0 - (square - mean * mean) / SPREAD, 1.0), 0.0)


@wp.func
def credence(apart: float) -> float:
    """Return how far a difference in direction, in units of OTHER, is taken for curvature: 1 … 0."""
    return wp.max(wp.min(2.0 - wp.abs(apart), 1.0), 0.0)


@wp.func
def nearer(by: float, apart: float, edge: float) -> float:
    """Return how far an end that is nearer by so much, and so far away, counts: 0 … 1."""
    least = wp.max(1.0 - apart * (1.0 / (CLOSE * edge)), FARTHER)
    return wp.max(wp.min(by / (UPWIND * apart), 1.0), least)


@wp.func
def tie_corner(
    corner: Corner,
    turns: Turns,
    da: float,
    db: float,
    at_a: float,
    at_b: float,
    trust_a: float,
    trust_b: float,
    u: float,
    edge: float,
) -> Tie:
    """Return what a corner makes of the amendments of a and b, from their distances and bearings.

    Along ab the square of the distance is D² = D0² + x (L - x) (p (L - x) + q x) / L², where D0 is that of
    the one source that explains da and db, and p, q make the slopes at a and b right (cubic Hermite).

    Parameters
    ----------
    at_a, at_b, trust_a, trust_b : float
        Bearings of a and b, and how far they are to be trusted.
    u : float
        Distance at c, which the gain is relative to; a corner whose way is no rival of it gains FAR.
    """
    tie = Tie()
    ray = trace(corner, da, db)
    below = wp.max(ray.below, 1.0e-12)
    before = wp.max(ray.before, 1.0e-12)
    inverse = 1.0 / (below * before)
    p = 2.0 * (ray.along - da * slope(turns.at_a, at_a, turns.around_a))
    q = 2.0 * (corner.length - db * slope(turns.at_b, at_b, turns.around_b) - ray.along)
    other = (0.5 / OTHER) * before * inverse  # 1 / (2 OTHER below)
    p = p * trust_a * credence(p * other)
    q = q * trust_b * credence(q * other)
    z = 2.0 * corner.half * ray.crossing
    bend = 0.5 * ray.crossing * (1.0 - z) * (p * (1.0 - z) + q * z) * below * inverse
    most = MOST * before
    # FAR in place of "and": with that the lane loop would not become vector instructions
    straight = wp.where(ray.direct != 0, FAR, ray.distance) + wp.clamp(bend, -most, most)
    by_a = da + corner.ac
    by_b = db + corner.bc
    side = wp.min(by_a, by_b)
    through = straight < side
    along = wp.where(wp.where(by_a <= by_b, da, db) < u, side, FAR)  # from a farther end it goes in a circle
    longer = ray.distance - u
    detour = DETOUR * wp.max(longer - 0.5 * RIVAL * edge, 0.0)
    tie.gain = wp.where(longer < RIVAL * edge, wp.where(through, straight, along) - u + detour, FAR)
    # of a and b only those nearer than c count: what follows from what then is no circle
    weight_a = (1.0 - z) * nearer(u - da, corner.ac, edge)
    weight_b = z * nearer(u - db, corner.bc, edge)
    grazed = 1.0 / (GRAZE * edge)
    of_sides = wp.clamp(0.5 + 0.5 * grazed * (by_a - by_b), 0.0, 1.0)
    crosses = wp.where(through, wp.min(grazed * (side - straight), 1.0), 0.0)
    tie.share = of_sides + crosses * (weight_b / (weight_a + weight_b) - of_sides)
    return tie
