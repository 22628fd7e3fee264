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
    log_adjoint,
    log_map,
    tangent,
)
from homolog.geodesics.lookup import SurfacePoint, TableData, surface_point

wp.set_module_options({"enable_backward": False, "fast_math": False})

__all__ = [
    "Knobs",
    "Layout",
    "Pose",
    "Surface",
    "advance",
    "combine",
    "damp_held",
    "locate",
    "mean_normals",
    "mix",
    "move",
    "project",
]


@wp.struct
class Surface:
    """One shape at one level of detail: a mesh to walk on and its geodesic table."""

    vertices: wp.array(dtype=wp.vec3)
    faces: wp.array(dtype=wp.vec3i)
    face_neighbors: wp.array(dtype=wp.vec3i)  # across the edges opposite to each corner
    table: TableData
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
    expected_width: float  # Parzen width of an even layout
    reach: float  # neighbour lists hold pairs nearer than this


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
    positions: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    bends: wp.array(dtype=wp.mat33),
):
    """Newton steps to the zero level, then the normal n and dn/dx = (I-nn')Hess(I-nn')/|grad|."""
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


@wp.kernel
def locate(
    first: int,
    per_shape: int,
    surfaces: wp.array(dtype=Surface),
    positions: wp.array(dtype=wp.vec3),
    face_of: wp.array(dtype=int),
    feet: wp.array(dtype=SurfacePoint),
):
    """Walk from the last face to the nearest one; never through space, where the other wall may be nearer.

    From an edge the walk looks across it, from a corner at all faces around that corner.
    """
    p = first + wp.tid()
    s = surfaces[p // per_shape]
    x = positions[p]
    face = face_of[p]
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
                turning = s.face_neighbors[start][(k + 1) % 3]
                while turning != start:
                    there = foot_on_face(s, turning, x)
                    if there[3] < here[3] * (1.0 - 1.0e-5):
                        here = there
                        face = turning
                        moved = int(1)
                    turning = s.face_neighbors[turning][(corner_of(s, turning, vertex) + 1) % 3]
    face_of[p] = face
    feet[p] = surface_point(s.vertices, s.faces, face, x)


@wp.kernel
def mean_normals(
    first: int,
    c: Layout,
    poses: wp.array(dtype=Pose),
    positions: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    means: wp.array(dtype=wp.vec3),
    centred: wp.array(dtype=wp.vec3),
    logs: wp.array(dtype=wp.vec3),
):
    """Centre the positions over shapes; Fréchet mean of the normals (one Karcher step) and their Logs."""
    i = first + wp.tid()
    total = wp.vec3(0.0, 0.0, 0.0)
    for k in range(c.shapes):
        p = k * c.per_shape + i
        posed = poses[k].linear * positions[p] + poses[k].shift
        centred[p] = posed
        total += posed
    middle = total / float(c.shapes)
    for k in range(c.shapes):
        centred[k * c.per_shape + i] = centred[k * c.per_shape + i] - middle
    mean = means[i]
    for _round in range(2):
        shift = wp.vec3(0.0, 0.0, 0.0)
        for k in range(c.shapes):
            shift += log_map(mean, poses[k].turn * normals[k * c.per_shape + i])
        shift = shift / float(c.shapes)
        angle = wp.length(shift)
        if angle > 1.0e-7:
            mean = wp.normalize(wp.cos(angle) * mean + wp.sin(angle) / angle * shift)
    means[i] = mean
    for k in range(c.shapes):
        logs[k * c.per_shape + i] = log_map(mean, poses[k].turn * normals[k * c.per_shape + i])


@wp.kernel
def combine(
    first: int,
    c: Layout,
    stage: wp.array(dtype=Knobs),
    iteration: wp.array(dtype=int),
    movable: wp.array(dtype=int),
    stiffness: wp.array(dtype=float),
    poses: wp.array(dtype=Pose),
    normals: wp.array(dtype=wp.vec3),
    means: wp.array(dtype=wp.vec3),
    bends: wp.array(dtype=wp.mat33),
    forces: wp.array(dtype=wp.vec3),
    ensemble: wp.array(dtype=wp.vec3),
    log_gradients: wp.array(dtype=wp.vec3),
    steps: wp.array(dtype=wp.vec3),
):
    """Sum of the three descent directions times tau, in the tangent plane; zero where held.

    Steps are turned as the shapes are compared, so that they can be mixed across shapes. The normals' part
    is divided by 1 + its own stiffness, else it overshoots at sharp rims.
    """
    p = first + wp.tid()
    n = normals[p]
    bend = bends[p]
    pose = poses[p // c.per_shape]
    upright = wp.transpose(pose.turn)
    turned = bend * (upright * log_adjoint(means[p % c.per_shape], pose.turn * n, log_gradients[p]))
    size = wp.ddot(bend, bend)
    knobs = stage[iteration[0]]
    damping = 1.0 + knobs.step * knobs.normals_weight * size * stiffness[0]
    pulled = wp.transpose(pose.linear) * ensemble[p]
    total = forces[p] - knobs.ensemble_weight * pulled - knobs.normals_weight / damping * turned
    steps[p] = float(movable[p]) * knobs.step * (pose.turn * tangent(total, n))


@wp.kernel
def mix(
    first: int,
    per_shape: int,
    shapes: int,
    matrix: wp.array(dtype=float, ndim=2),
    source: wp.array(dtype=wp.vec3),
    target: wp.array(dtype=wp.vec3),
):
    """target[k] = sum_l matrix[k, l] source[l], per particle: a small matrix across the shapes."""
    p = first + wp.tid()
    i = p % per_shape
    k = p // per_shape
    total = wp.vec3(0.0, 0.0, 0.0)
    for other in range(shapes):
        total += matrix[k, other] * source[other * per_shape + i]
    target[p] = total


@wp.kernel
def damp_held(
    first: int,
    c: Layout,
    stage: wp.array(dtype=Knobs),
    iteration: wp.array(dtype=int),
    movable: wp.array(dtype=int),
    gradient: wp.array(dtype=float, ndim=2),
    damping: wp.array(dtype=float, ndim=2),
    steps: wp.array(dtype=wp.vec3),
    damped: wp.array(dtype=wp.vec3),
):
    """Apply the implicit part of the step where some particles are held.

    (I + pW)^-1 across the shapes where a particle may move on all of them; else, on each alone, 1 / (1 + p r)
    with r the sum of |W| over the shapes on which it may move (Gershgorin's bound, exact for one shape).
    """
    p = first + wp.tid()
    i = p % c.per_shape
    k = p // c.per_shape
    together = wp.vec3(0.0, 0.0, 0.0)
    bound = float(0.0)
    free = int(0)
    for other in range(c.shapes):
        q = other * c.per_shape + i
        together += damping[k, other] * steps[q]
        bound += wp.abs(gradient[k, other]) * float(movable[q])
        free += movable[q]
    if free == c.shapes:
        damped[p] = together
    else:
        knobs = stage[iteration[0]]
        damped[p] = steps[p] / (1.0 + knobs.step * knobs.ensemble_weight * bound)


@wp.kernel
def move(
    first: int,
    per_shape: int,
    stage: wp.array(dtype=Knobs),
    iteration: wp.array(dtype=int),
    steps: wp.array(dtype=wp.vec3),
    poses: wp.array(dtype=Pose),
    normals: wp.array(dtype=wp.vec3),
    widths: wp.array(dtype=float),
    next_widths: wp.array(dtype=float),
    positions: wp.array(dtype=wp.vec3),
):
    """Take the step in the tangent plane, no longer than a part of the Parzen width."""
    p = first + wp.tid()
    d = tangent(wp.transpose(poses[p // per_shape].turn) * steps[p], normals[p])
    length = wp.length(d)
    limit = stage[iteration[0]].most * widths[p]
    if length > limit:
        d = d * (limit / length)
    positions[p] = positions[p] + d
    widths[p] = next_widths[p]


@wp.kernel
def advance(iteration: wp.array(dtype=int)):
    """Go to the next iteration's knobs."""
    iteration[0] = iteration[0] + 1
