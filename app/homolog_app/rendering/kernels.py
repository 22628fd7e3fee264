"""Drawing triangles: filled pixel by pixel, with rays where there are edges."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog_app.rendering.scene import AMBIENT, DIFFUSE, LIGHTS

wp.set_module_options({"enable_backward": False})

__all__ = ["fill", "occlude", "smooth_edges"]

SAMPLES = wp.constant(4)  # rays of an edge's pixel, on a rotated grid: all in different rows and columns
FAR = wp.constant(1.0e6)
FLAT = wp.constant(1.0e-6)  # sine of the angle between a ray and a plane that it does not meet
CREASE = wp.constant(0.95)  # cosine between the normals of neighbouring pixels
(KEY, KEY_STRENGTH), (FILL, FILL_STRENGTH) = (
    (wp.constant(wp.normalize(wp.vec3(*place))), wp.constant(strength)) for place, strength in LIGHTS
)
AMBIENT_PART, DIFFUSE_PART = wp.constant(AMBIENT), wp.constant(DIFFUSE)
JUMP = wp.constant(2.0)  # depth between neighbouring pixels beyond the slope's, in pixels


@wp.struct
class Scene:
    """Triangles with their colours, and the picture's plane: upper left corner, axes, size of a pixel.

    If `cut` is not 0, only what lies beyond a plane is drawn, where `plane` times place is at least `offset`.
    Solids are closed: behind the plane a ray that meets a surface from inside has met the cut surface.
    """

    mesh: wp.uint64
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
    """Light a colour as VTK does; inner sides of surfaces are lit, too."""
    facing = wp.vec3(wp.dot(normal, right), wp.dot(normal, up), wp.dot(normal, back))
    if facing[2] < 0.0:
        facing = -facing
    light = KEY_STRENGTH * wp.max(wp.dot(facing, KEY), 0.0) + FILL_STRENGTH * wp.max(
        wp.dot(facing, FILL), 0.0
    )
    lit = (AMBIENT_PART + DIFFUSE_PART * light) * colour
    return wp.vec3(wp.min(lit[0], 1.0), wp.min(lit[1], 1.0), wp.min(lit[2], 1.0))


@wp.func
def seen_at(scene: Scene, face: int, u: float, v: float, depth: float) -> Sight:
    """Return what a place on a face looks like."""
    seen = Sight()
    indices = scene.faces[face]
    seen.opacity = 1.0
    seen.normal = wp.normalize(corner_mix(scene.normals, indices, u, v))
    colour = corner_mix(scene.colours, indices, u, v)
    seen.colour = shade(colour, seen.normal, scene.right, scene.up, wp.cross(scene.right, scene.up))
    seen.depth = depth
    return seen


@wp.func
def cap_at(scene: Scene, start: wp.vec3, ahead: wp.vec3) -> Sight:
    """Return what the cut surface looks like where a ray meets it."""
    seen = Sight()
    seen.opacity = 1.0
    seen.normal = -scene.plane
    seen.colour = scene.cap
    seen.depth = (scene.offset - wp.dot(scene.plane, start)) / wp.dot(scene.plane, ahead)
    return seen


@wp.func
def pixel_ray(scene: Scene, column: float, row: float) -> wp.vec3:
    """Return where the ray through a place in the picture [pixels] begins."""
    return scene.corner + column * scene.step * scene.right - row * scene.step * scene.up


@wp.func
def look(scene: Scene, column: float, row: float) -> Sight:
    """Follow one ray through a place in the picture [pixels]."""
    start = pixel_ray(scene, column, row)
    ahead = -wp.cross(scene.right, scene.up)
    first, last = float(0.0), float(FAR)
    if scene.cut != 0:
        slope, height = wp.dot(scene.plane, ahead), wp.dot(scene.plane, start) - scene.offset
        if slope > FLAT:
            first = wp.max(first, -height / slope)
        elif slope < -FLAT:
            last = wp.min(last, -height / slope)
        elif height < 0.0:
            last = 0.0
    seen = Sight()
    if last > first:
        hit = wp.mesh_query_ray(scene.mesh, start + first * ahead, ahead, last - first)
        if hit.result:
            if first > 0.0 and hit.sign < 0.0:
                seen = cap_at(scene, start, ahead)
            else:
                seen = seen_at(scene, hit.face, hit.u, hit.v, first + hit.t)
    return seen


@wp.func
def edges(a: wp.vec3, b: wp.vec3, c: wp.vec3) -> wp.vec4:
    """Return how the shares of a triangle's first two corners grow along rows and columns."""
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    return wp.vec4(b[1] - c[1], c[0] - b[0], c[1] - a[1], a[0] - c[0]) / area


@wp.func
def seen_from_inside(places: wp.array(dtype=wp.vec3), corners: wp.vec3i) -> bool:
    """Whether a triangle, given by columns and rows in the picture, shows its inner side."""
    a, b, c = places[corners[0]], places[corners[1]], places[corners[2]]
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0.0


@wp.kernel
def fill(
    scene: Scene,
    places: wp.array(dtype=wp.vec3),
    rows_each: int,
    first: int,
    nearest: wp.array2d(dtype=int),
    relief: wp.array2d(dtype=wp.vec4),
    image: wp.array2d(dtype=wp.vec4),
):
    """Draw a band of rows, each pixel as its middle looks; note normal and depth there.

    Every triangle is visited and the pixels in its bounding box tried: in parallel projection that is many
    times faster than a ray for each pixel. One thread owns a band, so that nothing has to be locked.
    """
    low = (first + wp.tid()) * rows_each
    high = wp.min(low + rows_each, image.shape[0])
    for row in range(low, high):
        for column in range(image.shape[1]):
            nearest[row, column] = -1
            relief[row, column] = wp.vec4()
            image[row, column] = wp.vec4()
    ahead = -wp.cross(scene.right, scene.up)
    for face in range(scene.faces.shape[0]):
        indices = scene.faces[face]
        a, b, c = places[indices[0]], places[indices[1]], places[indices[2]]
        top = wp.max(int(wp.ceil(wp.min(a[1], wp.min(b[1], c[1])) - 0.5)), low)
        bottom = wp.min(int(wp.floor(wp.max(a[1], wp.max(b[1], c[1])) - 0.5)) + 1, high)
        if top < bottom:
            grow = edges(a, b, c)
            left = wp.max(int(wp.ceil(wp.min(a[0], wp.min(b[0], c[0])) - 0.5)), 0)
            right = wp.min(int(wp.floor(wp.max(a[0], wp.max(b[0], c[0])) - 0.5)) + 1, image.shape[1])
            for row in range(top, bottom):
                y = float(row) + 0.5 - c[1]
                for column in range(left, right):
                    x = float(column) + 0.5 - c[0]
                    u, v = grow[0] * x + grow[1] * y, grow[2] * x + grow[3] * y
                    w = 1.0 - u - v
                    if u >= 0.0 and v >= 0.0 and w >= 0.0:
                        depth = u * a[2] + v * b[2] + w * c[2]
                        if scene.cut != 0:
                            place = pixel_ray(scene, float(column) + 0.5, float(row) + 0.5) + depth * ahead
                            if wp.dot(scene.plane, place) < scene.offset:
                                continue
                        if nearest[row, column] < 0 or depth < relief[row, column][3]:
                            nearest[row, column] = face
                            relief[row, column] = wp.vec4(u, v, 0.0, depth)
    for row in range(low, high):
        for column in range(image.shape[1]):
            front = nearest[row, column]
            if front >= 0:
                hit = relief[row, column]
                seen = seen_at(scene, front, hit[0], hit[1], hit[3])
                if (
                    scene.cut != 0
                    and wp.dot(scene.plane, ahead) > FLAT
                    and seen_from_inside(places, scene.faces[front])
                ):
                    seen = cap_at(scene, pixel_ray(scene, float(column) + 0.5, float(row) + 0.5), ahead)
                image[row, column] = wp.vec4(seen.colour[0], seen.colour[1], seen.colour[2], 1.0)
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
    first_column: int,
    image: wp.array2d(dtype=wp.vec4),
):
    """Draw edges and creases again: mean colour of the rays that hit, and their share as opacity."""
    down, along = wp.tid()
    row, column = first_row + down, first_column + along
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
        hits = wp.max(total[3], 1.0)
        image[row, column] = wp.vec4(
            total[0] / hits, total[1] / hits, total[2] / hits, total[3] / float(SAMPLES)
        )


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
    """Share of the directions (a half sphere around z) in which the surface does not see itself.

    Every vertex looks along one of so many interleaved sets of the directions.
    """
    i = first + wp.tid()
    own = (i * 7 + i // 5) % sets  # neighbours have different sets, however vertices are ordered
    normal = normals[i]
    turn = wp.quat_between_vectors(wp.vec3(0.0, 0.0, 1.0), normal)
    free = float(0.0)
    count = directions.shape[0] // sets
    for j in range(count):
        along = wp.quat_rotate(turn, directions[own + j * sets])
        hit = wp.mesh_query_ray(mesh, points[i] + 0.01 * reach * normal, along, reach)
        if not hit.result:
            free += 1.0
    openness[i] = free / float(count)
