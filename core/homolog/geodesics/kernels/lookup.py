"""Lookups of geodesic distances in kernels: between any two points of a surface.

Kernels of other packages import the structs and functions of this module.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.kernels.memory import load_int

wp.set_module_options({"enable_backward": False})

__all__ = [
    "LANES",
    "MISSING",
    "SurfacePoint",
    "TableData",
    "blocks_of",
    "geodesic",
    "surface_point",
]

LANES = 16
"""Number of sources in a cluster: neighbouring vertices that are solved and stored together."""
MISSING = 65535
"""Code of a pair that is farther apart than the table reaches."""
CornerCodes = wp.types.matrix(shape=(3, 3), dtype=wp.int32)


@wp.struct
class TableData:
    """A geodesic table on a device, from `GeodesicTable.on_device`; an array can hold several."""

    codes: wp.array2d(dtype=wp.uint16)  # (R, LANES) the blocks of all clusters, one after another
    start: wp.array(dtype=wp.int32)  # (C,) first row of each cluster's block
    row: wp.array2d(dtype=wp.uint16)  # (C, V) row of a vertex within the cluster's block, or MISSING
    slot: wp.array(dtype=wp.int32)  # (V,) LANES * cluster + lane of each vertex
    unit: float  # length of one code step


@wp.struct
class SurfacePoint:
    """A point of a triangle, with what the interpolation needs of its corners."""

    corners: wp.vec3i
    weights: wp.vec3  # barycentric
    position: wp.vec3
    spread: wp.vec3  # squared distances from the point to the corners
    variance: float  # sum of weights times spread
    gradients: wp.mat33  # row i: gradient of weight i within the plane of the triangle


@wp.struct
class PairDistance:
    """The geodesic distance of two points, in the table's unit; negative beyond its range."""

    distance: float
    at_x: wp.vec3  # derivative with respect to the first point, in the plane of its triangle
    at_y: wp.vec3


@wp.func_native("return row.data[wp::int64(cluster) * row.shape[1] + vertex];")
def load_row(row: wp.array2d(dtype=wp.uint16), cluster: int, vertex: int) -> int:
    """Load a vertex's row within the block of a cluster."""
    ...


@wp.func_native("return row == 65535 ? 65535 : codes.data[wp::int64(16) * (start + row) + lane];")
def load_code(codes: wp.array2d(dtype=wp.uint16), start: int, row: int, lane: int) -> int:
    """Load a code from a row of a block, MISSING for a missing row."""
    ...


@wp.struct
class Blocks:
    """Where a table holds the codes of a triangle's corners."""

    slot: wp.vec3i
    start: wp.vec3i


@wp.func
def blocks_of(table: TableData, corners: wp.vec3i) -> Blocks:
    """Return the blocks of a triangle's corners: to be done once for the distances from one point to many."""
    blocks = Blocks()
    for i in range(3):
        blocks.slot[i] = load_int(table.slot, corners[i])
        blocks.start[i] = load_int(table.start, blocks.slot[i] // LANES)
    return blocks


@wp.func
def corner_codes(table: TableData, blocks: Blocks, b: wp.vec3i) -> CornerCodes:
    """Return the codes of the corners of one triangle, given by its blocks, and the corners b of another."""
    codes = CornerCodes()
    for i in range(3):
        slot = blocks.slot[i]
        for j in range(3):
            row = load_row(table.row, slot // LANES, b[j])
            codes[i, j] = load_code(table.codes, blocks.start[i], row, slot % LANES)
    return codes


@wp.func
def surface_point(
    vertices: wp.array(dtype=wp.vec3), faces: wp.array(dtype=wp.vec3i), face: int, position: wp.vec3
) -> SurfacePoint:
    """Return the point of a face next to a position, which should lie in or close to the face.

    Weights outside [0, 1] are clamped, so that the result is always a point of the face.
    """
    point = SurfacePoint()
    point.corners = faces[face]
    a = vertices[point.corners[0]]
    b = vertices[point.corners[1]]
    c = vertices[point.corners[2]]
    normal = wp.cross(b - a, c - a)
    scaled = normal / wp.max(wp.dot(normal, normal), 1.0e-30)
    gradient_a = wp.cross(scaled, c - b)
    gradient_b = wp.cross(scaled, a - c)
    gradient_c = wp.cross(scaled, b - a)
    # from each corner's opposite side: no cancellation where a weight is small
    weights = wp.vec3(
        wp.max(wp.dot(gradient_a, position - b), 0.0),
        wp.max(wp.dot(gradient_b, position - c), 0.0),
        wp.max(wp.dot(gradient_c, position - a), 0.0),
    )
    weights = weights / (weights[0] + weights[1] + weights[2])
    point.weights = weights
    point.position = weights[0] * a + weights[1] * b + weights[2] * c
    point.spread = wp.vec3(
        wp.length_sq(a - point.position), wp.length_sq(b - point.position), wp.length_sq(c - point.position)
    )
    point.variance = wp.dot(weights, point.spread)
    point.gradients = wp.matrix_from_rows(gradient_a, gradient_b, gradient_c)
    return point


@wp.func
def geodesic(table: TableData, blocks: Blocks, x: SurfacePoint, y: SurfacePoint) -> PairDistance:
    """Return the geodesic distance D(x, y) and its derivatives by x and by y; blocks are those of x.

    D² = Σ aᵢ bⱼ dᵢⱼ² - Σ aᵢ |vᵢ - x|² - Σ bⱼ |wⱼ - y|² is exact in the plane and smooth at x = y; within one
    triangle D is |x - y|. Derivatives have a length of about 1, 0 where D is 0. D is negative if one of the
    nine vertex distances is out of the table's range.
    """
    pair = PairDistance()
    if x.corners == y.corners:
        # straight, where rounded codes would be a hundredth of an edge off
        difference = x.position - y.position
        pair.at_x = wp.normalize(difference)
        pair.at_y = -pair.at_x
        pair.distance = wp.length(difference)
        return pair
    return interpolate(table.unit, corner_codes(table, blocks, y.corners), x, y)


@wp.func
def interpolate(unit: float, codes: CornerCodes, x: SurfacePoint, y: SurfacePoint) -> PairDistance:
    """Return the geodesic distance of points of different triangles from the codes of their corners."""
    pair = PairDistance()
    along_x = wp.vec3(0.0, 0.0, 0.0)  # y's interpolation at each corner of x
    along_y = wp.vec3(0.0, 0.0, 0.0)
    for i in range(3):
        total = float(0.0)
        for j in range(3):
            code = codes[i, j]
            if code == MISSING:
                pair.distance = -1.0
                return pair
            d = float(code) * unit
            total += y.weights[j] * (d * d)
            along_y[j] = along_y[j] + x.weights[i] * (d * d)
        along_x[i] = total
    squared = wp.dot(x.weights, along_x) - x.variance - y.variance
    if squared <= 1.0e-12 * (x.variance + y.variance):
        return pair
    pair.distance = wp.sqrt(squared)
    # the derivative of x's variance is Σ ∇aᵢ |vᵢ - x|²: the rest cancels, since Σ aᵢ (vᵢ - x) = 0
    pair.at_x = wp.transpose(x.gradients) * (along_x - x.spread) / (2.0 * pair.distance)
    pair.at_y = wp.transpose(y.gradients) * (along_y - y.spread) / (2.0 * pair.distance)
    return pair
