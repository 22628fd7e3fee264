"""Whether a project already has the result of a run."""

from homolog.cohort import Cohort, column_of, sides_of
from homolog.grooming.cohort import is_unchanged
from homolog.io.project import ProjectFolder
from homolog.io.records import IMPORTED, ResultRecord
from homolog.progress import Tick, no_tick
from homolog.run.result import CANCELLED
from homolog.settings import OWN, Mirror, RunSettings

__all__ = ["is_result_of"]


def is_result_of(project: ProjectFolder, cohort: Cohort, settings: RunSettings, tick: Tick = no_tick) -> bool:
    """Return whether the project's finished result is that of a cohort and settings.

    The order of subjects, groups, columns and the device do not matter; files are
    compared by their content.

    Parameters
    ----------
    project : ProjectFolder
        The project, with or without a result.
    cohort : Cohort
    settings : RunSettings
    tick : Tick
        Called at least every 0.1 s.

    Returns
    -------
    bool

    Raises
    ------
    InputError
        If the project is damaged.
    """
    record = project.read()
    result = record.result
    if result is None or record.unfinished or not _matches_request(result, cohort, settings):
        return False
    if several := settings.of_structures:
        folders = {name: project.structure(name) for name in several}
        return all(
            folders[name].exists and is_result_of(folders[name], cohort, own, tick)
            for name, own in several.items()
        )
    return is_unchanged(cohort, settings.groom, project.groomed, tick)


def _matches_request(result: ResultRecord, cohort: Cohort, settings: RunSettings) -> bool:
    """Return whether a result is complete and has these names, sides and settings."""
    own = result.settings
    return (
        result.ended not in (CANCELLED, IMPORTED)
        and (own.groom, own.optimize) == (settings.groom, settings.optimize)
        and not settings.optimize.landmarks  # the result does not store their files
        and {subject.name: column_of(subject.columns, OWN) for subject in result.subjects}
        == {subject.name: column_of(subject.columns, OWN) for subject in cohort.subjects}
        and _same_sides(result, cohort, settings.groom.mirror)
    )


def _same_sides(result: ResultRecord, cohort: Cohort, mirror: Mirror) -> bool:
    """Return whether the same subjects would be mirrored."""
    if mirror is Mirror.OFF:
        return True
    before = {subject.name: subject.side for subject in result.subjects if subject.side}
    now = sides_of(cohort)
    both = any(len(set(item.values())) > 1 for item in (before, now))
    return before == now or (mirror is Mirror.AUTO and not both)
