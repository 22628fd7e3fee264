"""Computations and views of the page *Patient* for later times."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from homolog.arrays import FloatArray
from homolog.errors import InputError
from homolog.progress import Tick, part_of
from homolog_app.rendering.colours import displacement_scale
from homolog_app.rendering.content import ViewContents
from homolog_app.rendering.text import signed, typeset
from homolog_app.scenes.patient import on_own_surface, region_place

if TYPE_CHECKING:
    from homolog.patient import FollowUp, PatientComparison, Reference, Region

__all__ = [
    "CHANGE",
    "ChangeRegion",
    "PatientTimes",
    "change_regions",
    "change_scene",
    "change_text",
    "with_file",
]

CHANGE = "change"
"""Map: distance from the first surface to a later one [mm]."""


@dataclass(frozen=True, slots=True, eq=False)
class PatientTimes:
    """A patient at several times.

    Attributes
    ----------
    comparisons : tuple of PatientComparison
        With the reference, the first time first.
    repeats : tuple of PatientComparison
        Further segmentations of the first time.
    follow_up : FollowUp or None
        None until there is a later time.
    """

    comparisons: "tuple[PatientComparison, ...]"
    repeats: "tuple[PatientComparison, ...]" = ()
    follow_up: "FollowUp | None" = None


@dataclass(frozen=True, slots=True, eq=False)
class ChangeRegion:
    """A region of change at a later time, a point of it in display coordinates, and its view direction."""

    time: str
    region: "Region"
    place: FloatArray
    seen_from: FloatArray


def with_file(
    times: PatientTimes,
    reference: "Reference",
    path: Path,
    values: Mapping[str, str],
    repeats: bool,
    tick: Tick,
) -> PatientTimes:
    """Return the times with one more file: a later time, or a further segmentation of the first one.

    Raises
    ------
    InputError
        If the file can't be compared with the reference, or a file of its name was added before.
    """
    from homolog.patient import compare_patient, compare_times
    from homolog.patient.files import patient_at

    subject = patient_at(path)
    if subject.name in {item.name for item in (*times.comparisons, *times.repeats)}:
        raise InputError(f"{path}: a file of this name was added before; use a different name for each time")
    added = compare_patient(reference, subject, values, tick=part_of(tick, 0.0, 0.8))
    if repeats:
        times = replace(times, repeats=(*times.repeats, added))
    else:
        times = replace(times, comparisons=(*times.comparisons, added))
    if len(times.comparisons) < 2:
        return times
    return replace(
        times,
        follow_up=compare_times(
            times.comparisons, times.repeats, part_of(tick, 0.8, 1.0), expected=reference.change
        ),
    )


def change_text(times: PatientTimes) -> str:
    """Describe the change and the measurement error."""
    from homolog.patient.findings import change_sentences

    if times.follow_up is None:
        count = len(times.repeats)
        return f"{count} repeated segmentation{'s' * (count != 1)}; add a later time." if count else ""
    return typeset("\n".join(change_sentences(times.follow_up)))


def change_scene(follow_up: "FollowUp", only_beyond: bool) -> ViewContents:
    """Return the first surface with the map of change of each later time."""
    from homolog.patient.findings import beyond_limit, limit_text
    from homolog_app.rendering.colours import common_limit

    first = follow_up.comparisons[0]
    limit = common_limit([change.distance for change in follow_up.changes])
    known, cause = beyond_limit(follow_up.changes[0], follow_up) is not None, limit_text(follow_up)
    note = f"faint within {cause}" if known else "without a limit"
    scale = displacement_scale(limit, f"Change since {first.name}", note)
    if only_beyond and known:
        scale = replace(scale, grey_label=f"within {cause}")
    contents = []
    for change in follow_up.changes:
        beyond = beyond_limit(change, follow_up)
        faded = ~beyond if only_beyond and beyond is not None else None
        title = f"since {first.name}"
        if not np.isnan(change.volume):
            title += f": volume {signed(100.0 * (change.volume - 1.0), 1)} %"
        contents.append(
            on_own_surface(first, change.name, title, scale, change.distance, beyond, faded=faded, faint=True)
        )
    return ViewContents(contents, int(np.ceil(np.sqrt(len(contents)))), scale, {})


def change_regions(follow_up: "FollowUp") -> Sequence[ChangeRegion]:
    """Return the regions of all later times, in their order."""
    first = follow_up.comparisons[0]
    return [
        ChangeRegion(change.name, region, *region_place(first, region))
        for change in follow_up.changes
        for region in (change.regions if change.expected is None else change.expected.regions)
    ]
