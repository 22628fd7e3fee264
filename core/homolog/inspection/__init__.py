"""Where corresponding particles may not correspond: suspects, and how to mend them."""

from homolog.inspection.energies import ParticleEnergies, particle_energies
from homolog.inspection.find import inspect, judge
from homolog.inspection.neighbourhood import Neighbourhood
from homolog.inspection.places import Places, find_places
from homolog.inspection.texture import carried_places, checkerboard, stripes
from homolog.inspection.types import Inspection, Kind, Suspect

__all__ = [
    "Inspection",
    "Kind",
    "Neighbourhood",
    "ParticleEnergies",
    "Places",
    "Suspect",
    "carried_places",
    "checkerboard",
    "find_places",
    "inspect",
    "judge",
    "particle_energies",
    "stripes",
]
