"""Kernels that prepare the grids of several shapes at once: opening angles and B-spline coefficients.

They compute what `scipy.ndimage` computes on the CPU.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp

wp.set_module_options({"enable_backward": False, "fast_math": False})

__all__ = ["Volume", "blur", "fill_inside", "filter_lines", "sample_angles", "turn_to_angles"]

SUM_TERMS = wp.constant(40)  # of the filter's first value; the pole to that power is negligible


@wp.struct
class Volume:
    """A grid of one shape, flat, the last axis fastest."""

    size: wp.vec3i
    grid: wp.array(dtype=wp.float32)
    spare: wp.array(dtype=wp.float32)  # as large as the grid
    lines: wp.array(dtype=wp.float64)  # as large as the grid
    field: wp.array3d(dtype=wp.float32)  # distances, whose inside is blurred
    spacing: float  # of the distances
    block: int  # nodes of the field along each edge of a node's cube
    margin: int  # nodes around the field
    weights: wp.array(dtype=wp.float64)  # of the blur: in the middle, and at each distance from it
    nodes: wp.array(dtype=wp.vec3d)  # points in grid indices
    angles: wp.array(dtype=wp.float64)  # at the points


@wp.func
def stride_of(size: wp.vec3i, axis: int) -> int:
    """Return the distance between neighbours along an axis."""
    return wp.where(axis == 0, size[1] * size[2], wp.where(axis == 1, size[2], 1))


@wp.kernel
def fill_inside(volumes: wp.array(dtype=Volume)):
    """Fill the grid with the fraction of each node's cube that is inside the shape."""
    shape, at = wp.tid()
    v = volumes[shape]
    i, j, k = at // (v.size[1] * v.size[2]), (at // v.size[2]) % v.size[1], at % v.size[2]
    if i >= v.size[0]:
        return
    total = float(0.0)
    for part in range(v.block * v.block * v.block):
        x = (i - v.margin) * v.block + part // (v.block * v.block)
        y = (j - v.margin) * v.block + (part // v.block) % v.block
        z = (k - v.margin) * v.block + part % v.block
        inside = x >= 0 and x < v.field.shape[0] and y >= 0 and y < v.field.shape[1]
        if inside and z >= 0 and z < v.field.shape[2]:
            total += wp.clamp(0.5 - v.field[x, y, z] / v.spacing, 0.0, 1.0)
    v.grid[at] = total / float(v.block * v.block * v.block)


@wp.kernel
def blur(axis: int, back: int, volumes: wp.array(dtype=Volume)):
    """Blur the grid along an axis into the spare one, or back."""
    shape, at = wp.tid()
    v = volumes[shape]
    if at >= v.grid.shape[0]:
        return
    source = v.grid
    target = v.spare
    if back == 1:
        source = v.spare
        target = v.grid
    stride = stride_of(v.size, axis)
    place = (at // stride) % v.size[axis]
    total = wp.float64(source[at]) * v.weights[0]
    for step in range(v.weights.shape[0] - 1):
        away = v.weights.shape[0] - 1 - step
        sides = wp.float64(0.0)
        if place >= away:
            sides += wp.float64(source[at - away * stride])
        if place + away < v.size[axis]:
            sides += wp.float64(source[at + away * stride])
        total += sides * v.weights[away]
    target[at] = float(total)


@wp.kernel
def turn_to_angles(volumes: wp.array(dtype=Volume)):
    """Turn the fraction in the spare grid to opening angles in the grid."""
    shape, at = wp.tid()
    v = volumes[shape]
    if at < v.grid.shape[0]:
        v.grid[at] = 2.0 * wp.pi * v.spare[at]


@wp.kernel
def filter_lines(axis: int, volumes: wp.array(dtype=Volume)):
    """Replace the values along an axis by the coefficients of cubic B-splines, mirrored at the ends."""
    shape, line = wp.tid()
    v = volumes[shape]
    count = v.size[axis]
    if line >= v.grid.shape[0] // count or count < 2:
        return
    pole = wp.sqrt(wp.float64(3.0)) - wp.float64(2.0)  # of the cubic B-spline
    gain = wp.float64(6.0)
    stride = stride_of(v.size, axis)
    first = (line // stride) * stride * count + line % stride
    last = first + (count - 1) * stride
    far = wp.pow(pole, wp.float64(count - 1))
    value = gain * wp.float64(v.grid[first]) + far * (gain * wp.float64(v.grid[last]))
    power = wp.float64(pole)
    for i in range(1, wp.min(count - 1, SUM_TERMS)):
        mirrored = gain * wp.float64(v.grid[last - i * stride])
        value += power * (gain * wp.float64(v.grid[first + i * stride]) + far * mirrored)
        power *= pole
    value /= wp.float64(1.0) - far * far
    v.lines[first] = value
    for i in range(1, count):
        value = gain * wp.float64(v.grid[first + i * stride]) + pole * value
        v.lines[first + i * stride] = value
    value = (pole * v.lines[last - stride] + value) * pole / (pole * pole - wp.float64(1.0))
    v.grid[last] = wp.float32(value)
    for i in range(1, count):
        value = pole * (value - v.lines[last - i * stride])
        v.grid[last - i * stride] = wp.float32(value)


@wp.kernel
def sample_angles(volumes: wp.array(dtype=Volume)):
    """Interpolate the grid at the points."""
    shape, point = wp.tid()
    v = volumes[shape]
    if point >= v.nodes.shape[0]:
        return
    low = wp.vec3i()
    part = wp.vec3d()
    for axis in range(3):
        place = wp.clamp(v.nodes[point][axis], wp.float64(0.0), wp.float64(v.size[axis] - 1))
        low[axis] = wp.min(int(wp.floor(place)), v.size[axis] - 2)
        part[axis] = place - wp.float64(low[axis])
    total = wp.float64(0.0)
    for corner in range(8):
        a, b, c = corner // 4, (corner // 2) % 2, corner % 2
        weight = wp.where(a == 1, part[0], wp.float64(1.0) - part[0])
        weight *= wp.where(b == 1, part[1], wp.float64(1.0) - part[1])
        weight *= wp.where(c == 1, part[2], wp.float64(1.0) - part[2])
        at = ((low[0] + a) * v.size[1] + low[1] + b) * v.size[2] + low[2] + c
        total += weight * wp.float64(v.grid[at])
    v.angles[point] = total
