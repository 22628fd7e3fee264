"""The files of one subject's folder: one, one for each structure, or one for each point in time."""

import re
from pathlib import Path

from homolog.cohort.file_names import (
    are_times,
    best_label_maps,
    corrected,
    is_picture,
    known_files,
    owner_of,
    scans_beside,
    structure_in,
)
from homolog.cohort.subject import IMAGE_ENDING, stem_of, suffix_of

__all__ = ["entries_of", "mask_files", "subjects_in"]

_FREESURFER = tuple(
    f"mri/{name}.{suffix}"
    for name in ("aseg", "aparc+aseg", "aparc.DKTatlas+aseg", "aparc.DKTatlas+aseg.deep")
    for suffix in ("mgz", "mgh", "nii.gz")
)
"""Where FreeSurfer and FastSurfer keep a subject's structures, the fewest first."""
_LABELS = ("segmentation", "label", "mask", "structure")
"""How folders of label maps begin, in any case and number."""
_KINDS_OF_SCAN = ("anat", "ct", "dwi", "func", "perf")
_SESSION = re.compile(r"ses-.+", re.IGNORECASE)
"""Folders within a subject's folder, of BIDS."""
_OWNERS = 3
"""Folders above a file whose names may begin its own."""


def subjects_in(folder: Path, name: str = "") -> dict[str, dict[str, Path]]:
    """Return the files of a subject's folder by structure, by the names of its subjects.

    There are several where it has sessions (BIDS), or its files are points in time (``frame01``, ``ED``); the
    file of a point in time has an empty name.

    Parameters
    ----------
    folder : Path
    name : str
        The subject's; the folder's if empty.

    Returns
    -------
    dict of str to dict of str to Path
    """
    name = name or folder.name
    for place in _FREESURFER:
        if (folder / place).is_file():
            return {name: {place[len("mri/") :].split(".")[0]: folder / place}}
    files = mask_files(folder)
    if are_times(files):
        return {f"{name}_{structure}": {"": file} for structure, file in files.items()}
    if files:
        return {name: files}
    subjects: dict[str, dict[str, Path]] = {}
    for item in entries_of(folder):
        if item.is_dir() and item.name.casefold() in _KINDS_OF_SCAN:
            subjects |= subjects_in(item, name)
        elif item.is_dir() and _SESSION.fullmatch(item.name):
            subjects |= subjects_in(item, f"{name}_{item.name}")
    return subjects


def mask_files(folder: Path) -> dict[str, Path]:
    """Return a subject's files by the name of their structure, where it has a file for each.

    The subject's name at the beginning of a file's name is no part of that. Pictures (``ct``, ``t1``, …) are
    left out where something else is there, and all other files where one holds all structures.

    Parameters
    ----------
    folder : Path
        The subject's; its folder of segmentations is taken if it has one. If there is no such folder,
        ``FOLDER/p1`` stands for the files ``p1_liver.nii.gz``, ``p1_spleen.nii.gz``, … of a common folder.

    Returns
    -------
    dict of str to Path
        Empty if there are none.
    """
    if not folder.exists():
        return _masks_of_owner(folder.parent, folder.name)
    below = [
        entry for entry in entries_of(folder) if entry.is_dir() and entry.name.casefold().startswith(_LABELS)
    ]
    inner = [files for item in below if (files := _masks(item))]
    return inner[0] if len(inner) == 1 else _masks(folder)


def _masks(folder: Path) -> dict[str, Path]:
    known = [file for file in known_files(entries_of(folder)) if suffix_of(file) != ".dcm"]
    scans, files, best = scans_beside(known), dict[str, Path](), corrected(known)
    ending = "_corr" if len(best) < len(known) else ""
    for file in best:
        if file not in scans:
            files.setdefault(_structure(file).removesuffix(ending), file)
    masks = {name: file for name, file in files.items() if not is_picture(name)}
    return best_label_maps(masks or files)


def _masks_of_owner(folder: Path, owner: str) -> dict[str, Path]:
    """Return the files by structure whose names begin with that of their subject."""
    if not folder.is_dir():
        return {}
    own = [file for file in entries_of(folder) if file.name.startswith(owner)]
    known = [file for file in known_files(own) if owner_of(stem_of(file)) == owner]
    best = corrected(known)
    ending = "_corr" if len(best) < len(known) else ""
    masks = {structure_in(stem_of(file)).removesuffix(ending): file for file in reversed(best)}
    return {name: masks[name] for name in sorted(masks) if name and not is_picture(name)}


def _structure(path: Path) -> str:
    """Return a file's name without those of the folders above it that it begins with."""
    stem = stem_of(path)
    for folder in reversed(path.parents[:_OWNERS]):
        owner, rest = folder.name, stem[len(folder.name) :]
        if owner and stem.casefold().startswith(owner.casefold()) and rest[:1] in ("_", "-", ".", " "):
            stem = rest[1:].strip() or stem
    return stem


def entries_of(folder: Path) -> list[Path]:
    """Return what is in a folder, without hidden entries and the scans of others."""
    entries = [path for path in sorted(folder.iterdir()) if not path.name.startswith(".")]
    scans = {path: stem for path in entries if (stem := stem_of(path)).endswith(IMAGE_ENDING)}
    if not scans:
        return entries
    stems = {stem_of(path) for path in entries}
    return [path for path in entries if scans.get(path, "").removesuffix(IMAGE_ENDING) not in stems]
