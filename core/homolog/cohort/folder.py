"""A cohort from a folder: its files, or those of its subfolders."""

import os
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from homolog.cohort.dicom import dicom_segmentations, holds_dicom, scan_beside, series_below, series_of
from homolog.cohort.file_names import (
    are_groups,
    are_times,
    corrected,
    files_beside,
    is_picture,
    is_site,
    kinds_before_numbers,
    known_files,
    maps_of_all,
    numbered_part,
    owner_of,
    pictures_among,
    structures_in_names,
)
from homolog.cohort.folder_names import (
    LABELS,
    MESHES,
    PREDICTION_FOLDER,
    SCANS,
    SOURCE_FOLDER,
    describe_contents,
    folders_of,
)
from homolog.cohort.name_patterns import copies_among, files_of_each, templates_among
from homolog.cohort.pictures import picture_cohort
from homolog.cohort.sides import SIDE_COLUMN, sides_among
from homolog.cohort.subject import (
    Cohort,
    Subject,
    image_beside,
    landmarks_beside,
    stem_of,
    suffix_of,
)
from homolog.cohort.subject_folder import (
    entries_of,
    has_label_folder,
    holds_files,
    holds_others,
    labels_of_scans,
    only_scans,
    owned_files,
    subjects_in,
)
from homolog.cohort.unread import contents_of, remedy_for
from homolog.errors import InputError

__all__ = ["DERIVATIVES", "read_folder"]

_NAMED = 5
"""Largest number of files or folders in a message."""
DERIVATIVES = "derivatives"
"""Folder of BIDS data sets with results computed from the scans."""
_TEMPLATE = re.compile(r"fsaverage.*|[lr]h\.EC_average|cvs_avg.*", re.IGNORECASE)
"""Names of FreeSurfer's own subjects."""
_LABEL_MAPS_OF_FREESURFER = (
    "the label maps in mri/ were read; to use surfaces, list them in a cohort.csv (surf/lh.pial)"
)
_SAME_NAMES = "next to files with the same names"

_Files = Mapping[str, Path]
"""Files of a subject, by structure."""


def read_folder(folder: Path) -> Cohort:
    """Return the cohort of a folder; raises InputError if there is none or the choice is ambiguous."""
    entries = entries_of(folder)
    slices = [
        entry
        for entry in entries
        if suffix_of(entry) == ".dcm" and entry.is_file() and not dicom_segmentations([entry])
    ]
    files = known_files(entries)
    folders = [entry for entry in entries if entry.is_dir()]
    series = {item: series_of(item) for item in folders if holds_dicom(item)}
    if series and not files and _have_masks(series):
        return _read_folders(folder, folders)
    if slices or not (files or series or not holds_dicom(folder)):
        raise InputError(
            f"{folder}: contains the slices of a DICOM series; give the folder above it, which contains one "
            "folder for each subject"
        )
    if not files and not series:
        below = {item: places for item in folders if (places := series_below(item))}
        if not below or max(map(len, below.values())) > 1 or _have_masks(below):
            return _read_folders(folder, folders)
        series = {item: places[0] for item, places in below.items()}
    if labels := labels_of_scans(files, folders):
        cohort = _of_label_folders(folder, labels, [])
        note = f"used: {_listed([item.name for item in labels])}, with the files above as scans"
        return replace(cohort, notes=(*cohort.notes, note))
    subjects, notes = _of_files(folder, files)
    stems = {stem_of(file) for file in files}
    unused = [item for item in folders if item not in series and files and holds_others(item)]
    if unused:
        notes.append(
            f"not used: the folders {_listed([item.name for item in unused])}, which contain segmentations "
            "or meshes, too; the files next to them were used"
        )
    series = {item: place for item, place in series.items() if item.name not in stems}
    subjects += [
        Subject(item.name, place, image=image_beside(place) or scan_beside(place))
        for item, place in series.items()
    ]
    return Cohort(tuple(sorted(subjects, key=lambda subject: subject.path)), folder, tuple(notes))


def _have_masks(folders: Iterable[Path]) -> bool:
    """Return whether there are label maps or meshes next to the DICOM slices of patients."""
    return any(
        file.is_file() for item in folders for files in subjects_in(item).values() for file in files.values()
    )


def _of_files(folder: Path, files: Sequence[Path]) -> tuple[list[Subject], list[str]]:
    """Return the subjects of the files in one folder, and a note on skipped files."""
    scans, derived = files_beside(files)
    copies = copies_among(files)
    left_out = {*scans, *derived, *copies}
    labels = [file for file in files if file not in left_out]
    templates = templates_among(labels)
    labels = [file for file in labels if file not in templates]  # few
    chosen = maps_of_all(labels) or corrected(labels)
    pictures = pictures_among(chosen)
    used, images = set(chosen), set(pictures.values())
    chosen = [file for file in chosen if file not in images]
    several = structures_in_names([stem_of(file) for file in chosen])
    scan_of = {label: scan for scan, label in scans.items()}
    skipped = {
        "next to label maps of the same subjects": [*scans, *pictures.values()],
        "predictions or probabilities next to label maps": derived,
        _SAME_NAMES: copies,
        "templates, atlases or means by their names": templates,
        f"next to {'maps of all structures' if maps_of_all(labels) else 'corrected ones'}": [
            file for file in labels if file not in used
        ],
    }
    notes = [_skipped(where, items) for where, items in skipped.items() if items]
    if kinds := kinds_before_numbers([stem_of(file) for file in chosen]):
        notes.append(
            f"files with equal numbers begin with {_listed(kinds)}, and all are subjects; if these are "
            "structures, move each to its own folder"
        )
    elif not several and (kinds := files_of_each([stem_of(file) for file in chosen])):
        notes.append(
            f"each subject has files named {_listed(kinds)}, and all are subjects of their own; if these are "
            "structures, move each to its own folder"
        )
    if several:
        owners = dict.fromkeys(owner_of(stem_of(file)) for file in chosen)
        return [Subject(owner, folder / owner, image=pictures.get(owner)) for owner in owners], notes
    scan_of |= {file: scan for file in chosen if (scan := pictures.get(owner_of(stem_of(file))))}
    return [_with_scan(file, scan_of.get(file)) for file in chosen], notes


def _with_scan(file: Path, scan: Path | None) -> Subject:
    """Return the subject of a label map, named after the scan if the map's name begins with the scan's."""
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
    every_below = below
    pipelines = [item for item in below if item.name.casefold() == DERIVATIVES]
    if pipelines and below != pipelines:
        return read_folder(pipelines[0])
    scans = only_scans(below)
    below = [item for item in below if item not in scans] or below
    templates = [item for item in below if _TEMPLATE.fullmatch(item.name)]
    by_place = _without_scans({item: subjects_in(item) for item in below if item not in templates})
    by_folder = {
        item: next(iter(subjects.values())) for item, subjects in by_place.items() if len(subjects) == 1
    }
    several = [item for item, files in by_folder.items() if len(files) > 1]
    groups = [item for item in below if not (item in templates or subjects_in(item)) and holds_files(item)]
    if several and groups:
        return _of_parts(folder, [*by_place, *groups])
    if several and len(by_place) == 1:
        if any(file.is_dir() for file in by_folder[several[0]].values()):  # a single patient does not show
            raise _several_meant(folder, {several[0]: {}})
        return read_folder(several[0])
    if several and (labels := _label_folders(by_folder)):
        return _of_label_folders(folder, labels, [item for item in by_folder if item not in labels])
    parts = [item.name for item in by_place]
    if several and (sides_among(parts) or all(map(is_site, parts)) or not _are_subjects(by_folder)):
        return _of_parts(folder, list(by_folder))
    if not by_place:
        above = [item for item in below if holds_files(item)]
        if len(above) == 1:
            return read_folder(above[0])
        if not above:
            if pictures := picture_cohort(folder, every_below):
                return pictures
            raise InputError(f"{folder}: contains no segmentation or mesh{contents_of(folder)}")
        return _of_parts(folder, above)
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


def _without_scans(by_place: Mapping[Path, Mapping[str, _Files]]) -> dict[Path, Mapping[str, _Files]]:
    """Return the folders with files; if there are masks, without folders that contain only scans."""
    filled = {item: subjects for item, subjects in by_place.items() if subjects}
    masks = {
        item: subjects
        for item, subjects in filled.items()
        if not all(is_picture(name) for files in subjects.values() for name in files)
    }
    return masks or filled


def _subject_of(name: str, files: _Files, by_structure: bool) -> Subject:
    """Return a subject; its path is its folder if it has one file per structure."""
    first = next(iter(files.values()))
    if by_structure and "" not in files and (len(files) > 1 or first.parent.name != "mri"):
        return Subject(name, Path(os.path.commonpath([file.parent for file in files.values()])))
    return _subject(name, first)


def _subject(name: str, file: Path) -> Subject:
    return Subject(name, file, landmarks=landmarks_beside(file), image=image_beside(file))


def _label_folders(by_folder: Mapping[Path, _Files]) -> list[Path]:
    """Return the folders of label maps if all others contain files of the same names, or predictions."""
    named, scans = (folders_of(kind, [item.name for item in by_folder]) for kind in (LABELS, SCANS))
    labels = [item for item in by_folder if item.name in named]
    names = {name for item in labels for name in by_folder[item]}
    known = [
        files.keys() <= names or item.name in scans or PREDICTION_FOLDER.fullmatch(item.name)
        for item, files in by_folder.items()
        if item not in labels
    ]
    return labels if all(known) else []


def _of_label_folders(folder: Path, labels: Sequence[Path], others: Sequence[Path]) -> Cohort:
    cohorts = [read_folder(item) for item in labels]
    names = Counter(subject.name for item in cohorts for subject in item.subjects)
    if max(names.values()) > 1:
        raise _several_meant(folder, {item: owned_files(item) for item in labels})
    notes = [note for cohort in cohorts for note in cohort.notes]
    if len(labels) > 1:
        notes.append(f"the folders {_listed([item.name for item in labels])} were combined")
    meshes = list(folders_of(MESHES, [item.name for item in others]))
    if meshes:
        notes.append(f"skipped, {_SAME_NAMES}: {_listed(meshes)}")
    if unused := [item.name for item in others if item.name not in meshes]:
        notes.append(
            f"used: {_listed([item.name for item in labels])}; not used: {_listed(unused)}; to use "
            "them, give that folder alone"
        )
    subjects = tuple(subject for cohort in cohorts for subject in cohort.subjects)
    return Cohort(subjects, cohorts[0].folder if len(cohorts) == 1 else folder, tuple(notes))


def _are_subjects(by_folder: Mapping[Path, _Files]) -> bool:
    """Return whether folders are subjects with a file for each structure: they share file names.

    If files are numbered and folders are not, or are time points, the files are the subjects.
    """
    if describe_contents([item.name for item in by_folder]):
        return False
    counts = Counter(name.casefold() for files in by_folder.values() for name in files)
    numbered = [bool(re.search(r"\d", name)) for name in counts]
    folders = [item.name for item in by_folder]
    are_persons = not any(re.search(r"\d", name) for name in folders) or are_times(folders)
    if 2 * sum(numbered) > len(numbered) and are_persons:
        return False
    return len(by_folder) > 1 and max(counts.values()) * 2 > len(by_folder)


def _of_parts(folder: Path, parts: Sequence[Path]) -> Cohort:
    """Return the cohort of folders with several subjects each: sides, groups, or structures."""
    if any(SOURCE_FOLDER.fullmatch(item.name) for item in parts):
        raise _several_meant(folder, {item: owned_files(item) for item in parts})
    if used := _without_results(parts):
        cohort = read_folder(used[0]) if len(used) == 1 else _of_parts(folder, used)
        unused = [item.name for item in parts if item not in used]
        note = f"not used: {_listed(unused)}, named like results; to use such a folder, give it alone"
        return replace(cohort, notes=(*cohort.notes, note))
    if sides := sides_among([item.name for item in parts]):
        return _of_sides(folder, {item: sides[item.name] for item in parts})
    if are_groups([item.name for item in parts]) or all(map(has_label_folder, parts)):
        return _of_groups(folder, parts)
    owned = {item: owned_files(item) for item in parts}
    if _are_structures(owned):
        owners = sorted({name for files in owned.values() for name in files})
        listed = _listed([item.name for item in parts])
        note = f"the folders {listed} were used as structures; if they are groups, give a cohort.csv"
        return Cohort(tuple(Subject(name, folder / name) for name in owners), folder, (note,))
    names = Counter(
        owner
        for files in owned.values()
        for owner in {numbered_part(name.casefold()) or name.casefold() for name in files}
    )
    mixed = max(names.values(), default=2) > 1 or any(re.search(r"\d", item.name) for item in parts)
    if mixed or describe_contents([item.name for item in parts]):
        raise _several_meant(folder, owned)
    return _of_groups(folder, parts)


def _without_results(parts: Sequence[Path]) -> list[Path]:
    """Return the folders without those that are named as results, if there are any: ``data``, ``output``."""
    used = [item for item in parts if not PREDICTION_FOLDER.fullmatch(item.name)]
    return used if len(used) < len(parts) else []


def _several_meant(folder: Path, owned: Mapping[Path, _Files]) -> InputError:
    for item, files in owned.items():
        if not files and (series := len(series_below(item))) > 1:
            return InputError(
                f"{item}: contains {series} DICOM series; give a cohort.csv that names one of them"
            )
    project = next((entry for entry in entries_of(folder) if entry.suffix.lower() == ".swproj"), None)
    imported = f"{remedy_for(project)} {project.name} PROJECT; or " if project else ""
    counts = [
        f"{item.name} ({len(files)})" if files else item.name
        for item, files in owned.items()
        if len(files) != 1 or all(len(each) == 1 for each in owned.values())
    ]
    return InputError(
        f"{folder}: contains folders with several segmentations or meshes: "
        f"{_listed(counts)}; {imported}give one of them, or a cohort.csv "
        "that names the files"
    )


def _are_structures(owned: Mapping[Path, Mapping[str, Path]]) -> bool:
    """Return whether each folder contains one structure, and most subjects are in two or more folders."""
    if len(owned) < 2 or describe_contents([item.name for item in owned]) or not all(owned.values()):
        return False
    counts = Counter(name for files in owned.values() for name in files)
    if describe_contents(counts):  # folders of patients, with images and masks
        return False
    return 2 * sum(count > 1 for count in counts.values()) > len(counts)


def _of_sides(folder: Path, sides: Mapping[Path, str]) -> Cohort:
    """Return the cohort of a folder for each side of the body, whose subjects may have the same names."""
    cohorts = {item: read_folder(item) for item in sides}
    subjects = [
        replace(
            subject,
            name=f"{subject.name}_{sides[item]}",
            columns={**subject.columns, SIDE_COLUMN: sides[item]},
        )
        for item, cohort in cohorts.items()
        for subject in cohort.subjects
    ]
    notes = [f"the folders {_listed([item.name for item in sides])} were used as sides"]
    notes += [f"{item.name}: {note}" for item, cohort in cohorts.items() for note in cohort.notes]
    return Cohort(tuple(subjects), folder, tuple(notes))


def _of_groups(folder: Path, parts: Sequence[Path]) -> Cohort:
    """Return the cohort of a folder for each group (controls, patients); its name is the subjects' group."""
    cohorts = {item.name: read_folder(item) for item in parts}
    names = Counter(subject.name for cohort in cohorts.values() for subject in cohort.subjects)
    alike = max(names.values()) > 1
    subjects = [
        replace(subject, name=f"{subject.name}_{group}" if alike else subject.name, group=group)
        for group, cohort in cohorts.items()
        for subject in cohort.subjects
    ]
    notes = [f"the folders {_listed(list(cohorts))} were used as groups"]
    notes += [f"{group}: {note}" for group, cohort in cohorts.items() for note in cohort.notes]
    return Cohort(tuple(subjects), folder, tuple(notes))
