"""Results of an inspection."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from homolog.arrays import BoolArray, FloatArray, IntArray, frozen
from homolog.inspection.located_particles import LocatedParticles
from homolog.inspection.neighbourhood import Neighbourhood

__all__ = ["Inspection", "Kind", "Suspect"]


class Kind(StrEnum):
    """Kinds of suspects."""

    EXCHANGED = "exchanged particles"
    NORMALS = "normal outliers"
    NEIGHBOURS = "swapped neighbourhood"
    FOLDED = "folded triangles"
    UNCOVERED = "uncovered region"


@dataclass(frozen=True, slots=True, eq=False)
class Suspect:
    """A region of one subject where the correspondence may be wrong.

    Attributes
    ----------
    kind : Kind
    subject : int
        Index of the subject.
    particles : (k,) int array
        The affected particles, the worst first; for an uncovered region, those around it.
    severity : float
        Severity; values from 1 on are reported. Each indicator contributes the smaller of two ratios: to the
        usual value at that particle, and to the threshold. Several indicators combine as the root of the sum
        of squares, those of an exchange as the sum.
    place : (3,) float64 array
        Position in aligned coordinates [mm].
    area : float
        Area of the uncovered region or the folded triangles [mm² in the subject's file]; 0 for other kinds.
    description : str
        Description in one sentence.
    """

    kind: Kind
    subject: int
    particles: IntArray
    severity: float
    place: FloatArray
    area: float
    description: str

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        object.__setattr__(self, "particles", frozen(self.particles, np.int64))
        object.__setattr__(self, "place", frozen(self.place, np.float64))


@dataclass(frozen=True, slots=True, eq=False)
class Inspection:
    """Result of an inspection.

    Attributes
    ----------
    suspects : tuple of Suspect
        Suspects, the most severe first.
    located : LocatedParticles
        Normals and distances of every subject.
    consensus : Neighbourhood
        The consensus of the subjects.
    """

    suspects: tuple[Suspect, ...]
    located: LocatedParticles
    consensus: Neighbourhood

    def movable(self, suspect: Suspect, rings: int = 2) -> BoolArray:
        """Return which particles to optimize again to repair a suspect, (M, N).

        These are the suspect's particles and `rings` rings of neighbours, on the suspect's subject only.
        """
        chosen = np.zeros(len(self.consensus.shape), dtype=bool)
        chosen[suspect.particles] = True
        for _ in range(rings):
            chosen[self.consensus.ring(np.flatnonzero(chosen))] = True
        result = np.zeros(self.located.world.shape[:2], dtype=bool)
        result[suspect.subject] = chosen
        return result
