"""Whether the orientations of a cohort's files agree, and whether shapes determine their orientations.

Iterative closest points rotates a nearly round shape into one of many meaningless minima. If the files agree,
as medical images in patient coordinates do, their common orientation is better.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from homolog.arrays import FloatArray
from homolog.geometry import rotation_of
from homolog.progress import Tick, run_in_threads
from homolog.registration.icp import Fit, OrientedPoints, held, softness_of_fit
from homolog.threads import cores, in_threads

__all__ = ["agree", "are_soft", "better_turned"]

_MOST_COMPARED = 40
"""Largest number of shapes whose orientations are compared."""
_DIRECTIONS, _TURNS = 150, 60
"""Number of directions in which shapes are compared, and of random rotations that represent chance."""
_CHANCE, _LARGEST_SHARE, _DEVIATIONS = 0.5, 0.4, 2.8
"""Share of random rotations that fit better than the files' orientations: expected by chance; largest if
files agree; and its least distance from chance in standard deviations."""
_SOFT = 0.5
"""Least `softness_of_fit` of a typical shape that hardly determines its orientation."""

_DISTANT, _GAIN = 1.1, 0.35
"""A shape may be rotated in its file if its distance exceeds this factor times the median, and if a rotation
reduces the mean logarithm of its distances from typical shapes by this difference."""
_REFERENCES = 4
_NEARER = 0.84
"""The rotation must reduce the distance from the most typical shape to less than this fraction."""
_FAR = 60.0
"""Smallest rotation that is reported [degrees]."""


def agree(shapes: Sequence[OrientedPoints]) -> bool:
    """Return whether shapes (sizes about 1) are more similar in their files' orientations than by chance.

    The test compares support functions (the extent in each direction). If orientations were arbitrary, half
    of all random rotations of a shape would make it more similar to another.
    """
    step = -(-len(shapes) // _MOST_COMPARED)
    some, rng = shapes[::step], np.random.default_rng(0)
    directions = rng.normal(size=(_DIRECTIONS, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    turned = np.concatenate(
        [directions @ turn for turn in Rotation.random(_TURNS, random_state=0).as_matrix()]
    )

    def extents_of(shape: OrientedPoints) -> tuple[FloatArray, FloatArray]:
        hull = shape.points[ConvexHull(shape.points, qhull_options="QJ").vertices]
        return (directions @ hull.T).max(axis=1), (turned @ hull.T).max(axis=1)

    given_extents, turned_extents = zip(*in_threads(extents_of, some, cores()), strict=True)
    extents, others = np.array(given_extents), np.array(turned_extents).reshape(len(some), _TURNS, -1)
    shares = []
    for index, own in enumerate(extents):
        given = np.delete(np.square(extents - own).mean(axis=1), index)
        at_random = np.delete(np.square(others - own).mean(axis=2), index, axis=0)
        shares.append(float(np.mean(at_random < given[:, None])))
    pairs = len(some) * (len(some) - 1) / 2
    return bool(
        np.mean(shares) < min(_LARGEST_SHARE, _CHANCE - _DEVIATIONS * np.sqrt(1.0 / 12.0 / max(pairs, 1)))
    )


def are_soft(shapes: Sequence[OrientedPoints], reference: OrientedPoints, fits: Sequence[Fit]) -> bool:
    """Return whether the typical shape, registered to the reference, hardly determines its orientation."""
    step = -(-len(shapes) // _MOST_COMPARED)
    values = [
        softness_of_fit(shape, reference, fit.pose)
        for shape, fit in zip(shapes[::step], fits[::step], strict=True)
        if shape is not reference
    ]
    return bool(np.median(values) > _SOFT)


def better_turned(
    shapes: Sequence[OrientedPoints],
    fits: Sequence[Fit],
    order: Sequence[int],
    register_freely: Callable[[OrientedPoints, OrientedPoints], Fit],
    tick: Tick,
) -> dict[int, float]:
    """Return rotation angles [degrees] that clearly improve the fit, by index: those files may be rotated.

    A single rotation must bring a shape nearer to typical shapes, which all keep their files' orientations.
    The test includes the most typical shape, and those that are unusually far from it.

    Parameters
    ----------
    shapes : sequence of OrientedPoints
        Shapes of sizes about 1, in their files' orientations.
    fits : sequence of Fit
        Their registrations to the most typical one, `held`.
    order : sequence of int
        Indices of the shapes, the most typical first.
    register_freely : callable
        Registers one shape to another, regardless of the orientations of the files.
    tick : Tick
        Progress and cancellation.
    """
    usual = float(np.median([fit.distance for fit in fits]))
    distant = {
        index for index, fit in enumerate(fits) if fit.distance > _DISTANT * usual and _angle(fit.pose) < _FAR
    }
    references = [shapes[k] for k in order if k not in distant][:_REFERENCES]

    def turn(index: int, inner: Tick) -> float:
        """Return the angle of the best-fitting rotation, or 0 for the file's orientation."""
        shape = shapes[index]
        free = register_freely(shape, references[0])
        if free.distance > _NEARER * held(shape, references[0]).distance:
            return 0.0
        kept = np.array([held(shape, reference).distance for reference in references])
        best, angle = _GAIN, 0.0
        for reference in references:
            inner(0.0, "aligning")
            pose = (free if reference is references[0] else register_freely(shape, reference)).pose
            if _angle(pose) < _FAR:
                continue
            turned = _turned(shape, rotation_of(pose))
            other = np.array([held(turned, item).distance for item in references])
            if (gain := float(np.log(kept / other).mean())) > best:
                best, angle = gain, _angle(pose)
        return angle

    looked_at = sorted(distant)
    works = [partial(turn, index) for index in looked_at]
    angles = run_in_threads(works, tick, "aligning", cores())
    return {index: angle for index, angle in zip(looked_at, angles, strict=True) if angle}


def _angle(pose: FloatArray) -> float:
    return float(np.degrees(Rotation.from_matrix(rotation_of(pose)).magnitude()))


def _turned(shape: OrientedPoints, rotation: FloatArray) -> OrientedPoints:
    return replace(shape, points=shape.points @ rotation.T, normals=shape.normals @ rotation.T)
