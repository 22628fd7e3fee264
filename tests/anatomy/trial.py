"""One random anatomy through grooming, as a file that a user would have, and what came of it."""

import signal
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from anatomy import LABEL_MAPS, label_map, random_mesh, write_label_map
from homolog.cohort import Subject
from homolog.errors import InputError
from homolog.grooming.subject import GroomedSubject, groom_subject
from homolog.io.meshes import write_mesh
from homolog.settings import GroomSettings
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import check_mesh, euler_number

__all__ = ["SLOWEST_S", "Trial", "attempt"]

SLOWEST_S = 60.0
"""Of processor time: other work on the machine does not count."""
FARTHEST = 1.0
"""Nodes: how far from the zero level a vertex may be."""


_OWN_MESH = "random: random: the mesh"


@dataclass(frozen=True, slots=True)
class Trial:
    """What came of one random anatomy.

    Attributes
    ----------
    kind : str
        ``"label map"`` or ``"mesh"``.
    family : str
        How it was made.
    seed : int
        Of its generator.
    outcome : str
        ``"groomed"``, ``"refused"``, ``"slow"`` or ``"bad"``.
    reason : str
        Why it was refused, or what is bad.
    cpu_s : float
        Processor time of grooming.
    vertices, coarse_vertices, genus : int
        Of the meshes.
    notes : str
        What the user is told: what was dropped, repaired or made finer.
    """

    kind: str
    family: str
    seed: int
    outcome: str
    reason: str
    cpu_s: float
    vertices: int = 0
    coarse_vertices: int = 0
    genus: int = 0
    notes: str = ""


def attempt(
    family: str,
    seed: int,
    folder: Path,
    most: float | None = None,
    edges: int | None = None,
    nodes: int | None = None,
) -> Trial:
    """Make a random anatomy, write it to a folder, groom the file, and look at what comes out.

    Parameters
    ----------
    family : str
        A name of `anatomy.LABEL_MAPS` or `anatomy.MESHES`.
    seed : int
        Same seed, same anatomy.
    folder : Path
        Where the file is written.
    most : float, optional
        Size of the largest, as in `anatomy`.
    edges : int, optional
        How many edges of the mesh are as long as the anatomy's box; a mesh of default size if not given.
    nodes : int, optional
        How many nodes of the grid are as long as the anatomy's box; the default spacing if not given.
    """
    limits = {} if most is None else {"most": most}
    if family in LABEL_MAPS:
        kind, path = "label map", folder / "random.nrrd"
        made = label_map(family, seed, **limits)
        size = float(np.linalg.norm(made.mask.shape * made.spacing))
        write_label_map(made, path)
    else:
        kind, path = "mesh", folder / "random.ply"
        mesh = random_mesh(family, seed, **limits)
        size = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
        write_mesh(path, mesh)
    settings = GroomSettings(
        mesh_edge=None if edges is None else min(size / edges, 100.0),
        spacing=None if nodes is None else min(size / nodes, 100.0),
    )
    began = time.process_time()
    result: dict[str, Any] = {}
    try:
        with _no_longer_than(SLOWEST_S):
            groomed = groom_subject(Subject("random", path), settings)
        faults = _faults(groomed)
        outcome, reason = ("bad", "; ".join(faults)) if faults else ("groomed", "")
        result = {
            "vertices": len(groomed.mesh.vertices),
            "coarse_vertices": len(groomed.coarse_mesh.vertices),
            "genus": groomed.report.genus,
            "notes": "; ".join(groomed.report.notes),
        }
    except InputError as error:
        reason = str(error).replace(str(path), "FILE")
        outcome = "bad" if _OWN_MESH in reason else "refused"  # nobody can repair what the program made
    except TimeoutError as error:
        outcome, reason = "slow", str(error)
    except Exception as error:  # noqa: BLE001 - whatever else is raised is what is looked for
        place = traceback.extract_tb(error.__traceback__)[-1]
        reason = f"{type(error).__name__} in {Path(place.filename).name}:{place.name}: {error}"
        outcome = "bad"
    return Trial(kind, family, seed, outcome, reason, time.process_time() - began, **result)


def _faults(groomed: GroomedSubject) -> list[str]:
    """Return what is wrong with a groomed subject."""
    faults = []
    field = groomed.field
    if field is None:  # a sheet stays open
        return _faults_of_sheet(groomed)
    sides = [np.moveaxis(field.values, axis, 0)[[0, -1]] for axis in range(3)]
    if not np.isfinite(field.values).all() or min(side.min() for side in sides) <= 0.0:
        faults.append("the field is not finite, or not positive at its border")
    for name, mesh in (("mesh", groomed.mesh), ("coarse mesh", groomed.coarse_mesh)):
        try:
            check_mesh(mesh, name)
        except InputError as error:
            faults.append(str(error))
            continue
        if (off := float(np.abs(field.sample_values(mesh.vertices)).max() / field.spacing)) > FARTHEST:
            faults.append(f"{name}: a vertex is {off:.2f} nodes from the zero level")
        if (whole := mesh.volume / _volume_inside(field.values, field.spacing)) < 0.5 or whole > 1.5:
            faults.append(f"{name}: has {whole:.2f} of the field's volume")
    if euler_number(groomed.mesh.faces) != euler_number(groomed.coarse_mesh.faces):
        faults.append(f"genus {_genus(groomed.mesh)}, of the coarse mesh {_genus(groomed.coarse_mesh)}")
    return faults


def _faults_of_sheet(groomed: GroomedSubject) -> list[str]:
    """Return what is wrong with a groomed open mesh."""
    faults = []
    for name, mesh in (("mesh", groomed.mesh), ("coarse mesh", groomed.coarse_mesh)):
        try:
            check_mesh(mesh, name, may_open=True)
        except InputError as error:
            faults.append(str(error))
    return faults


def _genus(mesh: TriangleMesh) -> int:
    return 1 - euler_number(mesh.faces) // 2


def _volume_inside(values: np.ndarray, spacing: float) -> float:
    """Return the volume within the zero level, of all its pieces [mm³]."""
    from skimage import measure

    vertices, faces = measure.marching_cubes(np.array(values), 0.0, gradient_direction="descent")[:2]
    return TriangleMesh(vertices, faces).volume * spacing**3


@contextmanager
def _no_longer_than(seconds: float) -> Iterator[None]:
    """Raise `TimeoutError` after so much processor time."""

    def stop(*_: object) -> None:
        raise TimeoutError(f"took longer than {seconds:g} s")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
