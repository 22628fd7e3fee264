"""Which shapes of a cohort are typical, and which do not look like the others."""

from collections.abc import Callable, Sequence

import numpy as np

from homolog.arrays import FloatArray, IntArray
from homolog.grooming.icp import Fit, OrientedPoints
from homolog.progress import Tick

__all__ = ["by_typicality", "medoid", "odd_ones", "radii_of"]

_QUANTILES = np.linspace(0.02, 0.98, 25)
_ODD, _LEAST_TYPICAL = 1.8, 0.06
"""A shape is far beyond this factor times the median distance from the most typical shape; least median
used."""
_ALIKE, _NEAR = 8, 2
"""Number of shapes (by similarity of radii) with which a distant shape is compared; number of near ones among
them that show that it is not odd (one in a cohort of three)."""


def radii_of(oriented_shapes: Sequence[OrientedPoints]) -> FloatArray:
    """Return quantiles of the distances from the centre, invariant to rotation (Osada et al. 2002)."""
    return np.array(
        [np.quantile(np.linalg.norm(shape.points, axis=1), _QUANTILES) for shape in oriented_shapes]
    )


def medoid(oriented_shapes: Sequence[OrientedPoints]) -> int:
    """Return the index of the shape whose radii are distributed most like all others' (Osada et al. 2002)."""
    return int(by_typicality(oriented_shapes)[0])


def by_typicality(oriented_shapes: Sequence[OrientedPoints]) -> IntArray:
    """Return the indices of shapes ordered by similarity of their radii to those of all others."""
    radii = radii_of(oriented_shapes)
    return np.argsort(np.abs(radii[:, None] - radii).sum(axis=(1, 2)), kind="stable")


def odd_ones(
    shapes: Sequence[OrientedPoints],
    distances: FloatArray,
    register_freely: Callable[[OrientedPoints, OrientedPoints], Fit],
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
    register_freely : callable
        Registers one shape to another, regardless of the orientations of the files.
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
            near += register_freely(shapes[index], shapes[other]).distance <= far
            if near == enough:
                break
        else:
            odd.add(index)
    return odd
