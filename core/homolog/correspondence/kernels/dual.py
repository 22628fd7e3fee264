"""The dual of `homolog.correspondence.entropy.dual` on a CUDA device, without synchronization with the host.

Matrices are processed in blocks of `BLOCK_SIZE` x `BLOCK_SIZE`, padded with the identity to whole ones, and
inverted by sweeps of `PANEL_ROWS` rows of blocks, as each sweep reads and writes the matrices as a whole.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.correspondence.kernels.particles import StepParameters

wp.set_module_options({"enable_backward": False})

__all__ = [
    "BLOCK_DIM",
    "BLOCK_SIZE",
    "N_MATRICES",
    "ONE_PANEL",
    "PANEL_ROWS",
    "eliminate",
    "extract_inverses",
    "gram",
    "multiply",
    "reduce_panel",
    "regularize",
]

N_MATRICES = wp.constant(3)  # C + aI, C + (a + p)I, normals' C + bI
BLOCK_SIZE = wp.constant(4)
BLOCK_DIM = 128
PANEL_ROWS = 4  # of blocks
ONE_PANEL = 64  # rows up to which all are one panel: launches then cost more than memory traffic


@wp.kernel
def gram(
    shapes: int,
    per_shape: int,
    divisor: wp.float64,
    rows: wp.array(dtype=wp.vec3),
    out: wp.array2d(dtype=wp.float64),
):
    """out[k, l] = sum over particles of rows_k . rows_l / divisor; a block of threads for each of entries."""
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
def regularize(
    stage: wp.array(dtype=StepParameters),
    iteration: wp.array(dtype=int),
    ensemble: wp.array2d(dtype=wp.float64),
    normals: wp.array2d(dtype=wp.float64),
    matrices: wp.array3d(dtype=wp.mat44d),
    logdets: wp.array(dtype=wp.float64),
    stiffness: wp.array(dtype=float),
):
    """Write the three matrices that are inverted, by blocks."""
    m, block_row, block_column = wp.tid()
    parameters = stage[iteration[0]]
    extra = wp.float64(parameters.regularization)
    if m == 1:
        extra = parameters.regularization + wp.float64(parameters.step * parameters.ensemble_weight)
    if m == 2:
        extra = parameters.normals_regularization
    shapes = ensemble.shape[0]
    block = wp.mat44d()
    for r in range(BLOCK_SIZE):
        for c in range(BLOCK_SIZE):
            i = block_row * BLOCK_SIZE + r
            j = block_column * BLOCK_SIZE + c
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
    matrices[m, block_row, block_column] = block
    if block_row == 0 and block_column == 0:
        logdets[m] = -wp.float64(shapes) * wp.log(extra)
        stiffness[0] = 0.0


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
def reduce_panel(
    begin: int,
    pivot: int,
    source: wp.array3d(dtype=wp.mat44d),
    before: wp.array3d(dtype=wp.mat44d),
    panel: wp.array3d(dtype=wp.mat44d),
    logdets: wp.array(dtype=wp.float64),
):
    """One Gauss-Jordan sweep by a block of pivots, of the rows `begin` … of a panel only.

    `before` holds the panel as the sweep before left it; the first sweep takes it from `source`.
    """
    m, i, j = wp.tid()
    row = begin + i
    if pivot == begin:
        corner = source[m, pivot, pivot]
        value = source[m, row, j]
        across = source[m, row, pivot]
        above = source[m, pivot, j]
    else:
        corner = before[m, pivot - begin, pivot]
        value = before[m, i, j]
        across = before[m, i, pivot]
        above = before[m, pivot - begin, j]
    inverse, determinant = invert_block(corner)
    if row == pivot and j == pivot:
        value = inverse
        logdets[m] = logdets[m] + wp.log(determinant)
    elif row == pivot:
        value = inverse * value
    elif j == pivot:
        value = -value * inverse
    else:
        value = value - across * (inverse * above)
    panel[m, i, j] = value


@wp.kernel
def eliminate(
    begin: int,
    rows: int,
    source: wp.array3d(dtype=wp.mat44d),
    panel: wp.array3d(dtype=wp.mat44d),
    target: wp.array3d(dtype=wp.mat44d),
):
    """Apply the sweeps of a panel of `rows` blocks to all rows; as many as panels invert the matrices."""
    m, i, j = wp.tid()
    if i >= begin and i < begin + rows:
        target[m, i, j] = panel[m, i - begin, j]
        return
    value = wp.mat44d()
    if j < begin or j >= begin + rows:
        value = source[m, i, j]
    for k in range(rows):
        value -= source[m, i, begin + k] * panel[m, k, j]
    target[m, i, j] = value


@wp.kernel
def extract_inverses(
    stage: wp.array(dtype=StepParameters),
    iteration: wp.array(dtype=int),
    inverses: wp.array3d(dtype=wp.mat44d),
    gradient: wp.array2d(dtype=float),
    damping: wp.array2d(dtype=float),
    normals: wp.array2d(dtype=float),
    stiffness: wp.array(dtype=float),
):
    """Remove the component common to all shapes and round to float32 (see `dual.inverse_dual`)."""
    i, j = wp.tid()
    block_row, block_column, r, c = i // BLOCK_SIZE, j // BLOCK_SIZE, i % BLOCK_SIZE, j % BLOCK_SIZE
    parameters = stage[iteration[0]]
    shapes = wp.float64(gradient.shape[0])
    a = parameters.regularization
    b = parameters.normals_regularization
    step_weight = wp.float64(parameters.step * parameters.ensemble_weight)
    unity = wp.float64(1.0)
    gradient[i, j] = float(inverses[0, block_row, block_column][r, c] - unity / (a * shapes))
    identity = wp.where(i == j, unity, wp.float64(0.0))
    damping[i, j] = float(
        identity
        - step_weight * (inverses[1, block_row, block_column][r, c] - unity / ((a + step_weight) * shapes))
    )
    normals_inverse = inverses[2, block_row, block_column][r, c] - unity / (b * shapes)
    normals[i, j] = float(normals_inverse)
    if i == j:
        wp.atomic_max(stiffness, 0, float(normals_inverse))


@wp.kernel
def multiply(
    shapes: int,
    per_shape: int,
    matrix: wp.array2d(dtype=float),
    source: wp.array(dtype=wp.vec3),
    target: wp.array(dtype=wp.vec3),
):
    """target[k] = sum_l matrix[k, l] source[l], per particle: a small symmetric matrix across the shapes."""
    block_row, i = wp.tid()
    total = wp.matrix(shape=(BLOCK_SIZE, 3), dtype=float)
    weights = wp.vec4()
    for other in range(shapes):
        for r in range(BLOCK_SIZE):
            weights[r] = matrix[other, wp.min(block_row * BLOCK_SIZE + r, shapes - 1)]
        total += wp.outer(weights, source[other * per_shape + i])
    for r in range(BLOCK_SIZE):
        k = block_row * BLOCK_SIZE + r
        if k < shapes:
            target[k * per_shape + i] = total[r]
