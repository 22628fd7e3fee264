"""Image stacks as volumes: folders of PNG, TIFF or BMP slices, and multi-page TIFF files."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageSequence

from homolog.arrays import Array, FloatArray
from homolog.cohort import pictures_in
from homolog.errors import InputError
from homolog.io.volumes import Stored, check_size
from homolog.progress import Tick

__all__ = ["read_pictures"]

_VOXEL_SIZE = "voxel_size.txt"
_ABOVE = 3
"""Number of folders searched for the voxel size: that of the slices and its parents."""
_NO_FRAME = (
    "pictures give no patient orientation: axial slices from the feet upward, with the patient's left on the "
    "right, were assumed"
)
_DESCRIPTION, _X_RESOLUTION, _Y_RESOLUTION = 270, 282, 283
_UNITS = {"nm": 1e-6, "um": 1e-3, "micron": 1e-3, "microns": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1000.0}
_OME = re.compile(r'PhysicalSize([XYZ])(Unit)?\s*=\s*"([^"]*)"')
_IMAGEJ = re.compile(r"^(unit|spacing)=(\S+)", re.MULTILINE)


def read_pictures(path: Path, tick: Tick) -> Stored:
    """Read the slices in a folder, or the pages of a TIFF file.

    The voxel size is that of ``voxel_size.txt`` in the slices' folder or a parent folder: the width and
    the height of a pixel and the distance of the slices [mm]; otherwise that stored by ImageJ or OME in a
    TIFF file.

    Raises
    ------
    InputError
        If the size is not given, slices are missing, of several sizes, in colours, or damaged.
    """
    files = pictures_in(path) if path.is_dir() else [path]
    if len(files) > 1:
        _check_numbers(path, files)
    pages: list[Array] = []
    size: FloatArray | None = None
    colours: set[tuple[int, ...]] = set()
    for number, file in enumerate(files):
        tick(number / len(files), f"reading {path.name}")
        try:
            with Image.open(file) as picture:
                count = len(files) * getattr(picture, "n_frames", 1)
                check_size(path, (*picture.size, count), 4.0)
                size = _noted_size(picture) if size is None else size
                pages += [_grey(file, frame, colours) for frame in ImageSequence.Iterator(picture)]
        except InputError:
            raise
        except (OSError, SyntaxError, ValueError, EOFError, Image.DecompressionBombError) as error:
            raise InputError(
                f"{file}: can't be read as an image ({error}); copy or export it again"
            ) from error
        if pages[-1].shape != pages[0].shape:
            raise InputError(f"{file}: differs in size from the other slices; export it again, or exclude it")
    given = _given_size(path if path.is_dir() else path.parent)
    size = given if given is not None else size
    if size is None:
        raise InputError(
            f"{path}: pictures have no size; write a file {_VOXEL_SIZE} next to them or in the folder above, "
            "with the width and the height of a pixel and the distance of the slices in mm, such as 0.5 0.5 2"
        )
    return Stored(np.stack(pages).transpose(), np.diag([*size, 1.0]), notes=(_NO_FRAME,))


def _check_numbers(folder: Path, files: Sequence[Path]) -> None:
    """Refuse slices whose order is unknown, and those with gaps between them."""
    numbers = [[int(number) for number in re.findall(r"\d+", file.stem)] for file in files]
    kinds = {re.sub(r"\d+", "0", file.name.lower()) for file in files}
    varying = [len(set(column)) for column in zip(*numbers, strict=False)]
    if len(kinds) > 1 or sum(count > 1 for count in varying) != 1 or max(varying) != len(files):
        shown = ", ".join(file.name for file in files[:3])
        raise InputError(
            f"{folder}: the order of its slices is not clear ({shown}, …); keep the slices of one stack in a "
            "folder, with names that differ only by one number"
        )
    places = sorted(row[int(np.argmax(varying))] for row in numbers)
    steps = np.diff(places)
    if (steps != steps[0]).any():
        after = places[int(np.argmax(steps != steps.min()))]
        raise InputError(f"{folder}: slices are missing after number {after}; copy it again, or exclude it")


def _grey(file: Path, picture: Image.Image, seen: set[tuple[int, ...]]) -> Array:
    """Return the values of a picture (rows, columns).

    Colour pictures must have equal channels, or a single colour on black in the whole stack; `seen` contains
    it, or will.
    """
    values = np.array(picture)
    if picture.mode == "LA":
        values = values[..., 0]
    if values.ndim == 3:
        colours = values[..., :3]
        if (colours != colours[..., :1]).any():
            seen |= set(map(tuple, np.unique(colours[colours.any(axis=-1)], axis=0).tolist()))
            if len(seen) > 1:
                raise InputError(
                    f"{file}: has several colours; save masks as grey values, one for each structure"
                )
        values = colours.max(axis=-1)
    if values.ndim != 2:
        raise InputError(f"{file}: has several values per pixel; save masks as grey values")
    return values.astype(np.uint8) if values.dtype == np.bool_ else values


def _given_size(folder: Path) -> FloatArray | None:
    """Return the voxel size of the nearest file that contains one [mm], or None."""
    places = [item / _VOXEL_SIZE for item in (folder.absolute(), *folder.absolute().parents)[:_ABOVE]]
    place = next((place for place in places if place.is_file()), None)
    if place is None:
        return None
    try:
        size = np.array([float(number) for number in re.split(r"[\s,;x×]+", place.read_text().strip())])
    except (OSError, ValueError):
        size = np.empty(0)
    if size.shape != (3,) or not np.isfinite(size).all() or size.min() <= 0.0:
        raise InputError(f"{place}: should contain three numbers in mm, such as 0.5 0.5 2; correct it")
    return size


def _noted_size(picture: Image.Image) -> FloatArray | None:
    """Return the voxel size that OME or ImageJ stored in a TIFF file [mm]; None if it is incomplete.

    The resolution alone is ignored: most programs write 72 or 96 pixels per inch.
    """
    tags = getattr(picture, "tag_v2", {})
    text = str(tags.get(_DESCRIPTION, "")).replace("\xb5", "u").replace("\u03bc", "u").replace("\\u00B5", "u")
    try:
        if sizes := {key: value for key, unit, value in _OME.findall(text) if not unit}:
            units = {key: value for key, unit, value in _OME.findall(text) if unit}
            return _positive([float(sizes[axis]) * _UNITS[units.get(axis, "um")] for axis in "XYZ"])
        if text.startswith("ImageJ"):
            noted = dict(_IMAGEJ.findall(text))
            unit = _UNITS[noted["unit"]]
            across = [1.0 / float(tags[key]) for key in (_X_RESOLUTION, _Y_RESOLUTION)]
            return _positive([unit * length for length in (*across, float(noted["spacing"]))])
    except (KeyError, ValueError, ZeroDivisionError):
        pass
    return None


def _positive(size: Sequence[float]) -> FloatArray | None:
    return np.array(size) if all(0.0 < length < np.inf for length in size) else None
