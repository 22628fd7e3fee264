"""Cohorts: the subjects' names, files and groups."""

import os
from collections import Counter
from os import PathLike
from pathlib import Path

from homolog.cohort.both_sides import with_both_sides
from homolog.cohort.dicom import dicom_files, dicom_segmentations, dicom_slices, is_dicom_seg
from homolog.cohort.entries import notes_on_skipped, readable_entries
from homolog.cohort.folder import DERIVATIVES, read_folder
from homolog.cohort.manifest import MANIFESTS, PARTICIPANTS, names_files, read_manifest
from homolog.cohort.pictures import pictures_in
from homolog.cohort.sides import (
    FROM_NAMES,
    LEFT,
    RIGHT,
    SIDE_COLUMN,
    Sides,
    other_side,
    side_of_word,
    sides_of,
)
from homolog.cohort.subject import (
    IMAGE_SUFFIXES,
    MESH_SUFFIXES,
    Cohort,
    Subject,
    checked_path,
    image_beside,
    landmarks_beside,
    stem_of,
    suffix_of,
)
from homolog.cohort.subject_folder import mask_files
from homolog.cohort.table import TableChanges, with_table, with_values_of
from homolog.cohort.unread import remedy_for
from homolog.errors import InputError
from homolog.spreadsheets import TABLE_SUFFIXES, lists_labels

__all__ = [
    "FROM_NAMES",
    "IMAGE_SUFFIXES",
    "LEFT",
    "MESH_SUFFIXES",
    "RIGHT",
    "SIDE_COLUMN",
    "TABLE_SUFFIXES",
    "Cohort",
    "Sides",
    "Subject",
    "TableChanges",
    "checked_path",
    "dicom_files",
    "dicom_segmentations",
    "dicom_slices",
    "image_beside",
    "is_dicom_seg",
    "landmarks_beside",
    "mask_files",
    "other_side",
    "pictures_in",
    "read_cohort",
    "side_of_word",
    "sides_of",
    "stem_of",
    "suffix_of",
    "with_both_sides",
    "with_table",
    "with_values_of",
]


def read_cohort(path: str | PathLike[str]) -> Cohort:
    r"""Read a cohort from a folder of segmentations or meshes, or from a table.

    Parameters
    ----------
    path : path
        A folder, or a table (CSV, TSV, XLSX) with the columns ``name,path[,group,…]`` and paths relative
        to the table's folder. A ``cohort.csv``, ``.tsv`` or ``.xlsx`` in a folder takes precedence; without
        paths, it gives groups and covariates of the folder's files, as a BIDS data set's ``participants.tsv``
        does. A folder may contain the files, or folders by subject, structure, time point, side or group
        (docs/formats.md).

    Returns
    -------
    Cohort

    Raises
    ------
    InputError
        If the path does not exist, a column or value is missing, or two subjects have the same name.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import homolog as hl
    >>> with TemporaryDirectory() as folder:
    ...     for name in ("anna", "bert"):
    ...         Path(folder, f"{name}.ply").touch()
    ...     _ = Path(folder, "cohort.csv").write_text(
    ...         "name,path,group\nanna,anna.ply,patient\nbert,bert.ply,control\n"
    ...     )
    ...     [(subject.name, subject.group) for subject in hl.read_cohort(folder).subjects]
    [('anna', 'patient'), ('bert', 'control')]
    """
    path = Path(path)
    if path.is_dir():
        cohort = _read_folder(path)
        cohort = Cohort(cohort.subjects, cohort.folder, (*cohort.notes, *notes_on_skipped(path)))
    elif path.is_file() and path.suffix.lower() in TABLE_SUFFIXES:
        cohort = read_manifest(path)
    elif path.is_file():
        if remedy := remedy_for(path):
            raise InputError(f"{path}: is neither a folder nor a table of subjects; {remedy}")
        raise InputError(f"{path}: is a single file; give the folder of the cohort's files, or a cohort.csv")
    else:
        raise InputError(f"{path}: does not exist; correct the path")
    repeated = [
        name for name, count in Counter(subject.name for subject in cohort.subjects).items() if count > 1
    ]
    if repeated:
        raise InputError(f"{path}: several subjects are named {', '.join(repeated)}; give each its own name")
    return cohort


def _read_folder(folder: Path) -> Cohort:
    manifest = next((place for name in MANIFESTS if (place := folder / name).is_file()), None)
    if manifest is None:
        return _with_participants(read_folder(folder), folder)
    if names_files(manifest):
        return read_manifest(manifest)
    cohort = read_folder(folder)
    changes = with_table(cohort.subjects, manifest)
    remarks = [f"{manifest.name}: {line}" for line in changes.lines if changes.without_row or changes.unknown]
    return Cohort(changes.subjects, folder, (*cohort.notes, *(remarks or changes.notes)))


def _with_participants(cohort: Cohort, folder: Path) -> Cohort:
    """Return the cohort of a folder without a table of its own, with the participants of a BIDS data set."""
    table = next((place for place in _places_of_participants(folder) if place.is_file()), None)
    notes = [*cohort.notes, *_unused_tables(folder, table)]
    if table is None:
        return Cohort(cohort.subjects, cohort.folder, tuple(notes))
    try:
        changes = with_table(cohort.subjects, table)
    except InputError as error:
        return Cohort(cohort.subjects, cohort.folder, (*notes, f"not used: {error}"))
    notes += [f"{table.name}: {line}" for line in changes.lines]
    return Cohort(changes.subjects, cohort.folder, tuple(notes))


def _places_of_participants(folder: Path) -> list[Path]:
    """Return the possible folders of a BIDS data set's table: the folder, or that above ``derivatives``."""
    absolute = folder.absolute()
    parents = [item.parent for item in (absolute, *absolute.parents) if item.name == DERIVATIVES]
    return [place / PARTICIPANTS for place in (folder, *parents[:1])]


_TRUTH = "truth.csv"  # of generated beans; not a table of subjects


def _unused_tables(folder: Path, used: Path | None) -> list[str]:
    """Return a note on the unused tables of a folder without a table named cohort."""
    tables = sorted(
        entry.name
        for entry in readable_entries(folder)
        if entry.suffix.lower() in TABLE_SUFFIXES
        and entry.is_file()
        and entry.name[0] != "~"
        and entry.name != _TRUTH
        and entry != used
        and not (os.access(entry, os.R_OK) and lists_labels(entry))
    )
    listed = f"{tables[0]} and {len(tables) - 1} more" if len(tables) > 1 else "".join(tables)
    if not tables:
        return []
    name = f"cohort{Path(tables[0]).suffix.lower()}"
    use = f"rename it to {name}, or import it later: homolog table PROJECT TABLE, or File > Import table"
    return [f"not used: {listed}; {use}"]
