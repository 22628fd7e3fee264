"""Alignment of groomed shapes."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Protocol

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

from homolog.arrays import BoolArray, FloatArray
from homolog.errors import InputError
from homolog.geometry import rotation_of, scale_of
from homolog.progress import Tick, no_tick, run_in_threads
from homolog.registration.doubtful import OtherTurn, other_turns
from homolog.registration.icp import (
    Fit,
    OrientedPoints,
    axes_rotation,
    fit_at,
    held,
    oriented_points,
    refined,
    registered,
)
from homolog.registration.notes import DOUBTFUL, MIN_SUBJECTS, Findings, notes_on
from homolog.registration.orientation import agree, are_soft, better_turned
from homolog.registration.typicality import (
    EPSILON,
    angles_from,
    by_typicality,
    medoid,
    odd_ones,
    radii_of,
    similar_pairs,
    typical_rotation,
)
from homolog.settings import Alignment, GroomSettings
from homolog.surfaces.mesh import TriangleMesh
from homolog.threads import cores, on_one_thread

__all__ = [
    "RegisterPair",
    "Registrable",
    "Registration",
    "align",
    "by_typicality",
    "medoid",
    "of_other_units",
    "register",
]


class Registrable(Protocol):
    """A subject with a surface of few vertices in the coordinates of its file."""

    @property
    def name(self) -> str:
        """The subject's name, for messages."""

    @property
    def coarse_mesh(self) -> TriangleMesh:
        """Its surface, evenly triangulated [mm]."""


class RegisterPair(Protocol):
    """A registration of one shape to another: `registered`, or its cached form."""

    def __call__(
        self, moving: OrientedPoints, fixed: OrientedPoints, *, free: bool = False, bends: bool = False
    ) -> Fit:
        """Return the registration of `moving` to `fixed`; see `registered`."""


_OTHER_UNIT = 100.0  # ratio of sizes
_NEIGHBOURS, _SIMILAR = 3, 40
"""Shapes with which a rotated shape is compared; shapes of similar radii among which they are sought."""
_CLEARLY_BETTER, _UNLIKE = 0.6, 1.5
"""A held shape is rotated freely if that reduces its distance to less than the first factor, and if its
distance exceeds the second factor times the median."""
_CLOSER = 0.75
"""Inconsistent orientations of files are ignored if the sum of distances then falls below this fraction."""


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """Alignment of a cohort.

    Attributes
    ----------
    alignments : (M, 4, 4) float64 array
        From local to world coordinates: a proper rotation times one positive scale, and a translation [mm].
    notes : tuple of M str or None
        Notes on subjects that do not look like the others, or had another orientation.
    """

    alignments: FloatArray
    notes: tuple[str | None, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Fits:
    """Registrations to the medoid.

    `held` says whether they keep the orientations of the files, `unsure` whether neither shapes nor files
    determine the orientations. `turns` contains the rotation angles
    [degrees] that would improve the fit clearly, by index of the shape.
    """

    fits: list[Fit]
    held: bool = False
    unsure: bool = False
    turns: dict[int, float] = field(default_factory=dict)


@on_one_thread
def align(groomed: Sequence[Registrable], settings: GroomSettings, tick: Tick = no_tick) -> FloatArray:
    """Return a similarity for each subject; see `register`.

    Parameters
    ----------
    groomed : sequence of Registrable
        The cohort.
    settings : GroomSettings
        Method of alignment and scaling.
    tick : Tick
        Progress and cancellation.

    Returns
    -------
    (M, 4, 4) array
        From local to world coordinates [mm].
    """
    return register(groomed, settings, tick).alignments


def register(
    groomed: Sequence[Registrable],
    settings: GroomSettings,
    tick: Tick = no_tick,
    *,
    register_pair: RegisterPair = registered,
) -> Registration:
    """Align a cohort.

    *Center* moves each surface's centre to the origin. *Axes* also rotates the principal axes onto
    those of a reference subject. *ICP* registers the surface to the reference: by `registered`, or by `held`
    if shapes hardly determine their orientations and those of the files agree. The world then has the
    reference's directions. Surfaces are compared at one size. The reference is the medoid of the
    distributions of distances from the centre, which do not depend on pose.

    Parameters
    ----------
    groomed : sequence of Registrable
        The cohort, at least one.
    settings : GroomSettings
        Its `alignment` and `scaling`: every root-mean-square radius becomes the cohort's geometric mean.
    tick : Tick
        Called at least every 0.2 s.
    register_pair : callable
        Registers one shape to another.

    Raises
    ------
    InputError
        If a shape is a hundred times as large or small as the others, which means another unit.
    """
    names, sizes, units = [item.name for item in groomed], np.empty(len(groomed)), []
    for index, item in enumerate(groomed):
        shape = oriented_points(item.coarse_mesh)
        sizes[index] = shape.size
        units.append(shape.scaled(1.0 / shape.size))
    if strange := of_other_units(names, sizes.tolist()):
        raise InputError("\n".join(strange.values()))
    goals = np.full(len(sizes), np.exp(np.log(sizes).mean())) if settings.scaling else sizes
    middle = medoid(units)
    reference = units[middle]
    result, distances = np.empty((len(units), 4, 4)), np.zeros(len(units))
    registrations = _fits(units, middle, settings.alignment, register_pair, tick)
    for index, (unit, size, goal) in enumerate(zip(units, sizes.tolist(), goals.tolist(), strict=True)):
        pose = np.eye(4)
        if settings.alignment is Alignment.AXES:
            pose[:3, :3] = axes_rotation(unit, reference)
        elif settings.alignment is Alignment.ICP:
            fit = registrations.fits[index]
            distances[index] = fit.distance
            pose[:3] = fit.pose[:3] / scale_of(fit.pose)
        pose[:3, :3] *= goal / size
        pose[:3, 3] *= goal
        pose[:3, 3] -= pose[:3, :3] @ unit.centre
        if settings.alignment is Alignment.NONE:
            pose[:3, 3] += unit.centre
        result[index] = pose
    freely = partial(register_pair, free=True)
    odd = odd_ones(units, distances, freely, tick) if len(units) >= MIN_SUBJECTS else set()
    findings = Findings(
        sizes, distances, _turns(result), odd,
        held=registrations.held, unsure=registrations.unsure, better=registrations.turns, others={},
    )  # fmt: skip
    if settings.alignment is Alignment.ICP:
        findings = replace(findings, others=_others(units, registrations, findings, tick))
    return Registration(result, notes_on(findings))


def _others(
    units: Sequence[OrientedPoints], registrations: _Fits, findings: Findings, tick: Tick
) -> dict[int, OtherTurn]:
    """Return further rotations after which rotated shapes fit about as well, or better, by index.

    Where the files agree, only shapes that were rotated against most others may be turned wrongly.
    """
    tested = np.flatnonzero(findings.angles > DOUBTFUL).tolist()
    if findings.differ or findings.unsure:
        tested = list(range(len(units)))
    if not tested:
        return {}
    rotations = rotation_of(np.array([fit.pose for fit in registrations.fits]))
    return other_turns(units, rotations, by_typicality(units).tolist(), tested, tick)


def _fits(
    units: Sequence[OrientedPoints],
    middle: int,
    alignment: Alignment,
    register_pair: RegisterPair,
    tick: Tick,
) -> _Fits:
    """Return the registrations of all shapes to the medoid; none if only centres or axes are aligned."""
    tick(0.0, "aligning")
    if alignment is not Alignment.ICP:
        return _Fits([])
    reference = units[middle]

    def fit(unit: OrientedPoints, inner: Tick) -> Fit:
        inner(0.0, "aligning")
        return register_pair(unit, reference)

    fits = run_in_threads([partial(fit, unit) for unit in units], tick, "aligning", cores())
    if len(units) < MIN_SUBJECTS:
        return _Fits(fits)
    is_soft, doubtful, turns = are_soft(units, reference, fits), _doubtful(fits), {}
    alike = agree(units) if is_soft or doubtful.any() else True  # no registration rotated a shape far
    holds = is_soft and alike
    if holds:
        fits = _held(units, middle, fits, tick)
        doubtful = _doubtful(fits)
        turns = better_turned(
            units, fits, by_typicality(units).tolist(), partial(register_pair, free=True), tick
        )
    unsure = is_soft and not alike and bool(doubtful.any())  # few files can't show that they agree
    if not holds and 2 * np.count_nonzero(doubtful) >= len(units):
        return _Fits(_by_neighbours(units, middle, register_pair, tick), unsure=unsure)
    if doubtful.any():
        fits = _reconsidered(units, reference, fits, doubtful, alike, register_pair, tick)
    if not alike and _distance(others := _by_neighbours(units, middle, register_pair, tick)) < (
        _CLOSER * _distance(fits)
    ):
        return _Fits(others, unsure=unsure)
    return _Fits(fits, holds, unsure, turns)


def _doubtful(fits: Sequence[Fit]) -> BoolArray:
    """Return which shapes are rotated far relative to most others."""
    return _turns(np.array([fit.pose for fit in fits])) > DOUBTFUL


def _distance(fits: Sequence[Fit]) -> float:
    return sum(fit.distance for fit in fits)


def _held(units: Sequence[OrientedPoints], middle: int, fits: Sequence[Fit], tick: Tick) -> list[Fit]:
    """Register shapes that hardly determine their orientation and whose files agree in it.

    A shape is rotated far only if it fits less well than others in the file's orientation, and clearly better
    after the rotation.
    """

    def fit(unit: OrientedPoints, inner: Tick) -> Fit:
        inner(0.0, "aligning")
        return Fit(np.eye(4), 0.0) if unit is units[middle] else held(unit, units[middle])

    result = run_in_threads([partial(fit, unit) for unit in units], tick, "aligning", cores())
    median = float(np.median([fit.distance for fit in result]))
    return [
        other
        if kept.distance > _UNLIKE * median and other.distance < _CLEARLY_BETTER * kept.distance
        else kept
        for kept, other in zip(result, fits, strict=True)
    ]


def _reconsidered(
    units: Sequence[OrientedPoints],
    reference: OrientedPoints,
    fits: Sequence[Fit],
    doubtful: BoolArray,
    files_agree: bool,
    register_pair: RegisterPair,
    tick: Tick,
) -> list[Fit]:
    """Register shapes that were rotated relative to all others through their neighbours.

    A shape that differs much from the reference may fit it better in a wrong orientation. If the files of
    most shapes agree in orientation, a rotated shape is compared with the shapes that it resembles most in
    that orientation. It keeps the common orientation if that fits one of them.
    """
    poses, alike = np.array([fit.pose for fit in fits]), np.flatnonzero(~doubtful)
    radii, typical = radii_of(units), typical_rotation(poses[alike])

    def neighbours(index: int) -> list[int]:
        order = np.argsort(np.abs(radii[alike] - radii[index]).sum(axis=1), kind="stable")
        similar: list[int] = alike[order].tolist()
        if not files_agree:
            return similar[:_NEIGHBOURS]
        similar = similar[:_SIMILAR]  # radii do not tell a shape from itself turned by 180 degrees
        gaps = [refined(units[index], units[other]).distance for other in similar]
        return [similar[k] for k in np.argsort(gaps, kind="stable")[:_NEIGHBOURS]]

    def reconsidered(index: int, inner: Tick) -> Fit:
        best, result = np.inf, fits[index]
        for neighbour in neighbours(index):
            inner(0.0, "aligning")
            fit = register_pair(units[index], units[neighbour])
            pose = poses[neighbour] @ fit.pose
            if fit.distance < best and angles_from(pose[None], typical)[0] <= DOUBTFUL:
                best, result = fit.distance, fit_at(units[index], reference, pose)
        return result

    again = np.flatnonzero(doubtful).tolist()
    changed = run_in_threads([partial(reconsidered, index) for index in again], tick, "aligning", cores())
    return list((dict(enumerate(fits)) | dict(zip(again, changed, strict=True))).values())


def _by_neighbours(
    units: Sequence[OrientedPoints], middle: int, register_pair: RegisterPair, tick: Tick
) -> list[Fit]:
    """Register shapes from files of arbitrary orientation to the medoid through chains of similar shapes.

    Relative orientations of similar shapes are the most certain: each shape is registered to those with the
    most similar radii, and the minimum spanning tree of the distances connects all of them. The orientations
    of the files are ignored.
    """
    pairs = similar_pairs(radii_of(units), middle)
    first, second = np.array(pairs).T

    def fit(pair: tuple[int, int], inner: Tick) -> Fit:
        inner(0.0, "aligning")
        return register_pair(units[pair[0]], units[pair[1]], bends=True)

    fits = run_in_threads([partial(fit, pair) for pair in pairs], tick, "aligning", cores())
    onto = {pair: item.pose for pair, item in zip(pairs, fits, strict=True)}
    distances = [item.distance + EPSILON for item in fits]
    graph = csr_array((distances, (first, second)), (len(units), len(units)))
    order, before = breadth_first_order(minimum_spanning_tree(graph), middle, directed=False)
    poses = {middle: np.eye(4)}
    for index in order[1:].tolist():
        nearer = int(before[index])
        pose = onto[index, nearer] if index < nearer else np.linalg.inv(onto[nearer, index])
        poses[index] = poses[nearer] @ pose
    return [fit_at(unit, units[middle], poses[index]) for index, unit in enumerate(units)]


def _turns(alignments: FloatArray) -> FloatArray:
    """Return the rotation angle of each similarity (M, 4, 4) relative to the most typical one [degrees]."""
    return angles_from(alignments, typical_rotation(alignments))


def of_other_units(names: Sequence[str], sizes: Sequence[float]) -> dict[str, str]:
    """Return messages on shapes so much larger or smaller than the others that their unit must differ.

    Parameters
    ----------
    names : sequence of str
    sizes : sequence of float
        Sizes of the shapes, in their common unit.

    Returns
    -------
    dict of str to str
        A message for each such shape, by name.
    """
    middle = float(np.median(sizes)) if len(sizes) else 0.0
    messages = {}
    for name, size in zip(names, sizes, strict=True):
        if not middle / _OTHER_UNIT < size < middle * _OTHER_UNIT:
            times, word = (size / middle, "large") if size > middle else (middle / size, "small")
            is_thousand = _OTHER_UNIT * 5.0 < times < _OTHER_UNIT * 20.0
            unit = "metres" if word == "small" else "micrometres"
            guess = f"its file is probably in {unit}:" if is_thousand else "if its unit differs,"
            others = f"{times:.0f} times as {word} as the others"
            messages[name] = f"{name}: is {others}; {guess} export it in mm, or exclude it"
    return messages
