"""How shapes lie to each other: poses from surfaces, mirror images, and poses from corresponding points."""

from homolog.registration.align import Registration, align, register
from homolog.registration.sides import align_cohort, check_sides

__all__ = ["Registration", "align", "align_cohort", "check_sides", "register"]
