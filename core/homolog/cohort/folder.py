"""A cohort from a folder: its files, or those of the folders in it."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from homolog.cohort.file_names import (
    corrected,
    kinds_before_numbers,
    known_files,
    maps_of_all,
    meshes_beside,
    numbered_part,
    owner_of,
    pictures_among,
    scans_beside,
    structures_in_names,
)
from homolog.cohort.sides import SIDE_COLUMN, is_side
from homolog.cohort.subject import (
    IMAGE_SUFFIXES,
    MESH_SUFFIXES,
    Cohort,
    Subject,
    image_beside,
    landmarks_beside,
    stem_of,
    suffix_of,
)
from homolog.cohort.subject_folder import entries_of, subjects_in
from homolog.errors import InputError

__all__ = ["dicom_files", "is_dicom_seg", "read_folder"]

_NAMED = 5
"""Files or folders that a message names, at most."""
_LABEL_FOLDER = re.compile(r"(segmentation|label|mask|structure)s?([-_.]?(tr|ts|train|test))?", re.IGNORECASE)
_IMAGE_FOLDER = re.compile(r"(image|scan|volume|picture)s?([-_.]?(tr|ts|train|test))?", re.IGNORECASE)
_MESH_FOLDER = re.compile(r"(mesh|meshe|surface|model)s?", re.IGNORECASE)
"""Names of folders that say what is in them, not of whom it is."""
_DERIVATIVES = "derivatives"
"""Where BIDS data sets keep what was computed from the scans."""
_TEMPLATE = re.compile(r"fsaverage.*|[lr]h\.EC_average|cvs_avg.*", re.IGNORECASE)
"""FreeSurfer's own subjects."""
_SEG_CLASSES = (b"1.2.840.10008.5.1.4.1.1.66.4", b"1.2.840.10008.5.1.4.1.1.66.7")
"""Of segments that may overlap, and of label maps."""

_LABEL_MAPS_OF_FREESURFER = (
    "the label maps in mri/ were read; to take surfaces instead, name them in a cohort.csv (surf/lh.pial)"
)
_SAME_NAMES = "next to segmentations of the same names"

_Files = Mapping[str, Path]
"""Of a subject, by structure."""


def read_folder(folder: Path) -> Cohort:
    """Return the cohort of a folder; raises InputError if there is none or several may be meant."""
    entries = entries_of(folder)
    slices = [
        entry
        for entry in entries
        if suffix_of(entry) == ".dcm" and entry.is_file() and not is_dicom_seg(entry)
    ]
    files = known_files(entries)
    folders = [entry for entry in entries if entry.is_dir()]
    series = {item: _of_series(item) for item in folders if dicom_files(item)}
    if slices or not (files or series or not dicom_files(folder)):
        raise InputError(
            f"{folder}: contains the slices of a DICOM series; give the folder above it, which contains one "
            "folder for each subject"
        )
    if not files and not series:
        series = {item: below for item in folders if (below := _series_below(item))}
    if not files and not series:
        return _read_folders(folder, folders)
    subjects, notes = _of_files(folder, files)
    subjects += [Subject(item.name, place, image=image_beside(place)) for item, place in series.items()]
    return Cohort(tuple(sorted(subjects, key=lambda subject: subject.path)), folder, tuple(notes))


def _of_files(folder: Path, files: Sequence[Path]) -> tuple[list[Subject], list[str]]:
    """Return the subjects of the files in one folder, and a note of those that are none."""
    scans, meshes = scans_beside(files), meshes_beside(files)
    labels = [file for file in files if file not in scans and file not in meshes]
    chosen = maps_of_all(labels) or corrected(labels)
    pictures = pictures_among(chosen)
    chosen = [file for file in chosen if file not in pictures.values()]
    several = structures_in_names([stem_of(file) for file in chosen])
    scan_of = {label: scan for scan, label in scans.items()}
    skipped = {
        "next to label maps of the same subjects": [*scans, *pictures.values()],
        _SAME_NAMES: meshes,
        f"next to {'maps of all structures' if maps_of_all(labels) else 'corrected ones'}": [
            file for file in labels if file not in chosen and file not in pictures.values()
        ],
    }
    notes = [_skipped(where, items) for where, items in skipped.items() if items]
    if kinds := kinds_before_numbers([stem_of(file) for file in chosen]):
        notes.append(
            f"files of the same numbers begin with {_listed(kinds)} and were all taken as subjects; give "
            "each a folder of its own if these are structures"
        )
    if several:
        owners = dict.fromkeys(owner_of(stem_of(file)) for file in chosen)
        return [Subject(owner, folder / owner, image=pictures.get(owner)) for owner in owners], notes
    scan_of |= {file: scan for file in chosen if (scan := pictures.get(owner_of(stem_of(file))))}
    return [_with_scan(file, scan_of.get(file)) for file in chosen], notes


def _with_scan(file: Path, scan: Path | None) -> Subject:
    """Return the subject of a label map; the scan beside it tells its name where that begins the map's."""
    if scan is None:
        return _subject(stem_of(file), file)
    name = stem_of(scan) if stem_of(file).startswith(stem_of(scan)) else stem_of(file)
    return replace(_subject(name, file), image=scan)


def _skipped(why: str, files: Sequence[Path]) -> str:
    return f"skipped, {why}: {_listed([file.name for file in files])}"


def _listed(names: Sequence[str]) -> str:
    more = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {more} more" if more > 0 else "")


def _read_folders(folder: Path, below: Sequence[Path]) -> Cohort:
    """Read folders of subjects: one file in each, or one for each structure; or the one with all files."""
    pipelines = [item for item in below if item.name.casefold() == _DERIVATIVES]
    if pipelines and below != pipelines:
        return read_folder(pipelines[0])
    templates = [item for item in below if _TEMPLATE.fullmatch(item.name)]
    by_place = {item: subjects for item in below if item not in templates and (subjects := subjects_in(item))}
    by_folder = {
        item: next(iter(subjects.values())) for item, subjects in by_place.items() if len(subjects) == 1
    }
    several = [item for item, files in by_folder.items() if len(files) > 1]
    if several and len(by_place) == 1:
        return read_folder(several[0])
    if several and (labels := _label_folder(by_folder)):
        left = [item for item in by_folder if _MESH_FOLDER.fullmatch(item.name)]
        labelled = read_folder(labels)
        return replace(labelled, notes=(*labelled.notes, *([_skipped(_SAME_NAMES, left)] if left else [])))
    if several and len(by_place) > 1 and all(is_side(item.name) for item in by_place):
        return _of_sides(folder, list(by_place))
    if several and not _are_subjects(by_folder):
        return _of_groups(folder, by_folder)
    if not by_place:
        inner = {item: _subjects_below(item) for item in below}
        by_place = {item: places[0] for item, places in inner.items() if [*map(len, places)] == [1]}
        above = [item for item, places in inner.items() if places]
        if len(above) == 1 or by_place.keys() != set(above) or not above:
            return read_folder(_only_folder_above_subjects(folder, above))
    every = {name: files for subjects in by_place.values() for name, files in subjects.items()}
    by_structure = any(len(files) > 1 for files in every.values())
    cohort = tuple(_subject_of(name, files, by_structure) for name, files in every.items())
    empty = [item for item in below if item not in by_place and item not in templates]
    skipped = {"FreeSurfer's own": templates, "without a segmentation or mesh": empty}
    notes = [_skipped(why, items) for why, items in skipped.items() if items]
    if any(
        subject.path.parent.name == "mri" and (subject.path.parents[1] / "surf").is_dir()
        for subject in cohort
    ):
        notes.append(_LABEL_MAPS_OF_FREESURFER)
    return Cohort(cohort, folder, tuple(notes))


def _subjects_below(folder: Path) -> list[dict[str, dict[str, Path]]]:
    """Return what the folders in a folder hold, under the name of that folder."""
    inner = [subjects_in(entry, folder.name) for entry in entries_of(folder) if entry.is_dir()]
    return [subjects for subjects in inner if subjects]


def _only_folder_above_subjects(folder: Path, above: Sequence[Path]) -> Path:
    """Return the one folder that has folders of subjects; raises InputError if none or several have."""
    if len(above) > 1:
        raise InputError(
            f"{folder}: several folders have folders of subjects: {_listed([item.name for item in above])}; "
            "give one of them"
        )
    if not above:
        raise InputError(
            f"{folder}: contains no segmentation or mesh; known files are "
            f"{', '.join(IMAGE_SUFFIXES + MESH_SUFFIXES)} and folders of DICOM files"
        )
    return above[0]


def _subject_of(name: str, files: _Files, by_structure: bool) -> Subject:
    """Return a subject; where subjects have a file for each structure, their folder is the path."""
    first = next(iter(files.values()))
    if by_structure and "" not in files and first.parent.name != "mri":
        return Subject(name, first.parent)
    return _subject(name, first)


def _subject(name: str, file: Path) -> Subject:
    return Subject(name, file, landmarks=landmarks_beside(file), image=image_beside(file))


def _label_folder(by_folder: Mapping[Path, _Files]) -> Path | None:
    """Return the folder of label maps where all others hold pictures (imagesTr) or meshes of their names."""
    labels = [item for item in by_folder if _LABEL_FOLDER.fullmatch(item.name)]
    if len(labels) != 1 or len(by_folder) == 1:
        return None
    names = by_folder[labels[0]].keys()
    known = [
        _IMAGE_FOLDER.fullmatch(item.name) or (_MESH_FOLDER.fullmatch(item.name) and files.keys() <= names)
        for item, files in by_folder.items()
        if item != labels[0]
    ]
    return labels[0] if all(known) else None


def _are_subjects(by_folder: Mapping[Path, _Files]) -> bool:
    """Return whether folders are subjects with a file for each structure: they share the files' names.

    Where files are numbered and folders are not, the files are the subjects.
    """
    if _describe_contents(by_folder):
        return False
    counts = Counter(name.casefold() for files in by_folder.values() for name in files)
    numbered = [bool(re.search(r"\d", name)) for name in counts]
    if 2 * sum(numbered) > len(numbered) and not any(re.search(r"\d", item.name) for item in by_folder):
        return False
    return len(by_folder) > 1 and max(counts.values()) * 2 > len(by_folder)


def _describe_contents(folders: Iterable[Path]) -> bool:
    kinds = (_LABEL_FOLDER, _IMAGE_FOLDER, _MESH_FOLDER)
    return any(kind.fullmatch(item.name) for item in folders for kind in kinds)


def _of_sides(folder: Path, below: Sequence[Path]) -> Cohort:
    """Return the cohort of a folder for each side of the body, whose subjects may have the same names."""
    cohorts = {item.name: read_folder(item) for item in below}
    subjects = [
        replace(subject, name=f"{subject.name}_{side}", columns={**subject.columns, SIDE_COLUMN: side})
        for side, cohort in cohorts.items()
        for subject in cohort.subjects
    ]
    notes = [f"the folders {_listed(list(cohorts))} were taken as sides"]
    notes += [f"{side}: {note}" for side, cohort in cohorts.items() for note in cohort.notes]
    return Cohort(tuple(subjects), folder, tuple(notes))


def _of_groups(folder: Path, by_folder: Mapping[Path, _Files]) -> Cohort:
    """Return the cohort of a folder for each group (controls, patients): its name is the subjects' group."""
    names = Counter(
        owner
        for files in by_folder.values()
        for owner in {numbered_part(name.casefold()) or name.casefold() for name in files}
    )
    mixed = max(names.values()) > 1 or any(re.search(r"\d", item.name) for item in by_folder)
    if mixed or _describe_contents(by_folder):
        counts = _listed(
            [f"{item.name} ({len(files)})" for item, files in by_folder.items() if len(files) > 1]
        )
        raise InputError(
            f"{folder}: contains folders with several segmentations or meshes: {counts}; give one of them, "
            "or a cohort.csv that names the files"
        )
    cohorts = {item.name: read_folder(item) for item in by_folder}
    subjects = [
        replace(subject, group=group) for group, cohort in cohorts.items() for subject in cohort.subjects
    ]
    notes = [f"the folders {_listed(list(cohorts))} were taken as groups"]
    notes += [f"{group}: {note}" for group, cohort in cohorts.items() for note in cohort.notes]
    return Cohort(tuple(subjects), folder, tuple(notes))


def _series_below(folder: Path) -> Path | None:
    """Return where a patient's one series or DICOM SEG lies, as hospitals export it: PATIENT/STUDY/SERIES."""
    for pattern in ("*/", "*/*/"):
        series = [
            _of_series(path) for path in sorted(folder.glob(pattern)) if path.is_dir() and dicom_files(path)
        ]
        segmentations = [path for path in series if path.is_file()]
        if len(segmentations or series) > 1:
            raise InputError(
                f"{folder}: contains {len(series)} DICOM series; give a cohort.csv that names one of them"
            )
        if series:
            return (segmentations or series)[0]
    return None


def _of_series(folder: Path) -> Path:
    """Return the one DICOM SEG that lies among the slices of a scan, else the folder."""
    segmentations = [file for file in dicom_files(folder) if is_dicom_seg(file)]
    return segmentations[0] if len(segmentations) == 1 else folder


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
