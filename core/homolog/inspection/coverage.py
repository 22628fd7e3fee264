"""Regions of a surface without particles."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from homolog.arrays import FloatArray, IntArray
from homolog.geodesics import distances_from
from homolog.inspection.located_particles import FAR, LocatedParticles
from homolog.inspection.types import Kind, Suspect
from homolog.progress import Tick, no_tick
from homolog.surfaces.topology import edges

__all__ = ["uncovered"]

_BEYOND = 3.0
"""Least distance of an uncovered point from the nearest particle, in medians of that distance; `FAR` must be
exceeded too."""
_EDGE = 1.0
"""Distance to the nearest particle at which an uncovered region ends, in spacings."""
_AROUND = 6
"""Number of particles listed for a region."""


@dataclass(frozen=True, slots=True, eq=False)
class _Gap:
    """A region of a surface that is far from every particle.

    Attributes
    ----------
    centre : int
        The vertex farthest from all particles.
    distance : float
        Distance of that vertex from the nearest particle, in spacings.
    area : float
        Area of the region that is more than a spacing away from every particle [mm²].
    around : (k,) int array
        The particles nearest to the centre along the surface.
    """

    centre: int
    distance: float
    area: float
    around: IntArray


def uncovered(located: LocatedParticles, tick: Tick = no_tick) -> list[Suspect]:
    """Return the uncovered regions of all subjects."""
    everywhere = [reach / s for reach, s in zip(located.coarse_reaches, located.spacing, strict=True)]
    consensus = float(np.median(np.concatenate(everywhere)))
    apart = [reach / s for reach, s in zip(located.reaches, located.spacing, strict=True)]
    limit = max(_BEYOND * consensus, FAR)
    suspects = []
    for m, alone in enumerate(apart):
        tick(m / len(apart), "uncovered regions")
        spacing = float(located.spacing[m])
        for gap in _gaps(located, m, alone, limit) if alone.max(initial=0.0) > limit else ():
            wanting = max(1.0, gap.area / spacing**2)
            linear, origin = located.alignments[m, :3, :3], located.alignments[m, :3, 3]
            suspects.append(
                Suspect(
                    kind=Kind.UNCOVERED,
                    subject=m,
                    particles=gap.around,
                    severity=gap.distance / limit * float(np.sqrt(wanting)),
                    place=linear @ located.meshes[m].vertices[gap.centre] + origin,
                    area=gap.area,
                    description=f"{gap.area:.3g} mm² without particles, up to {gap.distance * spacing:.3g} "
                    f"mm from the nearest; usual {consensus * spacing:.2g} mm",
                )
            )
    return suspects


def _gaps(located: LocatedParticles, m: int, reach: FloatArray, limit: float) -> list[_Gap]:
    """Return the regions around the vertices of a mesh that are farther than the limit, in spacings."""
    mesh, points, corners = located.meshes[m], located.local[m], located.meshes[m].faces[located.faces[m]]
    shares = mesh.vertex_areas
    sides = edges(mesh.faces)
    sides = sides[(reach[sides] > _EDGE).all(axis=1)]
    graph = coo_array((np.ones(len(sides)), tuple(sides.T)), shape=(len(reach),) * 2)
    labels = connected_components(graph, directed=False)[1]
    gaps = []
    for label in np.unique(labels[reach > limit]):
        region = np.flatnonzero(labels == label)
        centre = int(region[reach[region].argmax()])
        from_centre = distances_from(mesh, [centre])
        # straight distances only within the particle's triangle
        away = np.linalg.norm(mesh.vertices[corners] - points[:, None], axis=2)
        order = (from_centre[corners] + away).min(axis=1).argsort(kind="stable")
        gaps.append(_Gap(centre, float(reach[centre]), float(shares[region].sum()), order[:_AROUND]))
    return gaps
