"""Coherence on the device: how particles move apart from their neighbours (conventions as in `kernels`)."""

import warp as wp

from homolog.correspondence.kernels.particles import Layout, StepParameters

wp.set_module_options({"enable_backward": False, "fast_math": False})

__all__ = ["add_gradient", "damp", "find_residuals"]


@wp.kernel
def find_residuals(
    first: int,
    c: Layout,
    neighbours: wp.array(dtype=int, ndim=2),
    weights: wp.array(dtype=float, ndim=2),
    centred: wp.array(dtype=wp.vec3),
    residuals: wp.array(dtype=wp.vec3),
):
    """Write A y: a particle's deviation from the mean shape minus what those of its neighbours predict."""
    p = first + wp.tid()
    i = p % c.per_shape
    begin = p - i
    residual = centred[p]
    for k in range(neighbours.shape[1]):
        residual -= weights[i, k] * centred[begin + neighbours[i, k]]
    residuals[p] = residual


@wp.kernel
def add_gradient(
    first: int,
    c: Layout,
    stage: wp.array(dtype=StepParameters),
    iteration: wp.array(dtype=int),
    starts: wp.array(dtype=int),
    predicted: wp.array(dtype=int),
    shares: wp.array(dtype=float),
    residuals: wp.array(dtype=wp.vec3),
    ensemble: wp.array(dtype=wp.vec3),
):
    """Add A' A y, relative to the weight of H(Z), to the gradient of H(Z).

    `predicted` lists, from starts[i] on, the particles that i helps to predict, `shares` its weights there.
    """
    p = first + wp.tid()
    i = p % c.per_shape
    begin = p - i
    gradient = residuals[p]
    for k in range(starts[i], starts[i + 1]):
        gradient -= shares[k] * residuals[begin + predicted[k]]
    parameters = stage[iteration[0]]
    ensemble[p] = ensemble[p] + parameters.coherence / parameters.ensemble_weight * gradient


@wp.kernel
def damp(
    first: int,
    c: Layout,
    stage: wp.array(dtype=StepParameters),
    iteration: wp.array(dtype=int),
    stiffness: wp.array(dtype=float),
    free: wp.array(dtype=int),
    steps: wp.array(dtype=wp.vec3),
):
    """Damp what the steps of a particle on the shapes do not have in common, so that the step is stable.

    With half the largest eigenvalue of A' A as `stiffness` it is, for any tau.
    """
    i = first + wp.tid()
    parameters = stage[iteration[0]]
    damping = 1.0 / (1.0 + parameters.step * parameters.coherence * stiffness[0])
    common = wp.vec3(0.0, 0.0, 0.0)
    if c.shapes > 1:  # a single shape is compared with an ensemble at rest
        for k in range(c.shapes):
            common += steps[k * c.per_shape + i]
        common = common / float(c.shapes)
    for k in range(c.shapes):
        p = k * c.per_shape + i
        if free[p] == 1:
            steps[p] = common + damping * (steps[p] - common)
