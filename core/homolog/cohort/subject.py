"""Subjects and the types of their files."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

from homolog.errors import InputError

__all__ = [
    "IMAGE_ENDING",
    "IMAGE_SUFFIXES",
    "MARKUP_SUFFIXES",
    "MESH_SUFFIXES",
    "Cohort",
    "Subject",
    "checked_path",
    "column_of",
    "image_beside",
    "landmarks_beside",
    "stem_of",
    "suffix_of",
]

IMAGE_SUFFIXES = (
    ".nii.gz", ".nii", ".seg.nrrd", ".nrrd", ".nhdr", ".mha", ".mhd", ".mgz", ".mgh", ".hdr", ".hdr.gz",
    ".gipl", ".gipl.gz", ".dcm", ".tif", ".tiff",
)  # fmt: skip
FREESURFER_SUFFIXES = (".pial", ".white", ".smoothwm", ".midthickness", ".surf")
"""Last parts of the names of FreeSurfer's surfaces, such as ``lh.pial``."""
MESH_SUFFIXES = (
    ".vtp", ".vtk", ".ply", ".stl", ".obj", ".off", ".vtu", ".glb", ".gltf", ".3mf", ".surf.gii", ".gii",
    ".vtk.gz", ".ply.gz", ".stl.gz", ".obj.gz", ".off.gz", *FREESURFER_SUFFIXES,
)  # fmt: skip

MARKUP_SUFFIXES = (".mrk.json", ".fcsv")
IMAGE_ENDING = "_image"
"""End of the name, before the suffix, of the scan next to a subject's file."""
_LONGEST_PATH, _LONGEST_PART = 4000, 255  # characters; bytes between two slashes


@dataclass(frozen=True, slots=True)
class Subject:
    """One shape of the study.

    Attributes
    ----------
    name : str
        Name, unique within the cohort and valid as a file name.
    path : Path
        Segmentation (a file, or the folder of a series of slices) or surface mesh; with a file per structure,
        the folder that contains these.
    group : str or None
        Value of the table's ``group`` column, if any.
    columns : mapping of str to str
        The table's further columns, unchanged.
    landmarks : Path or None
        3D Slicer markups of its landmarks: the table's ``landmarks`` column, or ``<file>.mrk.json`` (or
        ``.fcsv``) next to the file, where ``<file>`` is its name without suffix.
    image : Path or None
        The grey-value scan behind the segmentation: the table's ``image`` column, or ``<file>_image`` with
        the suffix of an image next to the file. It is only displayed and may be missing.
    structures : mapping of str to Path
        The files by structure, if each structure has its own; empty for a single file.
    """

    name: str
    path: Path
    group: str | None = None
    columns: Mapping[str, str] = field(default_factory=dict)
    landmarks: Path | None = None
    image: Path | None = None
    structures: Mapping[str, Path] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse names that are not valid text, on which SimpleITK aborts."""
        for item in (self.path, self.landmarks, self.image, *self.structures.values()):
            try:
                str(item or "").encode()
            except UnicodeEncodeError as error:
                shown = os.fsencode(str(item)).decode("utf-8", "backslashreplace")
                raise InputError(f"{shown}: its name is not valid UTF-8; rename it") from error

    @property
    def is_there(self) -> bool:
        """Whether all of its files exist."""
        return all(file.exists() for file in self.structures.values() or [self.path])

    @property
    def is_mesh(self) -> bool:
        """Whether the file is a surface mesh rather than a segmentation."""
        return suffix_of(self.path) in MESH_SUFFIXES

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle the columns as a plain dict; Python 3.11.2 ignores `__getstate__` of classes with slots."""
        return _subject_of, (
            self.name,
            self.path,
            self.group,
            dict(self.columns),
            self.landmarks,
            self.image,
            dict(self.structures),
        )


def column_of(columns: Mapping[str, str], name: str) -> str:
    """Return the value of a column, whose name's case does not matter; empty if there is none."""
    values = (value for key, value in columns.items() if key.strip().casefold() == name)
    return next(values, "").strip()


def _subject_of(
    name: str,
    path: Path,
    group: str | None,
    columns: dict[str, str],
    landmarks: Path | None,
    image: Path | None,
    structures: dict[str, Path],
) -> Subject:
    return Subject(name, path, group, MappingProxyType(columns), landmarks, image, structures)


@dataclass(frozen=True, slots=True)
class Cohort:
    """The subjects of a study, in the order of all results.

    Attributes
    ----------
    subjects : tuple of Subject
        Sorted by name if read from a folder, in file order if read from a table.
    folder : Path
        The folder to which the subjects' paths are relative.
    notes : tuple of str
        Notes on the files: which were skipped, and why.
    """

    subjects: tuple[Subject, ...]
    folder: Path
    notes: tuple[str, ...] = ()

    @property
    def columns(self) -> list[str]:
        """Names of the further columns, in the order in which they first occur."""
        return list(dict.fromkeys(name for subject in self.subjects for name in subject.columns))

    def without(self, names: set[str]) -> "Cohort":
        """Return the cohort without the named subjects."""
        kept = tuple(subject for subject in self.subjects if subject.name not in names)
        return Cohort(kept, self.folder, self.notes)


def suffix_of(path: Path) -> str:
    """Return the known suffix of a file, in lower case (``".nii.gz"``), otherwise the last one."""
    name = path.name.lower()
    known = [item for item in IMAGE_SUFFIXES + MESH_SUFFIXES if name.endswith(item)]
    return known[0] if known else path.suffix.lower()


def stem_of(path: Path) -> str:
    """Return a file's name without suffix; for DICOM folders and FreeSurfer surfaces, the whole name."""
    suffix = suffix_of(path)
    if suffix in FREESURFER_SUFFIXES:
        return path.name
    known = suffix in IMAGE_SUFFIXES + MESH_SUFFIXES
    return path.name[: len(path.name) - len(suffix)] if known or not path.is_dir() else path.name


def landmarks_beside(path: Path) -> Path | None:
    """Return the markups file with a subject's name next to its file, if there is one."""
    stem = path.name[: len(path.name) - len(suffix_of(path))]
    places = (path.parent / (stem + suffix) for suffix in MARKUP_SUFFIXES)  # with_name fails for a root
    return next((file for file in places if file.is_file()), None)


def image_beside(path: Path) -> Path | None:
    """Return the scan next to a subject's file: ``NAME_image.nii.gz``, or a folder of that name."""
    stem = stem_of(path) + IMAGE_ENDING
    places = (path.parent / (stem + suffix) for suffix in IMAGE_SUFFIXES)
    folder = path.parent / stem
    return next((place for place in places if place.is_file()), folder if folder.is_dir() else None)


def checked_path(text: str) -> str:
    """Return the text of a path; raises ValueError if it is not a valid path."""
    parts = text.replace("\\", "/").split("/")
    if (
        "\0" in text
        or len(text) > _LONGEST_PATH
        or any(len(os.fsencode(part)) > _LONGEST_PART for part in parts)
    ):
        raise ValueError("can't be a path: it is too long or contains invalid characters")
    return text
