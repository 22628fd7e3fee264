"""The optimizer's Warp kernels, the same source for CPU and CUDA.

Particle arrays are flat, index = shape * N + particle, so that one launch serves all shapes. Every kernel
takes `first`, the index that its first thread stands for: on the CPU each core launches on its own range.
"""

import warp as wp

from homolog.correspondence.kernels.functions import (
    FieldData,
    StencilCache,
    closest_on_triangle,
    field_curvature,
    field_point,
)
from homolog.geodesics.kernels.lookup import SurfacePoint, TableData, surface_point

wp.set_module_options({"enable_backward": False, "fast_math": False})

__all__ = [
    "Layout",
    "Pose",
    "StepParameters",
    "Surface",
    "find_faces",
    "locate",
    "project",
    "project_on_mesh",
    "rim_at",
]


MIN_NORMAL_COSINE = wp.constant(0.5)  # between the normals of a face and a particle that agree
N_NEAREST = wp.constant(24)  # faces among which the start of a walk is chosen
MIN_START_COSINE = wp.constant(0.2)  # between a particle's normal and that of such a face


@wp.struct
class Surface:
    """One shape at one level of detail: a mesh to walk on and its geodesic table."""

    vertices: wp.array(dtype=wp.vec3)
    faces: wp.array(dtype=wp.vec3i)
    face_neighbours: wp.array(dtype=wp.vec3i)  # across the edges opposite to each corner
    normals: wp.array(dtype=wp.vec3)  # at the vertices of a mesh that carries particles; else none
    rims: wp.array(dtype=float)  # distance of each vertex from the nearest rim, if there is one; else none
    table: TableData
    size: float  # square root of its area over the mean area
    fixed: int  # 1: all its particles are fixed, so that nothing is computed for it


@wp.struct
class Pose:
    """The similarity that aligns a shape with the others: x -> linear x + shift."""

    linear: wp.mat33
    rotation: wp.mat33  # of linear, without its scale
    shift: wp.vec3


@wp.struct
class Layout:
    """Parameters that depend on the number of particles only."""

    per_shape: int  # particles on each shape, N
    shapes: int  # M
    geodesic: int  # 1: geodesic distances; 0: straight lines with the normal filter
    expected_width: float  # Parzen width of an even layout on a surface of mean area
    list_cutoff: float  # longest distance in neighbour lists, on a surface of mean area


@wp.struct
class StepParameters:
    """Parameters of one iteration; those of a stage lie in one array."""

    step: float  # tau of the implicit step, a squared length
    max_step: float  # longest move, in Parzen widths
    ensemble_weight: float
    coherence: float  # 1 / squared length
    normals_weight: float
    regularization: wp.float64  # squared length
    normals_regularization: wp.float64  # rad²


@wp.kernel
def project(
    first: int,
    per_shape: int,
    newton_steps: int,
    only_free: int,
    free: wp.array(dtype=int),
    fields: wp.array(dtype=FieldData),
    opening_fields: wp.array(dtype=FieldData),
    cache: StencilCache,
    opening_cache: StencilCache,
    positions: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    shape_operators: wp.array(dtype=wp.mat33),
    openings: wp.array(dtype=wp.vec4),
):
    """Project onto the zero level by Newton steps; compute the normal n and the shape operator dn/dx.

    dn/dx = (I - nn') Hess (I - nn') / |grad|. Where opening angles are in use, their gradient and value are
    computed too. With `only_free` nothing changes for fixed particles, and never for open shapes.
    """
    p = first + wp.tid()
    if only_free == 1 and free[p] == 0:
        return
    field = fields[p // per_shape]
    if field.scale == 0.0:
        return
    x = positions[p]
    limit = 1.5 / wp.length(wp.vec3(field.to_index[0, 0], field.to_index[1, 0], field.to_index[2, 0]))
    for _step in range(newton_steps * free[p]):
        here = field_point(field, cache, p, x)
        gradient_squared = wp.max(wp.length_sq(here.gradient), 1.0e-6)
        move = -here.value / gradient_squared * here.gradient
        length = wp.length(move)
        if length > limit:
            move = move * (limit / length)
        x = x + move
    surface = field_curvature(field, cache, p, x)
    size = wp.max(wp.length(surface.gradient), 1.0e-6)
    n = surface.gradient / size
    flat = wp.identity(n=3, dtype=float) - wp.outer(n, n)
    positions[p] = x
    normals[p] = n
    shape_operators[p] = flat * surface.hessian * flat / size
    opening_field = opening_fields[p // per_shape]
    if opening_field.scale != 0.0:
        opening = field_point(opening_field, opening_cache, p, x)
        slope = opening.gradient
        openings[p] = wp.vec4(slope[0], slope[1], slope[2], opening.value)


@wp.func
def closest_on_face(s: Surface, face: int, x: wp.vec3) -> wp.vec4:
    """Return the barycentric weights of a face's point closest to x, and its squared distance."""
    corners = s.faces[face]
    a = s.vertices[corners[0]]
    b = s.vertices[corners[1]]
    c = s.vertices[corners[2]]
    w = closest_on_triangle(x, a, b, c)
    return wp.vec4(w[0], w[1], w[2], wp.length_sq(x - (w[0] * a + w[1] * b + w[2] * c)))


@wp.func
def corner_of(s: Surface, face: int, vertex: int) -> int:
    """Return which corner of a face a vertex is."""
    corners = s.faces[face]
    return wp.where(corners[0] == vertex, 0, wp.where(corners[1] == vertex, 1, 2))


@wp.func
def normal_cosine(s: Surface, face: int, normal: wp.vec3) -> float:
    """Return the cosine between a face's normal and another."""
    corners = s.faces[face]
    a = s.vertices[corners[0]]
    return wp.dot(wp.normalize(wp.cross(s.vertices[corners[1]] - a, s.vertices[corners[2]] - a)), normal)


@wp.func
def next_face_around(s: Surface, face: int, vertex: int) -> int:
    """Return the next face around a vertex; at a rim, the last one follows the first one."""
    following = s.face_neighbours[face][(corner_of(s, face, vertex) + 1) % 3]
    if following < 0:
        following = face
        back = s.face_neighbours[face][(corner_of(s, face, vertex) + 2) % 3]
        while back >= 0:
            following = back
            back = s.face_neighbours[back][(corner_of(s, back, vertex) + 2) % 3]
    return following


@wp.func
def walk(s: Surface, begin: int, x: wp.vec3) -> int:
    """Walk from a face to a local minimum of the distance to x; return its face.

    From a point on an edge the face across it is tried, from a corner all faces around it.
    """
    face = begin
    closest_here = closest_on_face(s, face, x)
    moved = int(1)
    steps = int(0)
    while moved == 1 and steps < 500:
        moved = int(0)
        steps += 1
        start = face
        for k in range(3):
            if closest_here[k] <= 0.0 and s.face_neighbours[start][k] >= 0:
                other = s.face_neighbours[start][k]
                candidate = closest_on_face(s, other, x)
                if candidate[3] < closest_here[3] * (1.0 - 1.0e-5):
                    closest_here = candidate
                    face = other
                    moved = int(1)
        for k in range(3):
            if moved == 0 and closest_here[k] >= 1.0:
                vertex = s.faces[start][k]
                face_around = next_face_around(s, start, vertex)
                while face_around != start:
                    candidate = closest_on_face(s, face_around, x)
                    if candidate[3] < closest_here[3] * (1.0 - 1.0e-5):
                        closest_here = candidate
                        face = face_around
                        moved = int(1)
                    face_around = next_face_around(s, face_around, vertex)
    return face


@wp.func
def nearest_agreeing_face(s: Surface, face: int, x: wp.vec3, normal: wp.vec3) -> int:
    """Return the closest adjacent face whose normal agrees with the given one; the face itself if none."""
    best = face
    nearest = float(1.0e30)
    for k in range(3):
        vertex = s.faces[face][k]
        face_around = next_face_around(s, face, vertex)
        while face_around != face:
            candidate = closest_on_face(s, face_around, x)
            if candidate[3] < nearest and normal_cosine(s, face_around, normal) > MIN_NORMAL_COSINE:
                nearest = candidate[3]
                best = face_around
            face_around = next_face_around(s, face_around, vertex)
    return best


@wp.kernel
def project_on_mesh(
    first: int,
    per_shape: int,
    only_free: int,
    free: wp.array(dtype=int),
    carriers: wp.array(dtype=Surface),
    face_of: wp.array(dtype=int),
    positions: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    shape_operators: wp.array(dtype=wp.mat33),
):
    """Project the particles of open shapes onto their meshes; compute the normal n and the shape operator.

    A particle walks from its last face and can't leave the mesh across a rim. Normals are interpolated
    between vertices. With `only_free` nothing changes for fixed particles, and never for solid shapes.
    """
    p = first + wp.tid()
    s = carriers[p // per_shape]
    if s.normals.shape[0] == 0 or (only_free == 1 and free[p] == 0):
        return
    face = walk(s, face_of[p], positions[p])
    here = surface_point(s.vertices, s.faces, face, positions[p])
    for k in range(3):  # on an edge, of its two faces the first, wherever the walk came from
        if here.weights[k] <= 0.0 and s.face_neighbours[face][k] >= 0 and s.face_neighbours[face][k] < face:
            face = s.face_neighbours[face][k]
    here = surface_point(s.vertices, s.faces, face, positions[p])
    if free[p] == 1:
        positions[p] = here.position
    face_of[p] = face
    sum = wp.vec3(0.0, 0.0, 0.0)
    slope = wp.mat33()
    for k in range(3):
        normal = s.normals[here.corners[k]]
        sum += here.weights[k] * normal
        slope += wp.outer(normal, wp.vec3(here.gradients[k, 0], here.gradients[k, 1], here.gradients[k, 2]))
    size = wp.max(wp.length(sum), 1.0e-6)
    n = sum / size
    flat = wp.identity(n=3, dtype=float) - wp.outer(n, n)
    slope = flat * slope * flat / size
    normals[p] = n
    shape_operators[p] = 0.5 * (slope + wp.transpose(slope))


@wp.func
def rim_at(s: Surface, point: SurfacePoint) -> wp.vec4:
    """Return the direction away from the nearest rim at a point of a mesh, and the distance from it."""
    distance = float(0.0)
    away = wp.vec3(0.0, 0.0, 0.0)
    for k in range(3):
        there = s.rims[point.corners[k]]
        distance += point.weights[k] * there
        away += there * wp.vec3(point.gradients[k, 0], point.gradients[k, 1], point.gradients[k, 2])
    away = wp.normalize(away)
    return wp.vec4(away[0], away[1], away[2], distance)


@wp.kernel
def locate(
    first: int,
    per_shape: int,
    surfaces: wp.array(dtype=Surface),
    positions: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    face_of: wp.array(dtype=int),
    closest: wp.array(dtype=SurfacePoint),
):
    """Find each particle's closest point on its mesh by walking from its last face.

    A search in space could find the opposite wall of a thin shape. Below a sharp rim the walk can stay in a
    local minimum on the side that the particle came from; it is then restarted from the closest adjacent face
    whose normal agrees with the particle's.
    """
    p = first + wp.tid()
    s = surfaces[p // per_shape]
    x = positions[p]
    face = walk(s, face_of[p], x)
    if normal_cosine(s, face, normals[p]) < MIN_NORMAL_COSINE:
        face = walk(s, nearest_agreeing_face(s, face, x, normals[p]), x)
    face_of[p] = face
    closest[p] = surface_point(s.vertices, s.faces, face, x)


@wp.func
def distance_to_centre(s: Surface, face: int, x: wp.vec3) -> float:
    """Return the squared distance between x and the centre of a face."""
    corners = s.faces[face]
    centre = (s.vertices[corners[0]] + s.vertices[corners[1]] + s.vertices[corners[2]]) / 3.0
    return wp.length_sq(x - centre)


@wp.kernel
def find_faces(
    first: int,
    per_shape: int,
    surfaces: wp.array(dtype=Surface),
    positions: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    face_of: wp.array(dtype=int),
):
    """Find the nearest face of each particle's mesh whose normal agrees, as the start of a walk.

    Of the nearest `N_NEAREST` faces; the nearest one if the normal of none of them agrees. It compares all
    faces, which is quick on a GPU only.
    """
    p = first + wp.tid()
    s = surfaces[p // per_shape]
    x = positions[p]
    n = normals[p]
    nearest = int(0)
    agreeing = int(-1)
    smallest = float(1.0e30)
    smallest_agreeing = float(1.0e30)
    for face in range(s.faces.shape[0]):
        distance = distance_to_centre(s, face, x)
        if distance < smallest:
            smallest = distance
            nearest = face
        if distance < smallest_agreeing and normal_cosine(s, face, n) > MIN_START_COSINE:
            smallest_agreeing = distance
            agreeing = face
    closer = int(0)
    if agreeing != nearest and agreeing >= 0:
        for face in range(s.faces.shape[0]):
            if distance_to_centre(s, face, x) < smallest_agreeing:
                closer += 1
    face_of[p] = wp.where(agreeing >= 0 and closer < N_NEAREST, agreeing, nearest)
