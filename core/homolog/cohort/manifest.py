"""A cohort from a table of names, files, groups and covariates."""

import os
import unicodedata
from collections.abc import Mapping, Sequence
from pathlib import Path, PureWindowsPath
from types import MappingProxyType

from homolog.cohort.column_types import read_typed_rows
from homolog.cohort.subject import Cohort, Subject, checked_path, image_beside, landmarks_beside, stem_of
from homolog.errors import InputError
from homolog.spreadsheets import encoding_notes

__all__ = [
    "MANIFESTS",
    "OTHER_NAMES",
    "PARTICIPANTS",
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
# fmt: off
OTHER_NAMES = {
    "name": (
        "case", "case_id", "id", "participant_id", "patient", "patient_id", "subject", "subject_id",
        "kennung", "patienten_id", "proband", "probanden_id", "sujet", "sujeto", "paciente", "paziente",
    ),
    "path": (
        "file", "filename", "file_name", "filepath", "file_path", "mask", "mesh", "segmentation",
        "datei", "dateiname", "pfad", "fichier", "chemin", "archivo", "ruta", "percorso",
    ),
    "group": ("gruppe", "groupe", "grupo", "gruppo"),
}
# fmt: on
"""Names of these columns in tables, in five languages."""
_KNOWN = (*_OWN_COLUMNS, *(name for names in OTHER_NAMES.values() for name in names))
_BAD_IN_NAMES = set('/\\:*?"<>|') | {chr(code) for code in range(32)}


def read_manifest(path: Path) -> Cohort:
    """Return the cohort of a table; raises InputError if a column or value is missing or invalid."""
    columns, rows = read_typed_rows(path, _KNOWN)
    own = own_columns(columns)
    if "path" not in own.values():
        raise InputError(f"{path}: lacks the column path; the first line must be name,path,group")
    if not rows:
        raise InputError(f"{path}: lists no subject; add a line for each: name,path,group")
    subjects = [
        _subject({own.get(key, key): item for key, item in row.items()}, path, line) for line, row in rows
    ]
    files: dict[Path, list[str]] = {}
    for subject in subjects:
        files.setdefault(subject.path, []).append(subject.name)
    for file, names in files.items():
        if len(set(names)) > 1:
            raise InputError(
                f"{path}: {' and '.join(names)} have the same file, {file.name}; give each its own"
            )
    return Cohort(
        tuple(subjects), path.parent, (*encoding_notes(path), *_elsewhere(path, rows, own, subjects))
    )


def _elsewhere(
    path: Path,
    rows: Sequence[tuple[int, Mapping[str, str]]],
    own: Mapping[str, str],
    subjects: Sequence[Subject],
) -> tuple[str, ...]:
    """Return a note if files were found by the ends of paths of another computer."""
    column = next(key for key, name in own.items() if name == "path")
    matches = [
        (row[column], subject.path)
        for (_, row), subject in zip(rows, subjects, strict=True)
        if _is_absolute(row[column])
        and os.path.exists(subject.path)
        and not os.path.exists(path.parent / row[column])
    ]
    if not matches:
        return ()
    text, place = matches[0]
    return (
        f"paths in {path.name} that do not exist here were found by their ends: {len(matches)} of "
        f"{len(rows)}, such as {text}: {place.relative_to(path.parent).as_posix()}",
    )


def names_files(path: Path) -> bool:
    """Return whether a table has a column with the subjects' files."""
    return "path" in own_columns(read_typed_rows(path, _KNOWN)[0]).values()


def own_columns(columns: Sequence[str]) -> dict[str, str]:
    """Return the known columns of a table, also if capitalized or named differently."""
    own = {column: column for column in columns if column in _OWN_COLUMNS}
    for wanted in _OWN_COLUMNS:
        for names in ((wanted,), OTHER_NAMES.get(wanted, ())):
            alike = [column for column in columns if column.strip().lower() in names]
            if wanted not in own.values() and len(alike) == 1:
                own[alike[0]] = wanted
    return own


def _subject(row: Mapping[str, str], manifest: Path, line: int) -> Subject:
    if not row["path"]:
        raise InputError(f"{manifest}, line {line}: the path is empty")
    try:
        for column in ("path", "landmarks", "image"):
            checked_path(row.get(column) or "")
    except ValueError as error:
        raise InputError(f"{manifest}, line {line}: the {column} {error}; correct it") from error
    path = place_of(manifest.parent, row["path"])
    name = row.get("name", stem_of(path))
    if not name:
        raise InputError(f"{manifest}, line {line}: the name is empty")
    if _BAD_IN_NAMES & set(name) or name in (".", ".."):
        raise InputError(f"{manifest}, line {line}: {name!r} is not a valid name; rename the subject")
    further = {key: value for key, value in row.items() if key not in _OWN_COLUMNS}
    landmarks, image = row.get("landmarks"), row.get("image")
    return Subject(
        name=name,
        path=path,
        group=row.get("group") or None,
        columns=MappingProxyType(further),
        landmarks=place_of(manifest.parent, landmarks) if landmarks else landmarks_beside(path),
        image=place_of(manifest.parent, image) if image else image_beside(path),
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
    for form in forms if _is_absolute(text) else ():
        parts = [part for part in form.split("/") if part and not part.endswith(":")]
        if not {".", ".."} & set(parts):
            places += [folder.joinpath(*parts[start:]) for start in range(len(parts))]
    return next((place for place in places if os.path.exists(place)), places[1])


def _is_absolute(text: str) -> bool:
    """Return whether a path is absolute on some system."""
    return text.startswith(("/", "\\")) or bool(PureWindowsPath(text).drive)
