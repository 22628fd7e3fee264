"""From files to distance fields, meshes and poses."""

from homolog.grooming.align import align
from homolog.grooming.cohort import Problem, check_cohort, groom_cohort
from homolog.grooming.subject import GroomedSubject, GroomReport, groom_subject

__all__ = [
    "GroomReport",
    "GroomedSubject",
    "Problem",
    "align",
    "check_cohort",
    "groom_cohort",
    "groom_subject",
]
