"""Sampling entropy on the device: neighbours, Parzen widths, forces (conventions as in `kernels`)."""

import warp as wp

from homolog.correspondence.kernels.functions import tangent
from homolog.correspondence.kernels.particles import Layout, Surface, rim_at
from homolog.geodesics.kernels.lookup import (
    Blocks,
    CornerCodes,
    PairDistance,
    SurfacePoint,
    TableData,
    blocks_of,
    corner_codes,
    geodesic,
    interpolate,
)

wp.set_module_options({"enable_backward": False})

__all__ = [
    "CUTOFF",
    "MAX_WIDTH_RATIO",
    "PairCodes",
    "add_reaction_forces",
    "compute_forces",
    "find_rims",
    "link_back",
    "link_neighbours",
    "measure_pairs",
    "spread",
]

MIN_FILTER_COSINE = wp.constant(0.3)  # cosine below which Cates et al.'s filter weakens an interaction
CUTOFF = 3.5  # Parzen widths at which a kernel of 0.2 % is cut off
MAX_WIDTH_RATIO = 1.2  # largest Parzen width, over that of an even layout
CUTOFF_RATIO = wp.constant(CUTOFF)
MAX_WIDTH = wp.constant(MAX_WIDTH_RATIO)
MIN_WIDTH = wp.constant(0.1)
ON_RIM = wp.constant(0.05)
"""Distance from the rim of a particle on it, in Parzen widths of an even layout: enough to leave it."""
STRAIGHT_MARGIN = wp.constant(1.05)  # geodesic distances are interpolated, and may be that much too short


@wp.kernel
def spread(
    per_shape: int,
    side: int,
    spacing: float,
    positions: wp.array(dtype=wp.vec3),
    spread_positions: wp.array(dtype=wp.vec3),
):
    """Place the shapes in a cube of `side` per row, apart from each other, so that they share one hash grid.

    The hash grid is periodic: along one row, the number of shapes in the same cells would grow with the
    number of shapes.
    """
    p = wp.tid()
    k = p // per_shape
    cell = wp.vec3(float(k % side), float(k // side % side), float(k // (side * side)))
    spread_positions[p] = positions[p] + spacing * cell


ShortCodes = wp.types.matrix(shape=(3, 3), dtype=wp.uint16)


@wp.struct
class PairCodes:
    """Codes of two faces in the geodesic table, whose rows lie far apart; kept for a pair of neighbours."""

    face: int  # number from 1, 0 if nothing is kept
    other_face: int
    codes: ShortCodes


@wp.func
def pair_distance(
    table: TableData,
    blocks: Blocks,
    known: wp.array(dtype=PairCodes, ndim=2),
    faces: wp.array(dtype=int),
    p: int,
    k: int,
    j: int,
    x: SurfacePoint,
    y: SurfacePoint,
) -> PairDistance:
    """Return the geodesic distance of particle p from j, its k-th neighbour.

    The table is read only if one of them has left its face; without `known`, or beyond its rows, always.
    """
    if k >= known.shape[1] or x.corners == y.corners:
        return geodesic(table, blocks, x, y)
    face = faces[p] + 1
    other_face = faces[j] + 1
    codes = CornerCodes()
    if known[p, k].face == face and known[p, k].other_face == other_face:
        for a in range(3):
            for b in range(3):
                codes[a, b] = int(known[p, k].codes[a, b])
    else:
        codes = corner_codes(table, blocks, y.corners)
        pair = PairCodes()
        pair.face = face
        pair.other_face = other_face
        for a in range(3):
            for b in range(3):
                pair.codes[a, b] = wp.uint16(codes[a, b])
        known[p, k] = pair
    return interpolate(table.unit, codes, x, y)


@wp.kernel
def link_neighbours(
    first: int,
    c: Layout,
    grid: wp.uint64,
    surfaces: wp.array(dtype=Surface),
    spread_positions: wp.array(dtype=wp.vec3),
    faces: wp.array(dtype=int),
    closest: wp.array(dtype=SurfacePoint),
    known: wp.array(dtype=PairCodes, ndim=2),
    neighbours: wp.array(dtype=int, ndim=2),
    counts: wp.array(dtype=int),
    places: wp.array(dtype=wp.int8, ndim=2),
):
    """List the particles of the same shape within the cutoff, by geodesic or straight distance.

    `places` are all -1 then. `counts` holds the number of neighbours, also where it exceeds the length of a
    row.
    """
    p = first + wp.tid()
    shape = p // c.per_shape
    if surfaces[shape].fixed == 1:
        return
    table = surfaces[shape].table  # one copy: copying this struct costs more than a lookup
    x = spread_positions[p]
    closest_point = closest[p]
    blocks = Blocks()
    if c.geodesic == 1:
        blocks = blocks_of(table, closest_point.corners)
    count = int(0)
    cutoff = c.list_cutoff * surfaces[shape].size
    query = wp.hash_grid_query(grid, x, cutoff)
    other = int(0)
    while wp.hash_grid_query_next(query, other):
        near = wp.length(spread_positions[other] - x) < cutoff
        if other != p and other // c.per_shape == shape and near:
            d = float(0.0)
            if c.geodesic == 1:
                d = pair_distance(
                    table, blocks, known, faces, p, count, other, closest_point, closest[other]
                ).distance
            if d >= 0.0 and d < cutoff:
                if count < neighbours.shape[1]:
                    neighbours[p, count] = other
                    places[p, count] = wp.int8(-1)
                count += 1
    counts[p] = count


@wp.kernel
def link_back(
    first: int,
    neighbours: wp.array(dtype=int, ndim=2),
    counts: wp.array(dtype=int),
    places: wp.array(dtype=wp.int8, ndim=2),
):
    """Find the place of each particle in the lists of its neighbours; -1 if it is in none.

    The particle of lower index writes both places.
    """
    p = first + wp.tid()
    for k in range(wp.min(counts[p], neighbours.shape[1])):
        j = neighbours[p, k]
        if p < j:
            for place in range(wp.min(counts[j], neighbours.shape[1])):
                if neighbours[j, place] == p:
                    places[p, k] = wp.int8(place)
                    places[j, place] = wp.int8(k)


@wp.kernel
def measure_pairs(
    first: int,
    c: Layout,
    surfaces: wp.array(dtype=Surface),
    positions: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    faces: wp.array(dtype=int),
    closest: wp.array(dtype=SurfacePoint),
    known: wp.array(dtype=PairCodes, ndim=2),
    neighbours: wp.array(dtype=int, ndim=2),
    counts: wp.array(dtype=int),
    places: wp.array(dtype=wp.int8, ndim=2),
    widths: wp.array(dtype=float),
    pairs: wp.array(dtype=wp.vec4, ndim=2),
):
    """Measure the distance to each neighbour, and the direction away from it in the tangent plane.

    Each pair is measured once, for both of its particles. The distance is -1 where it is beyond the cutoff of
    both, or out of the table's range.
    """
    p = first + wp.tid()
    shape = p // c.per_shape
    if surfaces[shape].fixed == 1:
        return
    x = positions[p]
    n = normals[p]
    s = widths[p]
    closest_point = closest[p]
    table = surfaces[shape].table
    blocks = Blocks()
    if c.geodesic == 1:
        blocks = blocks_of(table, closest_point.corners)
    for k in range(wp.min(counts[p], neighbours.shape[1])):
        j = neighbours[p, k]
        place = int(places[p, k])
        if place < 0 or p < j:
            own = wp.vec4(0.0, 0.0, 0.0, -1.0)
            other = own
            straight = x - positions[j]
            reach = STRAIGHT_MARGIN * CUTOFF_RATIO * wp.max(s, widths[j])
            if wp.length_sq(straight) < reach * reach:
                if c.geodesic == 1:
                    pair = pair_distance(table, blocks, known, faces, p, k, j, closest_point, closest[j])
                    own = away(pair.at_x, n, pair.distance)
                    other = away(pair.at_y, normals[j], pair.distance)
                else:
                    d = wp.length(straight)
                    own = away(straight / d, n, d)
                    other = away(-straight / d, normals[j], d)
            pairs[p, k] = own
            if place >= 0:
                pairs[j, place] = other


@wp.func
def away(derivative: wp.vec3, normal: wp.vec3, distance: float) -> wp.vec4:
    """Return the derivative's direction in the tangent plane, and the distance; -1 if there is none."""
    direction = tangent(derivative, normal)
    size = wp.length(direction)
    if distance >= 0.0 and size > 1.0e-6:
        return wp.vec4(direction[0] / size, direction[1] / size, direction[2] / size, distance)
    return wp.vec4(0.0, 0.0, 0.0, -1.0)


@wp.kernel
def find_rims(
    first: int,
    c: Layout,
    surfaces: wp.array(dtype=Surface),
    closest: wp.array(dtype=SurfacePoint),
    rims: wp.array(dtype=wp.vec4),
):
    """Find the direction away from the nearest rim, and the distance from it; infinite without a rim.

    A particle on the rim itself, which its mirror image would hold there, counts as a little inside.
    """
    p = first + wp.tid()
    s = surfaces[p // c.per_shape]
    rims[p] = wp.vec4(0.0, 0.0, 0.0, wp.inf)
    if s.rims.shape[0] > 0:
        here = rim_at(s, closest[p])
        here[3] = wp.max(here[3], ON_RIM * c.expected_width * s.size)
        rims[p] = here


@wp.func
def mirrored(pair: wp.vec4, here: wp.vec4, there: wp.vec4) -> wp.vec4:
    """Return the distance from a neighbour's mirror image beyond the rim, and its derivative.

    Where the rim is straight and the surface flat, d'² = d² + 4ab with the distances a and b of the two
    from the rim. Densities are then those of a surface without rim: they neither push particles over it nor
    gather them there. -1 if the image is out of reach.
    """
    image = wp.vec4(0.0, 0.0, 0.0, -1.0)
    if pair[3] >= 0.0 and here[3] + there[3] < 1.0e9:
        d = wp.sqrt(pair[3] * pair[3] + 4.0 * here[3] * there[3])
        for k in range(3):
            image[k] = (pair[3] * pair[k] + 2.0 * there[3] * here[k]) / d
        image[3] = d
    return image


@wp.kernel
def compute_forces(
    first: int,
    c: Layout,
    surfaces: wp.array(dtype=Surface),
    normals: wp.array(dtype=wp.vec3),
    neighbours: wp.array(dtype=int, ndim=2),
    counts: wp.array(dtype=int),
    pairs: wp.array(dtype=wp.vec4, ndim=2),
    rims: wp.array(dtype=wp.vec4),
    widths: wp.array(dtype=float),
    next_widths: wp.array(dtype=float),
    masses: wp.array(dtype=float),
    forces: wp.array(dtype=wp.vec3),
    energies: wp.array(dtype=float),
):
    """Compute the energy log A_i - 3 log s_i, its descent force, and the next Parzen width.

    p(x_i) ~ A_i / s_i^3 with A_i = sum_j q_ij exp(-d_ij^2 / 2 s_i^2). The width s_i makes the energy
    stationary (s^2 = sum q w d^2 / 3 sum q w), so that its derivative drops out of the gradient. Each call
    makes one fixed-point iteration.
    """
    p = first + wp.tid()
    shape = p // c.per_shape
    if surfaces[shape].fixed == 1:
        return
    n = normals[p]
    s = widths[p]
    mass = float(0.0)
    squared_spread = float(0.0)
    force = wp.vec3(0.0, 0.0, 0.0)
    for k in range(wp.min(counts[p], neighbours.shape[1])):
        pair = pairs[p, k]
        d = pair[3]
        if d >= 0.0 and d < CUTOFF_RATIO * s:
            w = wp.exp(-0.5 * d * d / (s * s))
            if c.geodesic == 0:
                w = w * normal_filter(n, normals[neighbours[p, k]])
            mass += w
            squared_spread += w * d * d
            force += w * d * wp.vec3(pair[0], pair[1], pair[2])
        if rims.shape[0] > 0:
            image = mirrored(pair, rims[p], rims[neighbours[p, k]])
            d = image[3]
            if d >= 0.0 and d < CUTOFF_RATIO * s:
                w = wp.exp(-0.5 * d * d / (s * s))
                if c.geodesic == 0:
                    w = w * normal_filter(n, normals[neighbours[p, k]])
                mass += w
                squared_spread += w * d * d
                force += w * d * wp.vec3(image[0], image[1], image[2])
    if rims.shape[0] > 0:  # its own image, which moves as fast in the other direction
        d = 2.0 * rims[p][3]
        if d < CUTOFF_RATIO * s:
            w = wp.exp(-0.5 * d * d / (s * s))
            mass += w
            squared_spread += w * d * d
            force += 2.0 * w * d * wp.vec3(rims[p][0], rims[p][1], rims[p][2])
    even = c.expected_width * surfaces[shape].size
    fixed_point = MAX_WIDTH * even
    if mass > 1.0e-12:
        fixed_point = wp.sqrt(squared_spread / (3.0 * mass))
    next_widths[p] = wp.clamp(0.5 * (s + fixed_point), MIN_WIDTH * even, MAX_WIDTH * even)
    masses[p] = wp.max(mass * s * s, 1.0e-12)
    forces[p] = force / wp.max(mass * s * s, 1.0e-12)
    energies[p] = wp.log(wp.max(mass, 1.0e-12)) - 3.0 * wp.log(s)


@wp.kernel
def add_reaction_forces(
    first: int,
    c: Layout,
    normals: wp.array(dtype=wp.vec3),
    neighbours: wp.array(dtype=int, ndim=2),
    counts: wp.array(dtype=int),
    widths: wp.array(dtype=float),
    masses: wp.array(dtype=float),
    pairs: wp.array(dtype=wp.vec4, ndim=2),
    rims: wp.array(dtype=wp.vec4),
    forces: wp.array(dtype=wp.vec3),
):
    """Add the derivative of the neighbours' energies by this particle's position."""
    p = first + wp.tid()
    force = wp.vec3(0.0, 0.0, 0.0)
    for k in range(wp.min(counts[p], neighbours.shape[1])):
        pair = pairs[p, k]
        j = neighbours[p, k]
        d = pair[3]
        s = widths[j]
        if d >= 0.0 and d < CUTOFF_RATIO * s:
            w = wp.exp(-0.5 * d * d / (s * s))
            if c.geodesic == 0:
                w = w * normal_filter(normals[p], normals[j])
            force += w * d / masses[j] * wp.vec3(pair[0], pair[1], pair[2])
        if rims.shape[0] > 0:
            image = mirrored(pair, rims[p], rims[j])
            d = image[3]
            if d >= 0.0 and d < CUTOFF_RATIO * s:
                w = wp.exp(-0.5 * d * d / (s * s))
                if c.geodesic == 0:
                    w = w * normal_filter(normals[p], normals[j])
                force += w * d / masses[j] * wp.vec3(image[0], image[1], image[2])
    forces[p] = forces[p] + force


@wp.func
def normal_filter(a: wp.vec3, b: wp.vec3) -> float:
    """Return Cates et al.'s weight: 1 for similar normals, with a cosine fall-off to 0 for opposite ones."""
    cosine = wp.dot(a, b)
    if cosine >= MIN_FILTER_COSINE:
        return 1.0
    return wp.cos(0.5 * wp.pi * (MIN_FILTER_COSINE - cosine) / (MIN_FILTER_COSINE + 1.0))
