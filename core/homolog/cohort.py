"""Who is studied: the subjects' names, files and groups."""

import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

from homolog.errors import InputError
from homolog.spreadsheets import read_rows

__all__ = [
    "IMAGE_SUFFIXES",
    "MESH_SUFFIXES",
    "Cohort",
    "Subject",
    "checked_path",
    "dicom_files",
    "is_dicom_seg",
    "landmarks_beside",
    "read_cohort",
    "suffix_of",
]

IMAGE_SUFFIXES = (".nii.gz", ".nii", ".seg.nrrd", ".nrrd", ".nhdr", ".mha", ".mhd", ".dcm")
MESH_SUFFIXES = (".vtp", ".vtk", ".ply", ".stl", ".obj")

MANIFEST = "cohort.csv"
_OWN_COLUMNS = ("name", "path", "group", "landmarks")
_MARKUPS = ".mrk.json"
_SEG_CLASSES = (b"1.2.840.10008.5.1.4.1.1.66.4", b"1.2.840.10008.5.1.4.1.1.66.7")
"""Of segments that may overlap, and of label maps."""
_LONGEST_PATH, _LONGEST_PART = 4000, 255  # characters; bytes between two slashes
_BAD_IN_NAMES = set('/\\:*?"<>|') | {chr(code) for code in range(32)}


@dataclass(frozen=True, slots=True)
class Subject:
    """One shape of the study.

    Attributes
    ----------
    name : str
        Unique within the cohort and fit for a file name.
    path : Path
        Segmentation (a file, or the folder of a DICOM series) or closed surface mesh.
    group : str or None
        Value of the manifest's ``group`` column, if any.
    columns : mapping of str to str
        The manifest's further columns, kept as they are.
    landmarks : Path or None
        Slicer markups of its landmarks: the manifest's ``landmarks`` column, or ``<file>.mrk.json`` beside
        the file, where ``<file>`` is its name without suffix.
    """

    name: str
    path: Path
    group: str | None = None
    columns: Mapping[str, str] = field(default_factory=dict)
    landmarks: Path | None = None

    def __post_init__(self) -> None:
        """Refuse names that are no text, as files of other systems may have: SimpleITK aborts on them."""
        for one in (self.path, self.landmarks):
            try:
                str(one or "").encode()
            except UnicodeEncodeError as error:
                shown = os.fsencode(str(one)).decode("utf-8", "backslashreplace")
                raise InputError(f"{shown}: its name is no text in UTF-8; rename it") from error

    @property
    def is_mesh(self) -> bool:
        """Whether the file is a surface mesh rather than a segmentation."""
        return suffix_of(self.path) in MESH_SUFFIXES

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle the columns as a plain dict; `__getstate__` is not honoured by Python 3.11.2's slots."""
        return _subject_of, (self.name, self.path, self.group, dict(self.columns), self.landmarks)


def _subject_of(
    name: str, path: Path, group: str | None, columns: dict[str, str], landmarks: Path | None
) -> Subject:
    return Subject(name, path, group, MappingProxyType(columns), landmarks)


@dataclass(frozen=True, slots=True)
class Cohort:
    """The subjects of a study, in the order in which every result lists them.

    Attributes
    ----------
    subjects : tuple of Subject
        Sorted by name if read from a folder, in file order if read from a manifest.
    folder : Path
        Where the subjects' relative paths start.
    """

    subjects: tuple[Subject, ...]
    folder: Path

    def without(self, names: set[str]) -> "Cohort":
        """Return the cohort without the named subjects."""
        return Cohort(tuple(one for one in self.subjects if one.name not in names), self.folder)


def read_cohort(path: Path) -> Cohort:
    """Read a cohort from a folder of segmentations or meshes, or from a table.

    Parameters
    ----------
    path : Path
        A folder, or a CSV file with the columns ``name,path[,group,…]``; relative paths start at the
        file's own folder. A folder that holds a ``cohort.csv`` is read through it.

    Raises
    ------
    InputError
        If nothing is there, a column or value is missing, or two subjects have the same name.
    """
    path = Path(path)
    if path.is_dir():
        manifest = path / MANIFEST
        cohort = _read_manifest(manifest) if manifest.is_file() else _read_folder(path)
    elif path.is_file() and path.suffix.lower() == ".csv":
        cohort = _read_manifest(path)
    elif path.is_file():
        raise InputError(
            f"{path}: is one file; give the folder that holds the cohort's files, or a cohort.csv"
        )
    else:
        raise InputError(f"{path}: there is no such folder or file; correct the path")
    repeated = [name for name, count in Counter(one.name for one in cohort.subjects).items() if count > 1]
    if repeated:
        raise InputError(f"{path}: several subjects are called {', '.join(repeated)}; give each its own name")
    return cohort


def suffix_of(path: Path) -> str:
    """Return the known suffix that a file ends in, in lower case (``".nii.gz"``); else its last one."""
    name = path.name.lower()
    known = [one for one in IMAGE_SUFFIXES + MESH_SUFFIXES if name.endswith(one)]
    return known[0] if known else path.suffix.lower()


def landmarks_beside(path: Path) -> Path | None:
    """Return the markups file that lies beside a subject's file under its name, if there is one."""
    stem = path.name[: len(path.name) - len(suffix_of(path))]
    beside = path.parent / (stem + _MARKUPS)  # with_name knows no root
    return beside if beside.is_file() else None


def dicom_files(folder: Path) -> list[Path]:
    """Return the DICOM files of a folder, by their content; their names may end in anything.

    A DICOMDIR, the table of contents of a disc, is none of them.
    """
    files = [one for one in sorted(folder.iterdir()) if one.is_file() and one.name.upper() != "DICOMDIR"]
    return [one for one in files if _beginning(one)[128:132] == b"DICM"]


def is_dicom_seg(path: Path) -> bool:
    """Return whether a DICOM file is a segmentation object."""
    return any(one in _beginning(path) for one in _SEG_CLASSES)


def _beginning(path: Path) -> bytes:
    try:
        with path.open("rb") as stream:
            return stream.read(1024)
    except OSError:
        return b""


def _read_folder(folder: Path) -> Cohort:
    known = IMAGE_SUFFIXES + MESH_SUFFIXES
    entries = [one for one in sorted(folder.iterdir()) if not one.name.startswith(".")]
    slices = [one for one in entries if suffix_of(one) == ".dcm" and one.is_file() and not is_dicom_seg(one)]
    files = [one for one in entries if suffix_of(one) in known and one.is_file()]
    folders = [one for one in entries if one.is_dir()]
    series = {one: one for one in folders if dicom_files(one)}
    if slices or not (files or series or not dicom_files(folder)):
        raise InputError(
            f"{folder}: holds the slices of a DICOM series; give the folder above it, which holds one folder "
            "for each subject"
        )
    if not files and not series:
        series = {one: below for one in folders if (below := _series_below(one))}
    if not files and not series:
        raise InputError(
            f"{folder}: holds no segmentation or mesh; known files are {', '.join(known)} and folders of "
            "DICOM files"
        )
    subjects = [
        Subject(one.name[: -len(suffix_of(one))], one, landmarks=landmarks_beside(one)) for one in files
    ]
    subjects += [Subject(one.name, place) for one, place in series.items()]
    return Cohort(tuple(sorted(subjects, key=lambda one: one.path)), folder)


def _series_below(folder: Path) -> Path | None:
    """Return where a patient's one series lies, as hospitals export it: PATIENT/STUDY/SERIES."""
    for pattern in ("*/", "*/*/"):
        found = [one for one in sorted(folder.glob(pattern)) if one.is_dir() and dicom_files(one)]
        if len(found) > 1:
            raise InputError(
                f"{folder}: holds {len(found)} DICOM series; give a cohort.csv that says which one is meant"
            )
        if found:
            return found[0]
    return None


def _read_manifest(path: Path) -> Cohort:
    columns, rows = read_rows(path)
    others = [one for one in columns if one not in _OWN_COLUMNS]
    own = {one: one.lower() for one in others if one.lower() in set(_OWN_COLUMNS) - set(columns)}
    missing = [name for name in ("name", "path") if name not in (*columns, *own.values())]
    if missing:
        raise InputError(
            f"{path}: lacks the column {' and '.join(missing)}; the first line must be name,path,group"
        )
    if not rows:
        raise InputError(f"{path}: lists no subject; add a line for each: name,path,group")
    subjects = [
        _subject({own.get(key, key): one for key, one in row.items()}, path, line) for line, row in rows
    ]
    files: dict[Path, list[str]] = {}
    for one in subjects:
        files.setdefault(one.path, []).append(one.name)
    for file, names in files.items():
        if len(set(names)) > 1:
            raise InputError(f"{path}: {' and '.join(names)} are one file, {file.name}; give each its own")
    return Cohort(tuple(subjects), path.parent)


def checked_path(text: str) -> str:
    """Return the text of a path; raises ValueError if no system would take it for one."""
    parts = text.replace("\\", "/").split("/")
    if (
        "\0" in text
        or len(text) > _LONGEST_PATH
        or any(len(os.fsencode(one)) > _LONGEST_PART for one in parts)
    ):
        raise ValueError("can't be a path: it is too long, or holds characters that no path has")
    return text


def _subject(row: Mapping[str, str], manifest: Path, line: int) -> Subject:
    for column in ("name", "path"):
        if not row[column]:
            raise InputError(f"{manifest}, line {line}: the {column} is empty")
    bad = sorted(_BAD_IN_NAMES & set(row["name"]))
    if bad or row["name"] in (".", ".."):
        raise InputError(f"{manifest}, line {line}: {row['name']!r} can't be a file name; rename the subject")
    try:
        for column in ("path", "landmarks"):
            checked_path(row.get(column) or "")
    except ValueError as error:
        raise InputError(f"{manifest}, line {line}: the {column} {error}; correct it") from error
    further = {key: value for key, value in row.items() if key not in _OWN_COLUMNS}
    path, landmarks = _place(manifest.parent, row["path"]), row.get("landmarks")
    return Subject(
        name=row["name"],
        path=path,
        group=row.get("group") or None,
        columns=MappingProxyType(further),
        landmarks=_place(manifest.parent, landmarks) if landmarks else landmarks_beside(path),
    )


def _place(folder: Path, text: str) -> Path:
    """Return where a path of a table leads; a relative one may be written with backslashes."""
    place = folder / text
    return place if os.path.exists(place) else folder / text.replace("\\", "/")
