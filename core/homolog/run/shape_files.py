"""A shape model on disk: its tables, mean surface, and surfaces of its main modes."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from homolog.arrays import FloatArray
from homolog.cohort import Cohort
from homolog.correspondence import Shape
from homolog.io.meshes import write_mesh
from homolog.io.particles import write_particles
from homolog.io.project import ProjectFolder
from homolog.io.results import MODE_DEVIATIONS, mean_file, mode_file, write_smoothing
from homolog.io.tables import write_table
from homolog.memory import OnDemand
from homolog.progress import Tick, no_tick, part_of
from homolog.statistics.reconstruction import MeanSurface, mean_surface, medoid, warp_surface
from homolog.statistics.relative_pose import RelativePoses
from homolog.statistics.shape_model import ShapeModel
from homolog.surfaces.mesh import TriangleMesh
from homolog.threads import cores, in_threads

__all__ = [
    "mesh_of",
    "surface_of_model",
    "surface_of_shapes",
    "surface_of_structures",
    "write_model",
    "write_poses",
    "write_surfaces",
]

_SHOWN_SHARE = 0.95
_LEAST_SHOWN, _MOST_SHOWN = 3, 5


def surface_of_model(
    model: ShapeModel,
    world: FloatArray,
    meshes: Sequence[TriangleMesh],
    alignments: FloatArray,
    tick: Tick = no_tick,
) -> MeanSurface:
    """Return the mean surface of a model, without folds along the displayed modes.

    Parameters
    ----------
    model : ShapeModel
    world : (M, N, 3) array
        Aligned particles of its subjects, or of those that have a mesh [mm].
    meshes : sequence of M TriangleMesh
        Their meshes in file coordinates; the one nearest to the mean is warped to the mean.
    alignments : (M, 4, 4) array
        From file coordinates to aligned ones.
    tick : Tick

    Returns
    -------
    MeanSurface

    Raises
    ------
    NumericalError
        If particles coincide, so that they define no warp of the surface.
    """
    return _surface(model.mean_, _moves(model), world, meshes, alignments, tick)


def _surface(
    mean: FloatArray,
    moves: FloatArray,
    world: FloatArray,
    meshes: Sequence[TriangleMesh],
    alignments: FloatArray,
    tick: Tick,
) -> MeanSurface:
    nearest = medoid(world, mean)
    mesh = meshes[nearest].placed(alignments[nearest])
    return mean_surface(mean, world[nearest], mesh.vertices, mesh.faces, moves=moves, tick=tick)


def mesh_of(surface: MeanSurface) -> TriangleMesh:
    """Return a mean surface as a mesh, which knows its structures."""
    return TriangleMesh(surface.vertices, surface.faces, tuple(part.stop for _, part in surface.parts))


def surface_of_shapes(
    model: ShapeModel,
    world: FloatArray,
    shapes: Sequence[Shape],
    alignments: FloatArray,
    parts: Sequence[tuple[int, Sequence[Shape]]] = (),
    tick: Tick = no_tick,
) -> MeanSurface:
    """Return the mean surface of a model of shapes, or of their structures as separate pieces.

    Parameters
    ----------
    model, world, alignments, tick
        As in `surface_of_model`.
    shapes : sequence of M Shape
    parts : sequence of (int, sequence of M Shape)
        For each of several structures, its number of particles and its shapes.
    """
    if not parts:
        return surface_of_model(model, world, _meshes(shapes), alignments, tick)
    return surface_of_structures(
        model, world, [(count, _meshes(those)) for count, those in parts], alignments, tick
    )


def surface_of_structures(
    model: ShapeModel,
    world: FloatArray,
    parts: Sequence[tuple[int, Sequence[TriangleMesh]]],
    alignments: FloatArray,
    tick: Tick = no_tick,
) -> MeanSurface:
    """Return the mean surface of several structures as separate pieces.

    Parameters
    ----------
    model, world, alignments, tick
        As in `surface_of_model`.
    parts : sequence of (int, sequence of M TriangleMesh)
        For each structure, its number of particles and its meshes.
    """
    moves, surfaces, begin = _moves(model), list[MeanSurface](), 0
    for number, (count, meshes) in enumerate(parts):
        own, begin = slice(begin, begin + count), begin + count
        now = part_of(tick, number / len(parts), (number + 1) / len(parts))
        surfaces.append(_surface(model.mean_[own], moves[:, own], world[:, own], meshes, alignments, now))
    return MeanSurface.joined(surfaces)


def _meshes(shapes: Sequence[Shape]) -> Sequence[TriangleMesh]:
    return OnDemand(len(shapes), lambda index: shapes[index].mesh)


def write_model(new: ProjectFolder, cohort: Cohort, model: ShapeModel) -> None:
    """Write the tables of a shape model; scores are the root mean square over the particles.

    Parameters
    ----------
    new : ProjectFolder
        The new project folder, from `ProjectFolder.replacing_result`.
    cohort : Cohort
        The subjects.
    model : ShapeModel
        Shape model of the subjects.
    """
    modes = [f"mode_{number}" for number in range(1, len(model.explained_variance_) + 1)]
    write_table(
        new.model / "scores.csv",
        ["name", "group", *(f"{mode}_rms_mm" for mode in modes)],
        (
            [subject.name, subject.group, *scores]
            for subject, scores in zip(cohort.subjects, model.scores_.tolist(), strict=True)
        ),
    )
    write_table(
        new.model / "eigenvalues.csv",
        ["mode", "eigenvalue_mm2", "standard_deviation_rms_mm", "share", "cumulative_share"],
        zip(
            range(1, len(modes) + 1),
            (len(model.mean_) * model.explained_variance_).tolist(),
            model.standard_deviations_.tolist(),
            model.explained_variance_ratio_.tolist(),
            np.cumsum(model.explained_variance_ratio_).tolist(),
            strict=True,
        ),
    )
    flat = model.components_.reshape(len(modes), model.mean_.size).T.tolist()
    write_table(
        new.model / "eigenvectors.csv",
        ["particle", "axis", *modes],
        ([row // 3, "xyz"[row % 3], *values] for row, values in enumerate(flat)),
    )
    write_particles(new.model / "mean.particles", model.mean_)


def write_poses(new: ProjectFolder, names: Sequence[str], poses: RelativePoses) -> None:
    """Write how structures lie to each other in M named subjects, and components of pose and shape."""
    xyz = [
        *(f"rotation_{axis}_deg" for axis in "xyz"),
        *(f"translation_{axis}_mm" for axis in "xyz"),
    ]
    write_table(
        new.model / "pose.csv",
        ["name", "structure", "reference", "angle_deg", *xyz, "relative_size"],
        (
            [
                name,
                structure,
                poses.names[poses.reference],
                float(np.linalg.norm(poses.rotations[row, column])),
                *poses.rotations[row, column].tolist(),
                *poses.translations[row, column].tolist(),
                float(poses.sizes[row, column]),
            ]
            for row, name in enumerate(names)
            for column, structure in enumerate(poses.names)
        ),
    )
    parts = poses.components()
    total, deviations = parts.variances.sum(), parts.standard_deviations
    squares = np.square(deviations)
    write_table(
        new.model / "components.csv",
        ["component", "standard_deviation_rms_mm", "share", *parts.parts],
        [
            ["all", float(np.sqrt(total)), 1.0, *(parts.variances / total).tolist()],
            *(
                [number + 1, float(deviations[number]), float(squares[number] / total), *row]
                for number, row in enumerate(parts.shares.tolist())
            ),
        ],
    )


def write_surfaces(new: ProjectFolder, model: ShapeModel, surface: MeanSurface, tick: Tick) -> None:
    """Write the mean surface, and the surfaces of the main modes.

    Parameters
    ----------
    new : ProjectFolder
        The new project folder, from `ProjectFolder.replacing_result`.
    model : ShapeModel
        The model whose modes are written.
    surface : MeanSurface
        The mean, from `surface_of_model`.
    tick : Tick
        Progress and cancellation.
    """
    _write_surface(mean_file(new), mesh_of(surface))
    if surface.smoothed:
        write_smoothing(new, surface.smoothing)
    moves = surface.moved
    if moves is None:
        moves = warp_surface(model.mean_, surface.vertices, _moves(model), surface.smoothing, surface.parts)

    def write(mode: int) -> None:
        for sign, side in ((-1.0, "minus"), (1.0, "plus")):
            mesh = TriangleMesh(surface.vertices + sign * moves[mode], surface.faces)
            _write_surface(mode_file(new, mode, side), mesh)

    for mode, _ in enumerate(in_threads(write, range(len(moves)), cores())):
        tick(mode / len(moves), f"surfaces of mode {mode + 1}")


def _moves(model: ShapeModel) -> FloatArray:
    """Displacements of the particles along the displayed modes, (K, N, 3) [mm]."""
    enough = int(np.searchsorted(np.cumsum(model.explained_variance_ratio_), _SHOWN_SHARE)) + 1
    shown = min(max(enough, _LEAST_SHOWN), _MOST_SHOWN)
    moves: FloatArray = (
        MODE_DEVIATIONS * model.standard_deviations_[:shown, None, None] * model.components_[:shown]
    )
    return moves


def _write_surface(path: Path, mesh: TriangleMesh) -> None:
    """Write a surface twice: VTP for Homolog and 3D Slicer, PLY for other programs."""
    write_mesh(path, mesh)
    write_mesh(path.with_suffix(".ply"), mesh)
