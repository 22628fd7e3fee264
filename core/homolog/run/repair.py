"""Repair of a result: some particles are optimized again, and the result is replaced."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from homolog.arrays import BoolArray, FloatArray
from homolog.cohort import Cohort, Subject
from homolog.correspondence import Shape, repair
from homolog.device import choose_device, device_faults
from homolog.errors import InputError
from homolog.files.arrays import read_arrays
from homolog.files.project import ProjectFolder
from homolog.files.records import ResultRecord, ResultSubject
from homolog.geometry import transform_points
from homolog.grooming import GroomedSubject
from homolog.grooming.cache import load_groomed
from homolog.progress import Tick, no_tick, part_of
from homolog.run.result import OptimizationInput, OptimizationOutcome, add_note, model_of, write_result

__all__ = ["read_inputs", "repair_result", "write_repaired"]


def read_inputs(project: ProjectFolder) -> OptimizationInput:
    """Return the inputs of the project's optimization; input files are not needed.

    Raises
    ------
    InputError
        If there is no result, or the groomed surface of a subject is missing or damaged.
    """
    record = project.read()
    result = record.result
    if result is None:
        raise InputError(f"{project.folder}: has no result; run it first")
    groomed = [_groomed(project, subject) for subject in result.subjects]
    shapes = [
        Shape(item.name, item.field, item.mesh, item.coarse_mesh, np.array(subject.alignment))
        for item, subject in zip(groomed, result.subjects, strict=True)
    ]
    device = choose_device(result.settings.device)
    return OptimizationInput(
        _cohort(project, result), result.settings, groomed, shapes, result.fingerprint, device
    )


def repair_result(
    inputs: OptimizationInput,
    local: FloatArray,
    movable: BoolArray,
    misplaced: BoolArray,
    tick: Tick = no_tick,
) -> FloatArray:
    """Optimize some particles of a result again; the others stay as they are.

    Parameters
    ----------
    inputs : OptimizationInput
        As `read_inputs` gives it.
    local : (M, N, 3) array
        All particles in file coordinates [mm].
    movable, misplaced : (M, N) bool arrays
        Those that may move, and those of them that are not trusted: they begin where the other subjects
        predict them.
    tick : Tick

    Returns
    -------
    (M, N, 3) array
        The particles in file coordinates [mm].
    """
    with device_faults(inputs.device):
        return repair(
            inputs.shapes,
            inputs.settings.placing,
            local,
            movable,
            misplaced=misplaced,
            device=inputs.device,
            tick=tick,
        ).local


def write_repaired(
    project: ProjectFolder, local: FloatArray, notes: Mapping[str, str], tick: Tick = no_tick
) -> None:
    """Replace the particles of the project's result, with a new shape model.

    Parameters
    ----------
    project : ProjectFolder
    local : (M, N, 3) array
        Particles in file coordinates [mm].
    notes : mapping of str to str
        Notes on subjects, by name, stored with the result.
    tick : Tick

    Raises
    ------
    InputError
        If the project can't be written to or is in use; its result is then unchanged.
    """
    with project.locked(new=False):
        before = project.read()
        inputs = read_inputs(project)
        groomed = [
            add_note(item, notes[item.name]) if item.name in notes else item for item in inputs.groomed
        ]
        assert before.result is not None, "a study was read"
        alignments = np.stack([shape.alignment for shape in inputs.shapes])
        world = transform_points(alignments, local)
        outcome = OptimizationOutcome(
            replace(inputs, groomed=groomed),
            world,
            local,
            alignments,
            np.loadtxt(project.folder / "energies.csv", delimiter=",", skiprows=1, ndmin=2),
            before.result.iterations,
            before.result.ended,
            before.result.seconds,
        )
        model, surface = model_of(outcome, part_of(tick, 0.0, 0.5))
        write_result(project, outcome, model, surface, part_of(tick, 0.5, 1.0), before.excluded)
        next_run = {"subjects": before.subjects, "settings": before.settings, "unfinished": before.unfinished}
        project.write(project.read().model_copy(update=next_run))


def _groomed(project: ProjectFolder, subject: ResultSubject) -> GroomedSubject:
    """Return a subject's groomed archive, regardless of its present input file."""
    path = project.groomed / f"{subject.file}.npz"
    groomed = load_groomed(project.groomed, subject.name, str(read_arrays(path).get("key")))
    if groomed is None:
        raise InputError(f"{path}: is damaged; groom and run again")
    return groomed


def _cohort(project: ProjectFolder, result: ResultRecord) -> Cohort:
    paths = {subject.name: subject.path for subject in project.cohort().subjects}
    subjects = [
        Subject(subject.name, paths.get(subject.name, project.folder), subject.group, subject.columns)
        for subject in result.subjects
    ]
    return Cohort(tuple(subjects), project.folder)
