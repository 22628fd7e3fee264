"""A finished run on disk: particles, shape model, tables, and the record."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from homolog.arrays import FloatArray
from homolog.cohort import Cohort, sides_of
from homolog.correspondence import OptimizedParticles, Shape
from homolog.device import describe_device
from homolog.grooming import GroomedSubject
from homolog.inspection.verdict import Agreement, Verdict, judge, worst_of, write_verdict
from homolog.io.meshes import write_mesh
from homolog.io.names import file_stems
from homolog.io.particle_array import write_all_particles
from homolog.io.project import ProjectFolder
from homolog.io.records import ProjectRecord, ResultRecord, ResultStructure, ResultSubject
from homolog.io.results import surface_file
from homolog.io.tables import write_table
from homolog.memory import OnDemand
from homolog.progress import Tick, no_tick, part_of
from homolog.run.fingerprints import surface_hash, versions
from homolog.run.shape_files import surface_of_shapes, write_model, write_poses, write_surfaces
from homolog.settings import Mirror, RunSettings
from homolog.statistics.reconstruction import MeanSurface
from homolog.statistics.relative_pose import relative_poses
from homolog.statistics.shape_model import ShapeModel
from homolog.threads import blas_threads, cores, in_threads

__all__ = [
    "CANCELLED",
    "OptimizationInput",
    "OptimizationOutcome",
    "add_note",
    "add_repair_notes",
    "model_of",
    "write_result",
]

CANCELLED = "cancelled"
"""Value of `ended` for results saved from unfinished runs."""


@dataclass(frozen=True, slots=True, eq=False)
class OptimizationInput:
    """The input of an optimization.

    Attributes
    ----------
    cohort : Cohort
    settings : RunSettings
    groomed : sequence of GroomedSubject
    shapes : sequence of Shape
    fingerprint : str
        Hash of the settings and shapes.
    device : str
        Warp's device alias.
    parts : mapping of str to OptimizationInput
        The structures of subjects with several, by name; empty for a single one.
    everybody : Cohort or None
        The subjects, and those that lack some of several structures; None if there are no such.
    """

    cohort: Cohort
    settings: RunSettings
    groomed: Sequence[GroomedSubject]
    shapes: Sequence[Shape]
    fingerprint: str
    device: str
    parts: Mapping[str, "OptimizationInput"] = field(default_factory=dict)
    everybody: Cohort | None = None

    def pieces(self, counts: Sequence[int]) -> list[tuple[int, Sequence[Shape]]]:
        """Return the number of particles and the subjects' shapes of each of several structures."""
        return [
            (count, part.shapes_of([shape.name for shape in self.groomed]))
            for count, part in zip(counts, self.parts.values(), strict=True)
        ]

    def shapes_of(self, names: Sequence[str]) -> Sequence[Shape]:
        """Return the shapes of named subjects."""
        rows = {item.name: row for row, item in enumerate(self.groomed)}
        return OnDemand(len(names), lambda index: self.shapes[rows[names[index]]])


@dataclass(frozen=True, slots=True, eq=False)
class OptimizationOutcome:
    """Result of an optimization.

    Attributes
    ----------
    inputs : OptimizationInput
    world, local : (M, N, 3) float64 arrays
        Particles in aligned and in file coordinates [mm].
    alignments : (M, 4, 4) float64 array
        Similarities from local to world; reflections for mirrored subjects.
    energies : (T, 4) float64 array
        Iteration and the three terms of the objective.
    iterations : int
    ended : str
        Reason of the end; ``"cancelled"`` if the run can be resumed.
    seconds : mapping of str to float
        Time by phase.
    parts : mapping of str to OptimizationOutcome
        The structures of subjects with several, by name.
    """

    inputs: OptimizationInput
    world: FloatArray
    local: FloatArray
    alignments: FloatArray
    energies: FloatArray
    iterations: int
    ended: str
    seconds: Mapping[str, float]
    parts: Mapping[str, "OptimizationOutcome"] = field(default_factory=dict)


_MANY_REPAIRED = 0.25
_UNLIKE = (
    "more than a quarter of its particles were misplaced: it may differ too much from the others; check that "
    "all files show the same structure"
)


def add_note(groomed: GroomedSubject, note: str) -> GroomedSubject:
    """Return a subject with a further note in its report."""
    return replace(groomed, report=replace(groomed.report, notes=(*groomed.report.notes, note)))


def add_repair_notes(inputs: OptimizationInput, optimized: OptimizedParticles) -> OptimizationInput:
    """Return the inputs with a note on every subject with repaired particles."""
    if not optimized.repaired.any():
        return inputs
    counts = np.count_nonzero(optimized.repaired, axis=1)
    note = "misplaced particles (deviating normals, exchanged, or off the surface)"
    groomed = [
        add_note(item, f"{note} were repaired: {count} of {len(repaired)}") if count else item
        for item, count, repaired in zip(inputs.groomed, counts, optimized.repaired, strict=True)
    ]
    many = counts > _MANY_REPAIRED * optimized.repaired.shape[1]
    groomed = [
        add_note(item, _UNLIKE) if is_unlike else item for item, is_unlike in zip(groomed, many, strict=True)
    ]
    return replace(inputs, groomed=groomed)


def model_of(outcome: OptimizationOutcome, tick: Tick) -> tuple[ShapeModel, MeanSurface]:
    """Return the outcome's shape model and mean surface.

    Raises
    ------
    NumericalError
        If particles coincide, so that they define no warp of the surface.
    """
    shapes, world = outcome.inputs.shapes, outcome.world
    with blas_threads(len(shapes)):
        model = ShapeModel().fit(world, names=[shape.name for shape in shapes])
        pieces = outcome.inputs.pieces([part.local.shape[1] for part in outcome.parts.values()])
        return model, surface_of_shapes(model, world, shapes, outcome.alignments, pieces, tick)


def write_result(
    project: ProjectFolder,
    outcome: OptimizationOutcome,
    model: ShapeModel,
    surface: MeanSurface,
    tick: Tick,
    excluded: Mapping[str, str] | None = None,
    again: Agreement | None = None,
) -> Verdict:
    """Replace the project's last result by the outcome, after those of its structures if there are several.

    Parameters
    ----------
    project : ProjectFolder
        The project, locked by the caller.
    outcome : Outcome
    model, surface : ShapeModel, MeanSurface
        Model and mean surface of the outcome, from `model_of`.
    tick : Tick
    excluded : mapping of str to str, optional
        Reasons for the exclusion of subjects, by name.
    again : Agreement, optional
        With particles that another seed placed.

    Returns
    -------
    Verdict
        That of the structure which is worst.

    Raises
    ------
    InputError
        If the project can't be written to; its last result is then unchanged.
    """
    inputs, verdicts = outcome.inputs, dict[str, Verdict]()
    share = 1.0 / (1 + len(outcome.parts))
    for number, (name, part) in enumerate(outcome.parts.items()):
        folder, now = project.structure(name), part_of(tick, number * share, (number + 1) * share)
        have = {subject.name for subject in part.inputs.cohort.subjects}
        lacking = {name: why for name, why in (excluded or {}).items() if name not in have}
        with folder.locked():
            verdicts[name] = write_result(folder, part, *model_of(part, no_tick), now, lacking)
    tick = part_of(tick, len(outcome.parts) * share, 1.0)
    stems = file_stems([shape.name for shape in inputs.shapes])
    with project.replacing_result() as new, blas_threads(len(inputs.shapes)):
        _write_subjects(new, project, outcome, stems, part_of(tick, 0.0, 0.6))
        tick(0.6, "shape model")
        write_model(new, inputs.cohort, model)
        if inputs.parts:
            names = list(inputs.parts)
            reference = inputs.settings.optimize.align_by or names[0]
            ends = np.cumsum([part.local.shape[1] for part in outcome.parts.values()])[:-1]
            own = np.split(outcome.world, ends, axis=1)
            poses = relative_poses(own, names, names.index(reference))
            write_poses(new, [shape.name for shape in inputs.shapes], poses)
        write_surfaces(new, model, surface, part_of(tick, 0.7, 0.8))
        surfaces = OnDemand(
            len(inputs.shapes), lambda index: inputs.shapes[index].mesh.placed(outcome.alignments[index])
        )
        verdict = (
            worst_of(verdicts)
            if verdicts
            else judge(
                outcome.world,
                surfaces,
                alignments=outcome.alignments,
                again=again,
                tick=part_of(tick, 0.8, 1.0),
            )
        )
        write_verdict(new, verdict, outcome.world)
        write_table(
            new.folder / "energies.csv",
            ["iteration", "sampling", "ensemble", "normals"],
            ([int(row[0]), *row[1:]] for row in outcome.energies.tolist()),
        )
        new.write(
            ProjectRecord(
                subjects=project.describe(inputs.everybody or inputs.cohort),
                settings=inputs.settings,
                unfinished=outcome.ended == CANCELLED,
                excluded=dict(excluded or {}),
                result=_record(outcome, stems, surface, list((excluded or {}).values())),
            )
        )
    return verdict


def _write_subjects(
    new: ProjectFolder, project: ProjectFolder, outcome: OptimizationOutcome, stems: Sequence[str], tick: Tick
) -> None:
    write_all_particles(new, stems, outcome.local, outcome.world, part_of(tick, 0.0, 0.5))
    tick, shapes = part_of(tick, 0.5, 1.0), outcome.inputs.shapes

    def write(index: int) -> None:
        write_mesh(surface_file(project, stems[index]), shapes[index].mesh)

    for index, _ in enumerate(in_threads(write, range(len(shapes)), cores())):
        tick(index / len(stems), f"writing {shapes[index].name}")


def _record(
    outcome: OptimizationOutcome, stems: Sequence[str], surface: MeanSurface, excluded: list[str]
) -> ResultRecord:
    inputs = outcome.inputs
    mirror = inputs.settings.groom.mirror
    sides: Mapping[str, Any] = {} if mirror is Mirror.OFF else sides_of(inputs.cohort)
    subjects = [
        ResultSubject(
            name=subject.name,
            file=stem,
            group=subject.group,
            columns=dict(subject.columns),
            side=sides.get(subject.name, ""),
            content=surface_hash(shape),
            alignment=alignment.tolist(),
            notes=list(groomed.report.notes),
            spacing=0.0 if shape.field is None else round(shape.field.spacing, 6),
            vertices=len(shape.mesh.vertices),
            voxel=[round(edge, 6) for edge in groomed.report.voxel],
        )
        for subject, stem, shape, alignment, groomed in zip(
            inputs.cohort.subjects, stems, inputs.shapes, outcome.alignments, inputs.groomed, strict=True
        )
    ]
    return ResultRecord(
        finished=datetime.now(UTC).isoformat(timespec="seconds"),
        ended=outcome.ended,
        iterations=outcome.iterations,
        particles=outcome.world.shape[1],
        metric="geodesic" if inputs.settings.optimize.method.uses_geodesics else "euclidean",
        folded_faces=surface.folded,
        smoothed_particles=surface.smoothed,
        settings=inputs.settings,
        device=describe_device(inputs.device),
        versions=versions(),
        seconds=dict(outcome.seconds),
        fingerprint=inputs.fingerprint,
        excluded=excluded,
        subjects=subjects,
        structures=[
            ResultStructure(name=name, particles=_length(own), vertices=_length(near))
            for name, (own, near) in zip(inputs.parts, surface.parts, strict=True)
        ],
    )


def _length(rows: slice) -> int:
    return int(rows.stop - rows.start)
