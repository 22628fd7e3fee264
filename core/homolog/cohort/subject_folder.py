"""The files in a subject's folder: a single one, one per structure, or one per point in time."""

import re
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType

from homolog.cohort.dicom import holds_dicom
from homolog.cohort.entries import readable_entries
from homolog.cohort.file_names import (
    are_groups,
    are_times,
    best_label_maps,
    corrected,
    files_beside,
    is_mask,
    is_picture,
    is_site,
    known_files,
    maps_of_all,
    name_within,
    owner_of,
    structure_in,
    times_among,
)
from homolog.cohort.folder_names import IMAGES, LABELS, describe_contents, folders_of
from homolog.cohort.sides import sides_among
from homolog.cohort.subject import IMAGE_ENDING, IMAGE_SUFFIXES, stem_of, suffix_of

__all__ = [
    "entries_of", "has_label_folder", "holds_files", "holds_others", "labels_of_scans", "mask_files",
    "only_scans", "owned_files", "subjects_in",
]  # fmt: skip

_FREESURFER = tuple(
    f"mri/{name}.{suffix}"
    for name in ("aseg", "aparc+aseg", "aparc.DKTatlas+aseg", "aparc.DKTatlas+aseg.deep")
    for suffix in ("mgz", "mgh", "nii.gz")
)
"""Files of FreeSurfer and FastSurfer with a subject's structures, those with the fewest first."""
_LABELS = ("annotation", "contour", "ground", "label", "mask", "segmentation", "structure")
"""Prefixes of names of folders with label maps, singular or plural, case-insensitive."""
_KINDS_OF_SCAN = ("anat", "ct", "dwi", "func", "perf", "t1", "t1w")
_SESSION = re.compile(r"ses-.+", re.IGNORECASE)
"""Names of folders within a subject's folder in BIDS."""
_VISIT = re.compile(r"(m|t|tp|v|w|y)[-_]?\d{1,3}|bl", re.IGNORECASE)
_FIRST_VISIT = re.compile(r"(m|t|tp|v|w|y)[-_]?0+|bl", re.IGNORECASE)
"""Names of the folders of a subject's visits from zero or baseline: ``m00``, ``T0``, ``bl``."""
_OWNERS = 3
"""Number of parent folders with whose names a file's name may begin."""
_DEPTH = 5
"""Number of levels of folders that are searched."""


def subjects_in(folder: Path, name: str = "") -> dict[str, dict[str, Path]]:
    """Return the files in a subject's folder, by the names of its subjects and by structure.

    A folder has several subjects if it has sessions (BIDS) or folders of sides, or if its files or folders
    are points in time (``frame01``, ``ED``, ``2020-04-02``); the file of a point in time has an empty
    structure name.

    Parameters
    ----------
    folder : Path
    name : str
        Name of the subject; by default that of the folder.

    Returns
    -------
    dict of str to dict of str to Path
    """
    name = name or folder.name
    for place in _FREESURFER:
        if (folder / place).is_file():
            return {name: {place[len("mri/") :].split(".")[0]: folder / place}}
    files, below = mask_files(folder), [entry for entry in entries_of(folder) if entry.is_dir()]
    if are_times(files):
        return {f"{name}_{structure}": {"": file} for structure, file in files.items()}
    if files and not maps_of_all(list(files.values())):
        inner = (mask_files(item) for item in below)
        files = next((item for item in inner if maps_of_all(list(item.values()))), files)
    if files:
        return {name: files}
    subjects: dict[str, dict[str, Path]] = {}
    names = [item.name for item in below]
    visits = _visits_among(names) if re.search(r"\d", folder.name) else []
    parts = times_among(names) or list(sides_among(names)) or visits
    for item in below:
        if _SESSION.fullmatch(item.name) or item.name in parts:
            subjects |= subjects_in(item, f"{name}_{item.name}")
        elif item.name.casefold() in _KINDS_OF_SCAN:
            subjects |= subjects_in(item, name)
    if subjects:
        return subjects
    deeper = [nested for item in below if (nested := subjects_in(item, name))]
    return deeper[0] if len(deeper) == 1 else {}


def _visits_among(names: Sequence[str]) -> list[str]:
    """Return the folders of visits, if one of them is the first; ``T1`` and ``T2`` alone are scans."""
    visits = [name for name in names if _VISIT.fullmatch(name)]
    letters = {name[0].casefold() for name in visits if name.casefold() != "bl"}
    is_from_first = any(map(_FIRST_VISIT.fullmatch, visits))
    return visits if len(visits) > 1 and len(letters) < 2 and is_from_first else []


def mask_files(folder: Path) -> dict[str, Path]:
    """Return a subject's files by structure, if it has a file for each structure.

    A structure's name excludes the subject's name at the beginning of the file name. Scans (``ct``, ``t1``,
    …) are omitted if there are other files. All other files are omitted if one file contains all structures.

    Parameters
    ----------
    folder : Path
        The subject's folder; its folder of segmentations is used if it has one. If the folder does not exist,
        ``FOLDER/p1`` denotes the files ``p1_liver.nii.gz``, ``p1_spleen.nii.gz``, … of a common folder, or
        for ``liver/p1.nii.gz``, ``spleen/p1.nii.gz``, … of a folder for each structure.

    Returns
    -------
    dict of str to Path
        Files by structure; may be empty.
    """
    if not folder.exists():
        owner = folder.name
        return _masks_of_owner(folder.parent, owner) or _masks_in_folders(folder.parent, owner)
    below = [
        entry for entry in entries_of(folder) if entry.is_dir() and entry.name.casefold().startswith(_LABELS)
    ]
    inner = [files for item in below if (files := _masks(item))]
    return inner[0] if len(inner) == 1 else _masks(folder) or _masks_by_folder(folder)


def _masks(folder: Path) -> dict[str, Path]:
    known = [file for file in known_files(entries_of(folder)) if suffix_of(file) != ".dcm"]
    if not known:
        return _series_of_masks(folder)
    scans, derived = files_beside(known)
    files, best, left_out = dict[str, Path](), corrected(known), {*scans, *derived}
    ending = "_corr" if len(best) < len(known) else ""
    for file in best:
        if file not in left_out:
            files.setdefault(_structure(file).removesuffix(ending), file)
    masks = {name: file for name, file in files.items() if not is_picture(name)}
    if any(map(is_mask, masks)) and len(masks) > 1:  # that with the patient's name is the scan
        masks = {name: file for name, file in masks.items() if name != folder.name} or masks
    return best_label_maps(masks or files)


def _masks_of_owner(folder: Path, owner: str) -> dict[str, Path]:
    """Return the files whose names begin with that of their subject, by structure."""
    if not folder.is_dir():
        return {}
    own = [file for file in entries_of(folder) if file.name.startswith(owner)]
    known = [file for file in known_files(own) if owner_of(stem_of(file)) == owner]
    best, (_, derived) = corrected(known), files_beside(known)
    ending = "_corr" if len(best) < len(known) else ""
    best = [file for file in best if file not in derived]
    masks = {structure_in(stem_of(file)).removesuffix(ending): file for file in reversed(best)}
    return {name: masks[name] for name in sorted(masks) if name and not is_picture(name)}


def _series_of_masks(folder: Path) -> dict[str, Path]:
    """Return the folders of slices, one per structure, as in 3D-IRCADb."""
    inner = [entry for entry in entries_of(folder) if entry.is_dir() and not is_picture(entry.name)]
    return {entry.name: entry for entry in inner if holds_dicom(entry)}


def _masks_in_folders(folder: Path, owner: str) -> dict[str, Path]:
    """Return a subject's files in folders of structures: ``liver/p1.nii.gz``, ``spleen/p1.nii.gz``."""
    if not folder.is_dir():
        return {}
    parts = [entry for entry in entries_of(folder) if entry.is_dir() and not is_picture(entry.name)]
    files = {part.name: owned_files(part).get(owner) for part in parts}
    return {name: file for name, file in files.items() if file is not None}


def _masks_by_folder(folder: Path) -> dict[str, Path]:
    """Return the files in a numbered subject's folders of structures: ``S01/Tibia/tibia.nii.gz``."""
    names = [entry.name for entry in entries_of(folder) if entry.is_dir()]
    other = re.compile(r"\d|anat$|ses-", re.IGNORECASE)
    are_kinds = not any(other.search(name) or is_picture(name) for name in names)
    if len(names) < 2 or not are_kinds or not re.search(r"\d", folder.name) or is_site(folder.name):
        return {}
    if are_groups(names) or are_times(names) or sides_among(names) or describe_contents(names):
        return {}
    files = [_masks(folder / name) for name in names]
    single = all(len(item) == 1 for item in files)
    return (
        {name: next(iter(item.values())) for name, item in zip(names, files, strict=True)} if single else {}
    )


def owned_files(folder: Path) -> Mapping[str, Path]:
    """Return the files in the folder of a structure, or in its subjects' folders, by subject."""
    return _owned_files(folder, folder.stat().st_mtime_ns)


@lru_cache(maxsize=512)
def _owned_files(folder: Path, changed: int) -> Mapping[str, Path]:
    entries = entries_of(folder)
    known = known_files(entries)
    scans, _ = files_beside(known)
    files = {file: stem_of(file) for file in reversed(known) if file not in scans}
    for entry in entries if not files else ():
        masks = mask_files(entry) if entry.is_dir() else {}
        if len(masks) == 1:
            files[next(iter(masks.values()))] = entry.name
        elif entry.is_dir() and not masks and holds_dicom(entry):
            files[entry] = entry.name
    return MappingProxyType({name_within(folder.name, name): file for file, name in files.items()})


def _structure(path: Path) -> str:
    """Return a file's name without the names of parent folders with which it begins, the longest first."""
    stem, owners = stem_of(path), [folder.name for folder in path.parents[:_OWNERS] if folder.name]
    while ahead := [name for name in owners if re.match(rf"{re.escape(name)}[-_. ]+\S", stem, re.IGNORECASE)]:
        stem = stem[len(max(ahead, key=len)) :].lstrip("-_. ")
    return stem


def holds_files(folder: Path, without: re.Pattern[str] | None = None, depth: int = _DEPTH) -> bool:
    """Return whether a folder contains a segmentation or mesh at any level, outside folders of one kind."""
    entries = entries_of(folder)
    if known_files(entries) or holds_dicom(folder):
        return True
    below = [entry for entry in entries if entry.is_dir()]
    skipped = folders_of(without, [entry.name for entry in below]) if without else set[str]()
    return depth > 0 and any(
        holds_files(entry, without, depth - 1) for entry in below if entry.name not in skipped
    )


def only_scans(folders: Sequence[Path]) -> list[Path]:
    """Return the folders whose files are all in folders of scans, by their names: ``imagesTs``."""
    named = folders_of(IMAGES, [item.name for item in folders])
    return [
        item
        for item in folders
        if holds_files(item) and (item.name in named or not holds_files(item, without=IMAGES))
    ]


def labels_of_scans(files: Sequence[Path], folders: Sequence[Path]) -> list[Path]:
    """Return the folders of label maps of the files above them, if most of these are their scans by name."""
    named = folders_of(LABELS, [item.name for item in folders])
    labels = [item for item in folders if item.name in named]
    if not labels:
        return []
    owned = {name: file for item in labels for name, file in owned_files(item).items()}
    label_maps = set(owned.values())
    scans, _ = files_beside([*files, *label_maps])
    known = [file for file in files if stem_of(file) in owned or scans.get(file) in label_maps]
    are_images = all(suffix_of(file) in IMAGE_SUFFIXES for file in files)
    return labels if known and are_images and 2 * len(known) >= len(files) else []


def has_label_folder(folder: Path) -> bool:
    """Return whether a folder contains a folder of label maps of several subjects."""
    inner = {item.name: item for item in entries_of(folder) if item.is_dir()}
    return any(len(owned_files(inner[name])) > 1 for name in folders_of(LABELS, inner))


def holds_others(folder: Path) -> bool:
    """Return whether a folder next to a cohort's files contains segmentations or meshes, too."""
    is_project = (folder / "project.json").is_file()
    return not is_project and holds_files(folder) and not only_scans([folder])


def entries_of(folder: Path) -> list[Path]:
    """Return the entries of a folder (see `readable_entries`) without scans of other entries."""
    entries = readable_entries(folder)
    scans = {path: stem for path in entries if (stem := stem_of(path)).endswith(IMAGE_ENDING)}
    if not scans:
        return entries
    stems = {stem_of(path) for path in entries}
    return [path for path in entries if scans.get(path, "").removesuffix(IMAGE_ENDING) not in stems]
