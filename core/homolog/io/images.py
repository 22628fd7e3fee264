"""Volumes of any format, orientation and spacing, read into one frame (LPS, mm)."""

import math
import os
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from homolog.arrays import FloatArray
from homolog.cohort import IMAGE_SUFFIXES, dicom_files, pictures_in, suffix_of
from homolog.errors import InputError
from homolog.io.headers import check_gipl, read_header, segments_of
from homolog.io.particles import PARTICLE_SUFFIXES
from homolog.io.values import labels_of_channels
from homolog.io.volumes import Segment, Segmentation, Stored, Volume, check_size
from homolog.progress import Tick, no_tick, run_in_background
from homolog.settings import Values

__all__ = [
    "Segment",
    "Segmentation",
    "Volume",
    "check_kind",
    "read_segmentation",
    "read_stored",
    "read_volume",
]

_NRRD = (".nrrd", ".nhdr")
_GIPL = (".gipl", ".gipl.gz")
_NO_DIRECTION = "GIPL stores no orientation; LPS axes were assumed"
_NO_FRAME = "its header gives no patient orientation (no LPS or RAS space); LPS axes were assumed"


def read_segmentation(
    path: Path, label: int | None, segment: str | None = None, values: Values = Values.LABELS
) -> Segmentation:
    """Read the voxels of a structure from a label map.

    Parameters
    ----------
    path : Path
        NRRD (also detached, also ``.seg.nrrd``), NIfTI, Analyze, MetaImage, MGH, GIPL, DICOM SEG, TIFF of
        several pages, or the folder of a DICOM series or of pictures.
    label : int or None
        The value to keep; every value above 0 if neither value nor name are given.
    segment : str or None
        The name to keep, in files that name their segments.
    values : Values
        What the voxels are declared to be.

    Raises
    ------
    InputError
        If the file is missing, cut short, not 3-D, not of the declared values, larger than memory,
        contradicts itself about its position, or lacks the structure.
    """
    return read_volume(path, values).segmentation(label, segment)


def read_volume(path: Path, values: Values = Values.LABELS) -> Volume:
    """Read a volume with all its structures; raises as `read_segmentation` does."""
    return replace(_read(path), declared=values)


def _read(path: Path) -> Volume:
    path = Path(path)
    if check_kind(path).endswith(".dcm") or (path.is_dir() and dicom_files(path)):
        from homolog.io.dicom import read_dicom

        if (segments := read_dicom(path)) is not None:
            return segments
    stored = read_stored(path, no_tick)
    values, notes = stored.values, stored.notes
    if (stored.slope, stored.intercept) != (1.0, 0.0):
        check_size(path, values.shape[:3], 8.0 * values[:1, :1, :1].size)
        values = values * stored.slope + stored.intercept
    values = values.astype(values.dtype.newbyteorder("="), copy=False)
    if values.ndim == 3:
        return Volume(path, [values], stored.index_to_world, stored.named, notes)
    if stored.named:
        layers = list(np.moveaxis(values, -1, 0))
        return Volume(path, layers, stored.index_to_world, stored.named, notes)
    labels, note = labels_of_channels(path, values)
    return Volume(path, [labels], stored.index_to_world, (), (*notes, note))


def read_stored(path: Path, tick: Tick) -> Stored:
    """Read a volume of labels or grey values, as stored; see `homolog.io.scans.Scan`."""
    read: Callable[[Path, Tick], Stored]
    name = check_kind(path)
    if path.is_dir() and (dicom_files(path) or not pictures_in(path)):
        from homolog.io.dicom import read_series as read
    elif path.is_dir() or name.endswith((".tif", ".tiff")):
        from homolog.io.pictures import read_pictures as read
    elif name.endswith((".nii", ".nii.gz", ".mgz", ".mgh", ".hdr", ".hdr.gz")):
        from homolog.io.nifti import read_nifti as read
    elif name.endswith(".dcm"):
        raise InputError(f"{path}: is one DICOM file; give the folder of the scan's slices")
    else:
        read = _read_itk
    return read(path, tick)


def check_kind(path: Path) -> str:
    """Return a file's name in lower case; raises InputError if it is missing or not named like an image."""
    name = path.name.lower()
    if not path.is_file() and not path.is_dir():
        raise InputError(f"{path}: does not exist; correct the path or exclude it")
    if path.is_dir():
        return name
    if name.endswith(PARTICLE_SUFFIXES):
        raise InputError(
            f"{path}: contains particles without a surface, which can be analyzed but not groomed"
        )
    if suffix_of(path) not in IMAGE_SUFFIXES:
        raise InputError(
            f"{path}: has an unsupported type; convert it, or choose its header file if there is one "
            f"({', '.join(IMAGE_SUFFIXES)})"
        )
    return name


def _read_itk(path: Path, tick: Tick) -> Stored:
    """Read a NRRD, MetaImage or GIPL file through SimpleITK."""
    image, matrix, named, notes = run_in_background(lambda _: _itk_image(path), tick, f"reading {path.name}")
    values = np.asarray(_Pixels(image))
    order = (2, 1, 0) if values.ndim == 3 else (2, 1, 0, 3)
    return Stored(values.transpose(order), matrix, notes=notes, named=named)


class _Pixels:
    """The voxels of a SimpleITK image for numpy: not copied, and kept alive by the arrays that use them."""

    def __init__(self, image: Any) -> None:  # noqa: ANN401 - SimpleITK is untyped
        import SimpleITK

        self._image = image
        self.__array_interface__ = SimpleITK.GetArrayViewFromImage(image).__array_interface__


def _itk_image(path: Path) -> tuple[Any, FloatArray, tuple[Segment, ...], tuple[str, ...]]:
    """Read a NRRD or MetaImage file: SimpleITK's image, its matrix to LPS, its segments, and notes."""
    import SimpleITK

    is_gipl = path.name.lower().endswith(_GIPL)
    text = None if is_gipl else read_header(path)
    if text:
        text.check()
    SimpleITK.ProcessObject.SetGlobalWarningDisplay(False)
    reader = SimpleITK.ImageFileReader()
    reader.SetFileName(os.fspath(path))
    is_nrrd = path.suffix.lower() in _NRRD
    kind = "GiplImageIO" if is_gipl else "NrrdImageIO" if is_nrrd else "MetaImageIO"
    reader.SetImageIO(kind)  # ITK knows suffixes in lower case only
    try:
        reader.ReadImageInformation()
    except RuntimeError as error:
        raise InputError(
            f"{path}: is not a readable image; export it again, or exclude it ({_reason(error)})"
        ) from error
    known = (key for key in reader.GetMetaDataKeys() if key.isascii())  # SimpleITK fails on other keys
    header = {key: reader.GetMetaData(key) for key in known}
    named, count = segments_of(path, header), reader.GetNumberOfComponents()
    if any(not 0 <= item.layer < count for item in named):
        raise InputError(f"{path}: refers to layers that it does not contain; save it again")
    voxel = SimpleITK.GetArrayViewFromImage(SimpleITK.Image([1, 1, 1], reader.GetPixelID())).itemsize
    size = list(reader.GetSize())
    while len(size) > 3 and size[-1] == 1:  # a single point in time
        size.pop()
    check_size(path, size, voxel * count)
    (text.check_length if text else partial(check_gipl, path))(math.prod(size) * voxel * count)
    if len(size) < len(reader.GetSize()):
        reader.SetExtractSize([*size, *[0] * (len(reader.GetSize()) - len(size))])
    try:
        image = reader.Execute()
    except (RuntimeError, MemoryError) as error:
        raise InputError(f"{path}: may be cut short; copy or export it again ({_reason(error)})") from error
    matrix = np.eye(4)
    matrix[:3, :3] = np.reshape(image.GetDirection(), (3, 3)) * image.GetSpacing()
    matrix[:3, 3] = image.GetOrigin()
    return image, matrix, named, (*_notes(path, header), *(text.notes if text else ()))


def _notes(path: Path, header: dict[str, str]) -> tuple[str, ...]:
    if path.name.lower().endswith(_GIPL):
        return (_NO_DIRECTION,)
    is_nrrd = path.suffix.lower() in _NRRD
    return (_NO_FRAME,) if is_nrrd and header.get("NRRD_space") != "left-posterior-superior" else ()


def _reason(error: BaseException) -> str:
    """Return the last line of an ITK message, which contains the reason."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[-1] if lines else type(error).__name__
