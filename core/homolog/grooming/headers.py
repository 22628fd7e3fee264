"""Headers of NRRD and MetaImage files: where their voxels lie, and the names of segments."""

import os
from collections.abc import Mapping
from pathlib import Path, PurePosixPath

from homolog.errors import InputError
from homolog.grooming.volumes import Segment

__all__ = ["check_data_files", "segments_of"]

_LONGEST = 2**20
"""A text header that is longer than this is none."""


def check_data_files(path: Path) -> None:
    """Refuse a header whose voxels lie elsewhere than in its own folder, or are not there.

    Parameters
    ----------
    path : Path
        A NRRD or MetaImage file.

    Raises
    ------
    InputError
        Naming the file that is missing or not beside the header, or a compression that can't be read.
    """
    with path.open("rb") as stream:
        text = stream.read(_LONGEST).decode("latin-1")
    nrrd = text.startswith("NRRD")
    lines = (
        text.partition("\n\n" if "\r\n\r\n" not in text else "\r\n\r\n")[0].splitlines()
        if nrrd
        else (text.splitlines())
    )
    for number, line in enumerate(lines):
        key, _, value = (part.strip() for part in line.partition(":" if nrrd else "="))
        key = key.lower().replace(" ", "")
        if nrrd and key == "encoding" and value.lower() in ("bzip2", "bz2"):
            raise InputError(f"{path}: is compressed by bzip2, which can't be read; save it again with gzip")
        if key == ("datafile" if nrrd else "elementdatafile"):
            for name in _names(value, lines[number + 1 :]):
                _check_beside(path, name)
            return


def segments_of(path: Path, values: Mapping[str, str]) -> tuple[Segment, ...]:
    """Return the segments that 3D Slicer noted in a header, ``Segment0_Name`` and so on.

    Raises
    ------
    InputError
        If a value or layer is no number.
    """
    found = []
    number = 0
    while (name := values.get(f"Segment{number}_Name")) is not None:
        try:
            value, layer = (int(values.get(f"Segment{number}_{key}", default)) for key, default in _DEFAULTS)
        except ValueError as error:
            raise InputError(
                f"{path}: its header says nothing sensible of segment {name!r} ({error}); save it again"
            ) from error
        found.append(Segment(name, value, layer))
        number += 1
    return tuple(found)


_DEFAULTS = (("LabelValue", "1"), ("Layer", "0"))


def _names(value: str, following: list[str]) -> list[str]:
    """Return the files that a header names: one, a list, or those of a pattern (its first)."""
    words = value.split()
    if not words or words[0].upper() == "LOCAL":
        return []
    if words[0].upper() == "LIST":
        return [line.strip() for line in following if line.strip()]
    if "%" in words[0] and len(words) >= 3:
        try:
            return [words[0] % int(words[1])]
        except (ValueError, TypeError, OverflowError):
            return [words[0]]
    return [value]


def _check_beside(path: Path, name: str) -> None:
    place = PurePosixPath(os.path.normpath(name.replace("\\", "/")))
    if place.is_absolute() or ".." in place.parts or ":" in name:
        raise InputError(f"{path}: its voxels are said to be in {name}; put that file beside it")
    if not os.path.isfile(path.parent / place):  # no name is too long for it
        raise InputError(f"{path}: its voxels are in {name}, which is not there; put that file beside it")
