"""Casting rays at triangles."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp

wp.set_module_options({"enable_backward": False})

__all__ = ["cast", "occlude"]

SAMPLES = wp.constant(4)  # rays a pixel, on a rotated grid: all in different rows and columns
FAR = wp.constant(1.0e6)


@wp.func
def corner_mix(values: wp.array(dtype=wp.vec3), indices: wp.vec3i, u: float, v: float) -> wp.vec3:
    """Interpolate values at a triangle's corners."""
    return u * values[indices[0]] + v * values[indices[1]] + (1.0 - u - v) * values[indices[2]]


@wp.func
def shade(colour: wp.vec3, normal: wp.vec3, right: wp.vec3, up: wp.vec3, back: wp.vec3) -> wp.vec3:
    """Light from the viewer, from above left and a little from everywhere; a soft highlight."""
    key = wp.normalize(0.6 * up - 0.5 * right + 0.7 * back)
    light = 0.50 + 0.34 * wp.max(wp.dot(normal, back), 0.0) + 0.22 * wp.max(wp.dot(normal, key), 0.0)
    gloss = 0.08 * wp.pow(wp.max(wp.dot(normal, wp.normalize(key + back)), 0.0), 30.0)
    lit = light * colour + wp.vec3(gloss, gloss, gloss)
    return wp.vec3(wp.min(lit[0], 1.0), wp.min(lit[1], 1.0), wp.min(lit[2], 1.0))


@wp.kernel
def cast(
    mesh: wp.uint64,
    faces: wp.array(dtype=wp.vec3i),
    normals: wp.array(dtype=wp.vec3),
    colours: wp.array(dtype=wp.vec3),
    corner: wp.vec3,
    right: wp.vec3,
    up: wp.vec3,
    step: float,
    first_row: int,
    row_stride: int,
    image: wp.array2d(dtype=wp.vec4),
):
    """Draw one pixel: mean colour of the rays that hit (premultiplied), and their share as alpha."""
    index, column = wp.tid()
    row = first_row + index * row_stride
    back = wp.cross(right, up)
    total = wp.vec4()
    for ray in range(SAMPLES):
        x = (float(column) + float(2 * ray + 1) / 8.0) * step
        y = (float(row) + float((5 + 4 * ray + 2 * (ray // 2)) % 8) / 8.0) * step
        hit = wp.mesh_query_ray(mesh, corner + x * right - y * up, -back, FAR)
        if hit.result:
            indices = faces[hit.face]
            normal = wp.normalize(corner_mix(normals, indices, hit.u, hit.v))
            colour = shade(corner_mix(colours, indices, hit.u, hit.v), normal, right, up, back)
            total += wp.vec4(colour[0], colour[1], colour[2], 1.0)
    image[row, column] = total / float(SAMPLES)


@wp.kernel
def occlude(
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    reach: float,
    openness: wp.array(dtype=float),
):
    """Share of the directions (a half sphere around z) in which the surface does not see itself."""
    i = wp.tid()
    normal = normals[i]
    turn = wp.quat_between_vectors(wp.vec3(0.0, 0.0, 1.0), normal)
    free = float(0.0)
    for j in range(directions.shape[0]):
        hit = wp.mesh_query_ray(
            mesh, points[i] + 0.01 * reach * normal, wp.quat_rotate(turn, directions[j]), reach
        )
        if not hit.result:
            free += 1.0
    openness[i] = free / float(directions.shape[0])
