"""Wilks' lambda, its F by Rao, and Hotelling's T²."""

import numpy as np
from scipy import stats

from homolog.arrays import FloatArray, IntArray

__all__ = ["hotelling", "rao_f", "wilks_p"]


def hotelling(wilks: FloatArray | float, error_dof: int) -> FloatArray:
    """Return Hotelling's T² of one tested column from Wilks' lambda (1 - R²)."""
    lamb = np.asarray(wilks, dtype=np.float64)
    square: FloatArray = error_dof * (1.0 - lamb) / lamb
    return square


def rao_f(
    wilks: FloatArray, variables: IntArray | int, columns: int, error_dof: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return F and its two degrees of freedom (Rao 1951); exact for up to two variables or two columns.

    Parameters
    ----------
    wilks : (...) array
        Wilks' lambda.
    variables : int or (...) array
        Number of variables, at least 1.
    columns : int
        Number of tested columns.
    error_dof : int
        Degrees of freedom of the error.
    """
    p, q = np.asarray(variables, dtype=np.float64), float(columns)
    squares = p**2 + q**2 - 5.0
    ratio = (p**2 * q**2 - 4.0) / np.where(squares > 0.0, squares, 1.0)
    root = np.where(np.minimum(p, q) == 1.0, 1.0, np.sqrt(np.maximum(ratio, 0.0)))
    between = p * q
    within = root * (error_dof - (p - q + 1.0) / 2.0) - between / 2.0 + 1.0
    power = np.asarray(wilks) ** (1.0 / root)
    f: FloatArray = (1.0 - power) / np.maximum(power, 1e-290) * within / between
    return f, np.broadcast_to(between, f.shape), np.broadcast_to(within, f.shape)


def wilks_p(
    wilks: FloatArray, variables: IntArray | int, columns: int, error_dof: int, *, log: bool = False
) -> FloatArray:
    """Return the p-value of Wilks' lambda by Rao's F.

    Parameters
    ----------
    wilks, variables, columns, error_dof
        See `rao_f`.
    log : bool
        Whether to return the natural logarithm of p, which does not underflow.

    Returns
    -------
    array
        p-values in the shape of `wilks`.
    """
    f, between, within = rao_f(wilks, variables, columns, error_dof)
    tail = stats.f.logsf if log else stats.f.sf
    return np.asarray(tail(f, between, within), np.float64)
