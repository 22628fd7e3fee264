"""Kernels of the first particles: distances of shapes."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp

wp.set_module_options({"enable_backward": False, "fast_math": False})

__all__ = ["choose_far_points", "nearest_distances"]


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
