"""Subjects that fit the others better as mirror images: a test that knows how much subjects differ."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.spatial import KDTree

from homolog.arrays import FloatArray
from homolog.device import cores
from homolog.geometry import rotation_of, transform_points
from homolog.grooming.align import RegisterPair, by_typicality
from homolog.grooming.icp import OrientedPoints, oriented_points, refined, sought
from homolog.grooming.subject import GroomedSubject
from homolog.progress import Tick, part_of, run_in_threads
from homolog.surfaces.mirroring import MIRROR

__all__ = ["better_mirrored", "reversed_ones"]

_MOVING, _FIXED = 300, 800
"""Points of a subject, and of one that it and its mirror image are compared with."""
_REFERENCES, _COMPARISONS = 4, 240
"""Most subjects that each is compared with, and about how many comparisons there are beyond the first."""
_SAMPLE = 16
"""Subjects of a result that show how much mirror images differ."""
_CLEAR = 2.0
"""Preferences of the usual subjects over their spread, at least, if shapes are to tell sides at all."""
_LEAST_SPREAD = 0.05
_LIKELY = np.log(100.0)
"""Logarithm of how much likelier a preference is among mirror images than among the usual subjects."""
_LEAST, _NOTABLE = 0.5, 0.5
"""Of the usual preference: what a mirror image has at least, and what tells a side."""
_FEWEST = 3
_SLIGHT, _FEW = 0.25, 0.05
"""Preferences between those of usual subjects and of mirror images are below minus so much of the usual one;
largest share of the subjects that have them."""
_MOST, _FAR = 0.7, 5.0
"""Share of the subjects whose preferences exceed `_NOTABLE`; spreads between usual ones and mirror images."""

_RARE, _DISTINCT = 0.25, 0.5
"""Largest share of mirror images where the usual preference is below this one: wrong files are rare, and
where both sides are mixed, they differ clearly."""


@dataclass(frozen=True, slots=True, eq=False)
class _Pair:
    """A subject and its mirror image, both registered to the most typical subject, at one size."""

    own: OrientedPoints
    image: OrientedPoints
    fixed: OrientedPoints

    def preference(self, surface: OrientedPoints) -> float:
        """Return the logarithm of how much nearer to a surface the mirror image is than the subject."""
        return float(np.log(_gap(self.image, surface) / _gap(self.own, surface)))

    def searched(self, surface: OrientedPoints) -> "_Pair":
        """Return the pair, each placed better if an evenly spaced orientation leads to a closer fit."""
        own, image = (
            min(item, _moved(item, sought(item, surface).pose), key=lambda placed: _gap(placed, surface))
            for item in (self.own, self.image)
        )
        return replace(self, own=own, image=image)


def better_mirrored(
    groomed: Sequence[GroomedSubject],
    alignments: FloatArray,
    known: Collection[str],
    registered_already: bool,
    register_pair: RegisterPair,
    tick: Tick,
) -> set[str]:
    """Return the names of subjects whose mirror image fits the others far better than they do.

    A subject and its mirror image are registered to the most typical subjects; its preference is the
    logarithm of the ratio of their distances. See `reversed_ones` for what is decided from all preferences.

    Parameters
    ----------
    groomed : sequence of GroomedSubject
        The cohort.
    alignments : (M, 4, 4) float64 array
        Of the subjects.
    known : collection of str
        Subjects of a result, which are not decided upon.
    registered_already : bool
        Whether alignments register shapes to the most typical one.
    register_pair : callable
        Registration of a shape to another.
    tick : Tick
        Progress and cancelling.
    """
    placed = [
        oriented_points(item.coarse_mesh.placed(alignment))
        for item, alignment in zip(groomed, alignments, strict=True)
    ]
    units = [cloud.scaled(1.0 / cloud.size) for cloud in placed]
    order = by_typicality(units).tolist()
    looked_at, references = _looked_at(order, {k for k in order if groomed[k].name in known})
    if len(looked_at) <= _FEWEST:
        return set()
    middle = references[0]
    fixed = _thinned(units[middle], _FIXED)

    def pair_of(k: int, inner: Tick) -> _Pair:
        inner(0.0, "comparing with mirror images")
        cloud = _thinned(units[k], _MOVING)
        pose = np.eye(4)
        if not registered_already:
            pose = register_pair(cloud, fixed).pose
        else:
            pose[:3, 3] = (placed[k].centre - placed[middle].centre) / placed[k].size
        image = _turned(cloud, MIRROR[:3, :3])
        image = _moved(image, register_pair(image, fixed, free=True).pose)  # its orientation means nothing
        return _Pair(_moved(cloud, pose), image, _moved(_thinned(units[k], _FIXED), pose))

    every = sorted({*looked_at, *references})
    tasks = [partial(pair_of, k) for k in every]
    made = run_in_threads(tasks, part_of(tick, 0.0, 0.7), "comparing with mirror images", cores())
    pairs = dict(zip(every, made, strict=True))

    def preference(k: int, inner: Tick) -> FloatArray:
        inner(0.0, "comparing with mirror images")
        return np.array([0.0 if j == k else pairs[k].preference(pairs[j].fixed) for j in references])

    works = [partial(preference, k) for k in every]
    further = part_of(tick, 0.7, 1.0)
    rows = np.array(run_in_threads(works, further, "comparing with mirror images", cores()))
    sides = _sides(rows[[every.index(j) for j in references]])
    others = len(references) - np.isin(every, references)
    preferences = (rows @ sides / others)[[every.index(k) for k in looked_at]]
    are_images = reversed_ones(preferences, majority=not known)
    flagged = [
        k
        for k, is_image in zip(looked_at, are_images, strict=True)
        if is_image and groomed[k].name not in known
    ]
    for k in flagged:  # a registration that missed the best orientation looks like a mirror image
        tick(1.0, "comparing with mirror images")
        pairs[k] = pairs[k].searched(fixed)
        row = [0.0 if j == k else pairs[k].preference(pairs[j].fixed) for j in references]
        preferences[looked_at.index(k)] = row @ sides / (len(references) - (k in references))
    are_images = reversed_ones(preferences, majority=not known) if flagged else are_images
    return {groomed[k].name for k in flagged if are_images[looked_at.index(k)]}


def _looked_at(order: list[int], known: set[int]) -> tuple[list[int], list[int]]:
    """Return whom to compare with mirror images, and the most typical to compare with, from typical on.

    Of subjects of a result, which are not decided upon, a sample takes part.
    """
    sample = [k for k in order if k in known][:_SAMPLE]
    looked_at = [k for k in order if k in sample or k not in known]
    count = 1 + int(np.clip(_COMPARISONS // max(len(looked_at), 1), 1, _REFERENCES))
    return looked_at, (sample if len(sample) > 1 else order)[:count]


def _sides(preferences: FloatArray) -> FloatArray:
    """Return 1 for references on the side of the first one, and -1 for those on the other.

    They are the signs of the first eigenvector of the preferences among references (synchronization over
    the group of two elements; Singer 2011).
    """
    vector = np.linalg.eigh(preferences + preferences.T)[1][:, -1]
    return np.where(vector * vector[0] < 0.0, -1.0, 1.0)


def reversed_ones(preferences: FloatArray, *, majority: bool = True) -> list[bool]:
    """Return which subjects are mirror images of the usual ones, by their preferences for their own side.

    The usual subjects have positive preferences. They tell sides if the median is twice their spread (the
    standard deviation) and most preferences exceed half of it: otherwise shapes are too symmetric, or differ
    too much. A negative preference is a mirror image's if it is a hundred times likelier about minus the
    median than about the median, and farther from it than five spreads. Where more than a few preferences
    lie between, or many seem to be mirror images by small preferences, subjects differ in chance asymmetries,
    and none is a mirror image.

    Parameters
    ----------
    preferences : (M,) float64 array
        Logarithms of the distance of the mirror image over the subject's own, positive if the own one fits.
    majority : bool
        Whether the usual subjects are those of the more frequent sign; otherwise they are the positive ones.
    """
    values = -preferences if majority and 2 * np.sum(preferences < 0.0) > len(preferences) else preferences
    usual = values[values > 0.0]
    if len(usual) < _FEWEST:
        return [False] * len(values)
    middle = float(np.median(usual))
    spread = float(np.hypot(usual.std(), _LEAST_SPREAD))
    tell = np.mean(np.abs(values) >= _NOTABLE * middle)
    if middle < _CLEAR * spread or tell < _MOST:
        return [False] * len(values)
    is_image = (-values >= _LEAST * middle) & (-2.0 * middle * values >= _LIKELY * spread**2)
    is_image &= middle - values >= _FAR * spread
    between = np.sum((values < -_SLIGHT * middle) & ~is_image)
    if between > _FEW * len(values) or (is_image.mean() > _RARE and middle < _DISTINCT):
        return [False] * len(values)
    return [bool(item) for item in is_image]


def _turned(cloud: OrientedPoints, rotation: FloatArray) -> OrientedPoints:
    return replace(cloud, points=cloud.points @ rotation.T, normals=cloud.normals @ rotation.T)


def _moved(cloud: OrientedPoints, pose: FloatArray) -> OrientedPoints:
    rotation = rotation_of(pose)
    return replace(cloud, points=transform_points(pose, cloud.points), normals=cloud.normals @ rotation.T)


def _thinned(cloud: OrientedPoints, points: int) -> OrientedPoints:
    every = slice(None, None, max(1, len(cloud.points) // points))
    return replace(cloud, points=cloud.points[every], normals=cloud.normals[every])


def _gap(moving: OrientedPoints, fixed: OrientedPoints) -> float:
    """Return the mean distance of points from a point set's surface, once registered; sizes are about 1."""
    points = transform_points(refined(moving, fixed).pose, moving.points)
    nearest = KDTree(fixed.points).query(points)[1]
    away = np.einsum("ni,ni->n", points - fixed.points[nearest], fixed.normals[nearest])
    return max(float(np.abs(away).mean()), 1e-6)
