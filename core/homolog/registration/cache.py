"""Registrations kept on disk, so that only changed surfaces are registered again."""

import hashlib
from contextlib import suppress
from pathlib import Path

import numpy as np

from homolog.errors import InputError
from homolog.io.arrays import read_arrays, write_arrays
from homolog.registration.icp import Fit, OrientedPoints, registered

__all__ = ["RegistrationCache"]

_VERSION = "3"
"""Increase this number whenever results of `registered` change."""


class RegistrationCache:
    """Registrations of one surface to another, by the content of both.

    Parameters
    ----------
    path : Path, optional
        File of stored registrations; a damaged file, or one of another version, is ignored.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._path = path
        self._before = {} if path is None else _registrations(path)
        self._used: dict[str, Fit] = {}

    def registered(
        self, moving: OrientedPoints, fixed: OrientedPoints, *, free: bool = False, bends: bool = False
    ) -> Fit:
        """Return the result of `icp.registered`, from the cache if possible; safe from any thread."""
        way = "bends" if bends else free
        digest = hashlib.blake2b(f"{_VERSION} {way}".encode(), digest_size=16)
        for array in (moving.points, moving.normals, fixed.points, fixed.normals):
            digest.update(f"{array.shape}".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        key = digest.hexdigest()
        fit = self._used.get(key) or self._before.get(key)
        fit = fit or registered(moving, fixed, free=free, bends=bends)
        self._used[key] = fit
        return fit

    def save(self) -> None:
        """Store the requested registrations, if there are new ones.

        Registrations that can't be stored, as in a read-only folder, are computed again the next time.
        """
        if self._path is None or self._used.keys() <= self._before.keys():
            return
        fits = self._used.values()
        arrays = {"poses": [fit.pose for fit in fits], "distances": [fit.distance for fit in fits]}
        with suppress(InputError):
            write_arrays(self._path, {"keys": list(self._used), **arrays})


def _registrations(path: Path) -> dict[str, Fit]:
    try:
        stored = read_arrays(path)
        poses, distances = stored["poses"].reshape(-1, 4, 4), stored["distances"].tolist()
        return {
            str(key): Fit(pose, distance)
            for key, pose, distance in zip(stored["keys"], poses, distances, strict=True)
        }
    except (InputError, KeyError, ValueError, TypeError):
        return {}
