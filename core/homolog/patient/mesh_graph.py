"""Values on a surface averaged over neighbouring vertices."""

import numpy as np
from scipy.sparse import csr_array

from homolog.arrays import FloatArray, IntArray

__all__ = ["edges_of", "median_of_ring", "ring_mean"]


def edges_of(faces: IntArray) -> IntArray:
    """Return the edges (E, 2) of faces (F, 3), each once."""
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    return np.unique(np.sort(sides, axis=1), axis=0)


def ring_mean(values: FloatArray, faces: IntArray, rounds: int) -> FloatArray:
    """Return values (V,) averaged, so many times, with those of the neighbouring vertices."""
    first, second = edges_of(faces).T
    count = len(values)
    own = np.arange(count)
    rows, columns = np.concatenate([own, first, second]), np.concatenate([own, second, first])
    matrix = csr_array((np.ones(len(rows)), (rows, columns)), shape=(count, count))
    sums = matrix @ np.ones(count)
    for _ in range(rounds):
        values = (matrix @ values) / sums
    return values


def median_of_ring(values: FloatArray, faces: IntArray) -> FloatArray:
    """Return the median of each vertex's value and its neighbours', (V,)."""
    first, second = edges_of(faces).T
    count = len(values)
    own = np.arange(count)
    rows, columns = np.concatenate([own, first, second]), np.concatenate([own, second, first])
    order = np.lexsort([values[columns], rows])
    rows, sorted_values = rows[order], values[columns[order]]
    start = np.searchsorted(rows, own)
    size = np.append(start[1:], len(rows)) - start
    low, high = start + (size - 1) // 2, start + size // 2
    middle: FloatArray = 0.5 * (sorted_values[low] + sorted_values[high])
    return middle
