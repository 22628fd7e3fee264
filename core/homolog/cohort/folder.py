"""A cohort from a folder: its files, or those of the folders in it."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from homolog.cohort.subject import (
    IMAGE_ENDING,
    IMAGE_SUFFIXES,
    MESH_SUFFIXES,
    Cohort,
    Subject,
    image_beside,
    landmarks_beside,
    stem_of,
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
"""What pictures are called that lie next to label maps."""
_SEG_CLASSES = (b"1.2.840.10008.5.1.4.1.1.66.4", b"1.2.840.10008.5.1.4.1.1.66.7")
"""Of segments that may overlap, and of label maps."""


def read_folder(folder: Path) -> Cohort:
    """Return the cohort of a folder; raises InputError if there is none or several may be meant."""
    entries = _entries(folder)
    slices = [
        entry
        for entry in entries
        if suffix_of(entry) == ".dcm" and entry.is_file() and not is_dicom_seg(entry)
    ]
    files = _known_files(entries)
    folders = [entry for entry in entries if entry.is_dir()]
    series = {item: item for item in folders if dicom_files(item)}
    if slices or not (files or series or not dicom_files(folder)):
        raise InputError(
            f"{folder}: contains the slices of a DICOM series; give the folder above it, which contains one "
            "folder for each subject"
        )
    if not files and not series:
        series = {item: below for item in folders if (below := _series_below(item))}
    if not files and not series:
        return _read_folders(folder, folders)
    subjects = [_subject(file.name[: -len(suffix_of(file))], file) for file in files]
    subjects += [Subject(item.name, place, image=image_beside(place)) for item, place in series.items()]
    return Cohort(tuple(sorted(subjects, key=lambda subject: subject.path)), folder)


def _read_folders(folder: Path, below: Sequence[Path]) -> Cohort:
    """Read folders of subjects: one file in each, or one for each structure; or the one with all files."""
    by_folder = {item: sources for item in below if (sources := _sources(item))}
    several = [item for item, sources in by_folder.items() if len(sources) > 1]
    if several and len(by_folder) == 1:
        return read_folder(several[0])
    if several and (labels := _label_folder(by_folder)):
        return read_folder(labels)
    if several and not _are_subjects(by_folder):
        counts = ", ".join(f"{item.name} ({len(by_folder[item])})" for item in several[:_NAMED])
        raise InputError(
            f"{folder}: contains folders with several segmentations or meshes: {counts}"
            f"{' …' if len(several) > _NAMED else ''}; give one of them, or a cohort.csv that names "
            "the files"
        )
    if not by_folder:
        raise InputError(
            f"{folder}: contains no segmentation or mesh; known files are "
            f"{', '.join(IMAGE_SUFFIXES + MESH_SUFFIXES)} and folders of DICOM files"
        )
    subjects = [
        _subject_of(item, list(sources.values()), bool(several)) for item, sources in by_folder.items()
    ]
    return Cohort(tuple(subjects), folder)


def _subject_of(folder: Path, files: Sequence[Path], by_structure: bool) -> Subject:
    """Return the subject of a folder; where it has a file for each structure, their folder is its path."""
    if by_structure and files[0].parent.name != "mri":
        return Subject(folder.name, files[0].parent)
    return _subject(folder.name, files[0])


def _subject(name: str, file: Path) -> Subject:
    return Subject(name, file, landmarks=landmarks_beside(file), image=image_beside(file))


def _sources(folder: Path) -> Mapping[str, Path]:
    """Return a subject's files by structure."""
    for name in _FREESURFER:
        if (folder / name).is_file():
            return {"aseg": folder / name}
    return mask_files(folder)


def _label_folder(by_folder: Mapping[Path, Mapping[str, Path]]) -> Path | None:
    """Return the folder of label maps where all others hold pictures, as in imagesTr and labelsTr."""
    labels = [item for item in by_folder if _LABEL_FOLDER.fullmatch(item.name)]
    others = [item for item in by_folder if item not in labels]
    pictures = all(_IMAGE_FOLDER.fullmatch(other.name) for other in others)
    return labels[0] if len(labels) == 1 and others and pictures else None


def _are_subjects(by_folder: Mapping[Path, Mapping[str, Path]]) -> bool:
    """Return whether folders are subjects with a file for each structure: they share the files' names."""
    kinds = (_LABEL_FOLDER, _IMAGE_FOLDER, _MESH_FOLDER)
    if any(kind.fullmatch(item.name) for item in by_folder for kind in kinds):
        return False
    counts = Counter(name.casefold() for files in by_folder.values() for name in files)
    return len(by_folder) > 1 and max(counts.values()) * 2 > len(by_folder)


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
    below = [
        entry for entry in _entries(folder) if entry.is_dir() and entry.name.casefold().startswith(_LABELS)
    ]
    inner = [files for item in below if (files := _masks(item))]
    return inner[0] if len(inner) == 1 else _masks(folder)


def _masks(folder: Path) -> dict[str, Path]:
    files: dict[str, Path] = {}
    for known_file in _known_files(_entries(folder)):
        if suffix_of(known_file) != ".dcm":
            files.setdefault(_structure(known_file), known_file)
    masks = {name: file for name, file in files.items() if name.casefold() not in _PICTURES}
    return masks or files


def _structure(path: Path) -> str:
    stem = path.name[: -len(suffix_of(path))]
    for owner in (path.parent.name, path.parent.parent.name):
        rest = stem[len(owner) :]
        if owner and stem.casefold().startswith(owner.casefold()) and rest[:1] in ("_", "-", ".", " "):
            return rest[1:].strip() or stem
    return stem


def _entries(folder: Path) -> list[Path]:
    """Return what is in a folder, without hidden entries and the scans of others."""
    entries = [path for path in sorted(folder.iterdir()) if not path.name.startswith(".")]
    scans = {path: stem for path in entries if (stem := stem_of(path)).endswith(IMAGE_ENDING)}
    if not scans:
        return entries
    stems = {stem_of(path) for path in entries}
    return [path for path in entries if scans.get(path, "").removesuffix(IMAGE_ENDING) not in stems]


def _known_files(entries: Sequence[Path]) -> list[Path]:
    return [
        entry for entry in entries if suffix_of(entry) in IMAGE_SUFFIXES + MESH_SUFFIXES and entry.is_file()
    ]


def _series_below(folder: Path) -> Path | None:
    """Return where a patient's one series lies, as hospitals export it: PATIENT/STUDY/SERIES."""
    for pattern in ("*/", "*/*/"):
        series = [path for path in sorted(folder.glob(pattern)) if path.is_dir() and dicom_files(path)]
        if len(series) > 1:
            raise InputError(
                f"{folder}: contains {len(series)} DICOM series; give a cohort.csv that names one of them"
            )
        if series:
            return series[0]
    return None


def dicom_files(folder: Path) -> list[Path]:
    """Return the DICOM files of a folder, by their content; their names may end in anything.

    A DICOMDIR, the table of contents of a disc, is none of them.
    """
    files = [path for path in sorted(folder.iterdir()) if path.is_file() and path.name.upper() != "DICOMDIR"]
    return [file for file in files if _beginning(file)[128:132] == b"DICM"]


def is_dicom_seg(path: Path) -> bool:
    """Return whether a DICOM file is a segmentation object."""
    return any(item in _beginning(path) for item in _SEG_CLASSES)


def _beginning(path: Path) -> bytes:
    try:
        with path.open("rb") as stream:
            return stream.read(1024)
    except OSError:
        return b""
