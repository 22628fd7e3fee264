"""Connected regions of significant particles: where, how large, and which way."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from homolog.analysis.cautions import LEVEL
from homolog.analysis.comparison import Comparison
from homolog.analysis.effects import Effect
from homolog.arrays import FloatArray, IntArray
from homolog_app.report.study import Study
from homolog_app.report.surface_maps import SurfaceCarrier

__all__ = ["Region", "significant_regions"]

_SIDES = (("right", "left"), ("anterior", "posterior"), ("inferior", "superior"))
"""Of the axes of LPS coordinates: towards smaller and larger values."""
_OFF_THE_MIDDLE = 1.0 / 3.0
"""Share of half the extent along an axis from which a place is called by that axis' side."""


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """Significant particles next to each other.

    Attributes
    ----------
    particles : (n,) int array
        Their indices.
    area : float
        Of the mean surface that they stand for [mm²].
    peak : int
        The particle with the largest statistic.
    position : (3,) array
        Its mean position [mm].
    place : str
        The same in words, from the middle of the mean shape.
    outward : Effect
        Displacement at the peak along the outward normal [mm] with its interval, not corrected over the
        surface.
    length : float
        Of the whole displacement at the peak [mm].
    mean_outward : float
        Outward displacement, mean over the region's area [mm].
    p : float
        Corrected p of the peak.
    """

    particles: IntArray
    area: float
    peak: int
    position: FloatArray
    place: str
    outward: Effect
    length: float
    mean_outward: float
    p: float

    @property
    def direction(self) -> str:
        """Which way the surface lies at the peak, in words."""
        return "out of the tissue" if self.outward.value > 0.0 else "into the tissue"


def significant_regions(study: Study, comparison: Comparison, carrier: SurfaceCarrier) -> list[Region]:
    """Return the regions of a comparison with one effect, the largest first."""
    inside = comparison.p_fwe <= LEVEL
    if len(comparison.pointwise.effect) > 1 or not inside.any():
        return []
    faces = carrier.mesh.faces
    edges = carrier.nearest[np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])]
    kept = edges[inside[edges].all(axis=1)]
    graph = coo_matrix((np.ones(len(kept)), kept.T), shape=(len(inside), len(inside)))
    labels = connected_components(graph, directed=False)[1]
    normals = carrier.normals_at_particles(comparison)
    effect = comparison.pointwise.effect[0]
    outward = (effect * normals).sum(axis=1)
    low, high = comparison.pointwise.bounds(normals)
    regions = []
    for label in np.unique(labels[inside]):
        own = np.flatnonzero(inside & (labels == label))
        areas = study.areas[own]
        peak = int(own[comparison.pointwise.studentized[own].argmax()])
        regions.append(
            Region(
                particles=own,
                area=float(areas.sum()),
                peak=peak,
                position=comparison.mean[peak],
                place=_place(comparison.mean, normals, peak),
                outward=Effect(float(outward[peak]), float(low[peak]), float(high[peak])),
                length=float(np.linalg.norm(effect[peak])),
                mean_outward=float(outward[own] @ areas / max(float(areas.sum()), 1e-300)),
                p=float(comparison.p_fwe[peak]),
            )
        )
    return sorted(regions, key=lambda region: -region.area)


def _place(mean: FloatArray, normals: FloatArray, particle: int) -> str:
    """Return where a particle lies, such as ``"left posterior, inner surface"``."""
    middle = (mean.min(axis=0) + mean.max(axis=0)) / 2.0
    offset = mean[particle] - middle
    share = offset / np.maximum(np.ptp(mean, axis=0) / 2.0, 1e-300)
    sides = [
        pair[int(part > 0.0)] for pair, part in zip(_SIDES, share, strict=True) if abs(part) > _OFF_THE_MIDDLE
    ]
    facing = ", inner surface" if normals[particle] @ offset < 0.0 else ""
    return (" ".join(sides) or "middle") + facing
