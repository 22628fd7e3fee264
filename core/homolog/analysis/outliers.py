"""Subjects whose shape is far from all others: most often a broken segmentation or correspondence."""

from collections.abc import Collection

import numpy as np

from homolog.analysis.design import Design
from homolog.arrays import BoolArray, FloatArray, IntArray

__all__ = ["outliers_in_groups", "shape_outliers"]

_LIMIT = 5.0


def shape_outliers(particles: FloatArray, *, limit: float = _LIMIT) -> IntArray:
    """Return the indices of subjects that lie far from the median shape, the farthest first.

    Parameters
    ----------
    particles : (M, N, 3) array
        Aligned positions [mm].
    limit : float
        A subject is far if its distance is above the median distance by more than so many standard
        deviations, taken from the median absolute deviation (Leys et al. 2013).

    Returns
    -------
    (n,) int array
        Distances are root mean squares over the particles from the median of each coordinate.
    """
    apart = particles - np.median(particles, axis=0)
    distance = np.sqrt(np.square(apart).sum(axis=2).mean(axis=1))
    return _far(distance, limit)


def outliers_in_groups(
    particles: FloatArray, design: Design, members: Collection[BoolArray] = (), *, limit: float = _LIMIT
) -> IntArray:
    """Return the indices of subjects that lie far from the mean of their group, the farthest first.

    Parameters
    ----------
    particles : (M, N, 3) array
        Aligned positions, or differences of pairs [mm].
    design : Design
        Distances are those from the shape that it fits to a subject.
    members : collection of (M,) bool arrays
        The groups; distances are divided by the median of their group.
    limit : float
        See `shape_outliers`.
    """
    rest = design.residuals(particles.reshape(len(particles), -1))
    rest -= design.tested @ (design.tested.T @ rest)
    distance = np.sqrt(np.square(rest).mean(axis=1))
    for own in members:
        distance[own] /= max(float(np.median(distance[own])), np.finfo(float).tiny)
    return _far(distance, limit)


def _far(distance: FloatArray, limit: float) -> IntArray:
    above = distance - np.median(distance)
    deviation = 1.4826 * np.median(np.abs(above))
    far = np.flatnonzero(above > limit * deviation) if deviation > 0.0 else np.zeros(0, np.int64)
    order: IntArray = far[np.argsort(-distance[far])]
    return order
