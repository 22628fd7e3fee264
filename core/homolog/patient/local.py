"""Local statistics: standardised maps, their limit over the whole surface, and regions beyond it."""

from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from homolog.arrays import BoolArray, FloatArray, IntArray, frozen
from homolog.patient.mesh_graph import edges_of, ring_mean
from homolog.surfaces.mesh import TriangleMesh

__all__ = [
    "BANDS",
    "LocalNorm",
    "Region",
    "bands_of",
    "maxima_left_out",
    "prediction_limit",
    "regions",
    "scores_of",
]

BANDS: tuple[tuple[int, int], ...] = ((4, 0), (4, 32), (1, 8))
"""Rounds of averaging over neighbours, and rounds of the subtracted average, for wide, middle and narrow
differences. The standard deviation of n rounds is about 0.65 edges times the square root of n."""
_PRIOR_DOF = 4.0
"""Weight of the surface's mean variance relative to a vertex's own (Smyth 2004)."""
_SMOOTHING_ROUNDS = 3
"""Rounds of averaging variances over neighbouring vertices."""
_OWN_SHARE = 0.5
"""Least ratio of the difference to a band's value; it excludes the surroundings of a bump."""


def bands_of(maps: FloatArray, faces: IntArray) -> FloatArray:
    """Return maps (..., V) filtered to several widths, (B, ..., V), which separate bumps from wide variation.

    Parameters
    ----------
    maps : (..., V) array
        Differences [mm].
    faces : (F, 3) int array
        Faces of the surface.
    """
    rounds = sorted({count for band in BANDS for count in band if count})
    averaged, done, values = {}, 0, maps
    for count in rounds:
        values = ring_mean(values, faces, count - done)
        averaged[count], done = values, count
    return np.stack([averaged[own] - (averaged[wide] if wide else 0.0) for own, wide in BANDS])


@dataclass(frozen=True, slots=True, eq=False)
class LocalNorm:
    """Norm of each vertex, from leave-one-out fits of M controls; arrays are read-only.

    Attributes
    ----------
    mean : (..., V) array
        Mean difference [mm].
    deviation : (..., V) array
        Standard deviation of a new subject's difference [mm].
    """

    mean: FloatArray
    deviation: FloatArray

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("mean", "deviation"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))

    @classmethod
    def of(cls, maps: FloatArray, faces: IntArray) -> "LocalNorm":
        """Return the norm of maps (..., M, V) [mm] on a surface with these faces.

        Variances are averaged over neighbouring vertices and shrunk towards the surface's mean, so that the
        variance of few controls is nowhere underestimated.
        """
        count = maps.shape[-2]
        variance = ring_mean(maps.var(axis=-2, ddof=1), faces, _SMOOTHING_ROUNDS)
        dof = count - 1.0
        mean = variance.mean(axis=-1, keepdims=True)
        moderated = (_PRIOR_DOF * mean + dof * variance) / (_PRIOR_DOF + dof)
        return cls(maps.mean(axis=-2), np.sqrt(moderated * (1.0 + 1.0 / count)))

    def standardised(self, differences: FloatArray) -> FloatArray:
        """Return differences (..., V) [mm] in standard deviations."""
        z: FloatArray = (differences - self.mean) / self.deviation
        return z


def scores_of(norm: LocalNorm, differences: FloatArray, bands: FloatArray) -> FloatArray:
    """Return the z of differences: at each vertex the most extreme z of the bands, (V,).

    A band counts where the difference has the same sign and at least half the magnitude.

    Parameters
    ----------
    norm : LocalNorm
        Norm of the bands, (B, V).
    differences : (V,) array
        Differences [mm].
    bands : (B, V) array
        Bands of the differences, from `bands_of`.
    """
    z = norm.standardised(bands)
    counts = bands * differences >= _OWN_SHARE * np.square(bands)
    counts[0] = True
    z = np.where(counts, z, 0.0)
    chosen: FloatArray = np.take_along_axis(z, np.abs(z).argmax(axis=0)[None], axis=0)[0]
    return chosen


def maxima_left_out(maps: FloatArray, faces: IntArray) -> FloatArray:
    """Return each control's largest absolute z by the norm of the other controls, (M,).

    Parameters
    ----------
    maps : (M, V) array
        Differences [mm].
    faces : (F, 3) int array
        Faces of the surface.
    """
    everyone = np.arange(len(maps))
    bands = bands_of(maps, faces)
    largest = []
    for index in everyone.tolist():
        norm = LocalNorm.of(bands[:, everyone != index], faces)
        largest.append(np.abs(scores_of(norm, maps[index], bands[:, index])).max())
    return np.array(largest)


def prediction_limit(maxima: FloatArray, level: float = 0.05) -> float:
    """Return the limit that a new subject's maximum exceeds with a probability of `level`.

    With enough values it is an order statistic, valid for any distribution (Vovk et al. 2005). With fewer
    than ``2 / level - 1`` values, for which this would be the largest value or none, it is the one-sided
    prediction bound of a normal distribution of their logarithms (Hahn and Meeker 1991).

    Parameters
    ----------
    maxima : (M,) array
        Largest absolute z of each control, positive.
    level : float

    Returns
    -------
    float
    """
    count = len(maxima)
    if count + 1 >= 2.0 / level:
        rank = int(np.ceil((1.0 - level) * (count + 1)))
        return float(np.sort(maxima)[rank - 1])
    logs = np.log(maxima)
    bound = float(stats.t.ppf(1.0 - level, count - 1)) * logs.std(ddof=1) * np.sqrt(1.0 + 1.0 / count)
    return float(np.exp(logs.mean() + bound))


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """A connected part of the surface beyond the limit.

    Attributes
    ----------
    vertices : (n,) int array
        Vertices of the reference's surface, read-only.
    area : float
        Area on the expected surface [mm²].
    mean, peak : float
        Mean difference, and difference at the vertex with the largest absolute z [mm]; outward positive.
    z : float
        z at the peak.
    centre : int
        Vertex of the peak.
    missing : float
        Share of the area whose normals do not meet the patient's surface.
    """

    vertices: IntArray
    area: float
    mean: float
    peak: float
    z: float
    centre: int
    missing: float


def regions(
    surface: TriangleMesh,
    areas: FloatArray,
    differences: FloatArray,
    z: FloatArray,
    met: BoolArray,
    limit: float,
) -> tuple[Region, ...]:
    """Return the connected parts where absolute z is above a limit, the most extreme first.

    Parameters
    ----------
    surface : TriangleMesh
        V vertices.
    areas : (V,) array
        Areas of the vertices [mm²].
    differences : (V,) array
        Differences [mm], outward positive.
    z : (V,) array
    met : (V,) bool array
        Whether the normal meets the patient's surface.
    limit : float

    Returns
    -------
    tuple of Region
    """
    sides = np.where(np.abs(z) > limit, np.sign(z), 0.0)
    edges = edges_of(surface.faces)
    same = (sides[edges[:, 0]] == sides[edges[:, 1]]) & (sides[edges[:, 0]] != 0.0)
    first, second = edges[same].T
    graph = coo_array((np.ones(len(first)), (first, second)), shape=(len(z), len(z)))
    labels = np.asarray(connected_components(graph, directed=False)[1])
    regions = []
    for label in np.unique(labels[sides != 0.0]).tolist():
        own = np.flatnonzero(labels == label)
        share = areas[own] / areas[own].sum()
        centre = int(own[np.abs(z[own]).argmax()])
        regions.append(
            Region(
                frozen(own),
                float(areas[own].sum()),
                float(share @ differences[own]),
                float(differences[centre]),
                float(z[centre]),
                centre,
                float(share @ ~met[own]),
            )
        )
    return tuple(sorted(regions, key=lambda region: -abs(region.z)))
