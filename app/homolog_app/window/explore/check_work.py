"""What the Check page has computed; these functions run in the computing thread and know no Qt."""

from typing import TYPE_CHECKING

import numpy as np

from homolog.arrays import FloatArray
from homolog.errors import InputError
from homolog.files.project import ProjectFolder
from homolog.progress import Tick
from homolog.surfaces.mirroring import scale_of
from homolog_app.window.explore.check_scene import Distances

if TYPE_CHECKING:
    from homolog.inspection import Inspection, ParticleEnergies

__all__ = ["distances_on", "energies_of", "textures_of"]


def distances_on(
    inspection: "Inspection", subject: int, place: FloatArray, name: str, tick: Tick
) -> Distances:
    """Return the distances of a subject's surface from a place (3,) on it, in aligned coordinates."""
    from homolog.geodesics import distances_from
    from homolog.inspection.located_particles import closest_points_on

    located = inspection.located
    mesh, matrix = located.meshes[subject], located.alignments[subject]
    local = np.linalg.solve(matrix[:3, :3], place - matrix[:3, 3])
    normals, faces, _ = closest_points_on(mesh, local[None])
    normal = matrix[:3, :3] @ normals[0]
    corners = mesh.faces[faces[0]]
    away = np.linalg.norm(mesh.vertices[corners] - local, axis=1)
    along = distances_from(mesh, corners.tolist(), away.tolist(), name=name, tick=tick).astype(np.float64)
    straight = np.linalg.norm(mesh.vertices - local, axis=1)
    return Distances(subject, place, normal / np.linalg.norm(normal), along, straight)


def energies_of(inspection: "Inspection", project: ProjectFolder, tick: Tick) -> "ParticleEnergies":
    """Return what each particle adds to the energies, by the settings of the project's result."""
    from homolog.inspection import particle_energies

    tick(0.0, "energies of particles")
    record = project.read().result
    if record is None:
        raise InputError(f"{project.folder}: has no result any more; run again")
    return particle_energies(inspection.located, inspection.consensus, record.settings.optimize)


def textures_of(
    inspection: "Inspection", names: tuple[str, ...], tick: Tick
) -> dict[str, dict[str, FloatArray]]:
    """Return both patterns for each subject: a tone from 0 to 1 for each vertex of its surface."""
    from homolog.inspection import carried_places, checkerboard, stripes

    patterns: dict[str, dict[str, FloatArray]] = {"checkerboard": {}, "stripes": {}}
    for m, name in enumerate(names):
        tick(m / len(names), f"texture on {name}")
        carried = carried_places(inspection.located, inspection.consensus, m)
        matrix = inspection.located.alignments[m]
        blur = inspection.located.meshes[m].mean_edge * float(scale_of(matrix))
        patterns["checkerboard"][name] = checkerboard(carried, inspection.consensus.shape, blur)
        patterns["stripes"][name] = stripes(carried, inspection.consensus.shape, blur)
    return patterns
