"""The dual of `homolog.correspondence.dual` on a CUDA device, where nothing may wait for the host."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.correspondence.kernels import Knobs

wp.set_module_options({"enable_backward": False})

__all__ = ["MATRICES", "eliminate", "finish", "gram", "regularize"]

MATRICES = wp.constant(3)  # C + aI, C + (a + p)I, normals' C + bI
BLOCK = 128


@wp.kernel
def gram(
    per_shape: int, divisor: wp.float64, rows: wp.array(dtype=wp.vec3), out: wp.array2d(dtype=wp.float64)
):
    """out[k, l] = sum over particles of rows_k . rows_l / divisor; one block of threads an entry."""
    k, other, lane = wp.tid()
    total = wp.float64(0.0)
    for i in range(lane, per_shape, wp.block_dim()):
        total += wp.float64(wp.dot(rows[k * per_shape + i], rows[other * per_shape + i]))
    whole = wp.tile_extract(wp.tile_sum(wp.tile(total)), 0)
    if lane == 0:
        out[k, other] = whole / divisor


@wp.kernel
def regularize(
    stage: wp.array(dtype=Knobs),
    iteration: wp.array(dtype=int),
    ensemble: wp.array2d(dtype=wp.float64),
    normals: wp.array2d(dtype=wp.float64),
    matrices: wp.array3d(dtype=wp.float64),
    logdets: wp.array(dtype=wp.float64),
    stiffness: wp.array(dtype=float),
):
    """Write the three matrices that are inverted."""
    m, i, j = wp.tid()
    knobs = stage[iteration[0]]
    value = ensemble[i, j]
    extra = wp.float64(knobs.regularization)
    if m == 1:
        extra = knobs.regularization + wp.float64(knobs.step * knobs.ensemble_weight)
    if m == 2:
        value = normals[i, j]
        extra = knobs.normals_regularization
    if i == j:
        value += extra
    matrices[m, i, j] = value
    if i == 0 and j == 0:
        logdets[m] = -wp.float64(matrices.shape[1]) * wp.log(extra)
        stiffness[0] = 0.0


@wp.kernel
def eliminate(
    pivot: int,
    source: wp.array3d(dtype=wp.float64),
    target: wp.array3d(dtype=wp.float64),
    logdets: wp.array(dtype=wp.float64),
):
    """One Gauss-Jordan sweep; M of them invert the matrices (positive definite, so without pivoting)."""
    m, i, j = wp.tid()
    d = source[m, pivot, pivot]
    value = wp.float64(0.0)
    if i == pivot and j == pivot:
        value = wp.float64(1.0) / d
        logdets[m] = logdets[m] + wp.log(d)
    elif i == pivot:
        value = source[m, i, j] / d
    elif j == pivot:
        value = -source[m, i, j] / d
    else:
        value = source[m, i, j] - source[m, i, pivot] * source[m, pivot, j] / d
    target[m, i, j] = value


@wp.kernel
def finish(
    stage: wp.array(dtype=Knobs),
    iteration: wp.array(dtype=int),
    inverses: wp.array3d(dtype=wp.float64),
    gradient: wp.array2d(dtype=float),
    damping: wp.array2d(dtype=float),
    normals: wp.array2d(dtype=float),
    stiffness: wp.array(dtype=float),
):
    """Take out the motion common to all shapes and round to float32 (see `dual.inverse_dual`)."""
    i, j = wp.tid()
    knobs = stage[iteration[0]]
    shapes = wp.float64(gradient.shape[0])
    a = knobs.regularization
    b = knobs.normals_regularization
    pull = wp.float64(knobs.step * knobs.ensemble_weight)
    one = wp.float64(1.0)
    gradient[i, j] = float(inverses[0, i, j] - one / (a * shapes))
    identity = wp.where(i == j, one, wp.float64(0.0))
    damping[i, j] = float(identity - pull * (inverses[1, i, j] - one / ((a + pull) * shapes)))
    spread = inverses[2, i, j] - one / (b * shapes)
    normals[i, j] = float(spread)
    if i == j:
        wp.atomic_max(stiffness, 0, float(spread))
