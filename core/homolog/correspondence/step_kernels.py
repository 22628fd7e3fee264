"""One step of all particles across the shapes (conventions as in `kernels`)."""

import warp as wp

from homolog.correspondence.functions import log_adjoint, log_map, tangent
from homolog.correspondence.kernels import Knobs, Layout, Pose, Surface

wp.set_module_options({"enable_backward": False, "fast_math": False})

__all__ = ["advance", "combine", "damp_held", "mean_normals", "move"]


SMALL = wp.constant(0.75)  # size of a surface from which on tau is that of even particles on the mean one


@wp.kernel
def mean_normals(
    first: int,
    c: Layout,
    poses: wp.array(dtype=Pose),
    positions: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    openings: wp.array(dtype=wp.vec4),
    means: wp.array(dtype=wp.vec3),
    centred: wp.array(dtype=wp.vec3),
    logs: wp.array(dtype=wp.vec3),
):
    """Centre the positions over shapes; Fréchet mean of the normals (one Karcher step) and their Logs.

    A Log is tangential to the mean; along the mean it carries the centred opening angle.
    """
    i = first + wp.tid()
    total = wp.vec3(0.0, 0.0, 0.0)
    opening = float(0.0)
    for k in range(c.shapes):
        p = k * c.per_shape + i
        opening += openings[p][3] / float(c.shapes)
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
        p = k * c.per_shape + i
        logs[p] = log_map(mean, poses[k].turn * normals[p]) + (openings[p][3] - opening) * mean


@wp.kernel
def combine(
    first: int,
    c: Layout,
    stage: wp.array(dtype=Knobs),
    iteration: wp.array(dtype=int),
    movable: wp.array(dtype=int),
    stiffness: wp.array(dtype=float),
    surfaces: wp.array(dtype=Surface),
    poses: wp.array(dtype=Pose),
    normals: wp.array(dtype=wp.vec3),
    means: wp.array(dtype=wp.vec3),
    bends: wp.array(dtype=wp.mat33),
    openings: wp.array(dtype=wp.vec4),
    forces: wp.array(dtype=wp.vec3),
    ensemble: wp.array(dtype=wp.vec3),
    log_gradients: wp.array(dtype=wp.vec3),
    steps: wp.array(dtype=wp.vec3),
):
    """Sum of the three descent directions times tau, in the tangent plane; zero where held.

    Steps are turned as the shapes are compared, so that they can be mixed across shapes. They are implicit in
    the normals: (I + tau w_V r (S² + gg'))^-1 damps them where the normal turns fast, else they overshoot at
    sharp rims, with r the stiffest shape's and g the slope of the opening angle. The whole sum is damped, so
    that the parts balance where they did. On surfaces so small that steps would be too long for how close
    particles lie together tau is smaller; on others it is the same, so that a motion common to all shapes
    stays one.
    """
    p = first + wp.tid()
    n = normals[p]
    bend = bends[p]
    pose = poses[p // c.per_shape]
    upright = wp.transpose(pose.turn)
    mean = means[p % c.per_shape]
    turned = bend * (upright * log_adjoint(mean, pose.turn * n, log_gradients[p]))
    opening = openings[p]
    slope = tangent(wp.vec3(opening[0], opening[1], opening[2]), n)
    turned += wp.dot(log_gradients[p], mean) * slope
    knobs = stage[iteration[0]]
    size = surfaces[p // c.per_shape].size
    tau = knobs.step * wp.min(1.0, size * size / (SMALL * SMALL))
    pulled = wp.transpose(pose.linear) * ensemble[p]
    total = tangent(forces[p] - knobs.ensemble_weight * pulled - knobs.normals_weight * turned, n)
    stiff = tau * knobs.normals_weight * stiffness[0] * (bend * bend + wp.outer(slope, slope))
    steps[p] = (
        float(movable[p]) * tau * (pose.turn * (wp.inverse(wp.identity(n=3, dtype=float) + stiff) * total))
    )


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
