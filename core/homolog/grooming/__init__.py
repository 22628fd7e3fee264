"""From files to distance fields, meshes and poses."""

from homolog.grooming.align import align
from homolog.grooming.cohort import Problem, check_cohort, groom_cohort
from homolog.grooming.mirroring import align_cohort, check_sides
from homolog.grooming.subject import GroomedSubject, GroomReport, groom_subject

__all__ = [
    "GroomReport",
    "GroomedSubject",
    "Problem",
    "align",
    "align_cohort",
    "check_cohort",
    "check_sides",
    "groom_cohort",
    "groom_subject",
]
