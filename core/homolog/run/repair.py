"""Suspects of a result: search, table and repair, and replacement of the result."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from homolog.arrays import BoolArray, FloatArray
from homolog.cohort import Cohort, Subject
from homolog.correspondence import Shape, repair
from homolog.device import choose_device, device_faults
from homolog.errors import InputError
from homolog.geometry import transform_points
from homolog.grooming import GroomedSubject
from homolog.grooming.cache import load_groomed
from homolog.inspection import Inspection, Kind, Suspect, assess, inspect, locate_particles
from homolog.io.arrays import read_arrays
from homolog.io.atomic import write_text
from homolog.io.project import ProjectFolder
from homolog.io.records import IMPORTED, ResultRecord, ResultSubject
from homolog.io.results import Result, read_energies, read_result, read_surface
from homolog.io.tables import write_table
from homolog.progress import Tick, no_tick, part_of
from homolog.run.result import OptimizationInput, OptimizationOutcome, add_note, model_of, write_result
from homolog.run.structures import joined_subject
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import check_mesh
from homolog.threads import cores

__all__ = [
    "COLUMNS",
    "inspect_project",
    "read_inputs",
    "repair_result",
    "repaired",
    "rows",
    "write_repaired",
    "write_suspects",
]

COLUMNS = ("kind", "subject", "severity", "particles", "x_mm", "y_mm", "z_mm", "area_mm2", "words")
"""Columns of the table; x, y and z are the location in the coordinates of the subject's file."""

Row = tuple[str, str, float, str, float, float, float, float, str]


def inspect_project(
    project: ProjectFolder, tick: Tick = no_tick, *, workers: int | None = None
) -> dict[str, tuple[Result, Inspection]]:
    """Find suspects in a project's result, by structure; "" for a single one.

    Parameters
    ----------
    project : ProjectFolder
    tick : Tick
    workers : int, optional
        Largest number of processes; one per core by default.

    Raises
    ------
    InputError
        If there is no result, one of its files is damaged, it has fewer than three subjects, or a subject was
        imported without a surface.
    """
    result, record = read_result(project), project.read().result
    assert record is not None, "a result was read"
    if record.structures:
        share = 1.0 / len(record.structures)
        return {
            item.name: inspect_project(
                project.structure(item.name),
                part_of(tick, number * share, (number + 1) * share),
                workers=workers,
            )[""]
            for number, item in enumerate(record.structures)
        }
    meshes = [read_surface(project, subject) for subject in record.subjects]
    if record.ended == IMPORTED:
        _check_surfaces(result.names, meshes)
    inspection = inspect(
        result.local,
        meshes,
        result.alignments,
        names=result.names,
        workers=workers or cores(),
        tick=tick,
    )
    return {"": (result, inspection)}


def _check_surfaces(names: Sequence[str], meshes: Sequence[TriangleMesh]) -> None:
    for name, mesh in zip(names, meshes, strict=True):
        try:
            check_mesh(mesh, name, may_open=True)
        except InputError as error:
            raise InputError(
                f"{name}: was imported without a surface, which the check needs; import the model with its "
                "surfaces"
            ) from error


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
    parts = {item.name: read_inputs(project.structure(item.name)) for item in result.structures}
    archives = {name: {item.name: item for item in part.groomed} for name, part in parts.items()}
    groomed = [
        joined_subject({name: own[subject.name] for name, own in archives.items()})
        if archives
        else _groomed(project, subject)
        for subject in result.subjects
    ]
    shapes = [
        Shape(item.name, item.field, item.mesh, item.coarse_mesh, np.array(subject.alignment))
        for item, subject in zip(groomed, result.subjects, strict=True)
    ]
    device = choose_device(result.settings.device)
    return OptimizationInput(
        _cohort(project, result), result.settings, groomed, shapes, result.fingerprint, device, parts
    )


def repair_result(
    inputs: OptimizationInput,
    local: FloatArray,
    movable: BoolArray,
    misplaced: BoolArray,
    tick: Tick = no_tick,
) -> FloatArray:
    """Optimize some particles of a result again; the others are fixed.

    Parameters
    ----------
    inputs : OptimizationInput
        Input from `read_inputs`.
    local : (M, N, 3) array
        All particles in file coordinates [mm].
    movable, misplaced : (M, N) bool arrays
        Particles that may move, and the misplaced ones among them, which start at the positions predicted by
        the other subjects.
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


def repaired(
    project: ProjectFolder, inspection: Inspection, suspect: Suspect, tick: Tick = no_tick
) -> Inspection:
    """Optimize the particles of a suspect and two rings around them again; nothing is written.

    Returns
    -------
    Inspection
        The inspection of the new particles (``located.local`` and ``located.world``), or `inspection` itself
        if the new particles are not better. They are better if the severities of the subject's suspects have
        a smaller sum, and no suspect at the same place is at least as severe.
    """
    located, m = inspection.located, suspect.subject
    tick(0.0, "reading surfaces")
    inputs = read_inputs(project)
    misplaced = np.zeros(located.world.shape[:2], dtype=bool)
    if suspect.kind is not Kind.UNCOVERED:
        misplaced[m, suspect.particles] = True
    local = repair_result(
        inputs, located.local, inspection.movable(suspect), misplaced, part_of(tick, 0.0, 0.9)
    )
    name = inputs.shapes[m].name
    subject = locate_particles(
        local[m : m + 1], located.meshes[m : m + 1], located.alignments[m : m + 1], names=[name]
    )
    after = assess(located.with_subject(m, subject), part_of(tick, 0.95, 1.0))
    return after if _is_better(inspection, after, suspect) else inspection


def _is_better(before: Inspection, after: Inspection, suspect: Suspect) -> bool:
    old, new = ([s for s in item.suspects if s.subject == suspect.subject] for item in (before, after))
    severities = [s.severity for s in new if np.isin(s.particles, suspect.particles).any()]
    lower = sum(s.severity for s in new) < sum(s.severity for s in old)
    return lower and max(severities, default=0.0) < suspect.severity


def rows(inspection: Inspection, suspects: Sequence[Suspect], names: Sequence[str]) -> list[Row]:
    """Return the table rows of suspects, in the order of `COLUMNS`."""
    table: list[Row] = []
    for suspect in suspects:
        inverse = np.linalg.inv(inspection.located.alignments[suspect.subject])
        x, y, z = (inverse[:3, :3] @ suspect.place + inverse[:3, 3]).round(3).tolist()
        particles = " ".join(map(str, suspect.particles.tolist()))
        severity, area = round(suspect.severity, 3), round(suspect.area, 3)
        table.append(
            (
                suspect.kind.value,
                names[suspect.subject],
                severity,
                particles,
                x,
                y,
                z,
                area,
                suspect.description,
            )
        )
    return table


def write_suspects(path: Path, tables: Mapping[str, Sequence[Row]]) -> None:
    """Write the rows of each structure as CSV, or as a list of objects if the name ends in ``.json``.

    Several structures have a column ``structure``; a single one is named "".

    Raises
    ------
    InputError
        If the name has another suffix, or the file can't be written.
    """
    several = "" not in tables
    columns = (*COLUMNS, "structure") if several else COLUMNS
    table = [(*row, name) if several else row for name, own in tables.items() for row in own]
    if path.suffix.lower() == ".csv":
        write_table(path, columns, table)
    elif path.suffix.lower() == ".json":
        objects = [dict(zip(columns, row, strict=True)) for row in table]
        write_text(path, json.dumps(objects, indent=2, ensure_ascii=False) + "\n")
    else:
        raise InputError(f"{path}: use a name that ends in .csv or .json")


def write_repaired(
    project: ProjectFolder,
    local: Mapping[str, FloatArray],
    notes: Mapping[str, str],
    tick: Tick = no_tick,
) -> None:
    """Replace the particles of the project's result, with a new shape model.

    Parameters
    ----------
    project : ProjectFolder
    local : mapping of str to (M, N, 3) array
        Particles in file coordinates by structure, "" for a single one [mm].
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
        outcome = _outcome(project, read_inputs(project), local, notes)
        model, surface = model_of(outcome, part_of(tick, 0.0, 0.5))
        write_result(project, outcome, model, surface, part_of(tick, 0.5, 1.0), before.excluded)
        next_run = {"subjects": before.subjects, "settings": before.settings, "unfinished": before.unfinished}
        project.write(project.read().model_copy(update=next_run))


def _outcome(
    project: ProjectFolder,
    inputs: OptimizationInput,
    particles: Mapping[str, FloatArray],
    notes: Mapping[str, str],
    name: str = "",
) -> OptimizationOutcome:
    """Return a result with other particles, and those of its structures."""
    record = project.read().result
    assert record is not None, "a study was read"
    parts = {
        part: _outcome(project.structure(part), own, particles, notes, part)
        for part, own in inputs.parts.items()
    }
    names = [item.name for item in inputs.groomed]
    own = [
        part.local[[[item.name for item in part.inputs.groomed].index(subject) for subject in names]]
        for part in parts.values()
    ]
    local = np.concatenate(own, axis=1) if own else particles[name]
    groomed = [add_note(item, notes[item.name]) if item.name in notes else item for item in inputs.groomed]
    alignments = np.stack([shape.alignment for shape in inputs.shapes])
    return OptimizationOutcome(
        replace(inputs, groomed=groomed),
        transform_points(alignments, local),
        local,
        alignments,
        read_energies(project),
        record.iterations,
        record.ended,
        record.seconds,
        parts,
    )


def _groomed(project: ProjectFolder, subject: ResultSubject) -> GroomedSubject:
    """Return a subject's groomed archive, regardless of its current input file."""
    path = project.groomed / f"{subject.file}.npz"
    groomed = load_groomed(project.groomed, subject.name, str(read_arrays(path).get("key")))
    if groomed is None:
        raise InputError(f"{path}: is damaged; groom and run again")
    return groomed


def _cohort(project: ProjectFolder, result: ResultRecord) -> Cohort:
    known = {subject.name: subject for subject in project.cohort().subjects}
    subjects = [
        replace(
            known.get(subject.name, Subject(subject.name, project.folder)),
            group=subject.group,
            columns=subject.columns,
        )
        for subject in result.subjects
    ]
    return Cohort(tuple(subjects), project.folder)
