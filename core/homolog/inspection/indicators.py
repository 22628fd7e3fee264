"""Indicators of wrong correspondence, one number for each particle or triangle of each subject.

Every indicator is a pair of ratios: a value relative to the usual value there, and relative to a threshold.
The smaller one is its severity. Small deviations in very regular regions are therefore not reported, nor are
large ones where all subjects differ.
"""

import numpy as np

from homolog.arrays import FloatArray, IntArray
from homolog.inspection.located_particles import REACH, LocatedParticles
from homolog.inspection.neighbourhood import Neighbourhood, flattened

__all__ = [
    "consensus_values",
    "distance_residuals",
    "distortions",
    "log_distance_ratios",
    "normal_angles",
    "severity",
    "swap_log_ratios",
]

BEYOND = 4.0
"""Least ratio of an unusual value to the usual one."""
ANGLE = np.radians(45.0)
"""Threshold of the angle between normals."""
STRETCH = 0.5
"""Threshold of the root mean square of log ratios of distances (a factor of 1.65)."""
DISTORTION = np.radians(90.0)
"""Threshold of the distortion of a triangle, which is degenerate at 90° and folded over beyond."""
_PRIOR = 4.0
"""Weight of the cohort's median, as a number of subjects."""


def severity(values: FloatArray, size: float) -> FloatArray:
    """Return the severity of values (M, N); values from 1 on are reported."""
    consensus = np.maximum(consensus_values(values), 1e-12)  # 0 where all subjects are equal
    return np.minimum(values / (BEYOND * consensus), values / size)


def consensus_values(values: FloatArray) -> FloatArray:
    """Return the usual value at each particle or triangle, (M, N) to (N,).

    It is the median over subjects, shrunk towards the median of all particles.
    """
    own, prior = np.median(values, axis=0), np.median(values)
    count = len(values)
    return np.sqrt((count * own**2 + _PRIOR * prior**2) / (count + _PRIOR))


def normal_angles(located: LocatedParticles, consensus: Neighbourhood) -> FloatArray:
    """Return the angle [rad] of each particle's normal to the Fréchet mean over subjects, (M, N)."""
    cosine = np.einsum("mni,ni->mn", located.normals, consensus.normals)
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def log_distance_ratios(located: LocatedParticles, consensus: Neighbourhood) -> FloatArray:
    """Return log ratios of the distances to the consensus neighbours and the usual distances, (M, N, K).

    A neighbour beyond the range of the distances is counted at that range; absent neighbours are NaN.
    """
    everywhere = np.arange(len(consensus.shape))
    return np.stack(
        [swap_log_ratios(everywhere, everywhere, m, located, consensus) for m in range(len(located.world))]
    )


def swap_log_ratios(
    occupant: IntArray,
    counterpart: IntArray,
    subject: int,
    located: LocatedParticles,
    consensus: Neighbourhood,
) -> FloatArray:
    """Return the log ratios, (n, K), after moving some particles to the positions of others.

    Parameters
    ----------
    occupant : (n,) int array
        Particles whose positions are used.
    counterpart : (n,) int array
        Particles that are moved there; their neighbours give the expected distances.
    subject : int
        Index of the subject.
    located : LocatedParticles
        Particles of all subjects.
    consensus : Neighbourhood
        The consensus of all subjects.
    """
    neighbours, far = consensus.neighbours[counterpart], consensus.distances[counterpart]
    rows = np.repeat(occupant, neighbours.shape[1])
    distances = np.asarray(located.distances[subject][rows, neighbours.ravel()]).reshape(neighbours.shape)
    place = occupant[:, None] == neighbours  # this neighbour moves to the other position
    swapped = np.asarray(located.distances[subject][occupant, counterpart])
    distances = np.where(place, swapped[:, None], distances)
    distances[distances == 0.0] = REACH
    ratios: FloatArray = np.log(distances / np.where(np.isfinite(far), far, np.nan))
    return ratios


def distance_residuals(ratios: FloatArray) -> FloatArray:
    """Return the median absolute log ratio over neighbours, (..., K) to (...): robust to outliers."""
    alone = np.isnan(ratios).all(axis=-1, keepdims=True)
    return np.asarray(np.nanmedian(np.where(alone, 0.0, np.abs(ratios)), axis=-1))


def distortions(located: LocatedParticles, consensus: Neighbourhood) -> FloatArray:
    """Return the distortion of each consensus triangle on each subject [rad], (M, T).

    The affine map from the usual triangle has singular values s1 ≥ s2 ≥ 0, with the sign of the orientation
    against the surface's normal: the distortion is arccos(2 s1 s2 / (s1² + s2²)), 0 for a similarity, 90° for
    a degenerate triangle, 180° for a mirrored one.
    """
    corners = consensus.triangles
    before = flattened(consensus.shape[corners], consensus.normals[corners])
    after = flattened(located.world[:, corners], located.normals[:, corners])
    maps = after @ np.linalg.inv(before)
    both = np.maximum(np.square(maps).sum(axis=(-2, -1)), 1e-30)
    sign = 2.0 * np.linalg.det(maps) / both
    return np.asarray(np.arccos(np.clip(sign, -1.0, 1.0)))
