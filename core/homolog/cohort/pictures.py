"""Masks as image stacks: a folder of PNG, TIFF or BMP slices for each subject, or a multi-page TIFF file."""

import re
from collections.abc import Sequence
from pathlib import Path

from homolog.cohort.entries import readable_entries
from homolog.cohort.subject import Cohort, Subject
from homolog.errors import InputError

__all__ = ["has_pages", "picture_cohort", "pictures_in"]

_SUFFIXES = (".png", ".tif", ".tiff", ".bmp")
_MASKS = re.compile(r"(.*[-_ ])?(segmentation|seg|label|mask|gt|roi)s?([-_ ].*)?", re.IGNORECASE)
_NUMBER = re.compile(r"\d+")
_FEWEST = 2
_DEPTH = 3


def pictures_in(folder: Path) -> list[Path]:
    """Return the images in a folder, ordered by the numbers in their names."""
    files = [entry for entry in readable_entries(folder) if entry.suffix.lower() in _SUFFIXES]
    return sorted((file for file in files if file.is_file()), key=_natural)


def has_pages(path: Path) -> bool:
    """Return whether a TIFF file has several pages, which are the slices of a volume."""
    from PIL import Image

    try:
        with Image.open(path) as picture:
            return int(getattr(picture, "n_frames", 1)) >= _FEWEST
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError):
        return True  # damaged: refused later with its name


def picture_cohort(folder: Path, folders: Sequence[Path]) -> Cohort | None:
    """Return the cohort of a folder with a folder of slices for each subject; None without slices.

    Raises
    ------
    InputError
        If the folder itself contains slices, or a subject's folder contains several stacks.
    """
    if len(pictures_in(folder)) >= _FEWEST:
        raise InputError(
            f"{folder}: contains the slices of one stack of pictures; give the folder above it, which "
            "contains one folder for each subject"
        )
    if masks := [item for item in folders if _MASKS.fullmatch(item.name)]:
        below = [item for item in readable_entries(masks[0]) if item.is_dir()]
        if len(masks) == 1 and below and not pictures_in(masks[0]):
            return picture_cohort(masks[0], below)
    stacks = {item: places for item in folders if (places := _stacks(item, _DEPTH))}
    for item, places in stacks.items():
        if len(places) > 1:
            listed = ", ".join(place.relative_to(item).as_posix() for place in places[:5])
            raise InputError(
                f"{item}: contains several stacks of pictures: {listed}; name one of them for each "
                "subject in a cohort.csv"
            )
    if not stacks:
        return None
    note = f"{len(stacks)} folders of pictures were used as the slices of one subject each"
    subjects = [Subject(item.name, places[0]) for item, places in stacks.items()]
    return Cohort(tuple(sorted(subjects, key=lambda subject: subject.path)), folder, (note,))


def _stacks(folder: Path, depth: int) -> list[Path]:
    """Return the folders of stacks in a folder; only those named masks, if there are any."""
    if len(pictures_in(folder)) >= _FEWEST:
        return [folder]
    below = [item for item in readable_entries(folder) if item.is_dir()]
    below = [item for item in below if _MASKS.fullmatch(item.name)] or below
    return [place for item in below if depth > 0 for place in _stacks(item, depth - 1)]


def _natural(path: Path) -> tuple[list[int], str]:
    return [int(number) for number in _NUMBER.findall(path.stem)], path.name
