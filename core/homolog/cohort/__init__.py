"""Cohorts: the subjects' names, files, groups and further columns."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path

from homolog.cohort.dicom import dicom_files, dicom_segmentations, dicom_slices, is_dicom_seg
from homolog.cohort.entries import notes_on_skipped, readable_entries
from homolog.cohort.files import is_series, pictures_in
from homolog.cohort.layouts import DERIVATIVES, read_folder, structures_in, structures_named, subject_at
from homolog.cohort.manifest import MANIFESTS, PARTICIPANTS, names_files, read_manifest
from homolog.cohort.numbers import declared_missing, notes_on_numbers, outside_notes
from homolog.cohort.patterns import Proposal, counts_text, proposals, proposals_text, read_pattern
from homolog.cohort.sides import LEFT, RIGHT, SIDE_COLUMN, other_side, side_of_word, sides_of
from homolog.cohort.subject import (
    IMAGE_SUFFIXES,
    MARKUP_SUFFIXES,
    MESH_SUFFIXES,
    Cohort,
    Subject,
    checked_path,
    column_of,
    image_beside,
    landmarks_beside,
    stem_of,
    suffix_of,
)
from homolog.cohort.table import TableChanges, with_table, with_values_of
from homolog.cohort.unread import remedy_for
from homolog.errors import InputError, path_of
from homolog.spreadsheets import TABLE_SUFFIXES

__all__ = [
    "IMAGE_SUFFIXES",
    "LEFT",
    "MARKUP_SUFFIXES",
    "MESH_SUFFIXES",
    "RIGHT",
    "SIDE_COLUMN",
    "TABLE_SUFFIXES",
    "Cohort",
    "Proposal",
    "Subject",
    "TableChanges",
    "checked_path",
    "column_of",
    "counts_text",
    "declared_missing",
    "dicom_files",
    "dicom_segmentations",
    "dicom_slices",
    "image_beside",
    "is_dicom_seg",
    "is_series",
    "landmarks_beside",
    "names_files",
    "other_side",
    "outside_notes",
    "pictures_in",
    "proposals",
    "proposals_text",
    "read_cohort",
    "side_of_word",
    "sides_of",
    "stem_of",
    "structures_in",
    "structures_named",
    "subject_at",
    "suffix_of",
    "tables_beside",
    "tables_in",
    "tables_of_files",
    "with_table",
    "with_values",
    "with_values_of",
]


def read_cohort(
    path: str | PathLike[str],
    pattern: str | None = None,
    *,
    table: str | PathLike[str] | None = None,
    missing: Sequence[str] = (),
) -> Cohort:
    r"""Read a cohort from a folder of segmentations or meshes, or from a table.

    Parameters
    ----------
    path : path
        A folder, or a table (CSV, TSV, XLSX) with the columns ``name,path[,group,…]`` and paths relative
        to the table's folder, with ``path:femur,path:tibia`` for a file per structure. A ``cohort.csv``,
        ``.tsv`` or ``.xlsx`` in a folder takes precedence; without paths, it gives groups and covariates of
        the folder's files, as a BIDS data set's ``participants.tsv`` does. Layouts of folders that need no
        pattern are in docs/formats.md.
    pattern : str, optional
        Path of the files below the folder with fields in braces, such as
        ``{group}/{subject}/seg_{structure}.nii.gz``. ``{subject}`` is required; fields other than these
        become columns, ``*`` is any text that does not matter.
    table : path, optional
        A table with groups and covariates of the subjects.
    missing : sequence of str
        Values that stand for missing ones, such as ``-999``; such cells are empty.

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
    path = path_of(path)
    if not isinstance(pattern, str | None):
        raise InputError(f"pattern: give a text such as {{subject}}.nrrd, not {type(pattern).__name__}")
    if pattern is not None and not path.is_dir():
        raise InputError(f"{path}: is not a folder; a pattern needs the folder of the files")
    if path.is_dir():
        cohort = _of_folder(path, table is not None) if pattern is None else read_pattern(path, pattern)
        cohort = Cohort(cohort.subjects, path, (*cohort.notes, *notes_on_skipped(path)))
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
    cohort = cohort if table is None else with_values(cohort, path_of(table, "table"))
    cohort = declared_missing(cohort, missing)
    return replace(cohort, notes=(*cohort.notes, *notes_on_numbers(cohort.subjects)))


def _of_folder(folder: Path, has_table: bool) -> Cohort:
    manifest = next((place for name in MANIFESTS if (place := folder / name).is_file()), None)
    if manifest is not None and names_files(manifest):
        return read_manifest(manifest)
    try:
        cohort = read_folder(folder)
    except InputError as error:
        tables = [f"\nor give a table that lies there: {place}" for place in tables_of_files(folder)]
        raise InputError("".join([str(error), *tables])) from error
    if manifest is not None:
        return with_values(cohort, manifest)
    participants = next((place for place in _places_of_participants(folder) if place.is_file()), None)
    if participants is not None:
        try:
            cohort = with_values(cohort, participants)
        except InputError as error:
            cohort = Cohort(cohort.subjects, folder, (*cohort.notes, f"not used: {error}"))
    unused = [] if has_table else [place for place in tables_beside(cohort) if place != participants]
    notes = [f"not used: {place.name}, which names these subjects (table: {place})" for place in unused]
    return Cohort(cohort.subjects, folder, (*cohort.notes, *notes))


def with_values(cohort: Cohort, table: Path) -> Cohort:
    """Return a cohort with the values of a table, and a note if rows or subjects are without the other."""
    changes = with_table(cohort.subjects, table)
    partly = changes.coverage if changes.without_row or changes.unknown else []
    notes = [f"{table.name}: {line}" for line in (*partly, *changes.notes)]
    return Cohort(changes.subjects, cohort.folder, (*cohort.notes, *notes))


def _places_of_participants(folder: Path) -> list[Path]:
    """Return the possible places of a BIDS data set's table: the folder, or that above ``derivatives``."""
    absolute = folder.absolute()
    parents = [item.parent for item in (absolute, *absolute.parents) if item.name == DERIVATIVES]
    return [place / PARTICIPANTS for place in (folder, *parents[:1])]


_TRUTH = "truth.csv"  # of generated beans; not a table of subjects


def tables_beside(cohort: Cohort) -> list[Path]:
    """Return the tables in a cohort's folder, or in the one above, that name its subjects."""
    tables = []
    for place in tables_in(cohort.folder) or tables_in(cohort.folder.absolute().parent):
        try:
            changes = with_table(cohort.subjects, place)
        except InputError:
            continue
        if not changes.is_empty:
            tables.append(place)
    return tables


def tables_of_files(folder: Path) -> list[Path]:
    """Return the tables in a folder that list the subjects' files."""
    return [place for place in tables_in(folder) if _lists_files(place)]


def _lists_files(table: Path) -> bool:
    try:
        return names_files(table)
    except InputError:
        return False


def tables_in(folder: Path) -> list[Path]:
    """Return the tables of a folder that can be read."""
    if not folder.is_dir():
        return []
    entries: Iterable[Path] = readable_entries(folder)
    tables = [entry for entry in entries if entry.suffix.lower() in TABLE_SUFFIXES and entry.name[0] != "~"]
    return [entry for entry in tables if entry.is_file() and entry.name != _TRUTH]
