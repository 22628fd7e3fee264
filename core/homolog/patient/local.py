"""Local statistics: standardised maps of several widths, their limit over the whole surface, and regions."""

from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from homolog.arrays import BoolArray, FloatArray, IntArray, frozen
from homolog.patient.mesh_graph import edges_of, ring_mean
from homolog.statistics.moderation import moderated
from homolog.surfaces.mesh import TriangleMesh

__all__ = [
    "BANDS",
    "BEST_GAINS",
    "BEST_WIDTHS",
    "KINDS",
    "LEVEL",
    "BandNorm",
    "LocalNorm",
    "Region",
    "bands_of",
    "gains",
    "norm_and_maxima",
    "prediction_limit",
    "regions",
    "scores_of",
]

KINDS = 2
"""Maps: difference of the surface from the expected one [mm], and logarithm of the relative thickness."""
_SURROUND = 16
BANDS: tuple[tuple[int, int], ...] = ((2, 0), *((count, _SURROUND * count) for count in (2, 8)))
"""Rounds of averaging over neighbours, and rounds of the average of the surroundings, which predicts it.

The standard deviation of n rounds is about 0.65 edges times the square root of n. The first band is the map
itself, averaged over an edge. The others are relative to their surroundings, which are four times as wide:
the finest is as wide as an edge, the other one twice as wide. Wider differences are almost their own
surroundings; the first band shows them."""
_EDGES = 0.65
_BEST = (np.sqrt(_SURROUND) - 1.0) / (np.sqrt(_SURROUND) + 1.0)
BEST_GAINS: FloatArray = np.array([_BEST if wide else 1.0 for _, wide in BANDS])
"""Share of a bump's height in each band, for the width at which it is largest (see `gains`)."""
BEST_WIDTHS: FloatArray = _EDGES * np.sqrt(
    [8.0 * np.log(2.0) * np.sqrt(_SURROUND) * own for own, wide in BANDS if wide]
)
"""Full widths at half maximum of such bumps [edges]."""
_OWN_SHARE = 0.5
"""Least ratio of the difference to a band's value; it excludes the surroundings of a bump."""
LEVEL = 0.05
"""Share of healthy people with a region beyond the limit."""


def bands_of(maps: FloatArray, faces: IntArray) -> FloatArray:
    """Return maps (K, ..., V) filtered to several widths, (K, B, ..., V): averages minus their surroundings.

    Parameters
    ----------
    maps : (K, ..., V) array
    faces : (F, 3) int array
        Faces of the surface.
    """
    averaged, done, values = {}, 0, maps
    for count in sorted({count for band in BANDS for count in band if count}):
        values = ring_mean(values, faces, count - done)
        averaged[count], done = values, count
    return np.stack([averaged[own] - (averaged[wide] if wide else 0.0) for own, wide in BANDS], axis=1)


def gains(width: float, edge: float) -> FloatArray:
    """Return the share of a bump's height in each band, (B,).

    Parameters
    ----------
    width : float
        Full width at half maximum of a Gaussian bump [mm].
    edge : float
        Mean edge of the surface [mm].
    """
    own = np.square(width) / (8.0 * np.log(2.0))
    blur = np.square(_EDGES * edge) * np.array(BANDS)
    surrounded = np.where(blur[:, 1] > 0.0, own / (own + blur[:, 1]), 0.0)
    shares: FloatArray = own / (own + blur[:, 0]) - surrounded
    return shares


@dataclass(frozen=True, slots=True, eq=False)
class LocalNorm:
    """Norm of each vertex, from leave-one-out fits of M controls; arrays are read-only.

    Attributes
    ----------
    mean : (..., V) array
        Mean difference.
    deviation : (..., V) array
        Standard deviation of a new subject's difference.
    """

    mean: FloatArray
    deviation: FloatArray

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("mean", "deviation"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))

    @classmethod
    def of(cls, maps: FloatArray) -> "LocalNorm":
        """Return the norm of maps (..., M, V), with variances moderated over the surface."""
        count = maps.shape[-2]
        variance = moderated(maps.var(axis=-2, ddof=1), count - 1)
        return cls(maps.mean(axis=-2), np.sqrt(variance * (1.0 + 1.0 / count)))

    def standardised(self, differences: FloatArray) -> FloatArray:
        """Return differences (..., V) in standard deviations."""
        z: FloatArray = (differences - self.mean) / self.deviation
        return z


@dataclass(frozen=True, slots=True, eq=False)
class BandNorm(LocalNorm):
    """Norm of bands (K, B, V), whose deviations are scaled to a common limit.

    Attributes
    ----------
    roughness : (K, B, 1) array
        Median absolute z of the surface of a typical control. Subjects differ in how rough their surfaces
        are; a place stands out from its own surface.
    """

    roughness: FloatArray

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("mean", "deviation", "roughness"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))


def _roughness(z: FloatArray, seen: BoolArray | None = None) -> FloatArray:
    """Return the median absolute z (K, B, V) over the surface in each band, (K, B, 1)."""
    own = z if seen is None else z[..., seen]
    return np.maximum(np.median(np.abs(own), axis=-1, keepdims=True), 1e-9)


def _counting(
    norm: LocalNorm, maps: FloatArray, usual: FloatArray, bands: FloatArray, z: FloatArray
) -> FloatArray:
    """Return z (K, B, V), or 0 beside a bump, where a band's difference is not that of the map."""
    apart = bands - norm.mean
    return np.where(apart * (maps - usual)[:, None] >= _OWN_SHARE * np.square(apart), z, 0.0)


def scores_of(
    norm: BandNorm, maps: FloatArray, usual: FloatArray, bands: FloatArray, seen: BoolArray | None = None
) -> FloatArray:
    """Return the z of a subject's maps: at each vertex the most extreme one of all bands, (V,).

    A band counts where the difference has the same sign and at least half the magnitude.

    Parameters
    ----------
    norm : BandNorm
        Norm of the bands, (K, B, V).
    maps : (K, V) array
        The subject's maps.
    usual : (K, V) array
        Mean maps of the controls.
    bands : (K, B, V) array
        Bands of the maps, from `bands_of`.
    seen : (V,) bool array, optional
        Vertices that determine the subject's roughness.
    """
    z = norm.standardised(bands)
    z = _counting(norm, maps, usual, bands, z * norm.roughness / _roughness(z, seen))
    z = z.reshape(-1, maps.shape[-1])
    chosen: FloatArray = np.take_along_axis(z, np.abs(z).argmax(axis=0)[None], axis=0)[0]
    return chosen


def norm_and_maxima(maps: FloatArray, bands: FloatArray) -> tuple[BandNorm, FloatArray]:
    """Return the norm of the controls' bands, and each control's largest absolute z by the others (M,).

    Deviations of each band are scaled such that the limit of the controls' maxima is the same in all bands;
    else the one with the longest tails would set the limit for all.

    Parameters
    ----------
    maps : (K, M, V) array
        Maps of the controls.
    bands : (K, B, M, V) array
        Bands of the maps, from `bands_of`.
    """
    everyone = np.arange(maps.shape[1])
    ratios, roughness = [], []
    for index in everyone.tolist():
        others, own = everyone != index, bands[:, :, index]
        norm = LocalNorm.of(bands[:, :, others])
        z = norm.standardised(own)
        roughness.append(_roughness(z))
        counting = _counting(norm, maps[:, index], maps[:, others].mean(axis=1), own, z / roughness[-1])
        ratios.append(np.abs(counting).max(axis=-1, keepdims=True))
    typical = np.exp(np.log(np.stack(roughness)).mean(axis=0))
    largest = np.maximum(np.stack(ratios) * typical, 1e-9)
    maxima = [(largest[index] / _scales(largest[everyone != index])).max() for index in everyone.tolist()]
    norm, scales = LocalNorm.of(bands), _scales(largest)
    return BandNorm(norm.mean, norm.deviation * scales, typical / scales), np.array(maxima)


def _scales(largest: FloatArray) -> FloatArray:
    """Return the relative limits (K, B, 1) of maxima (M, K, B, 1) in the bands; their geometric mean is 1."""
    logs = _log_bound(np.log(largest), LEVEL)
    scales: FloatArray = np.exp(logs - logs.mean())
    return scales


def prediction_limit(maxima: FloatArray, level: float = 0.05) -> float:
    """Return the limit that a new subject's maximum exceeds with a probability of `level`.

    With at least ``1 / level - 1`` values it is their quantile, valid for any distribution (Vovk et al.
    2005); between two ranks their logarithms are interpolated. With fewer it is the one-sided prediction
    bound of a normal distribution of their logarithms (Hahn and Meeker 1991).

    Parameters
    ----------
    maxima : (M,) array
        Largest absolute z of each control, positive.
    level : float

    Returns
    -------
    float
    """
    count, logs = len(maxima), np.log(np.sort(maxima))
    rank = (1.0 - level) * (count + 1)
    if rank <= count + 1e-9:
        return float(np.exp(np.interp(rank, np.arange(1, count + 1), logs)))
    return float(np.exp(_log_bound(logs, level)))


def _log_bound(logs: FloatArray, level: float) -> FloatArray:
    """Return the bound of a new value from normal ones (M, ...), exceeded with a probability of `level`."""
    count = len(logs)
    reach = float(stats.t.ppf(1.0 - level, count - 1)) * np.sqrt(1.0 + 1.0 / count)
    bound: FloatArray = logs.mean(axis=0) + reach * logs.std(axis=0, ddof=1)
    return bound


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
    thicker : float
        Difference of the wall's thickness at the peak, relative to the expected one; NaN if not measured.
    """

    vertices: IntArray
    area: float
    mean: float
    peak: float
    z: float
    centre: int
    missing: float
    thicker: float = float("nan")


def regions(
    surface: TriangleMesh,
    areas: FloatArray,
    differences: FloatArray,
    z: FloatArray,
    met: BoolArray,
    limit: float,
    thicker: FloatArray | None = None,
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
    thicker : (V,) array, optional
        Relative differences of the wall's thickness.

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
                float("nan") if thicker is None else float(thicker[centre]),
            )
        )
    return tuple(sorted(regions, key=lambda region: -abs(region.z)))
