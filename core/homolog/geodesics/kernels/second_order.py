"""Second order: distances are corrected by the directions from which shortest paths arrive.

The first-order update assumes that both ends of an edge see one virtual source. Behind a bump or a hollow
they see two images of it, whose directions differ by the curvature between them. The *arrival* direction at
a vertex gives the derivative of the distance along every edge there. Values and derivatives at both ends
determine the distance along the edge to one order more (cubic Hermite interpolation).
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.kernels.local_solver import UNREACHED, Corner, trace

wp.set_module_options({"enable_backward": False})

PI = wp.constant(3.14159265)
HALF_PI = wp.constant(1.57079633)
CANDIDATE_TOLERANCE = wp.constant(0.05)
"""A path is a candidate if it exceeds the shortest by less than this fraction of a mean edge."""
CANDIDATE_PENALTY = wp.constant(4.0)
"""Beyond half the tolerance a candidate is penalized by this factor times the excess, so that it is dropped
continuously."""
LAST_CANDIDATE_BIT = wp.constant(30)
"""Each candidate corner is one bit; this bit stands for corner 30 and all after it."""
BLEND_EDGE_FRACTION = wp.constant(0.01)
"""Paths that exceed the shortest by less than this fraction of a mean edge are blended into the arrival
direction, so that it is continuous where two paths are equally long."""
INTERIOR_SIDE_FRACTION = wp.constant(0.1)
"""A path that crosses an edge closer to its end than this fraction of the edge gets less weight."""
MIN_PATH_WEIGHT = wp.constant(0.01)
"""Weight of a path through the end itself or through a triangle with a short side."""
MAX_ARRIVAL_VARIANCE = wp.constant(0.04)
"""Variance [rad²] of the arrival directions of equally long paths above which they are two fronts."""
SHORT_SIDE_EDGE_FRACTION = wp.constant(0.03)
"""Triangles with a side shorter than this fraction of a mean edge determine no arrival direction."""
MAX_IMAGE_ANGLE = wp.constant(0.4)
"""Angle [rad] between two images of the source from which they begin to count as two fronts; from twice the
angle they do so fully."""
MAX_RELATIVE_CORRECTION = wp.constant(0.1)
"""Largest correction by one triangle, as a fraction of the distance; more means two fronts, not curvature."""
UPWIND_MARGIN = wp.constant(0.1)
"""An edge endpoint gets less weight if it is closer to the source than the updated vertex by less than this
fraction of their separation."""
MIN_UPWIND_WEIGHT = wp.constant(1.0e-2)
"""Weight of an endpoint that is not upwind: small, but well above rounding."""
COINCIDENT_EDGE_FRACTION = wp.constant(1.0e-3)
"""An endpoint closer to the vertex than this fraction of a mean edge gets more weight, up to 1: for nearly
coincident vertices, rounding decides which is upwind."""
GRAZING_EDGE_FRACTION = wp.constant(5.0e-4)
"""The path through a triangle and those along its edges are blended where their lengths differ by less than
this fraction of a mean edge: rounding decides which is the shortest."""
CORRECTION_STEP = wp.constant(1.0e-4)
"""Quantum of corrections, as a fraction of a mean edge: smaller changes do not propagate."""
FINE_CORRECTION_STEP = wp.constant(1.0e-5)
"""Quantum at vertices with a short side. Corrections of nearly coincident vertices depend on each other
cyclically and change by little in each round."""
INITIAL_CORRECTION = wp.constant(1.0)
"""Initial correction of vertices with a short side, as a fraction of a mean edge: an upper bound. Started
from below, corrections of nearly coincident vertices would creep upwards for many rounds."""
MAX_ROUNDS = wp.constant(100)
"""Limit on the rounds of corrections. Seven are typical; the poles of a globe take some dozens."""


@wp.struct
class CornerAngles:
    """Directions [rad] of a corner's edges at their ends, counterclockwise, and the cone angles there."""

    angle_a: float  # of ab, at a
    cone_angle_a: float  # sum of all angles at a
    angle_b: float  # of ba, at b
    cone_angle_b: float
    angle_c: float  # of ca, at c
    cone_angle_c: float


@wp.struct
class UpdateStencil:
    """How c's correction follows from those of a and b: offset + (1 - weight_b) * a's + weight_b * b's."""

    offset: float
    weight_b: float


@wp.func
def edge_slope(direction: float, arrival: float, cone_angle: float) -> float:
    """Return the derivative of the distance along an edge: the cosine of its angle to the arrival direction.

    The angle is the smaller of the two around the vertex, at most pi. The series is exact to 4e-6.
    """
    apart = wp.abs(direction - arrival)
    angle = HALF_PI - wp.min(wp.min(apart, cone_angle - apart), PI)
    s = angle * angle
    return angle * (1.0 + s * (-0.166666567 + s * (8.33297e-3 + s * (-1.98096e-4 + s * 2.6e-6))))


@wp.func
def angle_from_edge(rise: float, run: float) -> float:
    """Return the angle in [0, pi] whose tangent is rise / run, for rise >= 0.

    The series (Abramowitz and Stegun 4.4.49) is exact to 1e-5 rad.
    """
    size = wp.abs(run)
    t = wp.min(rise, size) / wp.max(wp.max(rise, size), 1.0e-30)
    s = t * t
    arc = t * (0.9998660 + s * (-0.3302995 + s * (0.1801410 + s * (-0.0851330 + s * 0.0208351))))
    arc = wp.where(rise > size, HALF_PI - arc, arc)
    return wp.where(run < 0.0, PI - arc, arc)


@wp.struct
class Path:
    """A path through a triangle to its corner c."""

    distance: float  # at c
    arrival: float  # direction at c
    weight: float  # among equally long paths
    along_a: int  # 1 if it follows the edge ac
    along_b: int  # 1 if it follows the edge bc
    degenerate: float  # 1 if the triangle has a short side


@wp.func
def find_path(corner: Corner, angles: CornerAngles, da: float, db: float, edge: float) -> Path:
    """Return the shortest path through a triangle.

    Paths along an edge, and paths through triangles with a short side (where rounding decides which is the
    shortest), get the least weight. The weight fades continuously.
    """
    path = Path()
    ray = trace(corner, da, db)
    run = corner.ac * corner.ac - corner.x * ray.crossing
    path.distance = ray.distance
    path.along_a = wp.where(ray.via_edge == 1, 1, 0)
    path.along_b = wp.where(ray.via_edge == 2, 1, 0)
    path.arrival = angles.angle_c + angle_from_edge(corner.y * ray.crossing, run)
    path.degenerate = wp.where(
        wp.min(corner.length, wp.min(corner.ac, corner.bc)) < SHORT_SIDE_EDGE_FRACTION * edge, 1.0, 0.0
    )
    inner = wp.min(ray.crossing, corner.length - ray.crossing) * (2.0 * corner.half / INTERIOR_SIDE_FRACTION)
    path.weight = MIN_PATH_WEIGHT + wp.min(inner, 1.0 - path.degenerate)
    return path


@wp.func
def initial_correction(shortest: float, edge: float) -> float:
    """Return a vertex's initial correction, from its shortest side and the mean edge."""
    return wp.where(shortest < SHORT_SIDE_EDGE_FRACTION * edge, INITIAL_CORRECTION * edge, 0.0)


@wp.func
def correction_step(shortest: float, edge: float) -> float:
    """Return the quantum of a vertex's corrections, from its shortest side and the mean edge."""
    return wp.where(shortest < SHORT_SIDE_EDGE_FRACTION * edge, FINE_CORRECTION_STEP, CORRECTION_STEP) * edge


@wp.func
def has_changed(old: float, new: float, step: float) -> bool:
    """Return whether a correction has moved to another multiple of the quantum.

    Changes are quantized, not thresholded: a series of changes below a threshold would never propagate.
    """
    inverse = 1.0 / step
    return wp.floor(new * inverse) != wp.floor(old * inverse)


@wp.func
def blend_weight(path: float, best: float, edge: float) -> float:
    """Return the weight, 0 … 1, of a path in the arrival direction, from its length and the shortest's."""
    return wp.min(wp.max(1.0 - (path - best) * (1.0 / (BLEND_EDGE_FRACTION * edge)), 0.0), 1.0)


@wp.func
def angle_between(arrival: float, other: float, cone_angle: float) -> float:
    """Return the signed angle from one direction to another, at most half the cone angle."""
    turn = other - arrival
    turn = wp.where(turn > 0.5 * cone_angle, turn - cone_angle, turn)
    return wp.where(turn < -0.5 * cone_angle, turn + cone_angle, turn)


@wp.func
def wrap_angle(arrival: float, cone_angle: float) -> float:
    """Return the same direction in [0, cone_angle]."""
    turned = wp.where(arrival < 0.0, arrival + cone_angle, arrival)
    return wp.where(turned > cone_angle, turned - cone_angle, turned)


@wp.func
def arrival_confidence(square: float, mean: float) -> float:
    """Return the confidence, 0 … 1, in a mean arrival direction, from the mean and mean square deviation."""
    return wp.max(wp.min(2.0 - (square - mean * mean) / MAX_ARRIVAL_VARIANCE, 1.0), 0.0)


@wp.func
def curvature_weight(apart: float) -> float:
    """Return the weight, 0 … 1, of an angle between images as curvature; its unit is MAX_IMAGE_ANGLE."""
    return wp.max(wp.min(2.0 - wp.abs(apart), 1.0), 0.0)


@wp.func
def upwind_weight(lead: float, separation: float, edge: float) -> float:
    """Return the weight, 0 … 1, of an endpoint that is closer to the source by `lead`."""
    least = wp.max(1.0 - separation * (1.0 / (COINCIDENT_EDGE_FRACTION * edge)), MIN_UPWIND_WEIGHT)
    return wp.max(wp.min(lead / (UPWIND_MARGIN * separation), 1.0), least)


@wp.func
def corner_stencil(
    corner: Corner,
    angles: CornerAngles,
    da: float,
    db: float,
    arrival_a: float,
    arrival_b: float,
    confidence_a: float,
    confidence_b: float,
    u: float,
    edge: float,
) -> UpdateStencil:
    """Return a corner's update stencil, from the distances and arrival directions at a and b.

    Along ab the squared distance is D² = D0² + x (L - x) (p (L - x) + q x) / L². D0 is the distance from the
    virtual source that explains da and db; p and q give the derivatives at a and b (cubic Hermite).

    Parameters
    ----------
    arrival_a, arrival_b, confidence_a, confidence_b : float
        Arrival directions at a and b, and their confidences.
    u : float
        Distance at c, to which the offset is relative; the offset is UNREACHED if the path is no candidate.
    """
    stencil = UpdateStencil()
    ray = trace(corner, da, db)
    below = wp.max(ray.source_depth, 1.0e-12)
    before = wp.max(ray.to_crossing, 1.0e-12)
    inverse = 1.0 / (below * before)
    p = 2.0 * (ray.source_x - da * edge_slope(angles.angle_a, arrival_a, angles.cone_angle_a))
    slope_b = edge_slope(angles.angle_b, arrival_b, angles.cone_angle_b)
    q = 2.0 * (corner.length - db * slope_b - ray.source_x)
    per_angle = (0.5 / MAX_IMAGE_ANGLE) * before * inverse  # 1 / (2 MAX_IMAGE_ANGLE depth)
    p = p * confidence_a * curvature_weight(p * per_angle)
    q = q * confidence_b * curvature_weight(q * per_angle)
    z = 2.0 * corner.half * ray.crossing
    bend = 0.5 * ray.crossing * (1.0 - z) * (p * (1.0 - z) + q * z) * below * inverse
    most = MAX_RELATIVE_CORRECTION * before
    # UNREACHED in place of "and", which would prevent vectorization of the lane loop.
    straight = wp.where(ray.via_edge != 0, UNREACHED, ray.distance) + wp.clamp(bend, -most, most)
    via_a = da + corner.ac
    via_b = db + corner.bc
    side = wp.min(via_a, via_b)
    through = straight < side
    # Not from an end that is farther than c: the dependency would be cyclic.
    along = wp.where(wp.where(via_a <= via_b, da, db) < u, side, UNREACHED)
    excess = ray.distance - u
    penalty = CANDIDATE_PENALTY * wp.max(excess - 0.5 * CANDIDATE_TOLERANCE * edge, 0.0)
    stencil.offset = wp.where(
        excess < CANDIDATE_TOLERANCE * edge, wp.where(through, straight, along) - u + penalty, UNREACHED
    )
    # Only ends closer than c count, so that dependencies are acyclic.
    weight_a = (1.0 - z) * upwind_weight(u - da, corner.ac, edge)
    weight_b = z * upwind_weight(u - db, corner.bc, edge)
    grazed = 1.0 / (GRAZING_EDGE_FRACTION * edge)
    of_sides = wp.clamp(0.5 + 0.5 * grazed * (via_a - via_b), 0.0, 1.0)
    crosses = wp.where(through, wp.min(grazed * (side - straight), 1.0), 0.0)
    stencil.weight_b = of_sides + crosses * (weight_b / (weight_a + weight_b) - of_sides)
    return stencil
