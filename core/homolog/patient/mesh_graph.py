"""Values on a surface averaged over neighbouring vertices."""

import numpy as np
from scipy.sparse import csr_array

from homolog.arrays import FloatArray, IntArray

__all__ = ["edges_of", "median_of_ring", "remove_spikes", "ring_mean"]


def edges_of(faces: IntArray) -> IntArray:
    """Return the edges (E, 2) of faces (F, 3), each once."""
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    return np.unique(np.sort(sides, axis=1), axis=0)


def ring_mean(values: FloatArray, faces: IntArray, rounds: int) -> FloatArray:
    """Return values averaged with those of the neighbouring vertices, several times.

    Parameters
    ----------
    values : (..., V) array
        Values at the vertices.
    faces : (F, 3) int array
        Faces of the mesh.
    rounds : int
        Number of rounds of averaging.

    Returns
    -------
    (..., V) array
    """
    first, second = edges_of(faces).T
    count = values.shape[-1]
    own = np.arange(count)
    rows, columns = np.concatenate([own, first, second]), np.concatenate([own, second, first])
    matrix = csr_array((np.ones(len(rows)), (rows, columns)), shape=(count, count))
    sums = np.asarray(matrix.sum(axis=1), np.float64)
    flat = values.reshape(-1, count).T
    for _ in range(rounds):
        flat = np.asarray(matrix @ flat) / sums[:, None]
    averaged: FloatArray = flat.T.reshape(values.shape)
    return averaged


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


def remove_spikes(values: FloatArray, faces: IntArray, most: float) -> FloatArray:
    """Replace values that are far from the median of their ring by that median.

    A line along a normal that grazes the surface may meet another part of it. A single vertex then has a
    value that no surface with such edges can have.

    Parameters
    ----------
    values : (V,) array
        Values at the vertices.
    faces : (F, 3) int array
        Faces of the mesh.
    most : float
        Largest distance of a value from the median of its ring.

    Returns
    -------
    (V,) array
    """
    medians = median_of_ring(values, faces)
    result: FloatArray = np.where(np.abs(values - medians) > most, medians, values)
    return result
