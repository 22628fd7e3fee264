"""Variances of many places from few subjects, moderated by each other."""

import numpy as np
from scipy.special import digamma, polygamma

from homolog.arrays import FloatArray

__all__ = ["moderated"]

_LEAST = 1e-5
"""Least variance relative to the median, as in limma."""


def moderated(variances: FloatArray, dof: float) -> FloatArray:
    """Return variances, shrunk towards a common value as far as they do not differ more than by chance.

    Parameters
    ----------
    variances : (..., V) array
        Sample variances; each row is moderated for itself.
    dof : float
        Their degrees of freedom.

    Returns
    -------
    (..., V) array

    References
    ----------
    Smyth (2004), Linear models and empirical Bayes methods for assessing differential expression: the prior's
    value and degrees of freedom follow from mean and variance of the logarithms.
    """
    rows = np.atleast_2d(variances.reshape(-1, variances.shape[-1]))
    return np.stack([_row(row, dof) for row in rows]).reshape(variances.shape)


def _row(variances: FloatArray, dof: float) -> FloatArray:
    middle = float(np.median(variances))
    if middle <= 0.0:
        return variances
    own = np.maximum(variances, _LEAST * middle)
    logs = np.log(own) - digamma(0.5 * dof) + np.log(0.5 * dof)
    excess = float(logs.var(ddof=1)) - float(polygamma(1, 0.5 * dof))
    if excess <= 0.0:  # they differ by chance only
        return np.full_like(own, np.exp(logs.mean()))
    prior = 2.0 * _inverse_trigamma(excess)
    value = np.exp(logs.mean() + digamma(0.5 * prior) - np.log(0.5 * prior))
    result: FloatArray = (prior * value + dof * own) / (prior + dof)
    return result


def _inverse_trigamma(value: float) -> float:
    """Return the y whose trigamma is a positive value, by Newton's method on the reciprocal."""
    y = 0.5 + 1.0 / value
    for _ in range(50):
        trigamma = float(polygamma(1, y))
        step = trigamma * (1.0 - trigamma / value) / float(polygamma(2, y))
        y += step
        if -step < 1e-8 * y:
            break
    return y
