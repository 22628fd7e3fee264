"""Alignment of groomed shapes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from homolog.arrays import FloatArray
from homolog.errors import InputError
from homolog.geometry import scale_of
from homolog.progress import Tick, no_tick, run_in_threads
from homolog.registration.closest_points import Fit, OrientedPoints
from homolog.registration.icp import (
    ANOTHER,
    axes_rotation,
    candidates,
    oriented_points,
    refitted,
    softness_of_fit,
)
from homolog.registration.notes import MIN_SUBJECTS, Findings, notes_on
from homolog.registration.orientations import Choice, choose
from homolog.registration.typicality import angles_from, by_typicality, odd_ones, typical_rotation
from homolog.settings import Alignment, GroomSettings, Turn
from homolog.surfaces.mesh import TriangleMesh
from homolog.threads import cores, on_one_thread

__all__ = ["FindCandidates", "Registrable", "Registration", "align", "of_other_units", "register"]


class Registrable(Protocol):
    """A subject with a surface of few vertices in the coordinates of its file."""

    @property
    def name(self) -> str:
        """The subject's name, for messages."""

    @property
    def coarse_mesh(self) -> TriangleMesh:
        """Its surface, evenly triangulated [mm]."""


class FindCandidates(Protocol):
    """Registrations of one shape to another: `candidates`, or its cached form."""

    def __call__(self, moving: OrientedPoints, fixed: OrientedPoints) -> list[Fit]:
        """Return registrations of `moving` to `fixed`; see `candidates`."""


NO_TURNS: Mapping[str, Turn] = {}
_OTHER_UNIT = 100.0
"""Ratio of sizes: midway between the tenfold that people may differ and the thousandfold of other units."""
_MOST_COMPARED = 40
"""Largest number of shapes that show whether shapes are soft."""
_SOFT = 0.5
"""Least `softness_of_fit` of a typical shape that hardly determines its orientation: a prior standard
deviation of 5° then says more than its surface."""


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
    find: FindCandidates = candidates,
    turned: Mapping[str, Turn] = NO_TURNS,
) -> Registration:
    """Align a cohort.

    *Center* moves each surface's centre to the origin. *Axes* also rotates the principal axes onto
    those of a reference subject. *ICP* registers the surface to the reference, in the orientation that
    `choose` finds from all shapes. The world then has the reference's directions. Surfaces are compared at
    one size. The reference is the medoid of the distributions of distances from the centre, which do not
    depend on pose.

    Parameters
    ----------
    groomed : sequence of Registrable
        The cohort, at least one.
    settings : GroomSettings
        Its `alignment` and `scaling`: every root-mean-square radius becomes the cohort's geometric mean.
    tick : Tick
        Called at least every 0.2 s.
    find : callable
        Registers one shape to another.
    turned : mapping of str to Turn, optional
        Shapes that lie the other way round: they are turned by 180° about an axis of the reference, from the
        orientation that is found, and registered from there.

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
    order = by_typicality(units).tolist()
    reference = units[order[0]]
    result, distances = np.empty((len(units), 4, 4)), np.zeros(len(units))
    tick(0.0, "aligning")
    is_icp = settings.alignment is Alignment.ICP
    placed = _placed(units, order, find, tick) if is_icp else []
    half_turns = {
        names.index(name): _half_turn(reference, axis) for name, axis in turned.items() if name in names
    }
    for index in half_turns if is_icp else ():
        fit = refitted(units[index], reference, half_turns[index] @ placed[index].fit.pose)
        placed[index] = Choice(fit, is_clear=True, other=0.0)
    for index, (unit, size, goal) in enumerate(zip(units, sizes.tolist(), goals.tolist(), strict=True)):
        pose = np.eye(4)
        if settings.alignment is Alignment.AXES:
            pose[:3, :3] = axes_rotation(unit, reference)
        elif is_icp:
            fit = placed[index].fit
            distances[index] = fit.distance
            pose[:3] = fit.pose[:3] / scale_of(fit.pose)
        if not is_icp and index in half_turns:
            pose = half_turns[index] @ pose
        pose[:3, :3] *= goal / size
        pose[:3, 3] *= goal
        pose[:3, 3] -= pose[:3, :3] @ unit.centre
        if settings.alignment is Alignment.NONE:
            pose[:3, 3] += unit.centre
        result[index] = pose
    odd = odd_ones(units, distances, find, tick) if len(units) >= MIN_SUBJECTS else set()
    unclear = {index: item.other for index, item in enumerate(placed) if not item.is_clear}
    return Registration(result, notes_on(Findings(sizes, distances, _turns(result), odd, unclear)))


def _half_turn(reference: OrientedPoints, axis: Turn) -> FloatArray:
    """Return the rotation (4, 4) by 180° about a principal axis of a shape, through its centre."""
    points = reference.points
    along = np.linalg.eigh(points.T @ points)[1][:, [Turn.SHORT, Turn.MIDDLE, Turn.LONG].index(axis)]
    turn = np.eye(4)
    turn[:3, :3] = 2.0 * np.outer(along, along) - np.eye(3)
    return turn


def _placed(
    units: Sequence[OrientedPoints], order: Sequence[int], find: FindCandidates, tick: Tick
) -> list[Choice]:
    """Return the orientations of all shapes, with their final registrations to the most typical one."""
    reference = units[order[0]]

    def poses_found(index: int, inner: Tick) -> list[Fit]:
        inner(0.0, "aligning")
        return find(units[index], reference)

    works = [partial(poses_found, index) for index in range(len(units))]
    fits = run_in_threads(works, tick, "aligning", cores())
    holds = len(units) >= MIN_SUBJECTS and _are_soft(units, order, fits)

    def held(index: int, inner: Tick) -> list[Fit]:
        inner(0.0, "aligning")
        return [refitted(units[index], reference, np.eye(4), holds=True), *fits[index][1:]]

    if holds:
        works = [partial(held, index) for index in range(len(units))]
        fits = run_in_threads(works, tick, "aligning", cores())
    choices = choose(units, order, fits, tick)

    def refined(index: int, inner: Tick) -> Choice:
        inner(0.0, "aligning")
        choice = choices[index]
        if holds and angles_from(choice.fit.pose[None], Rotation.identity())[0] < ANOTHER:
            return replace(choice, fit=fits[index][0])
        return replace(choice, fit=refitted(units[index], reference, choice.fit.pose))

    works_of_choices = [partial(refined, index) for index in range(len(units))]
    return run_in_threads(works_of_choices, tick, "aligning", cores())


def _are_soft(units: Sequence[OrientedPoints], order: Sequence[int], fits: Sequence[Sequence[Fit]]) -> bool:
    """Return whether a usual shape, registered to the most typical one, hardly determines its orientation.

    Iterative closest points rotates a nearly round shape into one of many meaningless minima. The orientation
    of its file is better.
    """
    others = order[1:][:: -(-len(order) // _MOST_COMPARED)]
    reference = units[order[0]]
    closest = [min(fits[index], key=lambda fit: fit.distance) for index in others]
    values = [
        softness_of_fit(units[index], reference, fit.pose) for index, fit in zip(others, closest, strict=True)
    ]
    return bool(np.median(values) > _SOFT)


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
