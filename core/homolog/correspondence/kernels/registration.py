"""Kernels of the first particles: distances of shapes, and closest points of a deformed source."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp

wp.set_module_options({"enable_backward": False, "fast_math": False})

__all__ = ["N_MATCHES", "choose_far_points", "match_control_points", "multiply", "nearest_distances"]

N_MATCHES = 8
"""Vertices averaged for a closest point."""
Distances = wp.types.vector(length=N_MATCHES, dtype=wp.float64)
Rows = wp.types.vector(length=N_MATCHES, dtype=wp.int32)


@wp.kernel
def choose_far_points(
    starts: wp.array(dtype=int),
    vertices: wp.array(dtype=wp.vec3d),
    gaps: wp.array(dtype=wp.float64),
    chosen: wp.array2d(dtype=wp.vec3d),
):
    """Choose vertices of each shape that are far from each other, from its first one on (Gonzalez 1985)."""
    shape = wp.tid()
    begin = starts[shape]
    last = begin
    for number in range(chosen.shape[1]):
        chosen[shape, number] = vertices[last]
        farthest = begin
        largest = wp.float64(-1.0)
        for vertex in range(begin, starts[shape + 1]):
            gap = wp.length(vertices[vertex] - vertices[last])
            if number > 0:
                gap = wp.min(gap, gaps[vertex])
            gaps[vertex] = gap
            if gap > largest:
                largest = gap
                farthest = vertex
        last = farthest


@wp.kernel
def nearest_distances(
    of: wp.array(dtype=int),
    to: wp.array(dtype=int),
    points: wp.array2d(dtype=wp.vec3d),
    starts: wp.array(dtype=int),
    vertices: wp.array(dtype=wp.vec3d),
    distances: wp.array3d(dtype=wp.float64),
):
    """Write the distances of the points of some shapes to the nearest vertices of others."""
    row, column, number = wp.tid()
    point = points[of[row], number]
    smallest = wp.float64(1.0e300)
    for vertex in range(starts[to[column]], starts[to[column] + 1]):
        smallest = wp.min(smallest, wp.length_sq(vertices[vertex] - point))
    distances[row, column, number] = wp.sqrt(smallest)


@wp.kernel
def match_control_points(
    control: wp.array(dtype=int),
    incidence: wp.array(dtype=int),
    faces: wp.array(dtype=int),
    corners: wp.array(dtype=wp.vec3i),
    deformed: wp.array2d(dtype=wp.vec3d),
    starts: wp.array(dtype=int),
    vertices: wp.array(dtype=wp.vec3d),
    normals: wp.array(dtype=wp.vec3d),
    normal_length: wp.float64,
    match_width: wp.float64,
    matched: wp.array2d(dtype=wp.vec3d),
):
    """Average, for each control point of the deformed sources, the vertices that are nearest in both terms.

    Terms are positions and normals; `faces` of `corners` meet at each control point, from `incidence` on.
    """
    target, point = wp.tid()
    across = wp.vec3d()
    for k in range(incidence[point], incidence[point + 1]):
        face = corners[faces[k]]
        a = deformed[target, face[0]]
        across += wp.cross(deformed[target, face[1]] - a, deformed[target, face[2]] - a)
    normal = across / wp.max(wp.length(across), wp.float64(1.0e-300))
    place = deformed[target, control[point]]
    squares = Distances(wp.float64(1.0e300))
    rows = Rows(starts[target])
    for vertex in range(starts[target], starts[target + 1]):
        turned = normal_length * (normals[vertex] - normal)
        square = wp.length_sq(vertices[vertex] - place) + wp.length_sq(turned)
        if square < squares[N_MATCHES - 1]:
            slot = int(N_MATCHES - 1)
            while slot > 0 and square < squares[wp.max(slot - 1, 0)]:
                squares[slot] = squares[slot - 1]
                rows[slot] = rows[slot - 1]
                slot -= 1
            squares[slot] = square
            rows[slot] = vertex
    total = wp.float64(0.0)
    mean = wp.vec3d()
    for k in range(N_MATCHES):
        weight = wp.exp(wp.float64(-0.5) * (squares[k] - squares[0]) / (match_width * match_width))
        total += weight
        mean += weight * vertices[rows[k]]
    matched[target, point] = mean / total


@wp.kernel
def multiply(
    transposed: wp.array2d(dtype=wp.float64),
    divisors: wp.array(dtype=wp.float64),
    added: wp.float64,
    keep: wp.float64,
    vectors: wp.array2d(dtype=wp.vec3d),
    out: wp.array2d(dtype=wp.vec3d),
):
    """Multiply vectors (T, C) by a matrix, given as (C, R), and divide by the divisors plus a number.

    What `out` (T, R) held before is kept with a weight.
    """
    target, row = wp.tid()
    total = wp.vec3d()
    for column in range(transposed.shape[0]):
        total += transposed[column, row] * vectors[target, column]
    if divisors.shape[0] > 0:
        total /= divisors[row] + added
    if keep != wp.float64(0.0):
        total += keep * out[target, row]
    out[target, row] = total
