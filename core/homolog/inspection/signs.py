"""Signs of wrong correspondence, one number for each particle or triangle of each subject.

Every sign is a pair of ratios: a value over what is usual there, and over a size from which it matters. The
smaller of both is its severity, so that neither a tiny departure in a very regular place is reported nor a
large one where all subjects differ.
"""

import numpy as np

from homolog.arrays import FloatArray, IntArray
from homolog.inspection.neighbourhood import Neighbourhood, flattened
from homolog.inspection.places import REACH, Places

__all__ = ["distortions", "misfits", "normal_angles", "severity", "stretch_of", "stretches", "usual_values"]

BEYOND = 4.0
"""A value so many times the usual one is unusual …"""
ANGLE = np.radians(45.0)
"""… and matters from here on: an angle between normals,"""
STRETCH = 0.5
"""the root mean square of log ratios of distances (1.65 times as far or as near),"""
DISTORTION = np.radians(90.0)
"""or the distortion of a triangle: at 90° it has collapsed, beyond it is folded over."""
_PRIOR = 4.0
"""Subjects that the cohort's median counts for beside a particle's own."""


def severity(values: FloatArray, size: float) -> FloatArray:
    """Return the smaller of how unusual and how large values (M, N) are, both 1 where a report begins."""
    usual = np.maximum(usual_values(values), 1e-12)  # 0 where all subjects are the same
    return np.minimum(values / (BEYOND * usual), values / size)


def usual_values(values: FloatArray) -> FloatArray:
    """Return what is usual at each particle or triangle, (M, N) to (N,).

    The median over subjects, drawn towards the median of all: few subjects say little about one place.
    """
    own, prior = np.median(values, axis=0), np.median(values)
    count = len(values)
    return np.sqrt((count * own**2 + _PRIOR * prior**2) / (count + _PRIOR))


def normal_angles(places: Places, usual: Neighbourhood) -> FloatArray:
    """Return the angle [rad] of each particle's normal to the Fréchet mean over subjects, (M, N)."""
    cosine = np.einsum("mni,ni->mn", places.normals, usual.normals)
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def stretches(places: Places, usual: Neighbourhood) -> FloatArray:
    """Return log ratios of the distances to the consensus neighbours over the usual ones, (M, N, K).

    A neighbour beyond the reach of the distances counts as just that far; absent neighbours are NaN.
    """
    everywhere = np.arange(len(usual.shape))
    return np.stack([stretch_of(everywhere, everywhere, m, places, usual) for m in range(len(places.world))])


def stretch_of(
    standing: IntArray, stands_for: IntArray, subject: int, places: Places, usual: Neighbourhood
) -> FloatArray:
    """Return the log ratios, (n, K), as if some particles stood where others do.

    Parameters
    ----------
    standing : (n,) int array
        Particles whose places on the subject are taken …
    stands_for : (n,) int array
        … for those of these, by whose neighbours they are judged.
    """
    neighbours, far = usual.neighbours[stands_for], usual.distances[stands_for]
    rows = np.repeat(standing, neighbours.shape[1])
    found = np.asarray(places.distances[subject][rows, neighbours.ravel()]).reshape(neighbours.shape)
    place = standing[:, None] == neighbours  # this neighbour would stand in the other's place in turn
    swapped = np.asarray(places.distances[subject][standing, stands_for])
    found = np.where(place, swapped[:, None], found)
    found[found == 0.0] = REACH
    ratios: FloatArray = np.log(found / np.where(np.isfinite(far), far, np.nan))
    return ratios


def misfits(ratios: FloatArray) -> FloatArray:
    """Return the median size of log ratios over neighbours, (..., K) to (...): a few bad ones don't count."""
    alone = np.isnan(ratios).all(axis=-1, keepdims=True)
    return np.asarray(np.nanmedian(np.where(alone, 0.0, np.abs(ratios)), axis=-1))


def distortions(places: Places, usual: Neighbourhood) -> FloatArray:
    """Return how much each consensus triangle is distorted on each subject [rad], (M, T).

    The affine map from the usual triangle has singular values s1 ≥ s2 ≥ 0, with the sign of the orientation
    against the surface's normal: the distortion is arccos(2 s1 s2 / (s1² + s2²)), 0 for a similarity, 90°
    where the triangle has collapsed, 180° for a mirrored one.
    """
    corners = usual.triangles
    before = flattened(usual.shape[corners], usual.normals[corners])
    after = flattened(places.world[:, corners], places.normals[:, corners])
    maps = after @ np.linalg.inv(before)
    both = np.maximum(np.square(maps).sum(axis=(-2, -1)), 1e-30)
    sign = 2.0 * np.linalg.det(maps) / both
    return np.asarray(np.arccos(np.clip(sign, -1.0, 1.0)))
