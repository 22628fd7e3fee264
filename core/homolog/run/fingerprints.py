"""Hashes of surfaces and settings, to compare runs, and versions of packages."""

import hashlib
import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from homolog import __version__
from homolog.correspondence import Shape
from homolog.progress import Tick, no_tick
from homolog.settings import OptimizeSettings

__all__ = ["run_fingerprint", "surface_hash", "versions"]

_PACKAGES = ("numpy", "scipy", "scikit-image", "SimpleITK", "warp-lang")


def surface_hash(shape: Shape) -> str:
    """Return a hash of a shape's surface, without its name and alignment."""
    digest = hashlib.blake2b(digest_size=16)
    field = shape.field
    for array in (
        *(() if field is None else (field.values, field.index_to_world)),
        *(part for mesh in (shape.mesh, shape.coarse_mesh) for part in (mesh.vertices, mesh.faces)),
    ):
        digest.update(f"{array.shape}{array.dtype}".encode())
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def run_fingerprint(settings: OptimizeSettings, shapes: Sequence[Shape], tick: Tick = no_tick) -> str:
    """Return a hash of the settings and of the shapes in order, independent of the device.

    Parameters
    ----------
    settings : OptimizeSettings
        Settings of the run.
    shapes : sequence of Shape
        The shapes in order.
    tick : Tick
        Progress and cancellation.

    Returns
    -------
    str
    """
    contents = []
    for index, shape in enumerate(shapes):
        tick(index / len(shapes), f"surface of {shape.name}")
        contents.append(surface_hash(shape))
    places = [repr(shape.alignment.tolist()) for shape in shapes]
    marks = [repr(shape.landmarks.tolist()) for shape in shapes if shape.landmarks is not None]
    text = "\n".join([settings.model_dump_json(exclude_none=True), *contents, *places, *marks])
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def versions() -> dict[str, str]:
    """Return the versions of all packages that affect results."""
    versions = {"homolog": __version__, "python": platform.python_version()}
    for name in _PACKAGES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "unknown"
    return versions
