"""Left and right subjects in one frame: one side is mirrored, with a note on every mirrored subject."""

import hashlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol, Self, TypeVar

import numpy as np

from homolog.arrays import FloatArray
from homolog.cohort import LEFT, RIGHT, Cohort, column_of, other_side, sides_of
from homolog.errors import InputError
from homolog.progress import Tick, no_tick, part_of
from homolog.registration.align import FindCandidates, Registrable, Registration, register
from homolog.registration.cache import VERSION, RegistrationCache
from homolog.registration.mirror_images import better_mirrored
from homolog.settings import OWN, Alignment, GroomSettings, Mirror, OwnGrooming, Turn
from homolog.surfaces.mirroring import MIRROR, mirrors
from homolog.threads import on_one_thread

__all__ = ["align_cohort", "check_sides"]


class Sided(Registrable, Protocol):
    """A subject that can be mirrored."""

    @property
    def mirrored(self) -> Self:
        """Its mirror image."""

    def with_notes(self, notes: Sequence[str]) -> Self:
        """Return it with further notes."""


_Subject = TypeVar("_Subject", bound=Sided)


def check_sides(cohort: Cohort, settings: GroomSettings) -> None:
    """Raise InputError if a side is neither left nor right, or is to be mirrored where no side is known.

    Also if a cell of the column ``grooming`` can't be read.
    """
    _plan(cohort, settings, {})


@on_one_thread
def align_cohort(
    cohort: Cohort,
    groomed: Sequence[_Subject],
    settings: GroomSettings,
    tick: Tick = no_tick,
    *,
    known: Mapping[str, FloatArray] | None = None,
    cache: Path | None = None,
) -> tuple[list[_Subject], FloatArray]:
    """Align groomed subjects, those of one side of the body mirrored.

    Parameters
    ----------
    cohort : Cohort
        Its column ``side`` gives the sides.
    groomed : sequence of Sided
        The groomed subjects, in the order of the cohort.
    settings : GroomSettings
        Its `alignment`, `scaling` and `mirror`.
    tick : Tick
        Progress and cancellation.
    known : mapping of str to (4, 4) array, optional
        Alignments of a result's subjects. These are mirrored as in the result, and new subjects are mirrored
        to the same side.
    cache : Path, optional
        File with earlier registrations; only changed subjects are registered again.

    Returns
    -------
    list of Sided
        The subjects, with notes on those that were mirrored, that would fit far better mirrored, or that do
        not look like the others.
    (M, 4, 4) float64 array
        Similarities from local to world coordinates, as `align` gives them; a reflection for a mirrored
        subject.

    Raises
    ------
    InputError
        As `align` and `check_sides` do.
    """
    given = known or {}
    plan = _plan(cohort, settings, given)
    registrations = RegistrationCache(cache)
    key = _key_of(groomed, plan, settings, given, is_sided=bool(sides_of(cohort)))
    kept = registrations.whole(key)
    if kept is not None and len(kept[1]) == len(groomed):
        return [item.with_notes(notes) for item, notes in zip(groomed, kept[1], strict=True)], kept[0]
    registered, better = _aligned(groomed, plan, settings, given, registrations.candidates, tick)
    remedy = _WRONG_SIDE if sides_of(cohort) else _NO_SIDES
    all_notes = []
    for item, registered_as in zip(groomed, registered.notes, strict=True):
        notes = [plan.notes[item.name]] if item.name in plan.notes else []
        if item.name in better:
            notes.append(
                f"fits the others far better {'un' if item.name in plan.mirrored else ''}mirrored{remedy}"
            )
        elif registered_as is not None:
            notes.append(registered_as)
        all_notes.append(notes)
    registrations.keep_whole(key, registered.alignments, all_notes)
    registrations.save()
    aligned = [item.with_notes(notes) for item, notes in zip(groomed, all_notes, strict=True)]
    return aligned, registered.alignments


def _key_of(
    groomed: Sequence[Registrable],
    plan: "_Plan",
    settings: GroomSettings,
    given: Mapping[str, FloatArray],
    *,
    is_sided: bool,
) -> str:
    """Return a hash of all that alignments and their notes depend on."""
    digest = hashlib.blake2b(VERSION.encode(), digest_size=16)
    plans = sorted(plan.mirrored), sorted(plan.notes.items()), sorted(plan.turned.items()), is_sided
    digest.update(repr((settings.alignment, settings.scaling, settings.mirror, plans)).encode())
    for name, place in given.items():
        digest.update(name.encode() + np.ascontiguousarray(place).tobytes())
    for item in groomed:
        digest.update(f"{item.name}/{len(item.coarse_mesh.vertices)}".encode())
        digest.update(np.ascontiguousarray(item.coarse_mesh.vertices).tobytes())
        digest.update(np.ascontiguousarray(item.coarse_mesh.faces).tobytes())
    return digest.hexdigest()


_WRONG_SIDE = ": its side may be wrong or missing; enter left or right in a column side of the cohort's table"
_NO_SIDES = (
    "; if the structure is one of a pair, enter left or right in a column side of the cohort's table; if it "
    "is a single one, check that left and right are not exchanged in its file"
)


def _aligned(
    groomed: Sequence[Sided],
    plan: "_Plan",
    settings: GroomSettings,
    known: Collection[str],
    find: FindCandidates,
    tick: Tick,
) -> tuple[Registration, set[str]]:
    """Return alignments (reflections if mirrored), and the names of subjects that fit far better reversed."""
    taken = [item.mirrored if item.name in plan.mirrored else item for item in groomed]
    registered = register(taken, settings, part_of(tick, 0.0, 0.5), find=find, turned=plan.turned)
    alignments = registered.alignments
    better: set[str] = set()
    if settings.mirror is not Mirror.OFF:
        registered_already = settings.alignment is Alignment.ICP
        better = better_mirrored(taken, alignments, known, registered_already, find, part_of(tick, 0.5, 1.0))
    mirrored = np.array([item.name in plan.mirrored for item in groomed])
    reflected = np.where(mirrored[:, None, None], alignments @ MIRROR, alignments)
    return replace(registered, alignments=reflected), better


@dataclass(frozen=True, slots=True)
class _Plan:
    """The mirrored subjects, those to be turned, and notes."""

    mirrored: set[str]
    notes: dict[str, str]
    turned: Mapping[str, Turn] = field(default_factory=dict)


def _plan(cohort: Cohort, settings: GroomSettings, given: Mapping[str, FloatArray]) -> _Plan:
    """Return what the sides say, and then what the table says of single subjects; a result stays as it is."""
    plan = _plan_of_sides(cohort, settings, given)
    cells = {item.name: column_of(item.columns, OWN) for item in cohort.subjects if item.name not in given}
    own = {name: OwnGrooming.read(text, name) for name, text in cells.items() if text}
    reverse = {name for name, item in own.items() if item.mirrored}
    notes = plan.notes | dict.fromkeys(reverse, "mirrored, as its table says")
    turned = {name: item.turned for name, item in own.items() if item.turned is not None}
    return _Plan(plan.mirrored ^ reverse, notes, turned)


def _plan_of_sides(cohort: Cohort, settings: GroomSettings, given: Mapping[str, FloatArray]) -> _Plan:
    kept = {name for name, alignment in given.items() if mirrors(alignment)}
    notes = dict.fromkeys(kept, "mirrored, as in the result")
    if settings.mirror is Mirror.OFF:
        return _Plan(kept, notes)
    sides = sides_of(cohort)
    fixed = _fixed_side(sides, kept, given) if given else _fewer(sides, settings.mirror, cohort)
    if fixed is None:
        return _Plan(kept, notes)
    mirrored = kept | {name for name, side in sides.items() if side == fixed and name not in given}
    for name in mirrored & sides.keys():
        notes[name] = f"a {sides[name]} one, mirrored to {other_side(sides[name])}"
    unknown = [
        subject.name for subject in cohort.subjects if subject.name not in sides and subject.name not in given
    ]
    notes |= dict.fromkeys(unknown, "its side is not given; it was not mirrored")
    return _Plan(mirrored, notes)


def _fewer(sides: Mapping[str, str], wish: Mirror, cohort: Cohort) -> str | None:
    """Return the side to mirror; None if there is none."""
    if wish is not Mirror.AUTO:
        if not sides:
            raise InputError(
                f"{cohort.folder}: no subject's side is known, so no {wish} one can be mirrored; enter left "
                "or right in a column side of the cohort's table"
            )
        return str(wish.value)
    counts = {side: sum(item == side for item in sides.values()) for side in (LEFT, RIGHT)}
    return min(counts, key=counts.__getitem__) if all(counts.values()) else None


def _fixed_side(sides: Mapping[str, str], kept: set[str], known: Mapping[str, FloatArray]) -> str | None:
    """Return the side that new subjects are mirrored from; None if a result has left and right ones."""
    common = {other_side(sides[name]) if name in kept else sides[name] for name in known if name in sides}
    return other_side(common.pop()) if len(common) == 1 else None
