"""Warp kernels on the values of a distance field, at points in grid indices."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp

wp.set_module_options({"enable_backward": False})

_ON_LEVEL = wp.constant(wp.float64(1.0e-5))
"""Distance from the zero level at which projected points stop [nodes]."""


@wp.func
def _value(grid: wp.array3d(dtype=wp.float32), x: wp.vec3d) -> wp.float64:
    """Trilinear interpolant at a point in double precision, clamped at the border."""
    low, share = wp.vec3i(), wp.vec3d()
    for axis in range(3):
        place = wp.clamp(x[axis], wp.float64(0.0), wp.float64(grid.shape[axis] - 1))
        low[axis] = int(wp.floor(place))
        share[axis] = place - wp.floor(place)
    i, j, k = low[0], low[1], low[2]
    next_i, next_j = wp.min(i + 1, grid.shape[0] - 1), wp.min(j + 1, grid.shape[1] - 1)
    next_k = wp.min(k + 1, grid.shape[2] - 1)
    v00 = wp.lerp(wp.float64(grid[i, j, k]), wp.float64(grid[next_i, j, k]), share[0])
    v01 = wp.lerp(wp.float64(grid[i, j, next_k]), wp.float64(grid[next_i, j, next_k]), share[0])
    v10 = wp.lerp(wp.float64(grid[i, next_j, k]), wp.float64(grid[next_i, next_j, k]), share[0])
    v11 = wp.lerp(wp.float64(grid[i, next_j, next_k]), wp.float64(grid[next_i, next_j, next_k]), share[0])
    return wp.lerp(wp.lerp(v00, v10, share[1]), wp.lerp(v01, v11, share[1]), share[2])


@wp.func
def _slope(grid: wp.array3d(dtype=wp.float32), point: wp.vec3d) -> wp.vec3d:
    """Central differences over two nodes of the interpolant at a point."""
    slope = wp.vec3d()
    for axis in range(3):
        step = wp.vec3d()
        step[axis] = wp.float64(1.0)
        slope[axis] = wp.float64(0.5) * (_value(grid, point + step) - _value(grid, point - step))
    return slope


@wp.kernel
def sample_values(
    grid: wp.array3d(dtype=wp.float32),
    points: wp.array(dtype=wp.vec3d),
    values: wp.array(dtype=wp.float64),
) -> None:
    """Trilinear interpolant at points [nodes]."""
    values[wp.tid()] = _value(grid, points[wp.tid()])


@wp.kernel
def sample_slopes(
    grid: wp.array3d(dtype=wp.float32),
    points: wp.array(dtype=wp.vec3d),
    slopes: wp.array(dtype=wp.vec3d),
) -> None:
    """Slope at points [nodes]."""
    slopes[wp.tid()] = _slope(grid, points[wp.tid()])


@wp.kernel
def project(
    grid: wp.array3d(dtype=wp.float32),
    points: wp.array(dtype=wp.vec3d),
    spacing: wp.float64,
    steps: int,
) -> None:
    """Move points [nodes] to the zero level of distances in units of the spacing, by Newton steps."""
    point = points[wp.tid()]
    farthest = wp.float64(1.0)
    for _ in range(steps):
        value = _value(grid, point) / spacing
        if wp.abs(value) < _ON_LEVEL:
            break
        slope = _slope(grid, point) / spacing
        squared = wp.max(wp.dot(slope, slope), wp.float64(0.25))
        point -= wp.clamp(value / squared, -farthest, farthest) * slope
    points[wp.tid()] = point
