"""Products of band matrices with the lines of a grid: filters and interpolation along an axis."""

import numpy as np

from homolog.arrays import Array, Float32Array
from homolog.threads import on_one_thread

__all__ = ["along_axis"]

_BLOCK = 32
"""Rows of the matrix that are multiplied at a time."""


@on_one_thread
def along_axis(matrix: Float32Array, values: Array, axis: int) -> Float32Array:
    """Return the products of a matrix with all lines of values along an axis.

    Columns without any weight in a block of rows are omitted, most of them in a band matrix.

    Parameters
    ----------
    matrix : (N, M) array
        Weights, no row of zeros.
    values : array
        M values along the axis, of any dimension.
    axis : int

    Returns
    -------
    float32 array
        N values along the axis.
    """
    after = int(np.prod(values.shape[axis + 1 :]))
    lines = values.reshape(-1, values.shape[axis], after)
    result = np.empty((len(lines), len(matrix), after), np.float32)
    for start in range(0, len(matrix), _BLOCK):
        rows = slice(start, start + _BLOCK)
        used = np.flatnonzero(matrix[rows].any(axis=0))
        columns = slice(used[0], used[-1] + 1)
        if after == 1:
            np.matmul(lines[:, columns, 0], matrix[rows, columns].T, out=result[:, rows, 0])
        else:
            np.matmul(matrix[rows, columns], lines[:, columns], out=result[:, rows])
    return result.reshape(*values.shape[:axis], len(matrix), *values.shape[axis + 1 :])
