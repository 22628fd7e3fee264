"""A project's subjects as controls: particles with pose taken out, and the dense surface they carry."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from homolog.analysis.procrustes import align
from homolog.analysis.reconstruction import warp_surface
from homolog.arrays import FloatArray, frozen
from homolog.files.project import ProjectFolder
from homolog.files.results import Result, read_surface
from homolog.geometry import fit_similarity, inverse_matrices, transform_points
from homolog.patient.target import Target
from homolog.progress import Tick, no_tick, part_of
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.mirroring import mirrors
from homolog.surfaces.simplify import simplified

__all__ = ["COARSE_VERTICES", "Controls", "read_controls"]

SURFACE_VERTICES = 4000
"""Of the mean surface that carries the maps, at most."""
COARSE_VERTICES = 1500


@dataclass(frozen=True, slots=True, eq=False)
class Controls:
    """Controls of a reference, with pose taken out and their own size.

    Attributes
    ----------
    names : tuple of str
        The M subjects.
    points : (M, P, 3) array
        Vertices of the mean surface, as they lie on each subject, then particles [mm], read-only.
    surface : TriangleMesh
        The mean surface, whose vertices those are.
    meshes : tuple of TriangleMesh
        Groomed surfaces in the subjects' own frames, mirrored where the result mirrors them.
    particles : (M, N, 3) array
        The joint run's, in the same frames [mm], read-only.
    """

    names: tuple[str, ...]
    points: FloatArray
    surface: TriangleMesh
    meshes: tuple[TriangleMesh, ...]
    particles: FloatArray


def read_controls(
    project: ProjectFolder, result: Result, chosen: Sequence[int], tick: Tick = no_tick
) -> Controls:
    """Read the surfaces of some subjects of a result and give them corresponding vertices.

    Parameters
    ----------
    project : ProjectFolder
    result : Result
        Of the project.
    chosen : sequence of int
        Subjects, by their place in the result.
    tick : Tick

    Returns
    -------
    Controls

    Raises
    ------
    InputError
        If a groomed surface is missing or damaged.
    """
    record = project.read().result
    assert record is not None, "a result was read"
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    meshes, particles, turned = [], [], []
    for number, index in enumerate(chosen):
        tick(0.3 * number / len(chosen), f"reading {result.names[index]}")
        mesh, local, alignment = (
            read_surface(project, record.subjects[index]),
            result.local[index],
            result.alignments[index],
        )
        if mirrors(alignment):
            mesh, local = mesh.placed(mirror), transform_points(mirror, local)
            alignment = alignment @ mirror
        rotation = alignment[:3, :3] / np.cbrt(np.linalg.det(alignment[:3, :3]))
        meshes.append(mesh)
        particles.append(local)
        turned.append(local @ rotation.T)
    aligned = align(np.stack([shape - shape.mean(axis=0) for shape in turned]), scaling=False)
    template = _template(result, aligned)
    points = _dense(template, aligned, meshes, np.stack(particles), part_of(tick, 0.3, 1.0))
    surface = TriangleMesh(points[:, : len(template.vertices)].mean(axis=0), template.faces)
    return Controls(
        tuple(result.names[index] for index in chosen),
        frozen(points),
        surface,
        tuple(meshes),
        frozen(np.stack(particles)),
    )


def _template(result: Result, aligned: FloatArray) -> TriangleMesh:
    """Return the result's mean surface with few vertices, at the mean of the aligned particles (M, N, 3)."""
    mean = result.world.mean(axis=0)
    mesh = simplified(result.mean_surface, SURFACE_VERTICES)
    goal = aligned.mean(axis=0)
    pose = fit_similarity(mean, goal, scaling=True)
    start = transform_points(pose, mean)
    scale = np.cbrt(np.linalg.det(pose[:3, :3]))
    vertices = transform_points(pose, mesh.vertices)
    moved = warp_surface(start, vertices, (goal - start)[None], scale * result.smoothing)[0]
    return TriangleMesh(vertices + moved, mesh.faces)


def _dense(
    template: TriangleMesh,
    aligned: FloatArray,
    meshes: Sequence[TriangleMesh],
    particles: FloatArray,
    tick: Tick,
) -> FloatArray:
    """Return vertices that the particles carry onto each surface, and the particles, (M, P, 3)."""
    mean = aligned.mean(axis=0)
    tick(0.0, "carrying the mean surface")
    moves = warp_surface(mean, template.vertices, aligned - mean, np.zeros(len(mean)))
    points = np.empty((len(meshes), len(template.vertices) + len(mean), 3))
    for index, (mesh, shape, own) in enumerate(zip(meshes, aligned, particles, strict=True)):
        tick(index / len(meshes), "carrying the mean surface")
        pose = fit_similarity(own, shape, scaling=False)
        back = inverse_matrices(pose)
        carried_mesh = TriangleMesh(template.vertices + moves[index], template.faces)
        local = transform_points(back, carried_mesh.vertices)
        normals = carried_mesh.vertex_normals @ pose[:3, :3]
        far, met = Target(mesh).along_normals(local, normals)
        snapped = local + np.where(met, far, 0.0)[:, None] * normals
        points[index, : len(local)] = transform_points(pose, snapped)
        points[index, len(local) :] = shape
    return points
