"""A ShapeWorks project as a cohort: its shapes, names, groups and table, without particles."""

import os
from pathlib import Path
from types import MappingProxyType

from homolog.cohort import Cohort, Subject, stem_of, subject_at
from homolog.errors import InputError
from homolog.exchange.shapeworks_files import INPUTS, PREFIXES, Row, ShapeWorksProject, read_shapeworks_file
from homolog.exchange.shapeworks_paths import place_of
from homolog.spreadsheets import read_rows

__all__ = ["is_shapeworks", "read_shapeworks_cohort"]

_GROUP = "group_"
_NOT_TAKEN = ("name", "notes")


def is_shapeworks(path: Path) -> bool:
    """Return whether a file is a ShapeWorks project: ``.swproj``, or ``.xlsx`` with its columns of shapes."""
    suffix = path.suffix.lower()
    if suffix != ".xlsx" or not path.is_file():
        return suffix == ".swproj"
    return any(column.startswith(INPUTS) for column in read_rows(path)[0])


def read_shapeworks_cohort(path: Path) -> Cohort:
    """Return the cohort of a ShapeWorks project; several domains are structures of its subjects.

    Raises
    ------
    InputError
        If it can't be read, or a subject names no shape that exists.
    """
    source = read_shapeworks_file(path)
    return Cohort(tuple(_subject(source, row) for row in source.rows), path.parent)


def _subject(source: ShapeWorksProject, row: Row) -> Subject:
    files = {}
    for domain in source.domains:
        text = next(filter(None, (row.get(f"{prefix}{domain}", "") for prefix in INPUTS)), "")
        place = place_of(text, source.path.parent) if text else None
        if text and (place is None or not place.exists()):
            raise InputError(f"{source.path}: {text} does not exist; correct the path in ShapeWorks")
        if place is not None:
            files[domain] = place
    if not files:
        raise InputError(f"{source.path}: subject {row.get('name', '')} has no shape; remove its row")
    first = next(iter(files.values()))
    name = row.get("name") or stem_of(first)
    groups = {key.removeprefix(_GROUP): row[key] for key in row if key.startswith(_GROUP) and row[key]}
    further = {
        key: item for key, item in row.items() if not key.startswith(PREFIXES) and key not in _NOT_TAKEN
    }
    group = next(iter(groups), "")
    columns = MappingProxyType({key: item for key, item in groups.items() if key != group} | further)
    if len(source.domains) == 1:
        single = subject_at(first, name)
        return Subject(name, single.path, groups.get(group), columns, single.landmarks, single.image)
    folder = Path(os.path.commonpath([file.parent for file in files.values()]))
    return Subject(name, folder, groups.get(group), columns, structures=MappingProxyType(files))
