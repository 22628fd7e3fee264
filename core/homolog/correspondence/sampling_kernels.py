"""Sampling entropy on the device: neighbours, Parzen widths, forces (conventions as in `kernels`)."""

import warp as wp

from homolog.correspondence.functions import tangent
from homolog.correspondence.kernels import Layout, Surface
from homolog.geodesics.kernels.lookup import SurfacePoint, geodesic

wp.set_module_options({"enable_backward": False})

__all__ = ["CUTOFF", "WIDEST", "link_neighbors", "repel", "spread", "yield_back"]

NORMAL_CUTOFF = wp.constant(0.3)  # cosine below which Cates et al.'s filter weakens an interaction
CUTOFF = 3.5  # Parzen widths at which a kernel of 0.2 % is cut off
WIDEST = 1.2  # largest Parzen width, over that of an even layout
REACHED = wp.constant(CUTOFF)
WIDE = wp.constant(WIDEST)
NARROW = wp.constant(0.1)
LOOKUP_SQUARED = wp.constant(0)


@wp.kernel
def spread(
    per_shape: int,
    side: int,
    apart: float,
    positions: wp.array(dtype=wp.vec3),
    spread_positions: wp.array(dtype=wp.vec3),
):
    """Move the shapes apart, so that one hash grid serves them all.

    They fill a cube, `side` in a row: the grid repeats itself, and in one long row those that come to lie in
    the same cells grow with the number of shapes, and with them the candidates of every particle.
    """
    p = wp.tid()
    k = p // per_shape
    place = wp.vec3(float(k % side), float(k // side % side), float(k // (side * side)))
    spread_positions[p] = positions[p] + apart * place


@wp.kernel
def link_neighbors(
    first: int,
    c: Layout,
    grid: wp.uint64,
    surfaces: wp.array(dtype=Surface),
    spread_positions: wp.array(dtype=wp.vec3),
    feet: wp.array(dtype=SurfacePoint),
    neighbors: wp.array(dtype=int, ndim=2),
    counts: wp.array(dtype=int),
):
    """List the particles of the same shape within reach, by the metric in force.

    Where more are in reach than a row holds, the rest are left out and `counts` tells.
    """
    p = first + wp.tid()
    shape = p // c.per_shape
    if surfaces[shape].held == 1:
        return
    table = surfaces[shape].table  # once: a copy of this struct costs more than a lookup
    x = spread_positions[p]
    foot = feet[p]
    count = int(0)
    reach = c.reach * surfaces[shape].size
    query = wp.hash_grid_query(grid, x, reach)
    other = int(0)
    while wp.hash_grid_query_next(query, other):
        near = wp.length(spread_positions[other] - x) < reach
        if other != p and other // c.per_shape == shape and near:
            d = float(0.0)
            if c.geodesic == 1:
                d = geodesic(table, foot, feet[other], LOOKUP_SQUARED)[3]
            if d >= 0.0 and d < reach:
                if count < neighbors.shape[1]:
                    neighbors[p, count] = other
                count += 1
    counts[p] = count


@wp.kernel
def repel(
    first: int,
    c: Layout,
    surfaces: wp.array(dtype=Surface),
    positions: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    feet: wp.array(dtype=SurfacePoint),
    neighbors: wp.array(dtype=int, ndim=2),
    counts: wp.array(dtype=int),
    widths: wp.array(dtype=float),
    next_widths: wp.array(dtype=float),
    masses: wp.array(dtype=float),
    pairs: wp.array(dtype=wp.vec4, ndim=2),
    forces: wp.array(dtype=wp.vec3),
    energies: wp.array(dtype=float),
):
    """Find the Parzen width by its fixed point, the energy log A_i - 3 log s_i and its descent force.

    p(x_i) ~ A_i / s_i^3 with A_i = sum_j q_ij exp(-d_ij^2 / 2 s_i^2); s_i makes the energy stationary
    (s^2 = sum q w d^2 / 3 sum q w), so its derivative drops out of the gradient. One round of that
    iteration is made here, for the next call.
    """
    p = first + wp.tid()
    shape = p // c.per_shape
    if surfaces[shape].held == 1:
        return
    x = positions[p]
    n = normals[p]
    foot = feet[p]
    table = surfaces[shape].table
    count = wp.min(counts[p], neighbors.shape[1])
    for k in range(count):
        j = neighbors[p, k]
        pair = wp.vec4(0.0, 0.0, 0.0, -1.0)
        if c.geodesic == 1:
            found = geodesic(table, foot, feet[j], LOOKUP_SQUARED)
            away = tangent(wp.vec3(found[0], found[1], found[2]), n)
            size = wp.length(away)
            if found[3] >= 0.0 and size > 1.0e-6:
                pair = wp.vec4(away[0] / size, away[1] / size, away[2] / size, found[3])
        else:
            straight = x - positions[j]
            d = wp.length(straight)
            away = tangent(straight, n)
            if d > 1.0e-9:
                pair = wp.vec4(away[0] / d, away[1] / d, away[2] / d, d)
        pairs[p, k] = pair
    s = widths[p]
    mass = float(0.0)
    spread2 = float(0.0)
    push = wp.vec3(0.0, 0.0, 0.0)
    for k in range(count):
        pair = pairs[p, k]
        d = pair[3]
        if d >= 0.0 and d < REACHED * s:
            w = wp.exp(-0.5 * d * d / (s * s))
            if c.geodesic == 0:
                w = w * facing(n, normals[neighbors[p, k]])
            mass += w
            spread2 += w * d * d
            push += w * d * wp.vec3(pair[0], pair[1], pair[2])
    even = c.expected_width * surfaces[shape].size
    wanted = WIDE * even
    if mass > 1.0e-12:
        wanted = wp.sqrt(spread2 / (3.0 * mass))
    next_widths[p] = wp.clamp(0.5 * (s + wanted), NARROW * even, WIDE * even)
    masses[p] = wp.max(mass * s * s, 1.0e-12)
    forces[p] = push / wp.max(mass * s * s, 1.0e-12)
    energies[p] = wp.log(wp.max(mass, 1.0e-12)) - 3.0 * wp.log(s)


@wp.kernel
def yield_back(
    first: int,
    c: Layout,
    normals: wp.array(dtype=wp.vec3),
    neighbors: wp.array(dtype=int, ndim=2),
    counts: wp.array(dtype=int),
    widths: wp.array(dtype=float),
    masses: wp.array(dtype=float),
    pairs: wp.array(dtype=wp.vec4, ndim=2),
    forces: wp.array(dtype=wp.vec3),
):
    """Add to the sampling force how each neighbour's own energy changes as this particle moves."""
    p = first + wp.tid()
    push = wp.vec3(0.0, 0.0, 0.0)
    for k in range(wp.min(counts[p], neighbors.shape[1])):
        pair = pairs[p, k]
        j = neighbors[p, k]
        d = pair[3]
        s = widths[j]
        if d >= 0.0 and d < REACHED * s:
            w = wp.exp(-0.5 * d * d / (s * s))
            if c.geodesic == 0:
                w = w * facing(normals[p], normals[j])
            push += w * d / masses[j] * wp.vec3(pair[0], pair[1], pair[2])
    forces[p] = forces[p] + push


@wp.func
def facing(a: wp.vec3, b: wp.vec3) -> float:
    """Cates et al.'s numerical filter: 1 for like normals, cosine fall-off to 0 for opposite ones."""
    cosine = wp.dot(a, b)
    if cosine >= NORMAL_CUTOFF:
        return 1.0
    return wp.cos(0.5 * wp.pi * (NORMAL_CUTOFF - cosine) / (NORMAL_CUTOFF + 1.0))
