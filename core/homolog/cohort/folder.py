"""A cohort from a folder: its files, or those of the folders in it."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
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

__all__ = ["dicom_files", "is_dicom_seg", "mask_files", "read_folder"]

_NAMED = 5
"""Folders that a message names, at most."""
_FREESURFER = ("mri/aseg.mgz", "mri/aseg.mgh", "mri/aseg.nii.gz")
"""Where FreeSurfer keeps a subject's structures."""
_LABELS = ("segmentation", "label", "mask", "structure")
"""How folders of label maps begin, in any case and number."""
_LABEL_FOLDER = re.compile(r"(segmentation|label|mask|structure)s?([-_.]?(tr|ts|train|test))?", re.IGNORECASE)
_IMAGE_FOLDER = re.compile(r"(image|scan|volume|picture)s?([-_.]?(tr|ts|train|test))?", re.IGNORECASE)
_MESH_FOLDER = re.compile(r"(mesh|meshe|surface|model)s?", re.IGNORECASE)
"""Names of folders that say what is in them, not of whom it is."""
_PICTURES = frozenset(
    [
        "ct",
        "cta",
        "mr",
        "mri",
        "pet",
        "t1",
        "t1w",
        "t1c",
        "t1ce",
        "t1gd",
        "t1n",
        "t2",
        "t2w",
        "t2f",
        "t2star",
        "flair",
        "dwi",
        "adc",
        "swi",
        "pd",
        "bold",
        "image",
        "img",
        "scan",
        "volume",
        "orig",
        "brain",
        "norm",
        "nu",
    ]
)
"""What pictures are called that lie beside label maps."""
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
            f"{folder}: contains the slices of a DICOM series; give the folder above it, which contains one "
            "folder for each subject"
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
    """Read folders of subjects: one file in each, or one for each structure; or the one with all files."""
    found = {one: sources for one in below if (sources := _sources(one))}
    several = [one for one, sources in found.items() if len(sources) > 1]
    if several and len(found) == 1:
        return read_folder(several[0])
    if several and (labels := _label_folder(found)):
        return read_folder(labels)
    if several and not _are_subjects(found):
        counts = ", ".join(f"{one.name} ({len(found[one])})" for one in several[:_NAMED])
        raise InputError(
            f"{folder}: contains folders with several segmentations or meshes: {counts}"
            f"{' …' if len(several) > _NAMED else ''}; give one of them, or a cohort.csv that names "
            "the files"
        )
    if not found:
        raise InputError(
            f"{folder}: contains no segmentation or mesh; known files are "
            f"{', '.join(IMAGE_SUFFIXES + MESH_SUFFIXES)} and folders of DICOM files"
        )
    subjects = [_subject_of(one, list(sources.values()), bool(several)) for one, sources in found.items()]
    return Cohort(tuple(subjects), folder)


def _subject_of(folder: Path, files: Sequence[Path], by_structure: bool) -> Subject:
    """Return the subject of a folder; where it has a file for each structure, their folder is its path."""
    if by_structure and files[0].parent.name != "mri":
        return Subject(folder.name, files[0].parent)
    return Subject(folder.name, files[0], landmarks=landmarks_beside(files[0]))


def _sources(folder: Path) -> Mapping[str, Path]:
    """Return a subject's files by structure."""
    for name in _FREESURFER:
        if (folder / name).is_file():
            return {"aseg": folder / name}
    return mask_files(folder)


def _label_folder(found: Mapping[Path, Mapping[str, Path]]) -> Path | None:
    """Return the folder of label maps where all others hold pictures, as in imagesTr and labelsTr."""
    labels = [one for one in found if _LABEL_FOLDER.fullmatch(one.name)]
    others = [one for one in found if one not in labels]
    pictures = all(_IMAGE_FOLDER.fullmatch(one.name) for one in others)
    return labels[0] if len(labels) == 1 and others and pictures else None


def _are_subjects(found: Mapping[Path, Mapping[str, Path]]) -> bool:
    """Return whether folders are subjects with a file for each structure: they share the files' names."""
    kinds = (_LABEL_FOLDER, _IMAGE_FOLDER, _MESH_FOLDER)
    if any(kind.fullmatch(one.name) for one in found for kind in kinds):
        return False
    counts = Counter(name.casefold() for files in found.values() for name in files)
    return len(found) > 1 and max(counts.values()) * 2 > len(found)


def mask_files(folder: Path) -> dict[str, Path]:
    """Return a subject's files by the name of their structure, where it has a file for each.

    The subject's name at the beginning of a file's name is no part of that. Pictures (``ct``, ``t1``, …) are
    left out where something else is there.

    Parameters
    ----------
    folder : Path
        The subject's; its folder of segmentations is taken if it has one.

    Returns
    -------
    dict of str to Path
    """
    below = [one for one in _entries(folder) if one.is_dir() and one.name.casefold().startswith(_LABELS)]
    inner = [files for one in below if (files := _masks(one))]
    return inner[0] if len(inner) == 1 else _masks(folder)


def _masks(folder: Path) -> dict[str, Path]:
    files: dict[str, Path] = {}
    for one in _known_files(_entries(folder)):
        if suffix_of(one) != ".dcm":
            files.setdefault(_structure(one), one)
    masks = {name: one for name, one in files.items() if name.casefold() not in _PICTURES}
    return masks or files


def _structure(path: Path) -> str:
    stem = path.name[: -len(suffix_of(path))]
    for owner in (path.parent.name, path.parent.parent.name):
        rest = stem[len(owner) :]
        if owner and stem.casefold().startswith(owner.casefold()) and rest[:1] in ("_", "-", ".", " "):
            return rest[1:].strip() or stem
    return stem


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
                f"{folder}: contains {len(found)} DICOM series; give a cohort.csv that names one of them"
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
