"""From files to distance fields and meshes."""

from homolog.grooming.cohort import Problem, Reading, check_cohort, compared, groom_cohort
from homolog.grooming.subject import GroomedSubject, GroomReport, groom_subject

__all__ = [
    "GroomReport",
    "GroomedSubject",
    "Problem",
    "Reading",
    "check_cohort",
    "compared",
    "groom_cohort",
    "groom_subject",
]
