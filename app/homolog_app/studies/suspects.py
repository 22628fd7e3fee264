"""Suspects of a project's result: inspection, table, repair; for window and command line."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from homolog.errors import InputError
from homolog.files.atomic import write_text
from homolog.files.project import ProjectFolder
from homolog.files.records import IMPORTED
from homolog.files.results import Result, read_result, read_surface
from homolog.files.tables import write_table
from homolog.inspection import Inspection, Suspect, assess, inspect, locate_particles
from homolog.progress import Tick, no_tick, part_of
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import check_mesh

__all__ = ["COLUMNS", "inspect_project", "repaired", "rows", "write_suspects"]


COLUMNS = ("kind", "subject", "severity", "particles", "x_mm", "y_mm", "z_mm", "area_mm2", "words")
"""Columns of the table; x, y and z are the location in the coordinates of the subject's file."""

Row = tuple[str, str, float, str, float, float, float, float, str]


def inspect_project(project: ProjectFolder, tick: Tick = no_tick) -> tuple[Result, Inspection]:
    """Find suspects in a project's result.

    Raises
    ------
    InputError
        If there is no result, a file of it is damaged, it has fewer than three subjects, or a subject that
        was imported came without a surface.
    """
    result, record = read_result(project), project.read().result
    assert record is not None, "a result was read"
    meshes = [read_surface(project, subject) for subject in record.subjects]
    if record.ended == IMPORTED:
        _check_surfaces(result.names, meshes)
    return result, inspect(result.local, meshes, result.alignments, names=result.names, tick=tick)


def _check_surfaces(names: Sequence[str], meshes: Sequence[TriangleMesh]) -> None:
    for name, mesh in zip(names, meshes, strict=True):
        try:
            check_mesh(mesh, name)
        except InputError as error:
            raise InputError(
                f"{name}: was imported without a surface, which the check needs; import the model with its "
                "surfaces"
            ) from error


def repaired(
    project: ProjectFolder, inspection: Inspection, suspect: Suspect, tick: Tick = no_tick
) -> Inspection:
    """Optimize the particles of a suspect and two rings around them again; nothing is written.

    Returns
    -------
    Inspection
        Of the new particles: ``located.local`` and ``located.world``; or `inspection` itself, with the
        previous particles, if the new ones are not better: if the severities of the subject's suspects do
        not sum to less, or the place has a suspect that is at least as severe.
    """
    from homolog.inspection import Kind
    from homolog.run.repair import read_inputs, repair_result

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
    here = [s.severity for s in new if np.isin(s.particles, suspect.particles).any()]
    lower = sum(s.severity for s in new) < sum(s.severity for s in old)
    return lower and max(here, default=0.0) < suspect.severity


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


def write_suspects(path: Path, table: Sequence[Row]) -> None:
    """Write a table as CSV, or as a list of objects if the file's name ends in ``.json``.

    Raises
    ------
    InputError
        If the name ends otherwise, or the file can't be written.
    """
    if path.suffix.lower() == ".csv":
        write_table(path, COLUMNS, table)
    elif path.suffix.lower() == ".json":
        objects = [dict(zip(COLUMNS, row, strict=True)) for row in table]
        write_text(path, json.dumps(objects, indent=2, ensure_ascii=False) + "\n")
    else:
        raise InputError(f"{path}: use a name that ends in .csv or .json")
