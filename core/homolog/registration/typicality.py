"""Which shapes of a cohort are typical, and which do not look like the others."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial.transform import Rotation

from homolog.arrays import FloatArray, IntArray
from homolog.geometry import rotation_of
from homolog.progress import Tick
from homolog.registration.icp import Fit, OrientedPoints

__all__ = [
    "EPSILON", "angles_from", "by_typicality", "medoid", "odd_ones", "radii_of", "similar_pairs",
    "typical_rotation",
]  # fmt: skip

_QUANTILES = np.linspace(0.02, 0.98, 25)
_ODD, _LEAST_TYPICAL = 1.8, 0.06
"""A shape is far beyond this factor times the median distance from the most typical shape; least median
used."""
_LINKS, _PAIRS = 4, 56
"""Shapes to which each is registered if files have arbitrary orientations: at least the first, and the second
divided by their number, since in a small cohort few shapes are similar."""
_NEAREST, _MOST_TYPICAL = 64, 256
"""Number of similar shapes between which the spanning tree is sought; largest number of rotations that may be
the most typical one."""
EPSILON = 1e-6
"""Stands for distance zero, since SciPy's graphs drop edges up to 1e-8."""
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
    sums = [np.abs(own - radii).sum() for own in radii]  # not all pairs at once: memory for thousands
    return np.argsort(sums, kind="stable")


def similar_pairs(radii: FloatArray, middle: int) -> list[tuple[int, int]]:
    """Return pairs of shapes that connect all of them and each with the most similar ones, first < second.

    They are those of the minimum spanning tree of the differences of radii (M, 25), and those of each shape
    with the next ones. The tree is that of the differences from the nearest shapes and from the medoid.
    """
    count = len(radii)
    links = max(_LINKS, _PAIRS // count)
    begin, end, apart, linked = [], [], [], []
    for index, own in enumerate(radii):  # a row at a time: memory for thousands
        row = np.abs(own - radii).sum(axis=1) + EPSILON
        order = np.argsort(row, kind="stable")  # the first is the shape itself
        linked += [(index, other) for other in order[: links + 1].tolist() if other != index]
        others = [other for other in {*order[:_NEAREST].tolist(), middle} if other != index]
        begin += [index] * len(others)
        end += others
        apart += row[others].tolist()
    tree = minimum_spanning_tree(csr_array((apart, (begin, end)), (count, count))).tocoo()
    linked += zip(tree.row.tolist(), tree.col.tolist(), strict=True)
    return sorted({(min(pair), max(pair)) for pair in linked})


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
