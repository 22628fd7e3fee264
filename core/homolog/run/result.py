"""A finished run on disk: particles, shape model, tables, and the record of how they came about."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from homolog.analysis.reconstruction import MeanSurface
from homolog.analysis.shape_model import ShapeModel
from homolog.arrays import BoolArray, FloatArray
from homolog.cohort import Cohort, sides_of
from homolog.correspondence import OptimizedParticles, Shape
from homolog.device import describe_device
from homolog.files.meshes import write_mesh
from homolog.files.names import file_stems
from homolog.files.particles import write_particles
from homolog.files.project import Project
from homolog.files.records import ProjectRecord, ResultRecord, ResultSubject
from homolog.files.results import particle_file, surface_file
from homolog.files.tables import write_table
from homolog.grooming import GroomedSubject
from homolog.progress import Tick, part_of
from homolog.run.identity import content_of, versions
from homolog.run.shape_files import surface_of_model, write_model, write_surfaces
from homolog.settings import Mirror, RunSettings

__all__ = [
    "CANCELLED",
    "Outcome",
    "Study",
    "model_of",
    "noted",
    "with_repairs",
    "write_result",
]

CANCELLED = "cancelled"
"""How a result `ended` that was kept although its run was not done."""


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """What an optimization starts from.

    Attributes
    ----------
    cohort : Cohort
    settings : RunSettings
    groomed : sequence of GroomedSubject
    shapes : sequence of Shape
    fingerprint : str
        Of the settings and shapes.
    device : str
        Warp alias.
    """

    cohort: Cohort
    settings: RunSettings
    groomed: Sequence[GroomedSubject]
    shapes: Sequence[Shape]
    fingerprint: str
    device: str


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What it has come to.

    Attributes
    ----------
    study : Study
    world, local : (M, N, 3) float64 arrays
        Particles in aligned and in file coordinates [mm].
    alignments : (M, 4, 4) float64 array
        Similarities from local to world; reflections for mirrored subjects.
    energies : (T, 4) float64 array
        Iteration and the three parts of the objective.
    iterations : int
    ended : str
        Why; ``"cancelled"`` if it can be resumed.
    seconds : mapping of str to float
        Time by phase.
    """

    study: Study
    world: FloatArray
    local: FloatArray
    alignments: FloatArray
    energies: FloatArray
    iterations: int
    ended: str
    seconds: Mapping[str, float]


def noted(groomed: GroomedSubject, note: str) -> GroomedSubject:
    """Return a subject with one more note in its report."""
    return replace(groomed, report=replace(groomed.report, notes=(*groomed.report.notes, note)))


def with_repairs(study: Study, found: OptimizedParticles) -> Study:
    """Return the study with a note on every subject whose particles were repaired, if any were."""
    if not found.repaired.any():
        return study
    subjects: BoolArray = np.any(found.repaired > 0, axis=1)
    objective = found.energies[:, 1:].sum(axis=1)
    first = found.repaired[found.repaired > 0].min()
    before = objective[np.searchsorted(found.energies[:, 0], first)]
    note = (
        "misplaced particles (normals that disagreed with most subjects, exchanged, or off the surface) were "
        f"repaired: {np.count_nonzero(found.repaired)} on {subjects.sum()} subjects in total "
        f"(objective {before:.4f} at the first repair, {objective[-1]:.4f} at the end)"
    )
    groomed = [noted(one, note) if odd else one for one, odd in zip(study.groomed, subjects, strict=True)]
    return replace(study, groomed=groomed)


def model_of(outcome: Outcome, tick: Tick) -> tuple[ShapeModel, MeanSurface]:
    """Return the outcome's shape model and the surface that follows it.

    Raises
    ------
    NumericalError
        If particles coincide, so that no surface can be carried by them.
    """
    shapes, world = outcome.study.shapes, outcome.world
    model = ShapeModel.fit(world, names=[one.name for one in shapes])
    meshes = [one.mesh for one in shapes]
    return model, surface_of_model(model, world, meshes, outcome.alignments, tick)


def write_result(
    project: Project, outcome: Outcome, model: ShapeModel, surface: MeanSurface, tick: Tick
) -> None:
    """Let the outcome take the place of the project's last result.

    Parameters
    ----------
    project : Project
        Locked by the caller.
    outcome : Outcome
    model, surface : ShapeModel, MeanSurface
        As `model_of` made them.
    tick : Tick

    Raises
    ------
    InputError
        If the project can't be written to; its last result is then as it was.
    """
    study = outcome.study
    stems = file_stems([one.name for one in study.shapes])
    with project.replacing_result() as new:
        _write_subjects(new, project, outcome, stems, part_of(tick, 0.0, 0.6))
        tick(0.6, "shape model")
        write_model(new, study.cohort, model)
        write_surfaces(new, model, surface, part_of(tick, 0.7, 1.0))
        write_table(
            new.folder / "energies.csv",
            ["iteration", "sampling", "ensemble", "normals"],
            ([int(row[0]), *row[1:]] for row in outcome.energies.tolist()),
        )
        new.write(
            ProjectRecord(
                subjects=project.describe(study.cohort),
                settings=study.settings,
                unfinished=outcome.ended == CANCELLED,
                result=_record(outcome, stems, surface),
            )
        )


def _write_subjects(
    new: Project, project: Project, outcome: Outcome, stems: Sequence[str], tick: Tick
) -> None:
    for index, (stem, shape) in enumerate(zip(stems, outcome.study.shapes, strict=True)):
        tick(index / len(stems), f"writing {shape.name}")
        write_particles(particle_file(new, stem, "local"), outcome.local[index])
        write_particles(particle_file(new, stem, "world"), outcome.world[index])
        write_mesh(surface_file(project, stem), shape.mesh)


def _record(outcome: Outcome, stems: Sequence[str], surface: MeanSurface) -> ResultRecord:
    study = outcome.study
    mirror = study.settings.groom.mirror
    sides: Mapping[str, Any] = {} if mirror is Mirror.OFF else sides_of(study.cohort).of
    subjects = [
        ResultSubject(
            name=subject.name,
            file=stem,
            group=subject.group,
            columns=dict(subject.columns),
            side=sides.get(subject.name, ""),
            content=content_of(shape),
            alignment=alignment.tolist(),
            notes=list(groomed.report.notes),
        )
        for subject, stem, shape, alignment, groomed in zip(
            study.cohort.subjects, stems, study.shapes, outcome.alignments, study.groomed, strict=True
        )
    ]
    return ResultRecord(
        finished=datetime.now(UTC).isoformat(timespec="seconds"),
        ended=outcome.ended,
        iterations=outcome.iterations,
        particles=outcome.world.shape[1],
        metric="geodesic" if study.settings.optimize.method.uses_geodesics else "euclidean",
        folded_faces=surface.folded,
        smoothed_particles=surface.smoothed,
        settings=study.settings,
        device=describe_device(study.device),
        versions=versions(),
        seconds=dict(outcome.seconds),
        fingerprint=study.fingerprint,
        subjects=subjects,
    )
