"""Kernel functions of both solvers: update of a vertex from a triangle, encoding, mean of directions."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.kernels.lookup import MISSING

wp.set_module_options({"enable_backward": False})

UNREACHED = wp.constant(1.0e18)
D_MAX_CODE = wp.constant(64249)
"""Code of d_max; codes up to 65534 leave a headroom of 2 % until both directions of a pair are averaged."""

DECREASE_TOLERANCE = wp.constant(1.0000006)
"""A distance counts as decreased if it exceeded this times the new one; smaller changes are rounding."""


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
class DistanceLimits:
    """Range and resolution of one shape's distances [mm]."""

    max_encoded: float  # longest distance that has a code
    # One mean edge beyond d_max: a value within d_max may depend on one beyond it.
    propagation_limit: float
    unit: float  # length of one code step


@wp.func_native("return corners.data[index].b;")
def corner_b(corners: wp.array(dtype=Corner), index: int) -> int:
    """Load a corner's vertex b."""
    ...


@wp.func
def straight_path_squared(corner: Corner, da: float, db: float) -> float:
    """Return the squared length of the straight path to c; UNREACHED squared if none crosses ab.

    The path comes from the virtual source below ab that explains da and db (Novotni and Klein 2002). It is
    exact where the surface is flat, in acute and obtuse triangles, and monotone in da and db.
    """
    source_x = ((da - db) * (da + db) + corner.length * corner.length) * corner.half
    # NaN, hence not inside, where no virtual source explains both distances.
    source_depth = wp.sqrt(da * da - source_x * source_x)
    height = source_depth + corner.y
    crossing = source_x * corner.y + corner.x * source_depth
    inside = crossing >= 0.0 and crossing <= corner.length * height
    dx = corner.x - source_x
    return wp.where(inside, dx * dx + height * height, UNREACHED * UNREACHED)


@wp.func
def path_lower_bound(corner: Corner, da: float, db: float) -> float:
    """Return a lower bound of all straight paths through a triangle, valid if |da - db| <= |ab|."""
    return 0.5 * (da + db - corner.length) + corner.y


@wp.func
def encode(distance: float, limits: DistanceLimits) -> wp.uint16:
    """Return the code of a distance, MISSING beyond `max_encoded`."""
    return wp.uint16(wp.where(distance <= limits.max_encoded, int(distance / limits.unit + 0.5), MISSING))


@wp.func
def mean_code(code: int, reverse_code: int) -> wp.uint16:
    """Return the mean code of both directions; MISSING if either is missing or the mean exceeds d_max.

    The two differ by less than 1 % of d_max, so that the headroom keeps every pair within d_max two-sided.
    """
    mean = (code + reverse_code + 1) // 2
    return wp.uint16(wp.where(code == MISSING or reverse_code == MISSING or mean > D_MAX_CODE, MISSING, mean))
