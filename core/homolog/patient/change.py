"""Change of one subject between two times, and the expected change from controls."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from homolog.arrays import Array, FloatArray, frozen
from homolog.patient.distribution import Percentile, percentile
from homolog.patient.fit import SurfaceFit, fit_surface
from homolog.patient.local import LocalNorm, Region, prediction_limit, regions
from homolog.patient.mesh_graph import ring_mean
from homolog.patient.surface_model import SurfaceModel
from homolog.progress import Tick, no_tick
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["AVERAGED", "AgainstExpected", "ExpectedChange", "distances_to_times"]

AVERAGED = 4
"""Rounds of averaging of changes over neighbours: a width of about 1.3 edges."""
_LEVEL = 0.05
_TOLERANCE = 0.25
"""Distances with full weight in the registration [mean edges]."""
_PREFIX = "change_"


def distances_to_times(
    surface: TriangleMesh, first: TriangleMesh, later: TriangleMesh, tick: Tick = no_tick
) -> tuple[SurfaceFit, SurfaceFit]:
    """Register a first surface rigidly to the meshes of two times, robustly.

    Parameters
    ----------
    surface : TriangleMesh
        Surface of the first time, with the faces of the reference.
    first, later : TriangleMesh
        Groomed meshes, approximately in the surface's frame.
    tick : Tick

    Returns
    -------
    tuple of 2 SurfaceFit
        Fits to both times. Their residuals are distances along the surface's normals [mm], outward positive.
        The change is the second residual minus the first, which is due to registration alone.
    """
    points = np.concatenate([surface.vertices, surface.vertices])
    none = np.zeros((0, *points.shape))
    tolerance = np.full(len(surface.vertices), _TOLERANCE * surface.mean_edge)
    model = SurfaceModel(points, none, np.zeros(0), none, tolerance, surface.faces)
    fits = [fit_surface(model, mesh, mesh, np.zeros(0), tick, pose=np.eye(4)) for mesh in (first, later)]
    return fits[0], fits[1]


@dataclass(frozen=True, slots=True, eq=False)
class AgainstExpected:
    """A patient's change against that of the controls; arrays are read-only.

    Attributes
    ----------
    z : (V,) array
        Change averaged over neighbours, minus the controls' mean change, in their standard deviations.
    regions : tuple of Region
        Regions where absolute z exceeds the controls' limit; their values are relative to the mean change
        [mm].
    beyond : Percentile
        Root mean square of the change beyond the controls' mean change [mm].
    volume : Percentile
        Ratio of the later volume to the first one.
    """

    z: FloatArray
    regions: tuple[Region, ...]
    beyond: Percentile
    volume: Percentile


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedChange:
    """Change of P controls from their first time to the next; arrays are read-only.

    Attributes
    ----------
    local : LocalNorm
        Norm of the change at each vertex, averaged over neighbours.
    beyond, volume, maxima : (P,) arrays
        Sorted values of each control: root mean square of its change beyond the mean of the others [mm],
        ratio of its later volume to the first one, and largest absolute z relative to the others.
    limit : float
        Absolute z that 5 % of healthy people exceed anywhere.
    between : str
        Interval between the two times, as text.
    """

    local: LocalNorm
    beyond: FloatArray
    volume: FloatArray
    maxima: FloatArray
    limit: float
    between: str

    def __post_init__(self) -> None:
        """Sort and freeze the distributions."""
        for name in ("beyond", "volume", "maxima"):
            object.__setattr__(self, name, frozen(np.sort(getattr(self, name)), np.float64))

    @property
    def pairs(self) -> int:
        """Number of controls with two times."""
        return len(self.volume)

    @classmethod
    def of(
        cls, changes: FloatArray, volumes: FloatArray, surface: TriangleMesh, between: str
    ) -> "ExpectedChange":
        """Return the expected change from the changes of controls.

        Parameters
        ----------
        changes : (P, V) array
            Changes of each control [mm].
        volumes : (P,) array
            Ratio of the later volume to the first one.
        surface : TriangleMesh
            Surface of the reference.
        between : str
            Interval between the times, as text.
        """
        maps, everyone = ring_mean(changes, surface.faces, AVERAGED), np.arange(len(changes))
        norms = [LocalNorm.of(maps[everyone != index]) for index in everyone.tolist()]
        maxima = [np.abs(norm.standardised(own)).max() for norm, own in zip(norms, maps, strict=True)]
        beyond = [_rms(own - norm.mean, surface) for norm, own in zip(norms, maps, strict=True)]
        return cls(
            LocalNorm.of(maps),
            np.array(beyond),
            volumes,
            np.array(maxima),
            prediction_limit(np.array(maxima), _LEVEL),
            between,
        )

    def against(
        self, fit: SurfaceFit, own: SurfaceFit, volume: float, surface: TriangleMesh
    ) -> AgainstExpected:
        """Return a patient's change against the controls'.

        Parameters
        ----------
        fit, own : SurfaceFit
            Fits of the later time and of the first one (`distances_to_times`).
        volume : float
            Ratio of the later volume to the first one.
        surface : TriangleMesh
            The patient's surface of the first time.
        """
        change = fit.residual - own.residual
        averaged = ring_mean(change, surface.faces, AVERAGED)
        z, rest = self.local.standardised(averaged), averaged - self.local.mean
        met = fit.met & own.met
        beyond = regions(surface, surface.vertex_areas, change - self.local.mean, z, met, self.limit)
        return AgainstExpected(
            frozen(z),
            beyond,
            percentile(_rms(rest, surface), self.beyond),
            percentile(volume, self.volume, both_sides=True),
        )

    @property
    def arrays(self) -> dict[str, Array]:
        """Arrays for a file."""
        stored = {name: getattr(self, name) for name in ("beyond", "volume", "maxima")}
        stored |= {"mean": self.local.mean, "deviation": self.local.deviation}
        stored["limit"] = np.array([self.limit])
        return {f"{_PREFIX}{name}": array for name, array in stored.items()}

    @classmethod
    def from_arrays(cls, stored: Mapping[str, Array], between: str) -> "ExpectedChange":
        """Return the object from its `arrays` and texts."""
        part = {
            name.removeprefix(_PREFIX): array for name, array in stored.items() if name.startswith(_PREFIX)
        }
        local = LocalNorm(part["mean"], part["deviation"])
        return cls(local, part["beyond"], part["volume"], part["maxima"], float(part["limit"][0]), between)

    def is_of(self, vertices: int) -> bool:
        """Whether the arrays are consistent, also with the number of vertices."""
        lists = (self.beyond, self.volume, self.maxima)
        return (
            all(array.shape == (vertices,) for array in (self.local.mean, self.local.deviation))
            and all(array.shape == (self.pairs,) for array in lists)
            and all(bool(np.isfinite(array).all()) for array in self.arrays.values())
        )


def _rms(values: FloatArray, surface: TriangleMesh) -> float:
    areas = surface.vertex_areas
    return float(np.sqrt(areas @ np.square(values) / areas.sum()))
