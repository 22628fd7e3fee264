"""The surfaces of an imported model: from its files if they fit the particles, else from the particles."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from homolog.arrays import FloatArray
from homolog.cohort import MESH_SUFFIXES, Subject, suffix_of
from homolog.errors import InputError, NumericalError
from homolog.exchange.model import ForeignSubject
from homolog.exchange.surfels import surfels
from homolog.geometry import rms_radius
from homolog.grooming import groom_subject
from homolog.grooming.distance_maps import read_distance_map
from homolog.io.meshes import read_mesh
from homolog.progress import Tick, no_tick
from homolog.settings import GroomSettings
from homolog.statistics.reconstruction import mean_surface, medoid
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.simplify import simplified
from homolog.surfaces.topology import check_mesh

__all__ = ["SubjectSurface", "surfaces_of"]

_NEAR = 0.05  # of the size, plus half an edge: largest distance to vertices and face centres
_MOST = 0.95  # least fraction of particles within that distance
_VERTICES = 8000  # enough for display, and few enough for warping


@dataclass(frozen=True, slots=True, eq=False)
class SubjectSurface:
    """A subject's surface in local coordinates, its file (None without one), and notes."""

    mesh: TriangleMesh
    path: Path | None
    notes: tuple[str, ...] = ()


def surfaces_of(
    subjects: Sequence[ForeignSubject],
    local: Sequence[FloatArray],
    world: Sequence[FloatArray],
    alignments: FloatArray,
    tick: Tick = no_tick,
) -> list[SubjectSurface]:
    """Return a surface for every subject.

    A file's surface is used if the subject's particles lie on it. A subject without one gets the surface of
    the most typical subject that has one, warped by the particles; if no subject has one, it gets discs at
    its particles. Notes describe the choice.

    Parameters
    ----------
    subjects : sequence of M ForeignSubject
    local, world : sequences of M (N, 3) arrays
        Particles [mm].
    alignments : (M, 4, 4) array
        From local to world.
    tick : Tick
    """
    surfaces: list[SubjectSurface | None] = []
    refused: list[str] = []
    for index, (subject, points) in enumerate(zip(subjects, local, strict=True)):
        tick(index / len(subjects), f"surface of {subject.name}")
        surface, reason = _own(subject, points)
        surfaces.append(surface)
        refused.append(reason)
    have = [index for index, surface in enumerate(surfaces) if surface is not None]
    if not have:
        return [
            SubjectSurface(
                surfels(points),
                None,
                (f"{reason}; shown as discs at its particles, can't be groomed or optimized",),
            )
            for points, reason in zip(local, refused, strict=True)
        ]
    positions = np.array(world)
    template = have[medoid(positions[have], positions.mean(axis=0))]
    mesh = surfaces[template]
    assert mesh is not None, "the template has a surface"
    template_mesh = mesh.mesh.placed(alignments[template])
    result = []
    for index, surface in enumerate(surfaces):
        if surface is None:
            warped = mean_surface(
                positions[index], positions[template], template_mesh.vertices, template_mesh.faces
            )
            back = TriangleMesh(warped.vertices, template_mesh.faces).placed(np.linalg.inv(alignments[index]))
            template_name = subjects[template].name
            note = f"{refused[index]}; shown with the surface of {template_name}, warped by the particles"
            surface = SubjectSurface(back, None, (note,))
        result.append(surface)
    return result


def _own(subject: ForeignSubject, points: FloatArray) -> tuple[SubjectSurface | None, str]:
    """Return the surface of the first usable file, or the reason why there is none."""
    reason = "has no surface"
    for path in subject.shapes:
        try:
            mesh = _read(subject.name, path)
            gap = _gap(mesh, points)
        except (InputError, NumericalError) as error:
            reason = f"its surface can't be used ({str(error).removeprefix(f'{subject.name}: ')})"
            continue
        if gap <= 0.0:
            return SubjectSurface(mesh, path), ""
        reason = f"its particles are not on the surface in {path.name}"
    return None, reason


def _read(name: str, path: Path) -> TriangleMesh:
    if suffix_of(path) in MESH_SUFFIXES:
        mesh = read_mesh(path)
        check_mesh(mesh, str(path))
        mesh = mesh if mesh.volume > 0.0 else TriangleMesh(mesh.vertices, mesh.faces[:, ::-1])
        return simplified(mesh, _VERTICES)
    try:
        return groom_subject(Subject(name, path), GroomSettings()).mesh
    except InputError:
        return read_distance_map(path)


def _gap(mesh: TriangleMesh, points: FloatArray) -> float:
    """Return the excess of most particles' distance from the surface over the tolerance [mm]."""
    positions = np.concatenate([mesh.vertices, mesh.vertices[mesh.faces].mean(axis=1)])
    distances = np.asarray(KDTree(positions).query(points)[0])
    size = rms_radius(points)
    return float(np.quantile(distances, _MOST) - _NEAR * size - 0.5 * mesh.mean_edge)
