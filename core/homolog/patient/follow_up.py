"""One patient at several times: changes of the surface beyond measurement error."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from homolog.arrays import BoolArray, FloatArray, frozen
from homolog.errors import InputError
from homolog.patient.change import AVERAGED, AgainstExpected, ExpectedChange, distances_to_times
from homolog.patient.compare import PatientComparison
from homolog.patient.fit import SurfaceFit
from homolog.patient.local import Region, prediction_limit, regions
from homolog.patient.mesh_graph import ring_mean
from homolog.progress import Tick, no_tick, part_of
from homolog.statistics.moderation import moderated
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import enclosed_volume

__all__ = ["Change", "FollowUp", "compare_times"]

_LEVEL = 0.05
_POINTWISE = 1.96
"""Half-width of the range of 95 % of differences of two measurements [SD] (Bland and Altman 1999)."""
_FEWEST_REPEATS = 3
"""Smallest number of repeats for a limit of the whole surface."""


@dataclass(frozen=True, slots=True, eq=False)
class Change:
    """Change from the first time to a later one; arrays are read-only.

    Attributes
    ----------
    name : str
        Name of the later file.
    distance : (V,) array
        Distance from the first surface to the later one along the first one's normals [mm], outward positive.
    met : (V,) bool array
        Whether the normal meets both surfaces.
    z : (V,) array or None
        Change averaged over neighbours, in standard deviations of measurement error; None if it is unknown.
    regions : tuple of Region
        Regions where absolute z exceeds the limit.
    volume : float
        Ratio of the later volume to the first one; NaN of open surfaces.
    expected : AgainstExpected or None
        The change against that of the controls; None if no control has two times.
    """

    name: str
    distance: FloatArray
    met: BoolArray
    z: FloatArray | None
    regions: tuple[Region, ...]
    volume: float
    expected: AgainstExpected | None = None


@dataclass(frozen=True, slots=True, eq=False)
class FollowUp:
    """A patient at several times.

    Attributes
    ----------
    comparisons : tuple of PatientComparison
        Comparisons with the reference, one for each time.
    surface : TriangleMesh
        The surface `matched` of the first time, along whose normals changes are measured.
    changes : tuple of Change
        Change at each later time.
    repeats : int
        Number of repeated segmentations of the first time that determine the measurement error.
    error : (V,) array or None
        Standard deviation of the difference of two measurements, averaged over neighbours [mm]; None without
        repeats.
    limit : float or None
        Limit of absolute z.
    everywhere : bool
        Whether the limit holds for the whole surface (exceeded anywhere in 5 % of repeated measurements), or
        for each vertex alone.
    expected : ExpectedChange or None
        Expected change; None without controls with two times.
    """

    comparisons: tuple[PatientComparison, ...]
    surface: TriangleMesh
    changes: tuple[Change, ...]
    repeats: int
    error: FloatArray | None
    limit: float | None
    everywhere: bool
    expected: ExpectedChange | None = None


def compare_times(
    comparisons: Sequence[PatientComparison],
    repeats: Sequence[PatientComparison] = (),
    tick: Tick = no_tick,
    *,
    expected: ExpectedChange | None = None,
) -> FollowUp:
    """Compare later times of a patient with the first one.

    The first surface is registered rigidly to each later one, with the weights of Geman and McClure (1987),
    so that a change does not affect the rest; distances are then measured along its normals.

    Parameters
    ----------
    comparisons : sequence of PatientComparison
        At least two comparisons with one reference, the first time first.
    repeats : sequence of PatientComparison
        Comparisons of further segmentations of the first time.
    tick : Tick
    expected : ExpectedChange, optional
        Expected change of the reference (``reference.change``).

    Returns
    -------
    FollowUp

    Raises
    ------
    InputError
        If there are fewer than two times, or several references.
    """
    if len(comparisons) < 2:
        raise InputError("a follow-up needs at least two times; give another file of the same patient")
    first = comparisons[0]
    faces = first.expected.faces
    if any(not np.array_equal(item.expected.faces, faces) for item in (*comparisons, *repeats)):
        raise InputError("the times are compared with several references; compare them with one")
    surface = first.matched
    others = (*comparisons[1:], *repeats)
    mesh = first.mesh.placed(first.placement)
    fits = [
        distances_to_times(
            surface,
            mesh,
            item.mesh.placed(item.placement),
            part_of(tick, n / len(others), (n + 1) / len(others)),
        )
        for n, item in enumerate(others)
    ]
    own, later = fits[0][0], [fit for _, fit in fits]
    later, again = later[: len(comparisons) - 1], later[len(comparisons) - 1 :]
    error, limit = None, None
    if again:
        maps = ring_mean(np.stack([fit.residual - own.residual for fit in again]), faces, AVERAGED)
        error = _deviation(maps)
        limit = _limit(maps) if len(again) >= _FEWEST_REPEATS else _POINTWISE
    changes = [
        _change(first, item, surface, own, fit, error, limit, expected)
        for item, fit in zip(comparisons[1:], later, strict=True)
    ]
    return FollowUp(
        tuple(comparisons),
        surface,
        tuple(changes),
        len(again),
        None if error is None else frozen(error),
        limit,
        len(again) >= _FEWEST_REPEATS,
        expected,
    )


def _change(
    first: PatientComparison,
    later: PatientComparison,
    surface: TriangleMesh,
    own: SurfaceFit,
    fit: SurfaceFit,
    error: FloatArray | None,
    limit: float | None,
    expected: ExpectedChange | None,
) -> Change:
    distance = fit.residual - own.residual
    met = fit.met & own.met
    z: FloatArray | None = None
    beyond: tuple[Region, ...] = ()
    if error is not None and limit is not None:
        z = ring_mean(distance, surface.faces, AVERAGED) / error
        beyond = regions(surface, surface.vertex_areas, distance, z, met, limit)
    volume = abs(enclosed_volume(later.mesh) / enclosed_volume(first.mesh))
    against = None if expected is None else expected.against(fit, own, volume, surface)
    return Change(
        later.name, frozen(distance), frozen(met), None if z is None else frozen(z), beyond, volume, against
    )


def _deviation(maps: FloatArray) -> FloatArray:
    """Return the standard deviation of differences (n, V) whose mean is 0, moderated over the surface."""
    variance = moderated(np.square(maps).mean(axis=0), len(maps))
    return np.sqrt(np.maximum(variance, 1e-12))


def _limit(maps: FloatArray) -> float:
    """Return the limit that another repeat exceeds anywhere in 5 % of cases."""
    everyone = np.arange(len(maps))
    maxima = [
        float(np.abs(maps[index] / _deviation(maps[everyone != index])).max()) for index in everyone.tolist()
    ]
    return max(prediction_limit(np.array(maxima), _LEVEL), _POINTWISE)
