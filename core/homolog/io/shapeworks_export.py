"""A Homolog project as a ShapeWorks project: ``NAME.swproj``, its particles and surfaces next to it."""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from homolog.arrays import FloatArray
from homolog.cohort import column_of
from homolog.errors import InputError
from homolog.io.atomic import atomic_write, write_text
from homolog.io.bounded import read_json
from homolog.io.constraints import COLUMN, cut_column, parse_cuts, write_planes
from homolog.io.names import file_stems
from homolog.io.particles import write_particles
from homolog.io.project import ProjectFolder
from homolog.io.records import ResultRecord, ResultSubject
from homolog.io.results import read_result, surface_file
from homolog.io.shapeworks import (
    INPUTS,
    PATH_PREFIXES,
    Row,
    ShapeWorksProject,
    complete_row,
    escape_column,
    place_of,
    tables_of,
)
from homolog.progress import Tick, no_tick
from homolog.surfaces.clipping import Plane

__all__ = ["load_source_metadata", "moved_paths", "save_source_metadata", "write_shapeworks"]


def write_shapeworks(project: ProjectFolder, folder: Path, tick: Tick = no_tick) -> Path:
    """Write a project's result so that ShapeWorks opens it.

    Coordinates are written with all their digits. Other content of an imported ShapeWorks project (settings,
    columns, anatomies) is preserved.

    Parameters
    ----------
    project : ProjectFolder
        A project with a result.
    folder : Path
        Folder for ``NAME.swproj``, ``NAME_particles/`` and ``NAME_groomed/``, where NAME is the project's;
        created if necessary.
    tick : Tick

    Returns
    -------
    Path
        The ``.swproj`` file, written last.

    Raises
    ------
    InputError
        If there is no result or the folder can't be written to.
    """
    result = read_result(project)
    record = project.read().result
    assert record is not None, "a result that was read has a record"
    source, domain = load_source_metadata(project)
    (name,) = file_stems([project.folder.resolve().name])
    targets = _targets(project, record, folder, name, domain)
    before = {row.get("name", ""): row for row in source.rows}
    rows = []
    for index, subject in enumerate(record.subjects):
        tick(index / len(record.subjects), f"writing {subject.name}")
        row = moved_paths(before.get(subject.name, {}), project.folder, folder)
        row |= _described(row, subject)
        for target in targets:
            own = target.particles
            row |= target.write_particles(subject, result.local[index, own], result.world[index, own])
            row |= target.write_transforms(subject)
            row |= target.write_surface(row, subject)
            row |= target.write_constraints(row, subject)
        rows.append(row)
    for key in (f"constraints_{target.domain}" for target in targets):
        if any(key in row for row in rows):  # ShapeWorks needs it of all or none
            rows = [{key: ""} | row for row in rows]
    domains = source.domains if source.rows or not record.structures else [item.domain for item in targets]
    rows = [complete_row(row, domains) for row in rows] if len(domains) > 1 else rows
    content = {"data": rows} | _settings(source, record, domains, targets)
    path = folder / f"{name}.swproj"
    write_text(path, json.dumps(content, indent=4) + "\n")
    return path


@dataclass(frozen=True, slots=True)
class _Target:
    """The output of an export of one anatomy; its methods write a subject's part and return its columns.

    `files` are the groomed surfaces by subject, `ending` tells the files of several anatomies apart, and
    `cut` is the column with a subject's cuts.
    """

    folder: Path
    name: str
    domain: str
    particles: slice
    files: Mapping[str, Path]
    ending: str = ""
    cut: str = COLUMN

    def write_particles(self, subject: ResultSubject, local: FloatArray, world: FloatArray) -> Row:
        columns = {}
        for frame, points in (("local", local), ("world", world)):
            place = f"{self.name}_particles/{subject.file}{self.ending}_{frame}.particles"
            write_particles(self.folder / place, points)
            columns[f"{frame}_particles_{self.domain}"] = place
        return columns

    def write_transforms(self, subject: ResultSubject) -> Row:
        matrices = {"alignment": np.array(subject.alignment), "procrustes": np.eye(4)}
        return {
            f"{key}_{self.domain}": " ".join(map(repr, matrix.ravel().tolist()))
            for key, matrix in matrices.items()
        }

    def write_surface(self, row: Row, subject: ResultSubject) -> Row:
        surface = self.files[subject.name]
        if not surface.is_file():
            return {}
        place = f"{self.name}_groomed/{subject.file}{self.ending}{surface.suffix}"
        with atomic_write(self.folder / place) as part:
            part.write_bytes(surface.read_bytes())
        has_input = any(f"{prefix}{self.domain}" in row for prefix in INPUTS)
        return {f"groomed_{self.domain}": place} | ({} if has_input else {f"shape_{self.domain}": place})

    def write_constraints(self, row: Row, subject: ResultSubject) -> Row:
        """Write the planes of a subject that came without constraints; surfaces end where paint begins."""
        key = f"constraints_{self.domain}"
        planes = [
            cut
            for cut in parse_cuts(column_of(subject.columns, self.cut), subject.name)
            if isinstance(cut, Plane)
        ]
        if row.get(key) or not planes:
            return {}
        place = f"{self.name}_constraints/{subject.file}{self.ending}.json"
        write_planes(self.folder / place, planes)
        return {key: place}


def _targets(
    project: ProjectFolder, record: ResultRecord, folder: Path, name: str, domain: str
) -> list[_Target]:
    """Return the anatomies: the structures of a model of several, or the one that was imported."""
    everything = {subject.name: surface_file(project, subject.file) for subject in record.subjects}
    if not record.structures:
        return [_Target(folder, name, domain, slice(0, record.particles), everything)]
    targets, begin, settings = [], 0, record.settings.groom.of_structures
    for stem, item in zip(
        file_stems([structure.name for structure in record.structures]), record.structures, strict=True
    ):
        alone = project.structure(item.name)
        own = alone.read().result
        assert own is not None, "each structure of a result has one"
        files = {subject.name: surface_file(alone, subject.file) for subject in own.subjects}
        source = settings[item.name].structure if item.name in settings else item.name
        particles, begin = slice(begin, begin + item.particles), begin + item.particles
        targets.append(_Target(folder, name, item.name, particles, files, f"_{stem}", cut_column(source)))
    return targets


def _described(row: Row, subject: ResultSubject) -> Row:
    """Return the columns of a subject's name, group and table data, under the column names of its row."""
    columns, groups = {"name": subject.name}, [key for key in row if key.startswith("group_")]
    for key, value in subject.columns.items():
        group = f"group_{key}"
        columns[group if group in row else key if key in row else escape_column(key)] = value
    if subject.group is not None:  # first, since importers use the first column as group
        columns = {groups[0] if groups else "group_group": subject.group} | columns
    return columns


def _settings(
    source: ShapeWorksProject, record: ResultRecord, domains: Sequence[str], targets: Sequence[_Target]
) -> dict[str, Any]:
    """Return the tables other than the rows: the imported ones, updated by this result."""
    tables = tables_of(source)
    tables["groom"] = tables["groom"] or {target.domain: {} for target in targets}
    tables["project"] = {"version": "2"} | tables["project"]
    tables["optimize"] = tables["optimize"] or {
        "use_geodesic_distance": str(record.metric == "geodesic").lower(),
        "use_normals": str(record.settings.optimize.method.uses_normals).lower(),
    }
    counts = tables["optimize"].get("number_of_particles", "").split()
    own = {target.domain: str(target.particles.stop - target.particles.start) for target in targets}
    if len(counts) != len(domains):  # one for each anatomy
        counts = [""] * len(domains)
    counts = [own.get(domain, count) for domain, count in zip(domains, counts, strict=True)]
    tables["optimize"]["number_of_particles"] = " ".join(filter(None, counts))
    return tables


_FILE = "shapeworks.json"


def save_source_metadata(project: ProjectFolder, source: ShapeWorksProject, domain: str) -> None:
    """Write a ShapeWorks project's rows and settings into a Homolog project; raises as `write_text` does.

    Parameters
    ----------
    project : ProjectFolder
        The project that stores it.
    source : ShapeWorksProject
        The imported project.
    domain : str
        The imported anatomy.
    """
    rows = [moved_paths(row, source.path.parent, project.folder) for row in source.rows]
    content = {"file": source.path.name, "domain": domain, "data": rows, "others": source.others}
    write_text(project.folder / _FILE, json.dumps(content, indent=1) + "\n")


def load_source_metadata(project: ProjectFolder) -> tuple[ShapeWorksProject, str]:
    """Return the stored content, and the imported domain; empty if the project was not imported.

    Raises
    ------
    InputError
        If the file is damaged.
    """
    path = project.folder / _FILE
    if not path.is_file():
        return ShapeWorksProject(path, (), {}), "1"
    content = read_json(path, "record of a ShapeWorks project")
    rows, others = content.get("data"), content.get("others")
    good = [row for row in rows if isinstance(row, dict)] if isinstance(rows, list) else []
    return (
        ShapeWorksProject(
            path,
            tuple({str(key): str(value) for key, value in row.items()} for row in good),
            others if isinstance(others, dict) else {},
        ),
        str(content.get("domain", "1")),
    )


def moved_paths(row: Row, old: Path, new: Path) -> Row:
    """Return a row with paths relative to another folder.

    Parameters
    ----------
    row : dict
        A subject's row of a ShapeWorks project.
    old, new : Path
        The folders to which paths are relative, before and after.

    Returns
    -------
    dict
    """
    return {
        key: _moved(value, old, new) if value and key.startswith(PATH_PREFIXES) else value
        for key, value in row.items()
    }


def _moved(value: str, old: Path, new: Path) -> str:
    """Return a path relative to another folder; unchanged if its target is unknown here."""
    try:
        place = place_of(value, old.resolve())
        if place is None:
            return value
        moved = Path(os.path.relpath(place, new.resolve())).as_posix()
    except (InputError, ValueError):  # not a path, or on another drive
        return value
    return moved.replace(" ", "%20") if "%20" in value else moved
