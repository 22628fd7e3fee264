"""The optimizer's Warp kernels, the same source for CPU and CUDA.

Particle arrays are flat, index = shape * N + particle, so that one launch serves all shapes. Every kernel
takes `first`, the index that its first thread stands for: on the CPU each core launches on its own range.
"""

import warp as wp

from homolog.correspondence.functions import (
    FieldData,
    closest_on_triangle,
    field_curvature,
    field_point,
)
from homolog.geodesics.kernels.lookup import SurfacePoint, TableData, surface_point

wp.set_module_options({"enable_backward": False, "fast_math": False})

__all__ = [
    "Knobs",
    "Layout",
    "Pose",
    "Surface",
    "locate",
    "project",
]


ALIKE = wp.constant(0.5)  # cosine from which a face looks the way a particle does


@wp.struct
class Surface:
    """One shape at one level of detail: a mesh to walk on and its geodesic table."""

    vertices: wp.array(dtype=wp.vec3)
    faces: wp.array(dtype=wp.vec3i)
    face_neighbors: wp.array(dtype=wp.vec3i)  # across the edges opposite to each corner
    table: TableData
    size: float  # root of its area over that of the mean area
    held: int  # 1: none of its particles may move, so that nothing is computed for it


@wp.struct
class Pose:
    """The similarity under which a shape is compared with the others: x -> linear x + shift."""

    linear: wp.mat33
    turn: wp.mat33  # its rotation
    shift: wp.vec3


@wp.struct
class Layout:
    """What stays the same while the number of particles does."""

    per_shape: int  # particles on each shape, N
    shapes: int  # M
    geodesic: int  # 1: geodesic distances; 0: straight lines with the normal filter
    expected_width: float  # Parzen width of an even layout on a surface of mean area
    reach: float  # neighbour lists hold pairs nearer than this, there


@wp.struct
class Knobs:
    """What changes from one iteration to the next; a stage's iterations lie in one array."""

    step: float  # tau of the implicit step, a squared length
    most: float  # longest move, in Parzen widths
    ensemble_weight: float
    normals_weight: float
    regularization: wp.float64  # squared length
    normals_regularization: wp.float64  # rad²


@wp.kernel
def project(
    first: int,
    per_shape: int,
    newton_steps: int,
    movable: wp.array(dtype=int),
    fields: wp.array(dtype=FieldData),
    reliefs: wp.array(dtype=FieldData),
    positions: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    bends: wp.array(dtype=wp.mat33),
    openings: wp.array(dtype=wp.vec4),
):
    """Newton steps to the zero level, then the normal n and dn/dx = (I-nn')Hess(I-nn')/|grad|.

    Also the gradient of the opening angle, and the angle, where it counts.
    """
    p = first + wp.tid()
    field = fields[p // per_shape]
    x = positions[p]
    limit = 1.5 / wp.length(wp.vec3(field.to_index[0, 0], field.to_index[1, 0], field.to_index[2, 0]))
    for _step in range(newton_steps * movable[p]):
        here = field_point(field, x)
        steep = wp.max(wp.length_sq(here.gradient), 1.0e-6)
        move = -here.value / steep * here.gradient
        length = wp.length(move)
        if length > limit:
            move = move * (limit / length)
        x = x + move
    there = field_curvature(field, x)
    size = wp.max(wp.length(there.gradient), 1.0e-6)
    n = there.gradient / size
    flat = wp.identity(n=3, dtype=float) - wp.outer(n, n)
    positions[p] = x
    normals[p] = n
    bends[p] = flat * there.hessian * flat / size
    relief = reliefs[p // per_shape]
    if relief.scale != 0.0:
        opening = field_point(relief, x)
        slope = opening.gradient
        openings[p] = wp.vec4(slope[0], slope[1], slope[2], opening.value)


@wp.func
def foot_on_face(s: Surface, face: int, x: wp.vec3) -> wp.vec4:
    """Barycentric weights of a face's point nearest to x, and its squared distance."""
    corners = s.faces[face]
    a = s.vertices[corners[0]]
    b = s.vertices[corners[1]]
    c = s.vertices[corners[2]]
    w = closest_on_triangle(x, a, b, c)
    return wp.vec4(w[0], w[1], w[2], wp.length_sq(x - (w[0] * a + w[1] * b + w[2] * c)))


@wp.func
def corner_of(s: Surface, face: int, vertex: int) -> int:
    """Which corner of a face a vertex is."""
    corners = s.faces[face]
    return wp.where(corners[0] == vertex, 0, wp.where(corners[1] == vertex, 1, 2))


@wp.func
def facing(s: Surface, face: int, normal: wp.vec3) -> float:
    """Cosine between a face's normal and another."""
    corners = s.faces[face]
    a = s.vertices[corners[0]]
    return wp.dot(wp.normalize(wp.cross(s.vertices[corners[1]] - a, s.vertices[corners[2]] - a)), normal)


@wp.func
def around(s: Surface, face: int, vertex: int) -> int:
    """Return the next face around a vertex."""
    return s.face_neighbors[face][(corner_of(s, face, vertex) + 1) % 3]


@wp.func
def walk(s: Surface, begin: int, x: wp.vec3) -> int:
    """From a face downhill to one that no neighbour is nearer than.

    From an edge the walk looks across it, from a corner at all faces around that corner.
    """
    face = begin
    here = foot_on_face(s, face, x)
    moved = int(1)
    steps = int(0)
    while moved == 1 and steps < 500:
        moved = int(0)
        steps += 1
        start = face
        for k in range(3):
            if here[k] <= 0.0:
                other = s.face_neighbors[start][k]
                there = foot_on_face(s, other, x)
                if there[3] < here[3] * (1.0 - 1.0e-5):
                    here = there
                    face = other
                    moved = int(1)
        for k in range(3):
            if moved == 0 and here[k] >= 1.0:
                vertex = s.faces[start][k]
                turning = around(s, start, vertex)
                while turning != start:
                    there = foot_on_face(s, turning, x)
                    if there[3] < here[3] * (1.0 - 1.0e-5):
                        here = there
                        face = turning
                        moved = int(1)
                    turning = around(s, turning, vertex)
    return face


@wp.func
def alike(s: Surface, face: int, x: wp.vec3, normal: wp.vec3) -> int:
    """Return the nearest of the faces around a face's corners that faces as the normal does, or the face."""
    best = face
    nearest = float(1.0e30)
    for k in range(3):
        vertex = s.faces[face][k]
        turning = around(s, face, vertex)
        while turning != face:
            there = foot_on_face(s, turning, x)
            if there[3] < nearest and facing(s, turning, normal) > ALIKE:
                nearest = there[3]
                best = turning
            turning = around(s, turning, vertex)
    return best


@wp.kernel
def locate(
    first: int,
    per_shape: int,
    surfaces: wp.array(dtype=Surface),
    positions: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    face_of: wp.array(dtype=int),
    feet: wp.array(dtype=SurfacePoint),
):
    """Walk from the last face to the nearest one; never through space, where the other wall may be nearer.

    Where a particle turns around a sharp rim just below the mesh, its foot would stay behind on the side that
    it comes from, ever farther away: there the walk starts again from a face that looks like the particle.
    """
    p = first + wp.tid()
    s = surfaces[p // per_shape]
    x = positions[p]
    face = walk(s, face_of[p], x)
    if facing(s, face, normals[p]) < ALIKE:
        face = walk(s, alike(s, face, x, normals[p]), x)
    face_of[p] = face
    feet[p] = surface_point(s.vertices, s.faces, face, x)
