"""Bringing groomed shapes into one frame."""

from collections.abc import Sequence

import numpy as np

from homolog.arrays import FloatArray
from homolog.errors import InputError
from homolog.grooming.icp import Cloud, axes_rotation, cloud_of, registered
from homolog.grooming.subject import GroomedSubject
from homolog.progress import Tick, no_tick
from homolog.settings import Alignment, GroomSettings

__all__ = ["align"]

_OTHER_UNIT = 100.0
_QUANTILES = np.linspace(0.02, 0.98, 25)


def align(groomed: Sequence[GroomedSubject], settings: GroomSettings, tick: Tick = no_tick) -> FloatArray:
    """Return a similarity per subject from its local to world coordinates.

    With *center* each surface's centre becomes the origin. *Axes* also turns the principal axes onto
    those of a reference subject, and *ICP* registers the surface to the reference (`registered`); the world
    then has the reference's directions. The reference is the medoid of the distributions of
    distances from the centre, which do not depend on pose.

    Parameters
    ----------
    groomed : sequence of GroomedSubject
        The cohort, at least one.
    settings : GroomSettings
        Its `alignment` and `scaling`: every root-mean-square radius becomes the cohort's geometric mean.
    tick : Tick
        Called once per subject.

    Returns
    -------
    (M, 4, 4) float64 array
        A proper rotation times one positive scale, and a translation [mm].

    Raises
    ------
    InputError
        If a shape is a hundred times as large or small as the others: then its unit is another.
    """
    clouds = [cloud_of(one.coarse_mesh) for one in groomed]
    _check_units([one.name for one in groomed], [cloud.size for cloud in clouds])
    if settings.scaling:
        common = float(np.exp(np.mean([np.log(cloud.size) for cloud in clouds])))
        clouds = [cloud.scaled(common / cloud.size) for cloud in clouds]
    reference = clouds[_medoid(clouds)]
    result = np.empty((len(clouds), 4, 4))
    for index, (cloud, one) in enumerate(zip(clouds, groomed, strict=True)):
        tick(index / len(clouds), f"aligning {one.name}")
        pose = np.eye(4)
        if settings.alignment is Alignment.AXES:
            pose[:3, :3] = axes_rotation(cloud, reference)
        elif settings.alignment is Alignment.ICP:
            pose = registered(cloud, reference)
        if settings.alignment is Alignment.NONE:
            pose[:3, 3] = cloud.centre
        to_cloud = np.diag([cloud.scale, cloud.scale, cloud.scale, 1.0])
        to_cloud[:3, 3] = -cloud.scale * cloud.centre
        result[index] = pose @ to_cloud
    return result


def _check_units(names: Sequence[str], sizes: Sequence[float]) -> None:
    middle = float(np.median(sizes))
    for name, size in zip(names, sizes, strict=True):
        if not middle / _OTHER_UNIT < size < middle * _OTHER_UNIT:
            times, word = (size / middle, "large") if size > middle else (middle / size, "small")
            raise InputError(
                f"{name}: is {times:.0f} times as {word} as the others; if its unit is another, export it in "
                "mm"
            )


def _medoid(clouds: Sequence[Cloud]) -> int:
    """Return the index of the shape whose radii are distributed most like all others' (Osada et al. 2002)."""
    radii = np.array([np.quantile(np.linalg.norm(cloud.points, axis=1), _QUANTILES) for cloud in clouds])
    return int(np.argmin(np.abs(radii[:, None] - radii).sum(axis=(1, 2))))
