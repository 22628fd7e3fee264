"""A project's subjects as controls: aligned particles, and the dense surface that they deform."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from homolog.arrays import FloatArray, frozen
from homolog.correspondence import Shape
from homolog.correspondence.ensemble import Ensemble, ShapeState
from homolog.errors import InputError
from homolog.geometry import fit_similarity, inverse_matrices, rotation_of, scale_of, transform_points
from homolog.grooming.cache import read_groomed
from homolog.io.project import ProjectFolder
from homolog.io.records import ResultRecord
from homolog.io.results import Result, read_surface
from homolog.patient.target import Target
from homolog.progress import Tick, no_tick, part_of
from homolog.run.core_set import joint_ensemble
from homolog.settings import OptimizeSettings
from homolog.statistics.procrustes import align
from homolog.statistics.reconstruction import warp_surface
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.mirroring import MIRROR, mirrors
from homolog.surfaces.simplify import simplified

__all__ = ["COARSE_VERTICES", "Controls", "Jointly", "read_controls"]

SURFACE_VERTICES = 4000
"""Largest number of vertices of the mean surface for maps."""
COARSE_VERTICES = 1500


@dataclass(frozen=True, slots=True, eq=False)
class Jointly:
    """The joint run of the controls, which places a patient's particles.

    Attributes
    ----------
    shapes : tuple of M Shape
        Shapes in the frames of their files.
    turns : tuple of M (4, 4) arrays
        From the frames of the files to those of `Controls.meshes`.
    states : tuple of M ShapeState
        States with the positions of the particles.
    ensemble : Ensemble
        Ensemble of all shapes.
    settings : OptimizeSettings
        Settings of the run.
    """

    shapes: tuple[Shape, ...]
    turns: tuple[FloatArray, ...]
    states: tuple[ShapeState, ...]
    ensemble: Ensemble
    settings: OptimizeSettings


@dataclass(frozen=True, slots=True, eq=False)
class Controls:
    """Controls of a reference, rigidly aligned with their own size.

    Attributes
    ----------
    names : tuple of str
        Names of the M subjects.
    points : (M, P, 3) array
        Vertices of the mean surface on each subject, then particles [mm], read-only.
    surface : TriangleMesh
        The mean surface with these vertices.
    meshes : tuple of TriangleMesh
        Groomed surfaces in the subjects' own frames, mirrored where the result mirrors them.
    particles : (M, N, 3) array
        Particles of the joint run, in the same frames [mm], read-only.
    jointly : Jointly or None
        None if the distance fields of grooming are not stored.
    later : mapping of int to TriangleMesh
        Groomed surfaces of the next time of controls with two times, in their own frames.
    borders : tuple of M (k, 3) arrays
        Unit vectors out of each image where the control touches its border, in the frame of its mesh; empty
        if the distance fields of grooming are not stored.
    """

    names: tuple[str, ...]
    points: FloatArray
    surface: TriangleMesh
    meshes: tuple[TriangleMesh, ...]
    particles: FloatArray
    jointly: Jointly | None = None
    later: Mapping[int, TriangleMesh] = field(default_factory=dict)
    borders: tuple[FloatArray, ...] = ()


def read_controls(
    project: ProjectFolder,
    result: Result,
    chosen: Sequence[int],
    tick: Tick = no_tick,
    *,
    later: Mapping[int, int] | None = None,
) -> Controls:
    """Read the surfaces of some subjects of a result and give them corresponding vertices.

    Parameters
    ----------
    project : ProjectFolder
    result : Result
        The result of the project.
    chosen : sequence of int
        Indices of the subjects in the result.
    tick : Tick
    later : mapping of int to int, optional
        Index of the later time in the result, by position in `chosen`.

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
    meshes, particles, turned = [], [], []
    for number, index in enumerate(chosen):
        tick(0.2 * number / len(chosen), f"reading {result.names[index]}")
        local, alignment = result.local[index], result.alignments[index]
        if mirrors(alignment):
            local = transform_points(MIRROR, local)
            alignment = alignment @ MIRROR
        rotation = rotation_of(alignment)
        meshes.append(_mesh(project, record, result, index))
        particles.append(local)
        turned.append(local @ rotation.T)
    aligned = align(np.stack([shape - shape.mean(axis=0) for shape in turned]), scaling=False)
    template = _template(result, aligned)
    points = _dense(template, aligned, meshes, np.stack(particles), part_of(tick, 0.2, 0.6))
    surface = TriangleMesh(points[:, : len(template.vertices)].mean(axis=0), template.faces)
    shapes, borders = _stored(project, result, chosen)
    jointly = None
    if shapes:
        local, settings = result.local[list(chosen)], record.settings.placing
        jointly = _jointly(shapes, local, settings, part_of(tick, 0.6, 1.0))
    return Controls(
        tuple(result.names[index] for index in chosen),
        frozen(points),
        surface,
        tuple(meshes),
        frozen(np.stack(particles)),
        jointly,
        {who: _mesh(project, record, result, index) for who, index in (later or {}).items()},
        borders,
    )


def _mesh(project: ProjectFolder, record: ResultRecord, result: Result, index: int) -> TriangleMesh:
    """Return a subject's groomed surface, mirrored where the result mirrors it."""
    mesh = read_surface(project, record.subjects[index])
    return mesh.placed(MIRROR) if mirrors(result.alignments[index]) else mesh


def _stored(
    project: ProjectFolder, result: Result, chosen: Sequence[int]
) -> tuple[tuple[Shape, ...], tuple[FloatArray, ...]]:
    """Return the controls' shapes, and where they touch the borders of their images; empty if not stored."""
    shapes, borders = [], []
    for index in chosen:
        try:
            groomed = read_groomed(project.groomed, result.names[index])
        except InputError:
            return (), ()
        pose = result.alignments[index]
        shapes.append(Shape(groomed.name, groomed.field, groomed.mesh, groomed.coarse_mesh, pose))
        turn = MIRROR[:3, :3] if mirrors(pose) else np.eye(3)
        borders.append(np.array(groomed.report.borders, np.float64).reshape(-1, 3) @ turn.T)
    return tuple(shapes), tuple(borders)


def _jointly(shapes: tuple[Shape, ...], local: FloatArray, settings: OptimizeSettings, tick: Tick) -> Jointly:
    tick(0.0, "normals of the controls")
    states, ensemble = joint_ensemble(shapes, local, settings, tick)
    turns = tuple(MIRROR if mirrors(shape.alignment) else np.eye(4) for shape in shapes)
    return Jointly(shapes, turns, tuple(states), _without_templates(ensemble), settings)


def _without_templates(ensemble: Ensemble) -> Ensemble:
    return replace(ensemble, templates=ensemble.templates[:0], placements=ensemble.placements[:0])


def _template(result: Result, aligned: FloatArray) -> TriangleMesh:
    """Return the result's mean surface with few vertices, at the mean of the aligned particles (M, N, 3)."""
    mean = result.world.mean(axis=0)
    mesh = simplified(result.mean_surface, SURFACE_VERTICES)
    goal = aligned.mean(axis=0)
    pose = fit_similarity(mean, goal, scaling=True)
    start = transform_points(pose, mean)
    scale = scale_of(pose)
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
    """Return vertices mapped by the particles onto each surface, and the particles, (M, P, 3)."""
    mean = aligned.mean(axis=0)
    tick(0.0, "warping the mean surface")
    moves = warp_surface(mean, template.vertices, aligned - mean, np.zeros(len(mean)))
    points = np.empty((len(meshes), len(template.vertices) + len(mean), 3))
    for index, (mesh, shape, own) in enumerate(zip(meshes, aligned, particles, strict=True)):
        tick(index / len(meshes), "warping the mean surface")
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
