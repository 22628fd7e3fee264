"""File names of a whole folder: copies and templates among subjects, and several files of each subject."""

import re
from collections.abc import Sequence
from pathlib import Path

from homolog.cohort.file_names import describe_files, words_but_times
from homolog.cohort.subject import IMAGE_SUFFIXES, MESH_SUFFIXES, stem_of, suffix_of

__all__ = ["copies_among", "files_of_each", "templates_among"]

_TEMPLATES = frozenset(["atlas", "average", "avg", "mean", "meanshape", "reference", "template"])
_TISSUE = re.compile(r"([a-z]*[cp][0-6])(.+)")
"""Names of SPM's and CAT12's maps of tissues: ``c1s01``, ``mwp2s01``."""
_FEWEST_SUBJECTS = 3
_FULL = 0.75
"""Least share of the subjects with a file of each kind."""
_NUMBERED = 3
"""Numbers that are at most this many times as large as their count number the subjects."""


def copies_among(files: Sequence[Path]) -> list[Path]:
    """Return the meshes named like a segmentation, or like a mesh in another format, next to them.

    Files that are not compressed, next to the same ones compressed (``a.nii`` and ``a.nii.gz``), are copies.
    """
    order = (*IMAGE_SUFFIXES, *MESH_SUFFIXES)
    first: dict[str, Path] = {}
    for file in sorted(files, key=lambda file: order.index(suffix_of(file))):
        first.setdefault(stem_of(file), file)
    names = {file.name for file in files}
    return [
        file
        for file in files
        if (suffix_of(file) in MESH_SUFFIXES and first[stem_of(file)] != file) or f"{file.name}.gz" in names
    ]


def templates_among(files: Sequence[Path]) -> list[Path]:
    """Return the files that are by their names templates, atlases or means, if the others are not."""
    templates = [
        file
        for file in files
        if not re.search(r"\d", stem_of(file)) and not _TEMPLATES.isdisjoint(words_but_times(stem_of(file)))
    ]
    return templates if len(templates) + 1 < len(files) else []


def files_of_each(stems: Sequence[str]) -> list[str]:
    """Return the words by which several files of each subject differ: ``P1_L1``, ``P1_L2``, ``P2_L1`` ….

    These may be structures, scans or points in time. The result is empty if files are told apart by sides,
    groups, known points in time, or numbers.
    """
    split = [re.findall(r"[^\W_]+", stem) for stem in stems]
    tissues = [_TISSUE.fullmatch(stem) for stem in stems]
    if all(tissues):
        split = [[item[2], item[1]] for item in tissues if item]
    if len({len(parts) for parts in split}) != 1:
        return []
    for position in range(len(split[0]) - 1, 0, -1):
        kinds = list(dict.fromkeys(parts[position] for parts in split))
        owners = {(*parts[:position], *parts[position + 1 :]) for parts in split}
        is_full = len(stems) >= _FULL * len(kinds) * len(owners)
        if len(kinds) > 1 and len(owners) >= _FEWEST_SUBJECTS and is_full and _are_kinds(kinds):
            return kinds
    return []


def _are_kinds(names: Sequence[str]) -> bool:
    if all(word.isdecimal() for word in names):
        return max(map(int, names)) > _NUMBERED * len(names)
    return not all(map(describe_files, names))
