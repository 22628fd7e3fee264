"""The dual of many shapes on a CUDA device: products and inversions by tiles in shared memory.

The inversion is a Gauss-Jordan elimination by tiles of rows, in place, of the upper triangle: the part below
the diagonal equals what is above it, or its negative between rows that have been eliminated and rows that
have not.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.correspondence.kernels.dual import BLOCK_SIZE, load_block

# Warp's own products in place of those of MathDx, which take minutes to compile.
wp.set_module_options({"enable_backward": False, "enable_mathdx_gemm": False})

__all__ = [
    "TILE",
    "WIDE_TILE",
    "eliminate",
    "factor_corner",
    "gram",
    "multiply",
    "reduce_row",
    "start_corner",
]

TILE = wp.constant(32)
WIDE_TILE, DEPTH = wp.constant(64), wp.constant(16)  # of products, whose sums need no shared memory


@wp.kernel
def gram(divisor: wp.float64, rows: wp.array2d(dtype=float), out: wp.array2d(dtype=wp.float64)):
    """Write rows rows' / divisor, of rows (M, K)."""
    i, j = wp.tid()
    if i > j:
        return
    total = wp.tile_zeros(shape=(WIDE_TILE, WIDE_TILE), dtype=wp.float64)
    for k in range(0, rows.shape[1], DEPTH):
        here = wp.tile_load(rows, shape=(WIDE_TILE, DEPTH), offset=(i * WIDE_TILE, k))
        there = wp.tile_load(rows, shape=(WIDE_TILE, DEPTH), offset=(j * WIDE_TILE, k))
        wide, other = wp.tile_astype(here, wp.float64), wp.tile_astype(there, wp.float64)
        wp.tile_matmul(wide, wp.tile_transpose(other), total)
    scaled = total * (wp.float64(1.0) / divisor)
    wp.tile_store(out, scaled, offset=(i * WIDE_TILE, j * WIDE_TILE))
    if i < j:
        wp.tile_store(out, wp.tile_transpose(scaled), offset=(j * WIDE_TILE, i * WIDE_TILE))


@wp.kernel
def start_corner(pivot: int, matrices: wp.array3d(dtype=wp.float64), corner: wp.array3d(dtype=wp.float64)):
    """Write the tile of pivots next to the identity, (k, TILE, 2 TILE)."""
    m, i, j = wp.tid()
    value = wp.where(i + TILE == j, wp.float64(1.0), wp.float64(0.0))
    if j < TILE:
        value = matrices[m, pivot * TILE + i, pivot * TILE + j]
    corner[m, i, j] = value


@wp.func
def inverse_factor(matrix: wp.mat44d):
    """Return the inverse of the Cholesky factor of a positive definite matrix, and log det of the matrix."""
    factor, out, logdet = wp.mat44d(), wp.mat44d(), wp.float64(0.0)
    for j in range(BLOCK_SIZE):
        for i in range(BLOCK_SIZE):
            if i >= j:
                value = matrix[i, j]
                for k in range(BLOCK_SIZE):
                    if k < j:
                        value -= factor[i, k] * factor[j, k]
                if i == j:
                    logdet += wp.log(value)
                    factor[j, j] = wp.sqrt(value)
                else:
                    factor[i, j] = value / factor[j, j]
    for j in range(BLOCK_SIZE):
        for i in range(BLOCK_SIZE):
            if i >= j:
                value = wp.where(i == j, wp.float64(1.0), wp.float64(0.0))
                for k in range(BLOCK_SIZE):
                    if k >= j and k < i:
                        value -= factor[i, k] * out[k, j]
                out[i, j] = value / factor[i, i]
    return out, logdet


@wp.kernel
def factor_corner(
    pivot: int,
    source: wp.array3d(dtype=wp.float64),
    target: wp.array3d(dtype=wp.float64),
    logdets: wp.array(dtype=wp.float64),
):
    """Eliminate a block of pivots from the rows below it; one by each block leaves L^-1 on the right.

    L is the Cholesky factor. Its inverse is used in place of that of the tile, which would multiply rounding
    errors where one mode dwarfs the others.
    """
    m, i, j = wp.tid()
    value = load_block(source, m, i, j)
    if i >= pivot:
        factor, logdet = inverse_factor(load_block(source, m, pivot, pivot))
        row = factor * load_block(source, m, pivot, j)
        if i == pivot:
            value = row
            if j == 0:
                logdets[m] = logdets[m] + logdet
        else:
            value -= wp.transpose(factor * load_block(source, m, pivot, i)) * row
    for r in range(BLOCK_SIZE):
        for c in range(BLOCK_SIZE):
            target[m, i * BLOCK_SIZE + r, j * BLOCK_SIZE + c] = value[r, c]


@wp.kernel
def reduce_row(
    pivot: int,
    matrices: wp.array3d(dtype=wp.float64),
    corner: wp.array3d(dtype=wp.float64),
    half: wp.array3d(dtype=wp.float64),
    whole: wp.array3d(dtype=wp.float64),
):
    """Write L^-1 times the row of pivots, and the row that the elimination leaves, (k, TILE, P) each."""
    m, j = wp.tid()
    factor = wp.tile_load(corner[m], shape=(TILE, TILE), offset=(0, TILE))
    if j == pivot:
        wp.tile_store(whole[m], wp.tile_matmul(wp.tile_transpose(factor), factor), offset=(0, j * TILE))
    elif j > pivot:
        row = wp.tile_load(matrices[m], shape=(TILE, TILE), offset=(pivot * TILE, j * TILE))
        reduced = wp.tile_matmul(factor, row)
        wp.tile_store(half[m], reduced, offset=(0, j * TILE))
        wp.tile_store(whole[m], wp.tile_matmul(wp.tile_transpose(factor), reduced), offset=(0, j * TILE))
    else:
        column = wp.tile_load(matrices[m], shape=(TILE, TILE), offset=(j * TILE, pivot * TILE))
        reduced = wp.tile_matmul(factor, wp.tile_transpose(column)) * wp.float64(-1.0)
        wp.tile_store(half[m], reduced, offset=(0, j * TILE))
        wp.tile_store(whole[m], wp.tile_matmul(wp.tile_transpose(factor), reduced), offset=(0, j * TILE))


@wp.kernel
def eliminate(
    pivot: int,
    half: wp.array3d(dtype=wp.float64),
    whole: wp.array3d(dtype=wp.float64),
    matrices: wp.array3d(dtype=wp.float64),
):
    """Eliminate a tile of pivots from the upper triangle; one by each tile inverts the matrices."""
    m, i, j = wp.tid()
    if i > j:
        return
    if i == pivot:
        row = wp.tile_load(whole[m], shape=(TILE, TILE), offset=(0, j * TILE))
        wp.tile_store(matrices[m], row, offset=(i * TILE, j * TILE))
    elif j == pivot:
        row = wp.tile_load(whole[m], shape=(TILE, TILE), offset=(0, i * TILE))
        wp.tile_store(matrices[m], wp.tile_transpose(row), offset=(i * TILE, j * TILE))
    else:
        value = wp.tile_load(matrices[m], shape=(TILE, TILE), offset=(i * TILE, j * TILE))
        row = wp.tile_load(half[m], shape=(TILE, TILE), offset=(0, i * TILE))
        across = wp.tile_load(half[m], shape=(TILE, TILE), offset=(0, j * TILE))
        sign = wp.where(i < pivot, wp.float64(1.0), wp.float64(-1.0))
        change = wp.tile_matmul(wp.tile_transpose(row), across)
        wp.tile_store(matrices[m], value + change * sign, offset=(i * TILE, j * TILE))


@wp.kernel
def multiply(
    matrix: wp.array2d(dtype=float), source: wp.array2d(dtype=float), target: wp.array2d(dtype=float)
):
    """Write the product of a matrix (k, M) and rows (M, K)."""
    i, j = wp.tid()
    total = wp.tile_zeros(shape=(WIDE_TILE, WIDE_TILE), dtype=float)
    for k in range(0, matrix.shape[1], DEPTH):
        weights = wp.tile_load(matrix, shape=(WIDE_TILE, DEPTH), offset=(i * WIDE_TILE, k))
        rows = wp.tile_load(source, shape=(DEPTH, WIDE_TILE), offset=(k, j * WIDE_TILE))
        wp.tile_matmul(weights, rows, total)
    wp.tile_store(target, total, offset=(i * WIDE_TILE, j * WIDE_TILE))
