"""Groomed subjects on disk: one archive and one surface for other programs per subject."""

import hashlib
import json
import zipfile
from dataclasses import asdict
from pathlib import Path

import numpy as np

from homolog.arrays import Array
from homolog.files.atomic import replacing
from homolog.files.meshes import write_mesh
from homolog.grooming.images import Segmentation
from homolog.grooming.subject import GroomedSubject, GroomReport
from homolog.settings import GroomSettings
from homolog.surfaces.distance_field import DistanceField
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["content_key", "load_groomed", "save_groomed"]

_VERSION = "1"
"""To be raised whenever grooming gives other results: older archives are then made anew."""


def content_key(source: Segmentation | TriangleMesh, settings: GroomSettings) -> str:
    """Return a hash of all that a groomed subject depends on."""
    digest = hashlib.sha256(_VERSION.encode())
    digest.update(settings.model_dump_json(exclude={"alignment", "scaling", "label"}).encode())
    arrays: tuple[Array, ...]
    if isinstance(source, Segmentation):
        arrays = (source.mask, source.rotation, source.spacing, source.origin)
    else:
        arrays = (source.vertices, source.faces)
    for array in arrays:
        digest.update(f"{array.dtype}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def load_groomed(folder: Path, name: str, key: str) -> GroomedSubject | None:
    """Return a subject from the cache; None if it is not there, of other content, or damaged."""
    try:
        with _archive(folder, name).open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            if str(stored["key"]) != key:
                return None
            report = json.loads(str(stored["report"]))
            return GroomedSubject(
                name=name,
                field=DistanceField(stored["values"], stored["index_to_world"]),
                mesh=TriangleMesh(stored["vertices"], stored["faces"]),
                coarse_mesh=TriangleMesh(stored["coarse_vertices"], stored["coarse_faces"]),
                report=GroomReport(**{**report, "notes": tuple(report["notes"])}),
            )
    except (OSError, KeyError, ValueError, TypeError, EOFError, zipfile.BadZipFile):
        return None


def save_groomed(folder: Path, groomed: GroomedSubject, key: str) -> None:
    """Write a subject to the cache, ``<name>.npz``, and its surface, ``<name>.vtp``.

    Raises
    ------
    InputError
        If the folder can't be written to.
    """
    write_mesh(folder / f"{groomed.name}.vtp", groomed.mesh)
    with replacing(_archive(folder, groomed.name)) as part, part.open("wb") as stream:
        np.savez(
            stream,
            key=key,
            report=json.dumps(asdict(groomed.report)),
            values=groomed.field.values,
            index_to_world=groomed.field.index_to_world,
            vertices=groomed.mesh.vertices,
            faces=groomed.mesh.faces,
            coarse_vertices=groomed.coarse_mesh.vertices,
            coarse_faces=groomed.coarse_mesh.faces,
        )


def _archive(folder: Path, name: str) -> Path:
    return folder / f"{name}.npz"
