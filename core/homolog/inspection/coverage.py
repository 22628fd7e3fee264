"""Regions of a surface without particles."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from homolog.arrays import FloatArray
from homolog.geodesics import distances_from
from homolog.geometry import transform_points
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


def uncovered(located: LocatedParticles, tick: Tick = no_tick) -> list[Suspect]:
    """Return the uncovered regions of all subjects."""
    everywhere = [reach / s for reach, s in zip(located.coarse_reaches, located.spacing, strict=True)]
    consensus = float(np.median(np.concatenate(everywhere)))
    apart = [reach / s for reach, s in zip(located.reaches, located.spacing, strict=True)]
    limit = max(_BEYOND * consensus, FAR)
    suspects = []
    for m, alone in enumerate(apart):
        tick(m / len(apart), "uncovered regions")
        if alone.max(initial=0.0) > limit:
            suspects += _gaps(located, m, alone, limit, consensus)
    return suspects


def _gaps(
    located: LocatedParticles, m: int, reach: FloatArray, limit: float, consensus: float
) -> list[Suspect]:
    """Return the regions around the vertices of a mesh that are farther than the limit, in spacings."""
    mesh, points, corners = located.meshes[m], located.local[m], located.meshes[m].faces[located.faces[m]]
    shares, spacing = mesh.vertex_areas, float(located.spacing[m])
    sides = edges(mesh.faces)
    sides = sides[(reach[sides] > _EDGE).all(axis=1)]
    graph = coo_array((np.ones(len(sides)), tuple(sides.T)), shape=(len(reach),) * 2)
    labels = connected_components(graph, directed=False)[1]
    gaps = []
    for label in np.unique(labels[reach > limit]):
        region = np.flatnonzero(labels == label)
        centre, area = int(region[reach[region].argmax()]), float(shares[region].sum())
        from_centre = distances_from(mesh, [centre])
        # straight distances only within the particle's triangle
        away = np.linalg.norm(mesh.vertices[corners] - points[:, None], axis=2)
        order = (from_centre[corners] + away).min(axis=1).argsort(kind="stable")
        gaps.append(
            Suspect(
                kind=Kind.UNCOVERED,
                subject=m,
                particles=order[:_AROUND],
                severity=float(reach[centre]) / limit * float(np.sqrt(max(1.0, area / spacing**2))),
                place=transform_points(located.alignments[m], mesh.vertices[[centre]])[0],
                area=area,
                description=f"{area:.3g} mm² without particles, up to {reach[centre] * spacing:.3g} mm from "
                f"the nearest; usual {consensus * spacing:.2g} mm",
            )
        )
    return gaps
