"""Drawing triangles without OpenGL."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog_app.rendering.scene import AMBIENT, DIFFUSE, LIGHTS

wp.set_module_options({"enable_backward": False})

__all__ = ["SMOOTH", "TILE", "fill"]

SMOOTH = 2
"""Number of samples per pixel along rows and columns, for smooth edges."""

TILE = 8
"""Edge of the tiles [samples] in which the largest depth is known."""

SAMPLES = wp.constant(SMOOTH)
MARGIN = wp.constant(0.01)
FLAT = wp.constant(1.0e-6)  # sine of the angle below which a ray is parallel to a plane
(KEY, KEY_STRENGTH), (FILL, FILL_STRENGTH) = (
    (wp.constant(wp.normalize(wp.vec3(*place))), wp.constant(strength)) for place, strength in LIGHTS
)
AMBIENT_PART, DIFFUSE_PART = wp.constant(AMBIENT), wp.constant(DIFFUSE)


@wp.struct
class Solids:
    """Triangles, balls, colours in 0 ... 255, and the picture's plane: upper left corner, axes, sample size.

    `places` and `centres` are columns, rows [samples] and depths [mm] of vertices and balls, `normals` the
    vertices' normals along the picture's axes (right, up, towards the viewer). All balls have one radius
    [samples].

    If `cut` is not 0, only the part beyond a plane is drawn, where the product of `plane` and position is at
    least `offset`. Solids are closed: a surface whose inner side is visible behind the plane is seen through
    the cut.
    """

    faces: wp.array(dtype=wp.vec3i)
    places: wp.array(dtype=wp.vec3)
    normals: wp.array(dtype=wp.vec3)
    colours: wp.array(dtype=wp.vec3)
    centres: wp.array(dtype=wp.vec3)
    ball_colours: wp.array(dtype=wp.vec3)
    radius: float
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
def lit(normal: wp.vec3, colour: wp.vec3) -> wp.vec3:
    """Shade a point as VTK does, by its normal along the picture's axes; inner sides are lit, too."""
    facing = wp.where(normal[2] < 0.0, -normal, normal)
    light = KEY_STRENGTH * wp.max(wp.dot(facing, KEY), 0.0)
    light += FILL_STRENGTH * wp.max(wp.dot(facing, FILL), 0.0)
    return (AMBIENT_PART + DIFFUSE_PART * light) * colour


@wp.func
def edges(a: wp.vec3, b: wp.vec3, c: wp.vec3) -> wp.vec4:
    """Return the gradients of a triangle's first two barycentric coordinates along rows and columns."""
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    return wp.vec4(b[1] - c[1], c[0] - b[0], c[1] - a[1], a[0] - c[0]) * (1.0 / area)


@wp.func
def seen_from_inside(places: wp.array(dtype=wp.vec3), corners: wp.vec3i) -> bool:
    """Whether a triangle, given by columns and rows in the picture, shows its inner side."""
    a, b, c = places[corners[0]], places[corners[1]], places[corners[2]]
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0.0


@wp.func
def span(along: float, start: float, reach: wp.vec2) -> wp.vec2:
    """Narrow a range of columns to where `start + along * column` is positive, with a small margin."""
    low, high = reach[0], reach[1]
    if wp.abs(along) > FLAT:
        zero = -start / along
        if along > 0.0:
            low = wp.max(low, zero - MARGIN)
        else:
            high = wp.min(high, zero + MARGIN)
    return wp.vec2(low, high)


@wp.func
def hidden(low: wp.vec3, high: wp.vec3, start: int, farthest: wp.array2d(dtype=float)) -> bool:
    """Whether everything in the picture between two corners of a box is nearer than the box."""
    top = wp.max(int(low[1]) - start, 0) // TILE
    bottom = wp.min((int(high[1]) - start) // TILE, farthest.shape[0] - 1)
    left = wp.max(int(low[0]), 0) // TILE
    right = wp.min(int(high[0]) // TILE, farthest.shape[1] - 1)
    for i in range(top, bottom + 1):
        for j in range(left, right + 1):
            if low[2] < farthest[i, j]:
                return False
    return True


@wp.func
def find_farthest(depths: wp.array2d(dtype=float), farthest: wp.array2d(dtype=float)):
    """Find the largest depth of each tile of samples."""
    for i in range(farthest.shape[0]):
        for j in range(farthest.shape[1]):
            most = float(0.0)
            for row in range(i * TILE, wp.min(i * TILE + TILE, depths.shape[0])):
                for column in range(j * TILE, wp.min(j * TILE + TILE, depths.shape[1])):
                    most = wp.max(most, depths[row, column])
                if most == wp.inf:
                    break
            farthest[i, j] = most


@wp.func
def is_left(scene: Solids, x: float, y: float, depth: float, ahead: wp.vec3) -> bool:
    """Whether a point is beyond the cut."""
    if scene.cut == 0:
        return True
    across = x * scene.step * scene.right - y * scene.step * scene.up
    return wp.dot(scene.plane, scene.corner + across + depth * ahead) >= scene.offset


@wp.func
def draw_face(
    scene: Solids,
    face: int,
    start: int,
    ahead: wp.vec3,
    hits: wp.array2d(dtype=int),
    depths: wp.array2d(dtype=float),
):
    """Test the samples in a triangle, in the rows from `start`; keep the nearest hits."""
    corners = scene.faces[face]
    a, b, c = scene.places[corners[0]], scene.places[corners[1]], scene.places[corners[2]]
    low, high = wp.min(a, wp.min(b, c)), wp.max(a, wp.max(b, c))
    top = wp.max(int(wp.ceil(low[1] - 0.5)), start)
    bottom = wp.min(int(wp.floor(high[1] - 0.5)) + 1, start + hits.shape[0])
    if top >= bottom:
        return
    grow = edges(a, b, c)
    box = wp.vec2(wp.max(low[0] - 0.5, 0.0), wp.min(high[0] - 0.5, float(hits.shape[1] - 1)))
    for row in range(top, bottom):
        y = float(row) + 0.5
        u_row, v_row = grow[1] * (y - c[1]), grow[3] * (y - c[1])
        u_start, v_start = u_row + grow[0] * (0.5 - c[0]), v_row + grow[2] * (0.5 - c[0])
        reach = span(grow[2], v_start, span(grow[0], u_start, box))
        reach = span(-grow[0] - grow[2], 1.0 - u_start - v_start, reach)
        for column in range(int(wp.ceil(reach[0])), int(wp.floor(reach[1])) + 1):
            x = float(column) + 0.5
            u = grow[0] * (x - c[0]) + u_row
            v = grow[2] * (x - c[0]) + v_row
            w = 1.0 - u - v
            if u >= 0.0 and v >= 0.0 and w >= 0.0:
                depth = u * a[2] + v * b[2] + w * c[2]
                if depth < depths[row - start, column] and is_left(scene, x, y, depth, ahead):
                    hits[row - start, column] = face
                    depths[row - start, column] = depth


@wp.func
def draw_ball(
    scene: Solids,
    ball: int,
    start: int,
    hits: wp.array2d(dtype=int),
    depths: wp.array2d(dtype=float),
):
    """Test the samples in a ball, which is whole also where it crosses the cut."""
    centre = scene.centres[ball]
    top = wp.max(int(wp.ceil(centre[1] - scene.radius - 0.5)), start)
    bottom = wp.min(int(wp.floor(centre[1] + scene.radius - 0.5)) + 1, start + hits.shape[0])
    for row in range(top, bottom):
        y = float(row) + 0.5
        half = wp.sqrt(wp.max(scene.radius * scene.radius - (y - centre[1]) * (y - centre[1]), 0.0))
        left = wp.max(int(wp.ceil(centre[0] - half - 0.5)), 0)
        right = wp.min(int(wp.floor(centre[0] + half - 0.5)) + 1, hits.shape[1])
        for column in range(left, right):
            x = float(column) + 0.5
            way = half * half - (x - centre[0]) * (x - centre[0])
            depth = centre[2] - scene.step * wp.sqrt(wp.max(way, 0.0))
            if depth < depths[row - start, column]:
                hits[row - start, column] = scene.faces.shape[0] + ball
                depths[row - start, column] = depth


@wp.func
def colour_of(scene: Solids, hit: int, x: float, y: float, capped: bool) -> wp.vec3:
    """Return the colour of a face or ball at a sample."""
    if hit < scene.faces.shape[0]:
        corners = scene.faces[hit]
        a, b, c = scene.places[corners[0]], scene.places[corners[1]], scene.places[corners[2]]
        if capped and seen_from_inside(scene.places, corners):
            return scene.cap
        grow = edges(a, b, c)
        u = grow[0] * (x - c[0]) + grow[1] * (y - c[1])
        v = grow[2] * (x - c[0]) + grow[3] * (y - c[1])
        normal = corner_mix(scene.normals, corners, u, v)
        length = wp.max(wp.length(normal), FLAT)
        return lit(normal * (1.0 / length), corner_mix(scene.colours, corners, u, v))
    ball = hit - scene.faces.shape[0]
    across = wp.vec2(x - scene.centres[ball][0], scene.centres[ball][1] - y) / scene.radius
    normal = wp.vec3(across[0], across[1], wp.sqrt(wp.max(1.0 - wp.dot(across, across), 0.0)))
    return lit(normal, scene.ball_colours[ball])


@wp.func
def pixel_of(
    scene: Solids, capped: bool, first: int, row: int, column: int, hits: wp.array2d(dtype=int)
) -> wp.vec4ub:
    """Return the mean colour of a pixel's samples that hit something, and their share as opacity."""
    total, count = wp.vec3(), float(0.0)
    colour, before = wp.vec3(), int(-1)
    for sample in range(SAMPLES * SAMPLES):
        i, j = row * SAMPLES + sample // SAMPLES, column * SAMPLES + sample % SAMPLES
        hit = hits[i, j]
        if hit >= 0:
            count += 1.0
            if hit != before:  # the colour of a face or ball hardly varies within a pixel
                before = hit
                y = float(first * SAMPLES + i) + 0.5
                colour = colour_of(scene, hit, float(j) + 0.5, y, capped)
            total += colour
    pixel = wp.vec4ub()
    if count > 0.0:
        share = 1.0 / count
        pixel = wp.vec4ub(
            wp.uint8(wp.min(total[0] * share + 0.5, 255.0)),
            wp.uint8(wp.min(total[1] * share + 0.5, 255.0)),
            wp.uint8(wp.min(total[2] * share + 0.5, 255.0)),
            wp.uint8(255.0 * count / float(SAMPLES * SAMPLES) + 0.5),
        )
    return pixel


@wp.kernel
def fill(
    scene: Solids,
    first: int,
    near: int,
    hits: wp.array2d(dtype=int),
    depths: wp.array2d(dtype=float),
    farthest: wp.array2d(dtype=float),
    image: wp.array2d(dtype=wp.vec4ub),
):
    """Draw the rows of a picture that begin with `first`.

    `hits` and `depths` contain each sample's face or ball and depth, `farthest` the largest depth of each
    tile of samples after the first `near` faces, which hide most of the others. One thread owns these rows,
    so that no locks are needed.
    """
    for row in range(hits.shape[0]):
        for column in range(hits.shape[1]):
            hits[row, column] = -1
            depths[row, column] = wp.inf
    ahead = -wp.cross(scene.right, scene.up)
    start = first * SAMPLES
    for face in range(near):
        draw_face(scene, face, start, ahead, hits, depths)
    find_farthest(depths, farthest)
    for face in range(near, scene.faces.shape[0]):
        corners = scene.faces[face]
        a, b, c = scene.places[corners[0]], scene.places[corners[1]], scene.places[corners[2]]
        if not hidden(wp.min(a, wp.min(b, c)), wp.max(a, wp.max(b, c)), start, farthest):
            draw_face(scene, face, start, ahead, hits, depths)
    reach = wp.vec3(scene.radius, scene.radius, scene.radius * scene.step)
    for ball in range(scene.centres.shape[0]):
        if not hidden(scene.centres[ball] - reach, scene.centres[ball] + reach, start, farthest):
            draw_ball(scene, ball, start, hits, depths)
    capped = scene.cut != 0 and wp.dot(scene.plane, ahead) > FLAT
    for row in range(hits.shape[0] // SAMPLES):
        for column in range(hits.shape[1] // SAMPLES):
            image[first + row, column] = pixel_of(scene, capped, first, row, column, hits)
