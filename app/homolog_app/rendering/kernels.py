"""Drawing triangles without OpenGL, and ambient occlusion."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog_app.rendering.scene import AMBIENT, DIFFUSE, LIGHTS

wp.set_module_options({"enable_backward": False})

__all__ = ["SMOOTH", "fill", "occlude"]

SMOOTH = 2
"""Number of samples per pixel along rows and columns, for smooth edges."""

SAMPLES = wp.constant(SMOOTH)
FLAT = wp.constant(1.0e-6)  # sine of the angle below which a ray is parallel to a plane
(KEY, KEY_STRENGTH), (FILL, FILL_STRENGTH) = (
    (wp.constant(wp.normalize(wp.vec3(*place))), wp.constant(strength)) for place, strength in LIGHTS
)
AMBIENT_PART, DIFFUSE_PART = wp.constant(AMBIENT), wp.constant(DIFFUSE)


@wp.struct
class Triangles:
    """Triangles, their colours in 0 ... 255, and the picture's plane: upper left corner, axes, sample size.

    If `cut` is not 0, only the part beyond a plane is drawn, where the product of `plane` and position is at
    least `offset`. Solids are closed: a surface whose inner side is visible behind the plane is seen through
    the cut.
    """

    faces: wp.array(dtype=wp.vec3i)
    normals: wp.array(dtype=wp.vec3)
    colours: wp.array(dtype=wp.vec3)
    corner: wp.vec3
    right: wp.vec3
    up: wp.vec3
    step: float
    cut: int
    plane: wp.vec3
    offset: float
    cap: wp.vec3


@wp.func
def corner_mix(values: wp.array(dtype=wp.vec3), indices: wp.vec3i, u: float, v: float) -> wp.vec3:
    """Interpolate values at a triangle's corners."""
    return u * values[indices[0]] + v * values[indices[1]] + (1.0 - u - v) * values[indices[2]]


@wp.func
def shade(scene: Triangles, face: int, u: float, v: float) -> wp.vec3:
    """Shade a point on a face as VTK does; inner sides of surfaces are lit, too."""
    normal = wp.normalize(corner_mix(scene.normals, scene.faces[face], u, v))
    back = wp.cross(scene.right, scene.up)
    facing = wp.vec3(wp.dot(normal, scene.right), wp.dot(normal, scene.up), wp.dot(normal, back))
    if facing[2] < 0.0:
        facing = -facing
    light = KEY_STRENGTH * wp.max(wp.dot(facing, KEY), 0.0)
    light += FILL_STRENGTH * wp.max(wp.dot(facing, FILL), 0.0)
    return (AMBIENT_PART + DIFFUSE_PART * light) * corner_mix(scene.colours, scene.faces[face], u, v)


@wp.func
def edges(a: wp.vec3, b: wp.vec3, c: wp.vec3) -> wp.vec4:
    """Return the gradients of a triangle's first two barycentric coordinates along rows and columns."""
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    return wp.vec4(b[1] - c[1], c[0] - b[0], c[1] - a[1], a[0] - c[0]) / area


@wp.func
def seen_from_inside(places: wp.array(dtype=wp.vec3), corners: wp.vec3i) -> bool:
    """Whether a triangle, given by columns and rows in the picture, shows its inner side."""
    a, b, c = places[corners[0]], places[corners[1]], places[corners[2]]
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0.0


@wp.func
def draw_face(
    scene: Triangles,
    places: wp.array(dtype=wp.vec3),
    face: int,
    low: int,
    ahead: wp.vec3,
    nearest: wp.array2d(dtype=int),
    relief: wp.array2d(dtype=wp.vec3),
):
    """Test the samples in a triangle's bounding box, in the rows from `low`; keep the nearest hits."""
    indices = scene.faces[face]
    a, b, c = places[indices[0]], places[indices[1]], places[indices[2]]
    top = wp.max(int(wp.ceil(wp.min(a[1], wp.min(b[1], c[1])) - 0.5)), low)
    bottom = wp.min(int(wp.floor(wp.max(a[1], wp.max(b[1], c[1])) - 0.5)) + 1, low + nearest.shape[0])
    if top >= bottom:
        return
    grow = edges(a, b, c)
    left = wp.max(int(wp.ceil(wp.min(a[0], wp.min(b[0], c[0])) - 0.5)), 0)
    right = wp.min(int(wp.floor(wp.max(a[0], wp.max(b[0], c[0])) - 0.5)) + 1, nearest.shape[1])
    for row in range(top, bottom):
        y = float(row) + 0.5
        entered = bool(False)
        for column in range(left, right):
            x = float(column) + 0.5
            u = grow[0] * (x - c[0]) + grow[1] * (y - c[1])
            v = grow[2] * (x - c[0]) + grow[3] * (y - c[1])
            w = 1.0 - u - v
            if u >= 0.0 and v >= 0.0 and w >= 0.0:
                entered = True
                depth = u * a[2] + v * b[2] + w * c[2]
                if scene.cut != 0:
                    across = x * scene.step * scene.right - y * scene.step * scene.up
                    if wp.dot(scene.plane, scene.corner + across + depth * ahead) < scene.offset:
                        continue
                if nearest[row - low, column] < 0 or depth < relief[row - low, column][2]:
                    nearest[row - low, column] = face
                    relief[row - low, column] = wp.vec3(u, v, depth)
            elif entered:
                break


@wp.func
def pixel_of(
    scene: Triangles,
    places: wp.array(dtype=wp.vec3),
    capped: bool,
    row: int,
    column: int,
    nearest: wp.array2d(dtype=int),
    relief: wp.array2d(dtype=wp.vec3),
) -> wp.vec4ub:
    """Return the mean colour of a pixel's samples that hit a face, and their share as opacity."""
    total, hits = wp.vec3(), float(0.0)
    colour, before = wp.vec3(), int(-1)
    for sample in range(SAMPLES * SAMPLES):
        i, j = row * SAMPLES + sample // SAMPLES, column * SAMPLES + sample % SAMPLES
        front = nearest[i, j]
        if front >= 0:
            hits += 1.0
            if front != before:  # a face's colour hardly varies within a pixel
                before = front
                if capped and seen_from_inside(places, scene.faces[front]):
                    colour = scene.cap
                else:
                    colour = shade(scene, front, relief[i, j][0], relief[i, j][1])
            total += colour
    pixel = wp.vec4ub()
    if hits > 0.0:
        pixel = wp.vec4ub(
            wp.uint8(wp.min(total[0] / hits + 0.5, 255.0)),
            wp.uint8(wp.min(total[1] / hits + 0.5, 255.0)),
            wp.uint8(wp.min(total[2] / hits + 0.5, 255.0)),
            wp.uint8(255.0 * hits / float(SAMPLES * SAMPLES) + 0.5),
        )
    return pixel


@wp.kernel
def fill(
    scene: Triangles,
    places: wp.array(dtype=wp.vec3),
    first: int,
    nearest: wp.array2d(dtype=int),
    relief: wp.array2d(dtype=wp.vec3),
    image: wp.array2d(dtype=wp.vec4ub),
):
    """Draw the rows of a picture that begin with `first`.

    `places` are columns, rows and depths of the vertices, in samples; `nearest` and `relief` contain each
    sample's face, position in it, and depth. One thread owns these rows, so that no locks are needed.
    """
    for row in range(nearest.shape[0]):
        for column in range(nearest.shape[1]):
            nearest[row, column] = -1
    ahead = -wp.cross(scene.right, scene.up)
    for face in range(scene.faces.shape[0]):
        draw_face(scene, places, face, first * SAMPLES, ahead, nearest, relief)
    capped = scene.cut != 0 and wp.dot(scene.plane, ahead) > FLAT
    for row in range(nearest.shape[0] // SAMPLES):
        for column in range(nearest.shape[1] // SAMPLES):
            image[first + row, column] = pixel_of(scene, places, capped, row, column, nearest, relief)


@wp.kernel
def occlude(
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    reach: float,
    first: int,
    sets: int,
    openness: wp.array(dtype=float),
):
    """Share of directions (hemisphere around z) that are not occluded by the surface.

    Every vertex samples one of several interleaved sets of directions.
    """
    i = first + wp.tid()
    own = (i * 7 + i // 5) % sets  # neighbours have different sets for any order of vertices
    normal = normals[i]
    turn = wp.quat_between_vectors(wp.vec3(0.0, 0.0, 1.0), normal)
    free = float(0.0)
    count = directions.shape[0] // sets
    for j in range(count):
        along = wp.quat_rotate(turn, directions[own + j * sets])
        if not wp.mesh_query_ray_anyhit(mesh, points[i] + 0.01 * reach * normal, along, reach):
            free += 1.0
    openness[i] = free / float(count)


@wp.kernel
def find_opposite(
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    start: float,
    ahead: wp.array(dtype=float),
    behind: wp.array(dtype=float),
):
    """Distance of the surface along the normal of a vertex and against it; infinite without a hit."""
    i = wp.tid()
    out = wp.mesh_query_ray(mesh, points[i] + start * normals[i], normals[i], 1.0e30)
    ahead[i] = wp.where(out.result, out.t + start, wp.inf)
    into = wp.mesh_query_ray(mesh, points[i] - start * normals[i], -normals[i], 1.0e30)
    behind[i] = wp.where(into.result, into.t + start, wp.inf)
