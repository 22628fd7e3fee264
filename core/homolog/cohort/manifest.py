"""A cohort from a table of names, files, groups and covariates."""

import os
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path, PureWindowsPath
from types import MappingProxyType

from homolog.cohort.column_types import read_typed_rows
from homolog.cohort.layouts import subject_at
from homolog.cohort.subject import (
    IMAGE_SUFFIXES,
    MESH_SUFFIXES,
    Cohort,
    Subject,
    checked_path,
    stem_of,
    suffix_of,
)
from homolog.errors import InputError
from homolog.spreadsheets import Row, encoding_notes

__all__ = [
    "MANIFESTS",
    "NAMES",
    "PARTICIPANTS",
    "is_absolute",
    "names_files",
    "own_columns",
    "place_of",
    "read_manifest",
]

MANIFESTS = ("cohort.csv", "cohort.tsv", "cohort.xlsx")
"""Names of a folder's own table, the first one that exists."""
PARTICIPANTS = "participants.tsv"
"""Table of a BIDS data set with groups and covariates."""
_OWN_COLUMNS = ("name", "path", "group", "landmarks", "image")
NAMES = ("name", "id", "subject", "participant_id")
"""Names of the column with the subjects' names; the last one is that of BIDS."""
_STRUCTURE = "path:"
"""Begin of the names of columns with a file for each structure: ``path:femur``."""
_KNOWN = (*_OWN_COLUMNS, *NAMES)
_BAD_IN_NAMES = set('/\\:*?"<>|') | {chr(code) for code in range(32)}


def read_manifest(path: Path) -> Cohort:
    """Return the cohort of a table; raises InputError if a column or value is missing or invalid."""
    columns, rows = read_typed_rows(path, _KNOWN)
    own = own_columns(columns)
    files = _file_columns(path, columns, rows)
    if not files:
        raise InputError(f"{path}: lacks the column path; the first line must be name,path,group")
    if not rows:
        raise InputError(f"{path}: lists no subject; add a line for each: name,path,group")
    subjects = [
        _subject({own.get(key, key): item for key, item in row.items()}, files, path, line)
        for line, row in rows
    ]
    owners: dict[tuple[Path, ...], list[str]] = {}
    for subject in subjects:
        owners.setdefault(tuple(subject.structures.values()) or (subject.path,), []).append(subject.name)
    for (first, *_), names in owners.items():
        if len(set(names)) > 1:
            raise InputError(
                f"{path}: {' and '.join(names)} have the same file, {first.name}; give each its own"
            )
    return Cohort(tuple(subjects), path.parent, (*encoding_notes(path), *_elsewhere(path, rows, files)))


def _file_columns(path: Path, columns: Sequence[str], rows: Sequence[tuple[int, Row]]) -> dict[str, str]:
    """Return the columns of files, and the structure of each, empty for a single one.

    These are ``path``, or those that begin with ``path:``, or else those of which every value is an existing
    file.
    """
    own = own_columns(columns)
    if single := [column for column in columns if own.get(column) == "path"]:
        return {single[0]: ""}
    declared = [column for column in columns if column.strip().lower().startswith(_STRUCTURE)]
    if declared:
        return {column: column.strip()[len(_STRUCTURE) :].strip() for column in declared}
    existing = [
        column for column in columns if column and rows and _are_files(path, [row[column] for _, row in rows])
    ]
    existing = [column for column in existing if own.get(column, column) not in _OWN_COLUMNS]
    return {existing[0]: ""} if len(existing) == 1 else {column: column for column in existing}


def _are_files(table: Path, cells: Sequence[str]) -> bool:
    texts = [cell for cell in cells if cell]
    known = all(suffix_of(Path(text)) in IMAGE_SUFFIXES + MESH_SUFFIXES for text in texts)
    return bool(texts) and known and all(os.path.isfile(place_of(table.parent, text)) for text in texts)


def _elsewhere(path: Path, rows: Sequence[tuple[int, Row]], files: Iterable[str]) -> tuple[str, ...]:
    """Return a note if files were found by the ends of paths of another computer."""
    texts = [row[column] for _, row in rows for column in files if row[column]]
    moved = [
        (text, place)
        for text in texts
        if is_absolute(text)
        and not os.path.exists(path.parent / text)
        and os.path.exists(place := place_of(path.parent, text))
    ]
    if not moved:
        return ()
    text, place = moved[0]
    return (
        f"paths in {path.name} that do not exist here were found by their ends: {len(moved)} of "
        f"{len(texts)}, such as {text}: {place.relative_to(path.parent).as_posix()}",
    )


def names_files(path: Path) -> bool:
    """Return whether a table has columns with the subjects' files."""
    columns, rows = read_typed_rows(path, _KNOWN)
    return bool(_file_columns(path, columns, rows))


def own_columns(columns: Sequence[str]) -> dict[str, str]:
    """Return the known columns of a table, also if capitalized."""
    own = {column: column for column in columns if column in _OWN_COLUMNS}
    for wanted in _OWN_COLUMNS:
        for alias in NAMES if wanted == "name" else (wanted,):
            alike = [column for column in columns if column.strip().lower() == alias]
            if wanted not in own.values() and len(alike) == 1:
                own[alike[0]] = wanted
    return own


def _subject(row: Mapping[str, str], files: Mapping[str, str], manifest: Path, line: int) -> Subject:
    row = {("path" if key in files and not files[key] else key): item for key, item in row.items()}
    paths = {structure: row[key] for key, structure in files.items() if structure and row[key]}
    if not (row.get("path") or paths):
        raise InputError(f"{manifest}, line {line}: the path is empty")
    try:
        for column in ("path", "landmarks", "image"):
            checked_path(row.get(column) or "")
        for text in paths.values():
            checked_path(text)
    except ValueError as error:
        raise InputError(f"{manifest}, line {line}: the {column} {error}; correct it") from error
    places = {name: place_of(manifest.parent, text) for name, text in paths.items()}
    path = Path(os.path.commonpath([place.parent for place in places.values()])) if places else None
    path = place_of(manifest.parent, row["path"]) if path is None else path
    name = row.get("name", stem_of(next(iter(places.values()), path)))
    if not name:
        raise InputError(f"{manifest}, line {line}: the name is empty")
    if _BAD_IN_NAMES & set(name) or name in (".", ".."):
        raise InputError(f"{manifest}, line {line}: {name!r} is not a valid name; rename the subject")
    further = {key: value for key, value in row.items() if key not in (*_OWN_COLUMNS, *files)}
    landmarks, image = row.get("landmarks"), row.get("image")
    single = (
        subject_at(path, name) if not places else Subject(name, path, structures=MappingProxyType(places))
    )
    return replace(
        single,
        group=row.get("group") or None,
        columns=MappingProxyType(further),
        landmarks=place_of(manifest.parent, landmarks) if landmarks else single.landmarks,
        image=place_of(manifest.parent, image) if image else single.image,
    )


def place_of(folder: Path, text: str) -> Path:
    """Return the target of a path in a table; relative paths may have backslashes.

    Letters and accents may be apart in one place and not in the other, as in files copied from macOS. For an
    absolute path of another computer that does not exist here, the target is the file in the folder with the
    longest end of that path.
    """
    slashed = text.replace("\\", "/")
    forms = [unicodedata.normalize(form, slashed) for form in ("NFC", "NFD")]
    places = [folder / item for item in (text, slashed, *forms)]
    for form in forms if is_absolute(text) else ():
        parts = [part for part in form.split("/") if part and not part.endswith(":")]
        if not {".", ".."} & set(parts):
            places += [folder.joinpath(*parts[start:]) for start in range(len(parts))]
    return next((place for place in places if os.path.exists(place)), places[1])


def is_absolute(text: str) -> bool:
    """Return whether a path is absolute on some system."""
    return text.startswith(("/", "\\")) or bool(PureWindowsPath(text).drive)
