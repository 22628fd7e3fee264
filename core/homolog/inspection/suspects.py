"""Suspects of one subject, from its indicators."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from homolog.arrays import BoolArray, FloatArray, IntArray
from homolog.inspection import indicators as signs
from homolog.inspection.located_particles import LocatedParticles
from homolog.inspection.neighbourhood import Neighbourhood
from homolog.inspection.swapped_pairs import swapped_pairs
from homolog.inspection.types import Kind, Suspect

__all__ = ["SuspectCollector"]

_CANDIDATE = 0.6
"""Least severity of particles that may belong to an exchanged pair."""

_MOST = 200
"""Largest number of candidates for exchanged pairs per subject; the worst ones are tested."""


class SuspectCollector:
    """Combines the severities of neighbouring particles and triangles into suspects."""

    def __init__(self, located: LocatedParticles, consensus: Neighbourhood) -> None:
        self._located, self._consensus = located, consensus
        self._angles = signs.normal_angles(located, consensus)
        self._misfits = signs.distance_residuals(signs.log_distance_ratios(located, consensus))
        distortions = signs.distortions(located, consensus)
        self._folded = distortions > signs.DISTORTION
        self._normals = signs.severity(self._angles, signs.ANGLE)
        self._neighbours = signs.severity(self._misfits, signs.STRETCH)
        self._triangles = signs.severity(distortions, signs.DISTORTION)

    def suspects(self, m: int) -> list[Suspect]:
        """Return the suspects of a subject; an exchange explains all indicators of its two particles."""
        corners = self._consensus.triangles
        normals, neighbours, triangles = (
            item[m].copy() for item in (self._normals, self._neighbours, self._triangles)
        )
        worst = np.maximum(normals, neighbours)
        np.maximum.at(worst, corners.ravel(), np.repeat(triangles, 3))
        suspects = []
        candidates = np.argsort(-worst, kind="stable")[: min(_MOST, int((worst > _CANDIDATE).sum()))]
        for pair in swapped_pairs(m, candidates, self._located, self._consensus):
            touched = np.isin(corners, pair).any(axis=1)
            bad = self._triangles[m][touched & (self._triangles[m] >= 1.0)]
            own = np.concatenate([self._normals[m, pair], self._neighbours[m, pair], bad])
            if own.max() < 1.0:
                continue
            description = f"particles {pair[0]} and {pair[1]} are exchanged"
            total = np.array([own.sum()])  # the indicators are not independent: they add up
            suspects.append(self._suspect(Kind.EXCHANGED, m, pair, total, description))
            normals[pair] = neighbours[pair] = triangles[touched] = 0.0
        for kind, severities, describe in (
            (Kind.NORMALS, normals, self._outlier_description),
            (Kind.NEIGHBOURS, neighbours, self._misfit_description),
        ):
            for patch in self._patches(severities >= 1.0):
                particles = patch[np.argsort(-severities[patch], kind="stable")]
                description = describe(m, particles)
                suspects.append(self._suspect(kind, m, particles, severities[particles], description))
        return suspects + self._folds(m, triangles)

    def _folds(self, m: int, severities: FloatArray) -> list[Suspect]:
        """Return the connected patches of folded or extremely distorted triangles."""
        bad = np.flatnonzero(severities >= 1.0)
        corners = self._consensus.triangles[bad]
        inside = np.zeros(len(self._consensus.shape), dtype=bool)
        inside[corners] = True
        suspects = []
        for patch in self._patches(inside):
            own = np.isin(corners[:, 0], patch)
            weight = np.bincount(corners[own].ravel(), np.repeat(severities[bad[own]], 3), len(inside))
            folded = int(self._folded[m, bad[own]].sum())
            count = int(own.sum())
            noun = "triangles" if count > 1 else "triangle"
            description = f"{count} {noun} around particle {weight.argmax()} "
            description += "folded over" if folded == count else "distorted far more than usual"
            description += f", {folded} of them folded over" if 0 < folded < count else ""
            particles = patch[np.argsort(-weight[patch], kind="stable")]
            area = self._area(m, corners[own])
            suspects.append(self._suspect(Kind.FOLDED, m, particles, severities[bad[own]], description, area))
        return suspects

    def _suspect(
        self,
        kind: Kind,
        m: int,
        particles: IntArray,
        severities: FloatArray,
        description: str,
        area: float = 0.0,
    ) -> Suspect:
        total = float(np.sqrt(np.square(severities).sum()))
        return Suspect(kind, m, particles, total, self._located.world[m, particles[0]], area, description)

    def _outlier_description(self, m: int, particles: IntArray) -> str:
        angle = np.degrees(self._angles[:, particles[0]])
        return (
            f"{_named(particles)} normal {angle[m]:.0f}° from the mean of all subjects, "
            f"usual {np.median(angle):.0f}°"
        )

    def _misfit_description(self, m: int, particles: IntArray) -> str:
        factor = np.exp(self._misfits[:, particles[0]])
        return (
            f"{_named(particles)} distances to neighbours wrong by a factor of {factor[m]:.1f}, "
            f"usual {np.median(factor):.1f}"
        )

    def _area(self, m: int, corners: IntArray) -> float:
        a, b, c = (self._located.local[m, corners[:, k]] for k in range(3))
        return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())

    def _patches(self, flagged: BoolArray) -> list[IntArray]:
        """Return the flagged particles in groups connected by common triangles."""
        corners = self._consensus.triangles
        sides = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
        sides = sides[flagged[sides].all(axis=1)]
        graph = coo_array((np.ones(len(sides)), tuple(sides.T)), shape=(len(flagged),) * 2)
        labels = connected_components(graph, directed=False)[1]
        return [np.flatnonzero(flagged & (labels == label)) for label in np.unique(labels[flagged])]


def _named(particles: IntArray) -> str:
    others = len(particles) - 1
    return f"particle {particles[0]}" + (f" and {others} next to it:" if others else ":")
