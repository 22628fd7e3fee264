"""Reports of one patient at several times, in one folder."""

from collections.abc import Sequence
from pathlib import Path

from homolog.files.names import file_stems
from homolog.patient import FollowUp, Reference
from homolog.progress import Tick, no_tick, part_of
from homolog_app.report.follow_up import write_follow_up
from homolog_app.report.patient import write_patient
from homolog_app.report.patient_groups import GroupRow

__all__ = ["write_times"]


def write_times(
    folder: Path,
    follow_up: FollowUp,
    reference: Reference,
    tick: Tick = no_tick,
    groups: Sequence[GroupRow] = (),
) -> None:
    """Write a patient at several times: a folder for each time, and the report of the change.

    Parameters
    ----------
    folder : Path
        Exists.
    follow_up : FollowUp
    reference : Reference
    tick : Tick
    groups : sequence of GroupRow
        How typical the first time is of several groups.
    """
    times = follow_up.comparisons
    stems = file_stems([item.name for item in times])
    for number, (item, stem) in enumerate(zip(times, stems, strict=True)):
        here = part_of(tick, 0.8 * number / len(times), 0.8 * (number + 1) / len(times))
        write_patient(folder / stem, item, reference, here, () if number else groups)
    write_follow_up(folder, follow_up, reference, part_of(tick, 0.8, 1.0))
