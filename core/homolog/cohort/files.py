"""Which files of a folder are shapes: segmentations, meshes, and folders with the slices of a series."""

import os
import re
from collections.abc import Sequence
from pathlib import Path

from homolog.cohort.dicom import dicom_files, dicom_segmentations
from homolog.cohort.entries import readable_entries
from homolog.cohort.subject import IMAGE_ENDING, IMAGE_SUFFIXES, MESH_SUFFIXES, stem_of, suffix_of

__all__ = ["all_below", "is_series", "pictures_in", "shape_in", "shapes_below"]

_DEPTH = 5
"""Number of levels of folders that are searched."""
_PICTURES = (".png", ".tif", ".tiff", ".bmp")
_TWO = 2
_NUMBER = re.compile(r"\d+")
_OTHER_GIFTI = re.compile(
    r"\.(shape|func|label|time|tensor|vector|coord|topo|rgba|dset|annot)\.gii$"
    r"|(^|[^a-z])((very_?)?inflated|sphere|flat)([^a-z].*)?\.gii$",
    re.IGNORECASE,
)
"""GIFTI files of values on a surface, and of unfolded surfaces, as their standard and HCP name them."""


def shapes_below(folder: Path, depth: int = _DEPTH) -> list[Path]:
    """Return the shapes in a folder and its subfolders, in order, without scans of other files and projects.

    Folders of slices count only where there are no files: next to these they are scans or pictures.
    """
    every = all_below(folder, depth)
    return [path for path in every if path.is_file()] or every


def all_below(folder: Path, depth: int = _DEPTH) -> list[Path]:
    """Return the files and all folders of slices below a folder, to a number of levels of subfolders."""
    shapes = []
    for entry in _without_scans(readable_entries(folder)):
        if not entry.is_dir():
            shapes += [entry] if _is_shape(entry) else []
        elif series := shape_in(entry):
            shapes.append(series)
        elif depth > 0 and not (entry / "project.json").is_file():
            shapes += all_below(entry, depth - 1)
    return shapes


def shape_in(folder: Path) -> Path | None:
    """Return the only DICOM SEG or RTSTRUCT of a folder, or the folder if it contains a series of slices.

    Other segmentations or meshes take precedence over slices: the result is then None.
    """
    entries = [entry for entry in readable_entries(folder) if entry.is_file()]
    if any(suffix_of(entry) != ".dcm" and _is_shape(entry) for entry in entries):
        return None
    if dicom := dicom_files(folder):
        segmentations = dicom_segmentations(dicom)
        return folder if not segmentations else segmentations[0] if len(segmentations) == 1 else None
    return folder if len(pictures_in(folder)) >= _TWO else None


def is_series(path: Path) -> bool:
    """Return whether a path is a folder with the slices of a series."""
    return path.is_dir() and shape_in(path) == path


def pictures_in(folder: Path) -> list[Path]:
    """Return the images in a folder, ordered by the numbers in their names."""
    files = [entry for entry in readable_entries(folder) if entry.suffix.lower() in _PICTURES]
    return sorted((file for file in files if file.is_file()), key=_natural)


def _is_shape(path: Path) -> bool:
    suffix = suffix_of(path)
    if suffix not in IMAGE_SUFFIXES + MESH_SUFFIXES or _OTHER_GIFTI.search(path.name):
        return False
    if suffix == ".dcm":
        return bool(dicom_segmentations([path]))
    return suffix not in (".tif", ".tiff") or _has_pages(path)


def _has_pages(path: Path) -> bool:
    """Return whether a TIFF file has several pages, which are the slices of a volume."""
    from PIL import Image

    try:
        with Image.open(path) as picture:
            return int(getattr(picture, "n_frames", 1)) >= _TWO
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError):
        return os.path.isfile(path)  # damaged: refused later with its name


def _without_scans(entries: Sequence[Path]) -> list[Path]:
    """Return entries without the scans of others, ``NAME_image``."""
    scans = {path: stem for path in entries if (stem := stem_of(path)).endswith(IMAGE_ENDING)}
    stems = {stem_of(path) for path in entries} if scans else set()
    return [path for path in entries if scans.get(path, "").removesuffix(IMAGE_ENDING) not in stems]


def _natural(path: Path) -> tuple[list[int], str]:
    return [int(number) for number in _NUMBER.findall(path.stem)], path.name
