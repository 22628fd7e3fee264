"""Registrations kept on disk, so that only changed surfaces are registered again."""

import hashlib
import json
from contextlib import suppress
from pathlib import Path

import numpy as np

from homolog.arrays import Array, FloatArray
from homolog.errors import InputError
from homolog.io.arrays import read_arrays, write_arrays
from homolog.registration.icp import Fit, OrientedPoints, candidates

__all__ = ["VERSION", "RegistrationCache"]

VERSION = "4"
"""Increase this number whenever registrations change."""


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
        self._used: dict[str, list[Fit]] = {}
        self._whole: dict[str, Array] = {}

    def candidates(self, moving: OrientedPoints, fixed: OrientedPoints) -> list[Fit]:
        """Return the result of `icp.candidates`, from the cache if possible; safe from any thread."""
        digest = hashlib.blake2b(VERSION.encode(), digest_size=16)
        for array in (moving.points, moving.normals, fixed.points, fixed.normals):
            digest.update(f"{array.shape}".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        key = digest.hexdigest()
        fits = self._used.get(key) or self._before.get(key) or candidates(moving, fixed)
        self._used[key] = fits
        return fits

    def save(self) -> None:
        """Store the requested registrations, if there are new ones.

        Registrations that can't be stored, as in a read-only folder, are computed again the next time.
        """
        if self._path is None or (self._used.keys() <= self._before.keys() and not self._whole):
            return
        fits = [(key, fit) for key, item in self._used.items() for fit in item]
        arrays = {"poses": [fit.pose for _, fit in fits], "distances": [fit.distance for _, fit in fits]}
        with suppress(InputError):
            write_arrays(self._path, {"keys": [key for key, _ in fits], **arrays, **self._whole})

    def whole(self, key: str) -> tuple[FloatArray, list[list[str]]] | None:
        """Return alignments (M, 4, 4) and notes of the last cohort, if they are those of a key."""
        with suppress(InputError, KeyError, ValueError, TypeError):
            stored = read_arrays(self._path) if self._path is not None else {}
            if str(stored["cohort"]) == key:
                notes = json.loads(str(stored["notes"]))
                return stored["alignments"].reshape(len(notes), 4, 4), notes
        return None

    def keep_whole(self, key: str, alignments: FloatArray, notes: list[list[str]]) -> None:
        """Store the alignments and notes of a cohort with the next `save`."""
        kept = np.array(json.dumps(notes))
        self._whole = {"cohort": np.array(key), "alignments": alignments, "notes": kept}


def _registrations(path: Path) -> dict[str, list[Fit]]:
    result: dict[str, list[Fit]] = {}
    try:
        stored = read_arrays(path)
        poses, distances = stored["poses"].reshape(-1, 4, 4), stored["distances"].tolist()
        for key, pose, distance in zip(stored["keys"], poses, distances, strict=True):
            result.setdefault(str(key), []).append(Fit(pose, distance))
    except (InputError, KeyError, ValueError, TypeError):
        return {}
    return result
