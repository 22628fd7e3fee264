"""Warp functions of the optimizer: smooth field lookup, closest points, the sphere's Log map."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp

wp.set_module_options({"enable_backward": False})

__all__ = [
    "FieldData",
    "FieldPoint",
    "StencilCache",
    "closest_on_triangle",
    "field_curvature",
    "field_point",
    "log_adjoint",
    "log_map",
    "stencil_cache",
    "tangent",
]


@wp.struct
class FieldData:
    """A distance field as cubic B-spline coefficients, addressed in the optimizer's coordinates."""

    coefficients: wp.array(dtype=wp.float32, ndim=3)
    to_index: wp.mat33  # optimizer coordinates -> grid index, linear part
    origin_index: wp.vec3  # grid index of the coordinates' origin
    scale: float  # of the coefficients, to optimizer lengths or radians


@wp.struct
class FieldPoint:
    """Value, gradient and Hessian of a field at a point."""

    value: float
    gradient: wp.vec3
    hessian: wp.mat33


@wp.func
def spline_weights(t: float) -> wp.vec4:
    """Weights of the four cubic B-splines that reach a point t in [0, 1] between two nodes."""
    u = 1.0 - t
    return wp.vec4(
        u * u * u / 6.0,
        (4.0 - 3.0 * t * t * (2.0 - t)) / 6.0,
        (4.0 - 3.0 * u * u * (2.0 - u)) / 6.0,
        t * t * t / 6.0,
    )


@wp.func
def spline_derivatives(t: float) -> wp.vec4:
    """First derivatives of `spline_weights`."""
    u = 1.0 - t
    return wp.vec4(-0.5 * u * u, t * (1.5 * t - 2.0), -u * (1.5 * u - 2.0), 0.5 * t * t)


@wp.func
def spline_second_derivatives(t: float) -> wp.vec4:
    """Second derivatives of `spline_weights`."""
    return wp.vec4(1.0 - t, 3.0 * t - 2.0, 1.0 - 3.0 * t, t)


@wp.func
def base_node(index: float, size: int) -> int:
    """Node below an index, such that the four splines around it lie on the grid."""
    return wp.clamp(int(wp.floor(index)), 1, size - 3)


@wp.struct
class StencilCache:
    """Copies of the 64 coefficients around each particle, which lie far apart in the field; or empty."""

    cells: wp.array(dtype=wp.vec3i)  # whose coefficients they are
    lines: wp.array2d(dtype=wp.vec4)  # 16 along the third axis


def stencil_cache(particles: int, device: str) -> StencilCache:
    """Return the cache of a number of particles, nothing in it; with none, fields are read directly."""
    cache = StencilCache()
    cache.cells = wp.full(particles, wp.vec3i(-1, -1, -1), dtype=wp.vec3i, device=device)
    cache.lines = wp.empty((particles, 16), dtype=wp.vec4, device=device)
    return cache


@wp.struct
class Stencil:
    """A point's cell, and the one-dimensional spline weights and slopes in it."""

    cell: wp.vec3i
    t: wp.vec3  # where in the cell
    wx: wp.vec4
    wy: wp.vec4
    wz: wp.vec4
    dx: wp.vec4
    dy: wp.vec4
    dz: wp.vec4


@wp.func
def coefficient_line(field: FieldData, cell: wp.vec3i, a: int, b: int) -> wp.vec4:
    """Return four coefficients along the third axis, the first ones of a cell for a = b = 0."""
    i = cell[0] + a - 1
    j = cell[1] + b - 1
    return wp.vec4(
        field.coefficients[i, j, cell[2] - 1],
        field.coefficients[i, j, cell[2]],
        field.coefficients[i, j, cell[2] + 1],
        field.coefficients[i, j, cell[2] + 2],
    )


@wp.func
def is_current(cache: StencilCache, p: int, cell: wp.vec3i) -> bool:
    """Return whether the cache, if there is one, has the coefficients of particle p's cell."""
    if cache.cells.shape[0] == 0:
        return True
    return cell == cache.cells[p]


@wp.func
def cached_line(field: FieldData, cache: StencilCache, p: int, s: Stencil, a: int, b: int) -> wp.vec4:
    """Return `coefficient_line` of particle p's stencil, from the cache if there is one."""
    if cache.lines.shape[0] > 0:
        return cache.lines[p, 4 * a + b]
    return coefficient_line(field, s.cell, a, b)


@wp.func
def stencil_at(field: FieldData, cache: StencilCache, p: int, position: wp.vec3) -> Stencil:
    """Return the weights of a position; if particle p left its cell, the cache gets those around it."""
    index = field.to_index * position + field.origin_index
    cell = wp.vec3i(
        base_node(index[0], field.coefficients.shape[0]),
        base_node(index[1], field.coefficients.shape[1]),
        base_node(index[2], field.coefficients.shape[2]),
    )
    if not is_current(cache, p, cell):
        cache.cells[p] = cell
        for line in range(16):
            cache.lines[p, line] = coefficient_line(field, cell, line // 4, line % 4)
    s = Stencil()
    s.cell = cell
    s.t = wp.vec3(index[0] - float(cell[0]), index[1] - float(cell[1]), index[2] - float(cell[2]))
    s.wx = spline_weights(s.t[0])
    s.wy = spline_weights(s.t[1])
    s.wz = spline_weights(s.t[2])
    s.dx = spline_derivatives(s.t[0])
    s.dy = spline_derivatives(s.t[1])
    s.dz = spline_derivatives(s.t[2])
    return s


@wp.func
def field_point(field: FieldData, cache: StencilCache, p: int, position: wp.vec3) -> FieldPoint:
    """Value and gradient at the position of particle p (the Hessian is left zero)."""
    s = stencil_at(field, cache, p, position)
    value = float(0.0)
    gradient = wp.vec3(0.0, 0.0, 0.0)
    for a in range(4):
        for b in range(4):
            line = cached_line(field, cache, p, s, a, b)
            along = wp.dot(s.wz, line)
            value += s.wx[a] * s.wy[b] * along
            gradient += wp.vec3(
                s.dx[a] * s.wy[b] * along,
                s.wx[a] * s.dy[b] * along,
                s.wx[a] * s.wy[b] * wp.dot(s.dz, line),
            )
    result = FieldPoint()
    result.value = value * field.scale
    result.gradient = wp.transpose(field.to_index) * gradient * field.scale
    return result


@wp.func
def field_curvature(field: FieldData, cache: StencilCache, p: int, position: wp.vec3) -> FieldPoint:
    """Value, gradient and Hessian at the position of particle p."""
    s = stencil_at(field, cache, p, position)
    ex = spline_second_derivatives(s.t[0])
    ey = spline_second_derivatives(s.t[1])
    ez = spline_second_derivatives(s.t[2])
    value = float(0.0)
    gradient = wp.vec3(0.0, 0.0, 0.0)
    straight = wp.vec3(0.0, 0.0, 0.0)
    mixed = wp.vec3(0.0, 0.0, 0.0)  # xy, yz, zx
    for a in range(4):
        for b in range(4):
            line = cached_line(field, cache, p, s, a, b)
            along = wp.dot(s.wz, line)
            slope = wp.dot(s.dz, line)
            both = s.wx[a] * s.wy[b]
            value += both * along
            gradient += wp.vec3(s.dx[a] * s.wy[b] * along, s.wx[a] * s.dy[b] * along, both * slope)
            straight += wp.vec3(ex[a] * s.wy[b] * along, s.wx[a] * ey[b] * along, both * wp.dot(ez, line))
            mixed += wp.vec3(s.dx[a] * s.dy[b] * along, s.wx[a] * s.dy[b] * slope, s.dx[a] * s.wy[b] * slope)
    hessian = wp.mat33(
        straight[0],
        mixed[0],
        mixed[2],
        mixed[0],
        straight[1],
        mixed[1],
        mixed[2],
        mixed[1],
        straight[2],
    )
    result = FieldPoint()
    result.value = value * field.scale
    result.gradient = wp.transpose(field.to_index) * gradient * field.scale
    result.hessian = wp.transpose(field.to_index) * hessian * field.to_index * field.scale
    return result


@wp.func
def tangent(vector: wp.vec3, normal: wp.vec3) -> wp.vec3:
    """Part of a vector that is perpendicular to a unit normal."""
    return vector - wp.dot(vector, normal) * normal


@wp.func
def closest_on_triangle(p: wp.vec3, a: wp.vec3, b: wp.vec3, c: wp.vec3) -> wp.vec3:
    """Barycentric weights of a triangle's point nearest to p (Ericson 2005, section 5.1.5)."""
    ab = b - a
    ac = c - a
    ap = p - a
    d1 = wp.dot(ab, ap)
    d2 = wp.dot(ac, ap)
    if d1 <= 0.0 and d2 <= 0.0:
        return wp.vec3(1.0, 0.0, 0.0)
    bp = p - b
    d3 = wp.dot(ab, bp)
    d4 = wp.dot(ac, bp)
    if d3 >= 0.0 and d4 <= d3:
        return wp.vec3(0.0, 1.0, 0.0)
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v = d1 / (d1 - d3)
        return wp.vec3(1.0 - v, v, 0.0)
    cp = p - c
    d5 = wp.dot(ab, cp)
    d6 = wp.dot(ac, cp)
    if d6 >= 0.0 and d5 <= d6:
        return wp.vec3(0.0, 0.0, 1.0)
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        w = d2 / (d2 - d6)
        return wp.vec3(1.0 - w, 0.0, w)
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and (d4 - d3) >= 0.0 and (d5 - d6) >= 0.0:
        w2 = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return wp.vec3(0.0, 1.0 - w2, w2)
    total = va + vb + vc
    return wp.vec3(va / total, vb / total, vc / total)


@wp.func
def log_factor(cosine: float) -> float:
    """Angle over sine, by its series near 0; the cosine is kept away from -1, where Log is not defined."""
    c = wp.max(cosine, -1.0 + 1.0e-4)
    if c > 0.9999:
        return 1.0 + (1.0 - c) / 3.0
    return wp.acos(c) / wp.sqrt(1.0 - c * c)


@wp.func
def log_map(mean: wp.vec3, normal: wp.vec3) -> wp.vec3:
    """Log of a unit normal at the mean normal (the paper's Eq. 4 with root and projector corrected)."""
    c = wp.dot(mean, normal)
    return log_factor(c) * (normal - c * mean)


@wp.func
def log_adjoint(mean: wp.vec3, normal: wp.vec3, g: wp.vec3) -> wp.vec3:
    """Transposed derivative of `log_map` by the normal, applied to g (mean held)."""
    c = wp.dot(mean, normal)
    r = log_factor(c)
    slope = float(-1.0 / 3.0)
    if c <= 0.9999:
        safe = wp.max(c, -1.0 + 1.0e-4)
        slope = (safe * r - 1.0) / (1.0 - safe * safe)
    return r * (g - wp.dot(g, mean) * mean) + slope * wp.dot(g, normal - c * mean) * mean
