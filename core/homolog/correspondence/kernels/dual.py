"""The dual of `homolog.correspondence.entropy.dual` on a CUDA device, without synchronization with the host.

Several matrices are inverted at once, (k, P, P), padded with the identity to P. Threads compute blocks of
`BLOCK_SIZE` x `BLOCK_SIZE`. For many shapes see `kernels.dual_tiles`.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.correspondence.kernels.particles import StepParameters

wp.set_module_options({"enable_backward": False})

__all__ = [
    "BLOCK_DIM",
    "BLOCK_SIZE",
    "NORMALS",
    "N_MATRICES",
    "extract_inverses",
    "gram",
    "join",
    "load_block",
    "multiply",
    "regularize",
    "sweep",
]

N_MATRICES = 3  # C + aI, C + (a + p)I, normals' C + bI
NORMALS = wp.constant(2)
"""Index of the matrix of the normals; those before it are of the positions."""
BLOCK_SIZE = wp.constant(4)
BLOCK_DIM = 128


@wp.kernel
def gram(
    shapes: int,
    per_shape: int,
    divisor: wp.float64,
    rows: wp.array(dtype=wp.vec3),
    out: wp.array2d(dtype=wp.float64),
):
    """Write out[k, l] = sum over particles of rows_k . rows_l / divisor, a thread block for a block."""
    block_row, block_column, lane = wp.tid()
    total = wp.mat44d()
    begin = wp.where(
        block_row <= block_column, lane, per_shape
    )  # symmetric: the rest is written from the other side
    for i in range(begin, per_shape, wp.block_dim()):
        for r in range(BLOCK_SIZE):
            here = wp.vec3d(rows[wp.min(block_row * BLOCK_SIZE + r, shapes - 1) * per_shape + i])
            for c in range(BLOCK_SIZE):
                there = wp.vec3d(rows[wp.min(block_column * BLOCK_SIZE + c, shapes - 1) * per_shape + i])
                total[r, c] += wp.dot(here, there)
    for r in range(BLOCK_SIZE):
        for c in range(BLOCK_SIZE):
            block_sum = wp.tile_extract(wp.tile_sum(wp.tile(total[r, c])), 0)
            k = block_row * BLOCK_SIZE + r
            other = block_column * BLOCK_SIZE + c
            if lane == 0 and block_row <= block_column and k < shapes and other < shapes:
                out[k, other] = block_sum / divisor
                out[other, k] = block_sum / divisor


@wp.kernel
def join(
    share: wp.float64,
    others: wp.array2d(dtype=wp.float64),
    covariance: wp.array2d(dtype=wp.float64),
):
    """Take the mean of a structure's covariance and those of the others, which are weighted already."""
    i, j = wp.tid()
    covariance[i, j] = share * covariance[i, j] + others[i, j]


@wp.kernel
def regularize(
    first: int,
    stage: wp.array(dtype=StepParameters),
    iteration: wp.array(dtype=int),
    ensemble: wp.array2d(dtype=wp.float64),
    normals: wp.array2d(dtype=wp.float64),
    matrices: wp.array3d(dtype=wp.float64),
    logdets: wp.array(dtype=wp.float64),
    stiffness: wp.array(dtype=float),
):
    """Write the matrices `first` … that are inverted."""
    m, i, j = wp.tid()
    parameters = stage[iteration[0]]
    extra = wp.float64(parameters.regularization)
    if first + m == 1:
        extra = parameters.regularization + wp.float64(parameters.step * parameters.ensemble_weight)
    if first + m == NORMALS:
        extra = parameters.normals_regularization
    shapes = ensemble.shape[0]
    value = wp.where(i == j, wp.float64(1.0), wp.float64(0.0))
    if i < shapes and j < shapes:
        value = ensemble[i, j]
        if first + m == NORMALS:
            value = normals[i, j]
        if i == j:
            value += extra
    matrices[m, i, j] = value
    if i == 0 and j == 0:
        logdets[m] = -wp.float64(shapes) * wp.log(extra)
        stiffness[0] = 0.0


@wp.func
def load_block(matrices: wp.array3d(dtype=wp.float64), m: int, block_row: int, block_column: int):
    """Return a block of a matrix."""
    block = wp.mat44d()
    for r in range(BLOCK_SIZE):
        for c in range(BLOCK_SIZE):
            block[r, c] = matrices[m, block_row * BLOCK_SIZE + r, block_column * BLOCK_SIZE + c]
    return block


@wp.func
def invert_block(matrix: wp.mat44d):
    """Return the inverse of a positive definite matrix and its determinant: Gauss-Jordan without pivoting.

    Not by cofactors, which cancel where one mode dwarfs the others.
    """
    out = matrix
    determinant = wp.float64(1.0)
    for p in range(BLOCK_SIZE):
        determinant *= out[p, p]
        d = wp.float64(1.0) / out[p, p]
        for i in range(BLOCK_SIZE):
            if i != p:
                factor = out[i, p] * d
                for j in range(BLOCK_SIZE):
                    if j != p:
                        out[i, j] -= factor * out[p, j]
                out[i, p] = -factor
        for j in range(BLOCK_SIZE):
            if j != p:
                out[p, j] *= d
        out[p, p] = d
    return out, determinant


@wp.kernel
def sweep(
    pivot: int,
    source: wp.array3d(dtype=wp.float64),
    target: wp.array3d(dtype=wp.float64),
    logdets: wp.array(dtype=wp.float64),
):
    """One Gauss-Jordan sweep by a block of pivots; one by each block inverts the matrices."""
    m, i, j = wp.tid()
    inverse, determinant = invert_block(load_block(source, m, pivot, pivot))
    value = inverse
    if i == pivot and j == pivot:
        logdets[m] = logdets[m] + wp.log(determinant)
    elif i == pivot:
        value = inverse * load_block(source, m, pivot, j)
    elif j == pivot:
        value = -load_block(source, m, i, pivot) * inverse
    else:
        across = load_block(source, m, i, pivot)
        value = load_block(source, m, i, j) - across * (inverse * load_block(source, m, pivot, j))
    for r in range(BLOCK_SIZE):
        for c in range(BLOCK_SIZE):
            target[m, i * BLOCK_SIZE + r, j * BLOCK_SIZE + c] = value[r, c]


@wp.kernel
def extract_inverses(
    first: int,
    stage: wp.array(dtype=StepParameters),
    iteration: wp.array(dtype=int),
    inverses: wp.array3d(dtype=wp.float64),
    out: wp.array3d(dtype=float),
    stiffness: wp.array(dtype=float),
):
    """Write the matrices that `dual.solve_duals` returns, (k, M, M), from the upper triangles of inverses."""
    m, i, j = wp.tid()
    parameters = stage[iteration[0]]
    shapes = wp.float64(out.shape[1])
    extra = wp.float64(parameters.regularization)
    step_weight = wp.float64(parameters.step * parameters.ensemble_weight)
    if first + m == 1:
        extra += step_weight
    if first + m == NORMALS:
        extra = parameters.normals_regularization
    # without the component common to all shapes, see `dual.inverse_dual`
    value = inverses[m, wp.min(i, j), wp.max(i, j)] - wp.float64(1.0) / (extra * shapes)
    if first + m == 1:
        value = wp.where(i == j, wp.float64(1.0), wp.float64(0.0)) - step_weight * value
    out[m, i, j] = float(value)
    if first + m == NORMALS and i == j:
        wp.atomic_max(stiffness, 0, float(value))


@wp.kernel
def multiply(
    matrix: wp.array2d(dtype=float),
    per_shape: int,
    source: wp.array(dtype=wp.vec3),
    target: wp.array(dtype=wp.vec3),
):
    """Write target[k] = sum_l matrix[k, l] source[l], per particle, of a matrix (k, M)."""
    block_row, i = wp.tid()
    total = wp.matrix(shape=(BLOCK_SIZE, 3), dtype=float)
    weights = wp.vec4()
    rows = matrix.shape[0]
    for other in range(matrix.shape[1]):
        for r in range(BLOCK_SIZE):
            weights[r] = matrix[wp.min(block_row * BLOCK_SIZE + r, rows - 1), other]
        total += wp.outer(weights, source[other * per_shape + i])
    for r in range(BLOCK_SIZE):
        k = block_row * BLOCK_SIZE + r
        if k < rows:
            target[k * per_shape + i] = total[r]
