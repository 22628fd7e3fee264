"""Subjects whose shape is far from all others: most often a broken segmentation or correspondence."""

import numpy as np

from homolog.arrays import FloatArray, IntArray

__all__ = ["shape_outliers"]


def shape_outliers(particles: FloatArray, *, limit: float = 5.0) -> IntArray:
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
    above = distance - np.median(distance)
    deviation = 1.4826 * np.median(np.abs(above))
    far = np.flatnonzero(above > limit * deviation) if deviation > 0.0 else np.zeros(0, np.int64)
    order: IntArray = far[np.argsort(-distance[far])]
    return order
