"""The dual of `homolog.correspondence.dual` on a CUDA device, where nothing may wait for the host.

All kernels take `SIDE` shapes at a time in both directions: what a thread reads serves four of them, and an
inversion takes M/4 launches. Matrices that are inverted are padded with the identity to whole blocks.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.correspondence.kernels import Knobs

wp.set_module_options({"enable_backward": False})

__all__ = ["LANES", "MATRICES", "SIDE", "eliminate", "finish", "gram", "mix", "regularize"]

MATRICES = wp.constant(3)  # C + aI, C + (a + p)I, normals' C + bI
SIDE = wp.constant(4)
LANES = 128


@wp.kernel
def gram(
    shapes: int,
    per_shape: int,
    divisor: wp.float64,
    rows: wp.array(dtype=wp.vec3),
    out: wp.array2d(dtype=wp.float64),
):
    """out[k, l] = sum over particles of rows_k . rows_l / divisor; a block of threads for each of entries."""
    over, beside, lane = wp.tid()
    total = wp.mat44d()
    begin = wp.where(over <= beside, lane, per_shape)  # symmetric: the rest is written from the other side
    for i in range(begin, per_shape, wp.block_dim()):
        for r in range(SIDE):
            here = wp.vec3d(rows[wp.min(over * SIDE + r, shapes - 1) * per_shape + i])
            for c in range(SIDE):
                there = wp.vec3d(rows[wp.min(beside * SIDE + c, shapes - 1) * per_shape + i])
                total[r, c] += wp.dot(here, there)
    for r in range(SIDE):
        for c in range(SIDE):
            whole = wp.tile_extract(wp.tile_sum(wp.tile(total[r, c])), 0)
            k = over * SIDE + r
            other = beside * SIDE + c
            if lane == 0 and over <= beside and k < shapes and other < shapes:
                out[k, other] = whole / divisor
                out[other, k] = whole / divisor


@wp.kernel
def regularize(
    stage: wp.array(dtype=Knobs),
    iteration: wp.array(dtype=int),
    ensemble: wp.array2d(dtype=wp.float64),
    normals: wp.array2d(dtype=wp.float64),
    matrices: wp.array3d(dtype=wp.mat44d),
    logdets: wp.array(dtype=wp.float64),
    stiffness: wp.array(dtype=float),
):
    """Write the three matrices that are inverted, by blocks."""
    m, over, beside = wp.tid()
    knobs = stage[iteration[0]]
    extra = wp.float64(knobs.regularization)
    if m == 1:
        extra = knobs.regularization + wp.float64(knobs.step * knobs.ensemble_weight)
    if m == 2:
        extra = knobs.normals_regularization
    shapes = ensemble.shape[0]
    block = wp.mat44d()
    for r in range(SIDE):
        for c in range(SIDE):
            i = over * SIDE + r
            j = beside * SIDE + c
            value = wp.float64(0.0)
            if i < shapes and j < shapes:
                value = ensemble[i, j]
                if m == 2:
                    value = normals[i, j]
                if i == j:
                    value += extra
            elif i == j:
                value = wp.float64(1.0)
            block[r, c] = value
    matrices[m, over, beside] = block
    if over == 0 and beside == 0:
        logdets[m] = -wp.float64(shapes) * wp.log(extra)
        stiffness[0] = 0.0


@wp.func
def inverted(matrix: wp.mat44d):
    """Return the inverse of a positive definite matrix and its determinant: Gauss-Jordan without pivoting.

    Not by cofactors, which cancel where one mode dwarfs the others.
    """
    out = matrix
    determinant = wp.float64(1.0)
    for p in range(SIDE):
        determinant *= out[p, p]
        d = wp.float64(1.0) / out[p, p]
        for i in range(SIDE):
            if i != p:
                factor = out[i, p] * d
                for j in range(SIDE):
                    if j != p:
                        out[i, j] -= factor * out[p, j]
                out[i, p] = -factor
        for j in range(SIDE):
            if j != p:
                out[p, j] *= d
        out[p, p] = d
    return out, determinant


@wp.kernel
def eliminate(
    pivot: int,
    source: wp.array3d(dtype=wp.mat44d),
    target: wp.array3d(dtype=wp.mat44d),
    logdets: wp.array(dtype=wp.float64),
):
    """One Gauss-Jordan sweep of a block of pivots; as many as blocks in a row invert the matrices."""
    m, i, j = wp.tid()
    inverse, determinant = inverted(source[m, pivot, pivot])
    value = source[m, i, j]
    if i == pivot and j == pivot:
        value = inverse
        logdets[m] = logdets[m] + wp.log(determinant)
    elif i == pivot:
        value = inverse * value
    elif j == pivot:
        value = -value * inverse
    else:
        value = value - source[m, i, pivot] * (inverse * source[m, pivot, j])
    target[m, i, j] = value


@wp.kernel
def finish(
    stage: wp.array(dtype=Knobs),
    iteration: wp.array(dtype=int),
    inverses: wp.array3d(dtype=wp.mat44d),
    gradient: wp.array2d(dtype=float),
    damping: wp.array2d(dtype=float),
    normals: wp.array2d(dtype=float),
    stiffness: wp.array(dtype=float),
):
    """Take out the motion common to all shapes and round to float32 (see `dual.inverse_dual`)."""
    i, j = wp.tid()
    over, beside, r, c = i // SIDE, j // SIDE, i % SIDE, j % SIDE
    knobs = stage[iteration[0]]
    shapes = wp.float64(gradient.shape[0])
    a = knobs.regularization
    b = knobs.normals_regularization
    pull = wp.float64(knobs.step * knobs.ensemble_weight)
    one = wp.float64(1.0)
    gradient[i, j] = float(inverses[0, over, beside][r, c] - one / (a * shapes))
    identity = wp.where(i == j, one, wp.float64(0.0))
    damping[i, j] = float(identity - pull * (inverses[1, over, beside][r, c] - one / ((a + pull) * shapes)))
    spread = inverses[2, over, beside][r, c] - one / (b * shapes)
    normals[i, j] = float(spread)
    if i == j:
        wp.atomic_max(stiffness, 0, float(spread))


@wp.kernel
def mix(
    shapes: int,
    per_shape: int,
    matrix: wp.array2d(dtype=float),
    source: wp.array(dtype=wp.vec3),
    target: wp.array(dtype=wp.vec3),
):
    """target[k] = sum_l matrix[k, l] source[l], per particle: a small symmetric matrix across the shapes."""
    over, i = wp.tid()
    total = wp.matrix(shape=(SIDE, 3), dtype=float)
    weights = wp.vec4()
    for other in range(shapes):
        for r in range(SIDE):
            weights[r] = matrix[other, wp.min(over * SIDE + r, shapes - 1)]
        total += wp.outer(weights, source[other * per_shape + i])
    for r in range(SIDE):
        k = over * SIDE + r
        if k < shapes:
            target[k * per_shape + i] = total[r]
