"""Which shapes of a cohort are typical, and which do not look like the others."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from homolog.arrays import FloatArray, IntArray
from homolog.geometry import rotation_of
from homolog.progress import Tick
from homolog.registration.icp import Fit, OrientedPoints

__all__ = ["angles_from", "by_typicality", "odd_ones", "radii_of", "typical_rotation"]

_QUANTILES = np.linspace(0.02, 0.98, 25)
_ODD, _LEAST_TYPICAL = 1.8, 0.06
"""A shape is far beyond this factor times the median distance from the most typical shape; least median
used."""
_MOST_TYPICAL = 256
"""Largest number of rotations that may be the most typical one."""
_ALIKE, _NEAR = 8, 2
"""Number of shapes (by similarity of radii) with which a distant shape is compared; number of near ones among
them that show that it is not odd (one in a cohort of three)."""


def radii_of(oriented_shapes: Sequence[OrientedPoints]) -> FloatArray:
    """Return quantiles of the distances from the centre, invariant to rotation (Osada et al. 2002)."""
    return np.array(
        [np.quantile(np.linalg.norm(shape.points, axis=1), _QUANTILES) for shape in oriented_shapes]
    )


def by_typicality(oriented_shapes: Sequence[OrientedPoints]) -> IntArray:
    """Return the indices of shapes ordered by similarity of their radii to those of all others."""
    radii = radii_of(oriented_shapes)
    sums = [np.abs(own - radii).sum() for own in radii]  # not all pairs at once: memory for thousands
    return np.argsort(sums, kind="stable")


def angles_from(alignments: FloatArray, rotation: Rotation) -> FloatArray:
    """Return the angle of each similarity (M, 4, 4) to a rotation [degrees]."""
    turns = Rotation.from_matrix(rotation_of(alignments))
    angles: FloatArray = np.degrees((turns * rotation.inv()).magnitude())
    return angles


def typical_rotation(alignments: FloatArray) -> Rotation:
    """Return the rotation with the least median angle to all; of many, a sample is tried."""
    turns = Rotation.from_matrix(rotation_of(alignments))
    some = turns
    if len(alignments) > _MOST_TYPICAL:
        sample = np.random.default_rng(0).choice(len(alignments), _MOST_TYPICAL, replace=False)
        some = turns[np.sort(sample)]
    medians = [float(np.median((turns * turn.inv()).magnitude())) for turn in some]
    return some[int(np.argmin(medians))]


def odd_ones(
    shapes: Sequence[OrientedPoints],
    distances: FloatArray,
    find: Callable[[OrientedPoints, OrientedPoints], Sequence[Fit]],
    tick: Tick,
) -> set[int]:
    """Return the indices of shapes far from the most typical one and from all, or all but one, of the others.

    A shape of large variation is near some others; two shapes of another organ are near each other only.

    Parameters
    ----------
    shapes : sequence of OrientedPoints
        Shapes of sizes about 1.
    distances : (M,) float64 array
        Distances from the most typical shape after registration.
    find : callable
        Registers one shape to another, in different orientations.
    tick : Tick
        Progress and cancellation.
    """
    far, radii, odd = _ODD * max(float(np.median(distances)), _LEAST_TYPICAL), radii_of(shapes), set()
    for index in np.flatnonzero(distances > far).tolist():
        alike = np.argsort(np.abs(radii - radii[index]).sum(axis=1), kind="stable").tolist()
        alike.remove(index)
        near, enough = 0, min(_NEAR, len(alike) - 1)
        for other in alike[:_ALIKE]:
            tick(1.0, "aligning")
            near += min(fit.distance for fit in find(shapes[index], shapes[other])) <= far
            if near == enough:
                break
        else:
            odd.add(index)
    return odd
