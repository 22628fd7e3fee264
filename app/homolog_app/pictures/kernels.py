"""Casting rays at triangles."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp

wp.set_module_options({"enable_backward": False})

__all__ = ["cast", "occlude", "smooth_edges"]

SAMPLES = wp.constant(4)  # rays of an edge's pixel, on a rotated grid: all in different rows and columns
FAR = wp.constant(1.0e6)
CREASE = wp.constant(0.95)  # cosine between the normals of neighbouring pixels
JUMP = wp.constant(2.0)  # depth between neighbouring pixels beyond the slope's, in pixels


@wp.struct
class Scene:
    """Triangles with their colours, and the picture's plane: upper left corner, axes, size of a pixel."""

    mesh: wp.uint64
    faces: wp.array(dtype=wp.vec3i)
    normals: wp.array(dtype=wp.vec3)
    colours: wp.array(dtype=wp.vec3)
    corner: wp.vec3
    right: wp.vec3
    up: wp.vec3
    step: float


@wp.struct
class Sight:
    """What a ray meets: opaque or nothing, its colour, normal and depth."""

    opacity: float
    colour: wp.vec3
    normal: wp.vec3
    depth: float


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


@wp.func
def look(scene: Scene, column: float, row: float) -> Sight:
    """Follow one ray through a place in the picture [pixels]."""
    seen = Sight()
    back = wp.cross(scene.right, scene.up)
    start = scene.corner + column * scene.step * scene.right - row * scene.step * scene.up
    hit = wp.mesh_query_ray(scene.mesh, start, -back, FAR)
    if hit.result:
        indices = scene.faces[hit.face]
        seen.opacity = 1.0
        seen.normal = wp.normalize(corner_mix(scene.normals, indices, hit.u, hit.v))
        colour = corner_mix(scene.colours, indices, hit.u, hit.v)
        seen.colour = shade(colour, seen.normal, scene.right, scene.up, back)
        seen.depth = hit.t
    return seen


@wp.kernel
def cast(
    scene: Scene,
    first_row: int,
    row_stride: int,
    image: wp.array2d(dtype=wp.vec4),
    relief: wp.array2d(dtype=wp.vec4),
):
    """Draw each pixel by one ray through its middle; note normal and depth there."""
    index, column = wp.tid()
    row = first_row + index * row_stride
    seen = look(scene, float(column) + 0.5, float(row) + 0.5)
    image[row, column] = wp.vec4(seen.colour[0], seen.colour[1], seen.colour[2], seen.opacity)
    relief[row, column] = wp.vec4(seen.normal[0], seen.normal[1], seen.normal[2], seen.depth)


@wp.func
def breaks(
    relief: wp.array2d(dtype=wp.vec4),
    row: int,
    column: int,
    to_row: int,
    to_column: int,
    back: wp.vec3,
    step: float,
) -> bool:
    """Whether an edge or a crease runs between a pixel and its neighbour."""
    if to_row < 0 or to_column < 0 or to_row >= relief.shape[0] or to_column >= relief.shape[1]:
        return False
    here, there = relief[row, column], relief[to_row, to_column]
    normal = wp.vec3(here[0], here[1], here[2])
    other = wp.vec3(there[0], there[1], there[2])
    if (here[3] == 0.0) and (there[3] == 0.0):
        return False
    if wp.dot(normal, other) < CREASE:  # also where only one of the two shows a surface
        return True
    return wp.abs(here[3] - there[3]) * wp.abs(wp.dot(normal, back)) > JUMP * step


@wp.kernel
def smooth_edges(
    scene: Scene,
    relief: wp.array2d(dtype=wp.vec4),
    first_row: int,
    row_stride: int,
    image: wp.array2d(dtype=wp.vec4),
):
    """Draw edges and creases again: mean colour of the rays that hit (premultiplied), and their share."""
    index, column = wp.tid()
    row = first_row + index * row_stride
    back = wp.cross(scene.right, scene.up)
    edge = breaks(relief, row, column, row - 1, column, back, scene.step)
    edge = edge or breaks(relief, row, column, row + 1, column, back, scene.step)
    edge = edge or breaks(relief, row, column, row, column - 1, back, scene.step)
    edge = edge or breaks(relief, row, column, row, column + 1, back, scene.step)
    if edge:
        total = wp.vec4()
        for ray in range(SAMPLES):
            seen = look(
                scene,
                float(column) + float(2 * ray + 1) / 8.0,
                float(row) + float((5 + 4 * ray + 2 * (ray // 2)) % 8) / 8.0,
            )
            total += wp.vec4(seen.colour[0], seen.colour[1], seen.colour[2], seen.opacity)
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
