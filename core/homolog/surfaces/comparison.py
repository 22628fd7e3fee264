"""Distance from one surface to another."""

from dataclasses import dataclass

import numpy as np

from homolog.arrays import FloatArray, frozen
from homolog.surfaces.closest import signed_distances_to
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["SurfaceDistances", "distances_both_ways", "surface_distances"]


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceDistances:
    """Distances of one surface's vertices from another surface. Arrays are read-only.

    Attributes
    ----------
    signed : (V,) array
        Distance of each vertex to the nearest point of the other surface [mm], negative inside it.
    areas : (V,) array
        Area of each vertex [mm²], the weight of its distance.
    """

    signed: FloatArray
    areas: FloatArray

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("signed", "areas"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))

    @property
    def mean(self) -> float:
        """Mean absolute distance [mm]."""
        return float(np.average(np.abs(self.signed), weights=self.areas))

    @property
    def bias(self) -> float:
        """Mean signed distance [mm], positive where the surface is mostly outside the other one."""
        return float(np.average(self.signed, weights=self.areas))

    @property
    def rms(self) -> float:
        """Root mean square distance [mm]."""
        return float(np.sqrt(np.average(np.square(self.signed), weights=self.areas)))

    @property
    def maximum(self) -> float:
        """Largest distance [mm]; the larger one of both directions is the Hausdorff distance."""
        return float(np.abs(self.signed).max())

    def percentile(self, percent: float) -> float:
        """Return the distance [mm] that this percentage of the area does not exceed."""
        order = np.abs(self.signed).argsort()
        covered = self.areas[order].cumsum()
        at = np.searchsorted(covered, percent / 100.0 * covered[-1])
        return float(np.abs(self.signed)[order[min(int(at), len(order) - 1)]])


def surface_distances(surface: TriangleMesh, other: TriangleMesh) -> SurfaceDistances:
    """Return the distances of a surface from another one in the same coordinates.

    Parameters
    ----------
    surface : TriangleMesh
        Surface at whose vertices distances are computed.
    other : TriangleMesh
        Closed surface with faces counter-clockwise seen from outside.

    Returns
    -------
    SurfaceDistances
    """
    return SurfaceDistances(signed_distances_to(other, surface.vertices), surface.vertex_areas)


def distances_both_ways(first: TriangleMesh, second: TriangleMesh) -> SurfaceDistances:
    """Return the distances of two surfaces from each other: at the first one's vertices, then the other's."""
    forward, backward = surface_distances(first, second), surface_distances(second, first)
    return SurfaceDistances(
        *map(np.concatenate, ((forward.signed, backward.signed), (forward.areas, backward.areas)))
    )
