"""Volumes of any format, orientation and spacing, read into one frame (LPS, mm)."""

import math
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from homolog.arrays import FloatArray
from homolog.cohort import IMAGE_SUFFIXES, dicom_files, pictures_in, suffix_of
from homolog.errors import InputError
from homolog.io.headers import read_header, segments_of
from homolog.io.particles import PARTICLE_SUFFIXES
from homolog.io.values import labels_of_channels
from homolog.io.volumes import Segment, Segmentation, StoredScan, Volume, check_size
from homolog.progress import Tick, run_in_background
from homolog.settings import Values

__all__ = [
    "Segment",
    "Segmentation",
    "Volume",
    "check_kind",
    "read_itk_scan",
    "read_segmentation",
    "read_volume",
]

_NRRD = (".nrrd", ".nhdr")
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
    name = check_kind(path)
    if name.endswith((".tif", ".tiff")) or (path.is_dir() and pictures_in(path) and not dicom_files(path)):
        from homolog.io.pictures import read_pictures

        return read_pictures(path)
    if path.is_dir() or name.endswith(".dcm"):
        from homolog.io.dicom import read_dicom

        return read_dicom(path)
    if name.endswith((".nii", ".nii.gz")):
        from homolog.io.nifti import read_nifti

        return read_nifti(path)
    if name.endswith((".mgz", ".mgh")):
        from homolog.io.nifti import read_mgh

        return read_mgh(path)
    if name.endswith((".gipl", ".gipl.gz")):
        from homolog.io.gipl import read_gipl

        return read_gipl(path)
    if name.endswith((".hdr", ".hdr.gz")):
        from homolog.io.nifti import read_pair

        return read_pair(path)
    return _read_itk(path)


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


def _read_itk(path: Path) -> Volume:
    """Read a NRRD or MetaImage file of labels."""
    import SimpleITK

    image, matrix, named, notes = _itk_image(path)
    values = np.moveaxis(SimpleITK.GetArrayFromImage(image), (2, 1, 0), (0, 1, 2))
    count = image.GetNumberOfComponentsPerPixel()
    if count > 1 and not named:
        values, note = labels_of_channels(path, values)
        return Volume(path, [values], matrix, named, (*notes, note))
    layers = [values[..., layer] for layer in range(count)] if count > 1 else [values]
    return Volume(path, layers, matrix, named, notes)


def read_itk_scan(path: Path, tick: Tick) -> StoredScan:
    """Read a NRRD or MetaImage file of grey values; see `homolog.io.scans.Scan`."""
    image, matrix, _, notes = run_in_background(lambda _: _itk_image(path), tick, f"reading {path.name}")
    if image.GetNumberOfComponentsPerPixel() > 1:
        raise InputError(f"{path}: has several values per voxel; choose a scan of grey values")
    return np.asarray(_Pixels(image)).T, matrix, 1.0, 0.0, notes


class _Pixels:
    """The voxels of a SimpleITK image for numpy: not copied, and kept alive by the arrays that use them."""

    def __init__(self, image: Any) -> None:  # noqa: ANN401 - SimpleITK is untyped
        import SimpleITK

        self._image = image
        self.__array_interface__ = SimpleITK.GetArrayViewFromImage(image).__array_interface__


def _itk_image(path: Path) -> tuple[Any, FloatArray, tuple[Segment, ...], tuple[str, ...]]:
    """Read a NRRD or MetaImage file: SimpleITK's image, its matrix to LPS, its segments, and notes."""
    import SimpleITK

    text = read_header(path)
    text.check()
    SimpleITK.ProcessObject.SetGlobalWarningDisplay(False)
    reader = SimpleITK.ImageFileReader()
    reader.SetFileName(os.fspath(path))
    is_nrrd = path.suffix.lower() in _NRRD
    reader.SetImageIO("NrrdImageIO" if is_nrrd else "MetaImageIO")  # ITK knows suffixes in lower case only
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
    text.check_length(math.prod(size) * voxel * count)
    if len(size) < len(reader.GetSize()):
        reader.SetExtractSize([*size, *[0] * (len(reader.GetSize()) - len(size))])
    try:
        image = reader.Execute()
    except (RuntimeError, MemoryError) as error:
        raise InputError(f"{path}: may be cut short; copy or export it again ({_reason(error)})") from error
    matrix = np.eye(4)
    matrix[:3, :3] = np.reshape(image.GetDirection(), (3, 3)) * image.GetSpacing()
    matrix[:3, 3] = image.GetOrigin()
    return image, matrix, named, (*_notes(path, header), *text.notes)


def _notes(path: Path, header: dict[str, str]) -> tuple[str, ...]:
    is_nrrd = path.suffix.lower() in _NRRD
    return (_NO_FRAME,) if is_nrrd and header.get("NRRD_space") != "left-posterior-superior" else ()


def _reason(error: BaseException) -> str:
    """Return the last line of an ITK message, which contains the reason."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[-1] if lines else type(error).__name__
