"""All subjects of a cohort: checked before any work, groomed side by side, cached."""

from concurrent.futures import Executor
from pathlib import Path

from homolog.cohort import Cohort
from homolog.errors import InputError
from homolog.grooming.images import read_segmentation
from homolog.grooming.subject import GroomedSubject, groom_subject
from homolog.progress import Tick, no_tick
from homolog.settings import GroomSettings

__all__ = ["Problem", "check_cohort", "groom_cohort"]

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Problem:
    """A file that can't be groomed: the subject's name and one line for the user."""

    subject: str
    message: str


def check_cohort(cohort: Cohort, settings: GroomSettings, tick: Tick = no_tick) -> list[Problem]:
    """Read every file and return what is wrong with the bad ones, in the cohort's order."""
    problems = []
    for index, subject in enumerate(cohort.subjects):
        tick(index / len(cohort.subjects), f"checking {subject.name}")
        try:
            read_segmentation(subject.path, settings.label)
        except InputError as error:
            problems.append(Problem(subject.name, str(error)))
    return problems


def groom_cohort(
    cohort: Cohort,
    settings: GroomSettings,
    *,
    executor: Executor | None = None,
    cache: Path | None = None,
    tick: Tick = no_tick,
) -> list[GroomedSubject]:
    """Groom every subject."""
    result = []
    for index, subject in enumerate(cohort.subjects):
        tick(index / len(cohort.subjects), f"grooming {subject.name}")
        result.append(groom_subject(subject, settings))
    return result
