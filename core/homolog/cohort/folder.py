"""A cohort from a folder: its files, or those of the folders in it."""

from collections.abc import Sequence
from pathlib import Path

from homolog.cohort.subject import (
    IMAGE_SUFFIXES,
    MESH_SUFFIXES,
    Cohort,
    Subject,
    landmarks_beside,
    suffix_of,
)
from homolog.errors import InputError

__all__ = ["dicom_files", "is_dicom_seg", "read_folder"]

_NAMED = 5
"""Folders that a message names, at most."""
_SEG_CLASSES = (b"1.2.840.10008.5.1.4.1.1.66.4", b"1.2.840.10008.5.1.4.1.1.66.7")
"""Of segments that may overlap, and of label maps."""


def read_folder(folder: Path) -> Cohort:
    """Return the cohort of a folder; raises InputError if there is none or several may be meant."""
    entries = _entries(folder)
    slices = [one for one in entries if suffix_of(one) == ".dcm" and one.is_file() and not is_dicom_seg(one)]
    files = _known_files(entries)
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
        return _read_folders(folder, folders)
    subjects = [
        Subject(one.name[: -len(suffix_of(one))], one, landmarks=landmarks_beside(one)) for one in files
    ]
    subjects += [Subject(one.name, place) for one, place in series.items()]
    return Cohort(tuple(sorted(subjects, key=lambda one: one.path)), folder)


def _read_folders(folder: Path, below: Sequence[Path]) -> Cohort:
    """Read the one folder that holds files, or one file of each folder, which then names the subject."""
    found = {one: files for one in below if (files := _known_files(_entries(one)))}
    several = [one for one, files in found.items() if len(files) > 1]
    if several and len(found) == 1:
        return read_folder(several[0])
    if several:
        counts = ", ".join(f"{one.name} ({len(found[one])})" for one in several[:_NAMED])
        raise InputError(
            f"{folder}: holds folders with several segmentations or meshes: {counts}"
            f"{' …' if len(several) > _NAMED else ''}; give one of them, or a cohort.csv that names "
            "the files"
        )
    if not found:
        raise InputError(
            f"{folder}: holds no segmentation or mesh; known files are "
            f"{', '.join(IMAGE_SUFFIXES + MESH_SUFFIXES)} and folders of DICOM files"
        )
    subjects = (Subject(one.name, file, landmarks=landmarks_beside(file)) for one, (file,) in found.items())
    return Cohort(tuple(subjects), folder)


def _entries(folder: Path) -> list[Path]:
    return [one for one in sorted(folder.iterdir()) if not one.name.startswith(".")]


def _known_files(entries: Sequence[Path]) -> list[Path]:
    return [one for one in entries if suffix_of(one) in IMAGE_SUFFIXES + MESH_SUFFIXES and one.is_file()]


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
