"""Grooming in a project without a run: all subjects, one again, or those that are groomed already."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor

from homolog.arrays import FloatArray
from homolog.cluster import retried_on_workers, subject_executor
from homolog.cohort import Cohort
from homolog.grooming import GroomedSubject, compared, groom_cohort
from homolog.grooming.cache import load_groomed, stored_key
from homolog.grooming.cohort import is_unchanged
from homolog.io.project import ProjectFolder
from homolog.progress import Tick, part_of
from homolog.registration import align_cohort
from homolog.run.structures import joined_subject
from homolog.settings import GroomSettings, RunSettings
from homolog.threads import cores

__all__ = ["groom_again", "groom_project", "groomed_before"]


def groom_project(
    cohort: Cohort, settings: RunSettings, project: ProjectFolder, tick: Tick
) -> tuple[list[GroomedSubject], FloatArray]:
    """Groom and align a cohort; unchanged subjects come from the project's cache."""
    groomed = retried_on_workers(
        lambda executor: _groomed(cohort, settings, project, executor, part_of(tick, 0.0, 0.9)),
        "grooming",
        settings.workers or cores(),
        settings.cluster,
    )
    tick(0.9, "aligning")
    return _aligned(cohort, groomed, settings, project, part_of(tick, 0.9, 1.0))


def _folders(settings: RunSettings, project: ProjectFolder) -> dict[str, tuple[GroomSettings, ProjectFolder]]:
    """Return how each structure is groomed, and its project; "" for a single one, here and below."""
    several = settings.groom.of_structures
    return {name: (own, project.structure(name)) for name, own in several.items()} or {
        "": (settings.groom, project)
    }


def _groomed(
    cohort: Cohort, settings: RunSettings, project: ProjectFolder, executor: Executor, tick: Tick
) -> dict[str, Sequence[GroomedSubject]]:
    folders = _folders(settings, project)
    parts: dict[str, Sequence[GroomedSubject]] = {}
    for number, (name, (own, folder)) in enumerate(folders.items()):
        folder.groomed.mkdir(parents=True, exist_ok=True)
        now = part_of(tick, number / len(folders), (number + 1) / len(folders))
        parts[name] = groom_cohort(cohort, own, executor=executor, cache=folder.groomed, tick=now)
    return parts


def _aligned(
    cohort: Cohort,
    parts: Mapping[str, Sequence[GroomedSubject]],
    settings: RunSettings,
    project: ProjectFolder,
    tick: Tick,
) -> tuple[list[GroomedSubject], FloatArray]:
    """Return whole subjects and their alignments, as a run has them."""
    by = settings.optimize.align_by
    if "" in parts:
        return align_cohort(cohort, parts[""], settings.groom, tick, cache=project.registrations)
    wholes = [joined_subject(dict(zip(parts, own, strict=True))) for own in zip(*parts.values(), strict=True)]
    shapes, folder = (wholes, project) if by is None else (parts[by], project.structure(by))
    shapes, places = align_cohort(cohort, shapes, settings.groom, tick, cache=folder.registrations)
    return wholes if by else list(shapes), places


def groom_again(
    cohort: Cohort,
    name: str,
    others: Mapping[str, GroomedSubject],
    settings: RunSettings,
    project: ProjectFolder,
    tick: Tick,
) -> dict[str, tuple[GroomedSubject, FloatArray]]:
    """Groom one subject of a cohort again; return all as they now lie to each other, the others unchanged."""
    alone = Cohort(tuple(item for item in cohort.subjects if item.name == name), cohort.folder)
    with subject_executor(1, settings.cluster) as executor:
        parts = _groomed(alone, settings, project, executor, part_of(tick, 0.0, 0.5))
    own = {part: items[0] for part, items in parts.items()}
    shapes = {**others, name: own[""] if "" in own else joined_subject(own)}
    among = Cohort(tuple(item for item in cohort.subjects if item.name in shapes), cohort.folder)
    aligned, places = align_cohort(
        among,
        compared([shapes[item.name] for item in among.subjects]),
        settings.groom,
        part_of(tick, 0.5, 1.0),
        cache=project.registrations,
    )
    shapes[name] = next(item for item in aligned if item.name == name)
    return {item.name: (shapes[item.name], place) for item, place in zip(among.subjects, places, strict=True)}


def groomed_before(
    cohort: Cohort, settings: RunSettings, project: ProjectFolder, tick: Tick
) -> tuple[list[GroomedSubject], FloatArray] | None:
    """Return a project's cached groomed subjects, aligned; None unless all are up to date."""
    parts: dict[str, list[GroomedSubject]] = {}
    for name, (groom, folder) in _folders(settings, project).items():
        if not is_unchanged(cohort, groom, folder.groomed, tick):
            return None
        stored = [(item.name, stored_key(folder.groomed, item.name)) for item in cohort.subjects]
        kept = [load_groomed(folder.groomed, *item) for item in stored]
        parts[name] = [item for item in kept if item is not None]
        if len(parts[name]) < len(kept):  # damaged
            return None
    return _aligned(cohort, parts, settings, project, tick) if cohort.subjects else None
