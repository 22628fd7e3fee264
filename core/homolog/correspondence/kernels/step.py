"""One step of all particles across the shapes (conventions as in `kernels`)."""

import warp as wp

from homolog.correspondence.kernels.functions import log_adjoint, log_map, tangent
from homolog.correspondence.kernels.particles import Layout, Pose, StepParameters, Surface

wp.set_module_options({"enable_backward": False, "fast_math": False})

__all__ = ["combine", "damp_with_fixed", "mean_normals", "move", "next_iteration"]


FULL_STEP_SIZE = wp.constant(0.75)
"""Relative size of a surface below which tau is reduced."""


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
    """Centre the positions over shapes; update the Fréchet mean of the normals (Karcher steps); compute Logs.

    A Log is tangential to the mean normal; its component along the mean holds the centred opening angle.
    """
    i = first + wp.tid()
    total = wp.vec3(0.0, 0.0, 0.0)
    mean_opening = float(0.0)
    for k in range(c.shapes):
        p = k * c.per_shape + i
        mean_opening += openings[p][3] / float(c.shapes)
        aligned = poses[k].linear * positions[p] + poses[k].shift
        centred[p] = aligned
        total += aligned
    middle = total / float(c.shapes)
    for k in range(c.shapes):
        centred[k * c.per_shape + i] = centred[k * c.per_shape + i] - middle
    mean = means[i]
    for _round in range(2):
        shift = wp.vec3(0.0, 0.0, 0.0)
        for k in range(c.shapes):
            shift += log_map(mean, poses[k].rotation * normals[k * c.per_shape + i])
        shift = shift / float(c.shapes)
        angle = wp.length(shift)
        if angle > 1.0e-7:
            mean = wp.normalize(wp.cos(angle) * mean + wp.sin(angle) / angle * shift)
    means[i] = mean
    for k in range(c.shapes):
        p = k * c.per_shape + i
        logs[p] = log_map(mean, poses[k].rotation * normals[p]) + (openings[p][3] - mean_opening) * mean


@wp.kernel
def combine(
    first: int,
    c: Layout,
    stage: wp.array(dtype=StepParameters),
    iteration: wp.array(dtype=int),
    free: wp.array(dtype=int),
    stiffness: wp.array(dtype=float),
    surfaces: wp.array(dtype=Surface),
    poses: wp.array(dtype=Pose),
    normals: wp.array(dtype=wp.vec3),
    means: wp.array(dtype=wp.vec3),
    shape_operators: wp.array(dtype=wp.mat33),
    openings: wp.array(dtype=wp.vec4),
    forces: wp.array(dtype=wp.vec3),
    ensemble: wp.array(dtype=wp.vec3),
    log_gradients: wp.array(dtype=wp.vec3),
    steps: wp.array(dtype=wp.vec3),
):
    """Sum the three descent directions times tau, in the tangent plane; zero for fixed particles.

    Steps are rotated into the aligned frame, so that they can be mixed across shapes. They are implicit in
    the normals: (I + tau w_V r (S² + gg'))^-1 damps them where the normal changes fast; explicit steps would
    overshoot at sharp rims. S is the shape operator, g the gradient of the opening angle and r the largest
    stiffness of all shapes. The whole sum is damped, so that equilibria do not change. tau is reduced only on
    surfaces small enough for a full step to exceed the particle spacing; otherwise all shapes share one tau,
    so that a common motion stays common.
    """
    p = first + wp.tid()
    if free[p] == 0:
        steps[p] = wp.vec3(0.0, 0.0, 0.0)
        return
    n = normals[p]
    shape_operator = shape_operators[p]
    pose = poses[p // c.per_shape]
    inverse_rotation = wp.transpose(pose.rotation)
    mean = means[p % c.per_shape]
    pulled_back = shape_operator * (inverse_rotation * log_adjoint(mean, pose.rotation * n, log_gradients[p]))
    opening = openings[p]
    slope = tangent(wp.vec3(opening[0], opening[1], opening[2]), n)
    pulled_back += wp.dot(log_gradients[p], mean) * slope
    parameters = stage[iteration[0]]
    size = surfaces[p // c.per_shape].size
    tau = parameters.step * wp.min(1.0, size * size / (FULL_STEP_SIZE * FULL_STEP_SIZE))
    ensemble_part = wp.transpose(pose.linear) * ensemble[p]
    total = tangent(
        forces[p] - parameters.ensemble_weight * ensemble_part - parameters.normals_weight * pulled_back, n
    )
    stiffness_matrix = (
        tau
        * parameters.normals_weight
        * stiffness[0]
        * (shape_operator * shape_operator + wp.outer(slope, slope))
    )
    steps[p] = tau * (pose.rotation * (wp.inverse(wp.identity(n=3, dtype=float) + stiffness_matrix) * total))


@wp.kernel
def damp_with_fixed(
    first: int,
    c: Layout,
    stage: wp.array(dtype=StepParameters),
    iteration: wp.array(dtype=int),
    free: wp.array(dtype=int),
    gradient: wp.array(dtype=float, ndim=2),
    damping: wp.array(dtype=float, ndim=2),
    steps: wp.array(dtype=wp.vec3),
    damped: wp.array(dtype=wp.vec3),
):
    """Apply the implicit part of the step where some particles are fixed.

    A particle that is free on all shapes gets (I + pW)^-1 across them. Otherwise each shape gets 1/(1 + p r)
    alone; r is the sum of |W| over the shapes on which the particle is free (Gershgorin's bound, exact for
    one shape).
    """
    p = first + wp.tid()
    i = p % c.per_shape
    k = p // c.per_shape
    coupled = wp.vec3(0.0, 0.0, 0.0)
    bound = float(0.0)
    n_free = int(0)
    for other in range(c.shapes):
        q = other * c.per_shape + i
        coupled += damping[k, other] * steps[q]
        bound += wp.abs(gradient[k, other]) * float(free[q])
        n_free += free[q]
    if n_free == c.shapes:
        damped[p] = coupled
    else:
        parameters = stage[iteration[0]]
        damped[p] = steps[p] / (1.0 + parameters.step * parameters.ensemble_weight * bound)


@wp.kernel
def move(
    first: int,
    per_shape: int,
    stage: wp.array(dtype=StepParameters),
    iteration: wp.array(dtype=int),
    steps: wp.array(dtype=wp.vec3),
    poses: wp.array(dtype=Pose),
    normals: wp.array(dtype=wp.vec3),
    widths: wp.array(dtype=float),
    next_widths: wp.array(dtype=float),
    positions: wp.array(dtype=wp.vec3),
):
    """Move in the tangent plane, by at most `max_step` Parzen widths."""
    p = first + wp.tid()
    d = tangent(wp.transpose(poses[p // per_shape].rotation) * steps[p], normals[p])
    length = wp.length(d)
    limit = stage[iteration[0]].max_step * widths[p]
    if length > limit:
        d = d * (limit / length)
    positions[p] = positions[p] + d
    widths[p] = next_widths[p]


@wp.kernel
def next_iteration(iteration: wp.array(dtype=int)):
    """Advance to the next iteration's parameters."""
    iteration[0] = iteration[0] + 1
