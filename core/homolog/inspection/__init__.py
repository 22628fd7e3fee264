"""Checks of the correspondence: suspects and their repair."""

from homolog.inspection.energies import ParticleEnergies, particle_energies
from homolog.inspection.find import assess, inspect
from homolog.inspection.located_particles import LocatedParticles, locate_particles
from homolog.inspection.neighbourhood import Neighbourhood
from homolog.inspection.texture import carried_places, checkerboard, stripes
from homolog.inspection.types import Inspection, Kind, Suspect
from homolog.inspection.verdict import Verdict, Word, judge, read_verdict, refuse_unusable, write_verdict

__all__ = [
    "Inspection",
    "Kind",
    "LocatedParticles",
    "Neighbourhood",
    "ParticleEnergies",
    "Suspect",
    "Verdict",
    "Word",
    "assess",
    "carried_places",
    "checkerboard",
    "inspect",
    "judge",
    "locate_particles",
    "particle_energies",
    "read_verdict",
    "refuse_unusable",
    "stripes",
    "write_verdict",
]
