"""Cache on disk: groomed subjects, with one archive and one surface each."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from homolog.arrays import Array
from homolog.errors import InputError
from homolog.grooming.subject import GroomedSubject, GroomReport
from homolog.io.arrays import read_arrays
from homolog.io.atomic import atomic_write
from homolog.io.constraints import text_of
from homolog.io.images import Segmentation
from homolog.io.meshes import write_mesh
from homolog.io.names import file_stems
from homolog.settings import GroomSettings
from homolog.surfaces.clipping import Cut
from homolog.surfaces.distance_field import DistanceField
from homolog.surfaces.mesh import TriangleMesh

__all__ = [
    "check_names",
    "content_key",
    "is_outdated",
    "load_groomed",
    "load_report",
    "read_groomed",
    "save_groomed",
    "stored_key",
]

_VERSION = "14"
"""Increase this number whenever results of grooming change: older archives are then recomputed."""


def content_key(
    source: Segmentation | TriangleMesh, settings: GroomSettings, cuts: Sequence[Cut] = ()
) -> str:
    """Return hashes of the inputs of a groomed subject: the file's content, and settings with cuts."""
    content, rest = hashlib.sha256(), hashlib.sha256(_VERSION.encode())
    rest.update(
        settings.model_dump_json(
            exclude={
                *("alignment", "mirror", "scaling", "label", "values", "structures", "structure_grooming")
            }
        ).encode()
    )
    rest.update(text_of(cuts).encode())
    arrays: tuple[Array, ...]
    if isinstance(source, Segmentation):
        arrays = (source.mask, source.rotation, source.spacing, source.origin)
    else:
        arrays = (source.vertices, source.faces)
    for array in arrays:
        content.update(f"{array.dtype}{array.shape}".encode())
        content.update(np.ascontiguousarray(array).tobytes())
    return f"{_VERSION}.{content.hexdigest()} {rest.hexdigest()}"


def check_names(names: Sequence[str]) -> None:
    """Raise InputError if two subjects would be stored in the same file."""
    owners: dict[str, str] = {}
    for name in names:
        stem = file_stems([name])[0]
        if stem in owners:
            raise InputError(
                f"the names {owners[stem]} and {name} differ only by special characters, and their files "
                f"would both be named {stem}; rename one"
            )
        owners[stem] = name


def stored_key(folder: Path, name: str) -> str:
    """Return the key with which a subject was stored in the cache; empty if it is missing or damaged."""
    try:
        return str(read_arrays(_file(folder, name, "npz"), names=("key",))["key"])
    except (InputError, KeyError):
        return ""


def is_outdated(stored: str, key: str) -> bool:
    """Return whether a stored key is that of another content of the same subject's file."""
    before, now = stored.partition(" ")[0], key.partition(" ")[0]
    return before.partition(".")[0] == now.partition(".")[0] and before != now


def load_groomed(folder: Path, name: str, key: str) -> GroomedSubject | None:
    """Return a subject from the cache; None if it is missing, damaged, or made from other content.

    Parameters
    ----------
    folder : Path
        The cache.
    name : str
        Name of the subject.
    key : str
        Result of `content_key`.

    Returns
    -------
    GroomedSubject or None
    """
    try:
        stored = read_arrays(_file(folder, name, "npz"))
        if str(stored["key"]) != key:
            return None
        return GroomedSubject(
            name=name,
            field=DistanceField(stored["values"], stored["index_to_world"]) if "values" in stored else None,
            mesh=_mesh(stored, ""),
            coarse_mesh=_mesh(stored, "coarse_"),
            report=_report(stored),
        )
    except _DAMAGED:
        return None


def read_groomed(folder: Path, name: str) -> GroomedSubject:
    """Return a subject that a run has groomed.

    Raises
    ------
    InputError
        If it is missing or damaged.
    """
    path = _file(folder, name, "npz")
    groomed = load_groomed(folder, name, str(read_arrays(path).get("key", "")))
    if groomed is None:
        raise InputError(f"{path}: is damaged; delete it and run again")
    return groomed


def load_report(folder: Path, name: str) -> GroomReport | None:
    """Return the last grooming report of a subject, or None."""
    try:
        return _report(read_arrays(_file(folder, name, "npz")))
    except _DAMAGED:
        return None


_DAMAGED = (InputError, KeyError, ValueError, TypeError, RecursionError)


def _report(stored: Mapping[str, Array]) -> GroomReport:
    report = json.loads(str(stored["report"]))
    borders = tuple(tuple(item) for item in report.get("borders", ()))
    rest = {"voxel": tuple(report.get("voxel", ())), "ends": tuple(report.get("ends", (0, 0)))}
    return GroomReport(**{**report, "notes": tuple(report["notes"]), "borders": borders, **rest})


def _mesh(stored: Mapping[str, Array], prefix: str) -> TriangleMesh:
    """Return a surface; refuse faces whose indices exceed its vertices, since kernels do not check them."""
    mesh = TriangleMesh(stored[f"{prefix}vertices"], stored[f"{prefix}faces"])
    if mesh.vertices.shape[1:] != (3,) or mesh.faces.shape[1:] != (3,):
        raise ValueError("no triangles in space")
    if mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices):
        raise ValueError("faces without vertices")
    return mesh


def save_groomed(folder: Path, groomed: GroomedSubject, key: str) -> None:
    """Write a subject to the cache and its surface, an ``.npz`` and a ``.vtp`` named after it.

    Parameters
    ----------
    folder : Path
        The cache.
    groomed : GroomedSubject
        The subject to store.
    key : str
        Result of `content_key`.

    Raises
    ------
    InputError
        If the folder can't be written to.
    """
    write_mesh(_file(folder, groomed.name, "vtp"), groomed.mesh)
    grid: dict[str, Any] = {}
    if groomed.field is not None:
        grid = {"values": groomed.field.values, "index_to_world": groomed.field.index_to_world}
    with atomic_write(_file(folder, groomed.name, "npz")) as part, part.open("wb") as stream:
        np.savez(
            stream,
            key=key,
            report=json.dumps(asdict(groomed.report)),
            **grid,
            vertices=groomed.mesh.vertices,
            faces=groomed.mesh.faces,
            coarse_vertices=groomed.coarse_mesh.vertices,
            coarse_faces=groomed.coarse_mesh.faces,
        )


def _file(folder: Path, name: str, kind: str) -> Path:
    """Return a file's path within the folder; subjects with equal paths overwrite each other."""
    return folder / f"{file_stems([name])[0]}.{kind}"
