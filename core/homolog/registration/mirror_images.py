"""Subjects that fit the others better as mirror images, tested relative to the variation of the cohort."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product

import numpy as np

from homolog.arrays import FloatArray
from homolog.geometry import transform_points
from homolog.progress import Tick, part_of, run_in_threads
from homolog.registration.align import FindCandidates, Registrable
from homolog.registration.closest_points import SearchedPoints
from homolog.registration.icp import OrientedPoints, oriented_points, refined_each, sought
from homolog.registration.typicality import by_typicality
from homolog.surfaces.mirroring import MIRROR
from homolog.surfaces.nearest import NearestPoints
from homolog.surfaces.orientation import TURNED_FILES
from homolog.threads import cores

__all__ = ["better_mirrored", "reversed_ones"]

_MOVING, _FIXED = 300, 800
"""Number of points of a subject and its mirror image, and of a subject that both are compared with."""
_REFERENCES, _COMPARISONS = 4, 240
"""Largest number of references for each subject, and approximate number of comparisons beyond the first."""
_SAMPLE = 16
"""Number of subjects of a result that show how much mirror images differ."""
_CLEAR = 2.0
"""Least median of the usual preferences relative to their spread; below it shapes do not show sides."""
_LEAST_SPREAD = 0.05
_CERTAIN = 1.5
"""Largest magnitude of a preference that counts: beyond it, differences say nothing more about sides."""
_LIKELY = float(np.log(1.0 / TURNED_FILES - 1.0))
"""Least log-likelihood ratio of a preference, mirror image versus usual subject: prior odds against it."""
_LEAST, _NOTABLE = 0.5, 0.5
"""Fractions of the median preference: least magnitude of a mirror image's, and of one that shows a side."""
_FEWEST = 3
_SLIGHT, _FEW = 0.25, 0.05
"""A preference below minus this fraction of the median is ambiguous unless it is that of a mirror image;
largest share of subjects with ambiguous preferences."""
_MOST, _FAR = 0.7, 5.0
"""Least share of subjects whose preferences exceed `_NOTABLE`; least distance of a mirror image in
spreads."""

_RARE, _DISTINCT = 0.25, 0.5
"""Largest share of mirror images if the median preference is below the second value: wrong files are rare,
and mixed sides have larger preferences."""


_MESSAGE = "comparing with mirror images"


class _Surface:
    """The surface of a point set, with search trees."""

    def __init__(self, shape: OrientedPoints) -> None:
        self.shape, self.searched = shape, SearchedPoints(shape)
        self._positions = NearestPoints(shape.points, shape.normals)

    def distance(self, points: FloatArray) -> float:
        """Return the mean distance of points from the surface."""
        nearest = self._positions.nearest(points)[1]
        away = np.einsum("ni,ni->n", points - self.shape.points[nearest], self.shape.normals[nearest])
        return max(float(np.abs(away).mean()), 1e-6)


@dataclass(frozen=True, slots=True, eq=False)
class _Pair:
    """A subject and its mirror image, both registered to the most typical subject, at one size."""

    own: OrientedPoints
    image: OrientedPoints
    fixed: OrientedPoints

    def preferences(self, surfaces: Sequence[_Surface]) -> FloatArray:
        """Return the logarithm of the subject's distance to each surface over that of its mirror image."""
        of_image, of_own = _gaps([self.image, self.own], surfaces)
        result: FloatArray = np.log(of_image / of_own)
        return result

    def searched(self, surface: _Surface) -> "_Pair":
        """Return the pair, registered again if evenly spaced orientations lead to a closer fit."""

        def nearer(shape: OrientedPoints) -> OrientedPoints:
            placed = [shape, shape.placed(sought(shape, surface.shape).pose)]
            return placed[_nearest(placed, surface)]

        return replace(self, own=nearer(self.own), image=nearer(self.image))


def better_mirrored(
    groomed: Sequence[Registrable],
    alignments: FloatArray,
    known: Collection[str],
    registered_already: bool,
    find: FindCandidates,
    tick: Tick,
) -> set[str]:
    """Return the names of subjects whose mirror images fit the others far better.

    A subject and its mirror image are registered to the most typical subjects; its preference is the
    logarithm of the ratio of their distances. `reversed_ones` decides from all preferences.

    Parameters
    ----------
    groomed : sequence of Registrable
        The cohort.
    alignments : (M, 4, 4) float64 array
        Alignments of the subjects.
    known : collection of str
        Subjects of a result; their sides are not changed.
    registered_already : bool
        Whether alignments register shapes to the most typical one.
    find : callable
        Registration of a shape to another.
    tick : Tick
        Progress and cancellation.
    """
    clouds = [
        oriented_points(item.coarse_mesh.placed(alignment))
        for item, alignment in zip(groomed, alignments, strict=True)
    ]
    units = [cloud.scaled(1.0 / cloud.size) for cloud in clouds]
    order = by_typicality(units).tolist()
    tested, references = _tested_and_references(order, {k for k in order if groomed[k].name in known})
    if len(tested) <= _FEWEST:
        return set()
    pairing = _Pairing(clouds, units, references[0], registered_already, find)
    tasks = [partial(pairing.pair, k) for k in references]
    made = run_in_threads(tasks, part_of(tick, 0.0, 0.1), _MESSAGE, cores())
    compared = _References(dict(zip(references, made, strict=True)))
    involved = sorted({*tested, *references})
    works = [partial(compared.preferences, k, pairing) for k in involved]
    rows = np.array(run_in_threads(works, part_of(tick, 0.1, 1.0), _MESSAGE, cores()))
    sides = _sides(rows[np.searchsorted(involved, references)])
    others = len(references) - np.isin(involved, references)
    preferences = (rows @ sides / others)[np.searchsorted(involved, tested)]
    are_images = reversed_ones(preferences, majority=not known)
    flagged = [
        k for k, is_image in zip(tested, are_images, strict=True) if is_image and groomed[k].name not in known
    ]
    for k in flagged:  # failed registrations resemble mirror images
        row = compared.preferences(k, pairing, part_of(tick, 1.0, 1.0), searches=True)
        preferences[tested.index(k)] = row @ sides / (len(references) - (k in references))
    are_images = reversed_ones(preferences, majority=not known) if flagged else are_images
    return {groomed[k].name for k in flagged if are_images[tested.index(k)]}


@dataclass(frozen=True, slots=True, eq=False)
class _Pairing:
    """Registrations of subjects and their mirror images to the most typical subject.

    Attributes
    ----------
    clouds, units : sequence of M OrientedPoints
        Aligned subjects, and the same at size 1.
    middle : int
        Index of the most typical one.
    registered_already : bool
        Whether alignments register shapes to it.
    find : callable
    """

    clouds: Sequence[OrientedPoints]
    units: Sequence[OrientedPoints]
    middle: int
    registered_already: bool
    find: FindCandidates
    surface: "_Surface" = field(init=False)

    def __post_init__(self) -> None:
        """Make the search trees of the most typical subject."""
        object.__setattr__(self, "surface", _Surface(_thinned(self.units[self.middle], _FIXED)))

    def pair(self, k: int, tick: Tick) -> _Pair:
        """Return a subject and its mirror image, both registered."""
        tick(0.0, _MESSAGE)
        cloud = _thinned(self.units[k], _MOVING)
        pose = np.eye(4)
        if self.registered_already:
            pose[:3, 3] = (self.clouds[k].centre - self.clouds[self.middle].centre) / self.clouds[k].size
        image = _turned(cloud, MIRROR[:3, :3])
        image = image.placed(self._closest(image))  # its orientation is arbitrary
        # In cohorts of both sides a registration from any orientation may be closer.
        poses = pose, self._closest(cloud)
        pose = poses[_nearest([cloud.placed(item) for item in poses], self.surface)]
        return _Pair(cloud.placed(pose), image, _thinned(self.units[k], _FIXED).placed(pose))

    def _closest(self, cloud: OrientedPoints) -> FloatArray:
        """Return the pose of the closest registration to the most typical subject, (4, 4)."""
        return min(self.find(cloud, self.surface.shape), key=lambda fit: fit.distance).pose


class _References:
    """The most typical subjects, by index, with which all are compared."""

    def __init__(self, pairs: Mapping[int, _Pair]) -> None:
        self._pairs = pairs
        self._surfaces = [_Surface(pair.fixed) for pair in pairs.values()]

    def preferences(self, k: int, pairing: _Pairing, tick: Tick, *, searches: bool = False) -> FloatArray:
        """Return a subject's preferences among the references, 0 for itself.

        `searches` says whether it is registered again from evenly spaced orientations.
        """
        tick(0.0, _MESSAGE)
        pair = self._pairs[k] if k in self._pairs else pairing.pair(k, tick)
        if searches:
            pair = pair.searched(pairing.surface)
        others = [position for position, j in enumerate(self._pairs) if j != k]
        result = np.zeros(len(self._surfaces))
        result[others] = pair.preferences([self._surfaces[position] for position in others])
        return result


def _tested_and_references(order: list[int], known: set[int]) -> tuple[list[int], list[int]]:
    """Return the subjects to test, and the references to compare them with, both in order of typicality.

    Only a sample of the subjects of a result is tested, since their sides are not changed.
    """
    sample = [k for k in order if k in known][:_SAMPLE]
    tested = [k for k in order if k in sample or k not in known]
    count = 1 + int(np.clip(_COMPARISONS // max(len(tested), 1), 1, _REFERENCES))
    return tested, (sample if len(sample) > 1 else order)[:count]


def _sides(preferences: FloatArray) -> FloatArray:
    """Return 1 for references on the same side as the first one, and -1 for the others.

    They are the signs of the first eigenvector of the preferences among references (synchronization over
    the group of two elements; Singer 2011).
    """
    vector = np.linalg.eigh(preferences + preferences.T)[1][:, -1]
    return np.where(vector * vector[0] < 0.0, -1.0, 1.0)


def reversed_ones(preferences: FloatArray, *, majority: bool = True) -> list[bool]:
    """Return which subjects are mirror images of the usual ones, by their preferences for their own side.

    The usual subjects have positive preferences. Shapes show sides if the median is at least twice the spread
    (standard deviation) and most preferences exceed half the median; otherwise they are too symmetric or too
    variable. A subject with a negative preference is a mirror image if the preference is 99 times
    likelier in a distribution about minus the median than in one about the median, and farther than five
    spreads from the median. If more than a few preferences are ambiguous, or many subjects seem to be mirror
    images with small preferences, the asymmetries are random, and no subject is a mirror image.

    Parameters
    ----------
    preferences : (M,) float64 array
        Logarithms of the mirror image's distance relative to the subject's, positive if the subject fits
        better.
    majority : bool
        Whether the usual subjects are those of the more frequent sign; otherwise they are the positive ones.
    """
    values = -preferences if majority and 2 * np.sum(preferences < 0.0) > len(preferences) else preferences
    values = np.clip(values, -_CERTAIN, _CERTAIN)
    usual = values[values > 0.0]
    if len(usual) < _FEWEST:
        return [False] * len(values)
    middle = float(np.median(usual))
    spread = float(np.hypot(usual.std(), _LEAST_SPREAD))
    showing = np.mean(np.abs(values) >= _NOTABLE * middle)
    if middle < _CLEAR * spread or showing < _MOST:
        return [False] * len(values)
    is_image = (-values >= _LEAST * middle) & (-2.0 * middle * values >= _LIKELY * spread**2)
    is_image &= middle - values >= _FAR * spread
    between = np.sum((values < -_SLIGHT * middle) & ~is_image)
    if between > _FEW * len(values) or (is_image.mean() > _RARE and middle < _DISTINCT):
        return [False] * len(values)
    return [bool(item) for item in is_image]


def _turned(cloud: OrientedPoints, rotation: FloatArray) -> OrientedPoints:
    return replace(cloud, points=cloud.points @ rotation.T, normals=cloud.normals @ rotation.T)


def _thinned(cloud: OrientedPoints, points: int) -> OrientedPoints:
    every = slice(None, None, max(1, len(cloud.points) // points))
    return replace(cloud, points=cloud.points[every], normals=cloud.normals[every])


def _gaps(moving: Sequence[OrientedPoints], surfaces: Sequence[_Surface]) -> FloatArray:
    """Return the mean distances of registered points from surfaces, by point set and surface."""
    pairs = list(product([SearchedPoints(shape) for shape in moving], surfaces))
    fits = refined_each([own for own, _ in pairs], [surface.searched for _, surface in pairs])
    return np.array(
        [
            surface.distance(transform_points(fit.pose, own.points))
            for (own, surface), fit in zip(pairs, fits, strict=True)
        ]
    ).reshape(len(moving), -1)


def _nearest(placed: Sequence[OrientedPoints], surface: _Surface) -> int:
    """Return the index of the point set that is nearest to a surface after registration."""
    return int(_gaps(placed, [surface]).argmin())
