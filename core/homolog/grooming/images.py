"""Reading segmentations: any orientation and spacing, one frame (LPS, mm), every fault named."""

import gzip
import os
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from homolog.arrays import Array, BoolArray, FloatArray, frozen
from homolog.errors import InputError
from homolog.memory import check_fits

__all__ = ["Segmentation", "read_segmentation"]

_MASKS = 2
"""Bytes that each voxel takes beside its value while the label is picked."""


@dataclass(frozen=True, slots=True, eq=False)
class Segmentation:
    """The voxels of one label.

    Attributes
    ----------
    mask : (I, J, K) bool array
        True inside, read-only.
    rotation : (3, 3) float64 array
        Proper rotation; its columns are the directions of the three grid axes in LPS.
    spacing : (3,) float64 array
        Distance of neighbouring voxel centres along the grid axes [mm].
    origin : (3,) float64 array
        Centre of voxel (0, 0, 0) [mm, LPS].
    """

    mask: BoolArray
    rotation: FloatArray
    spacing: FloatArray
    origin: FloatArray

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        object.__setattr__(self, "mask", frozen(self.mask, np.bool_))
        for name in ("rotation", "spacing", "origin"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))

    @property
    def volume(self) -> float:
        """Volume of the voxels inside [mm³]."""
        return float(np.count_nonzero(self.mask) * self.spacing.prod())


def read_segmentation(path: Path, label: int | None) -> Segmentation:
    """Read the voxels of a label from a NRRD, NIfTI or MetaImage volume.

    Parameters
    ----------
    path : Path
        The label map.
    label : int or None
        The value to keep; every value above 0 if None.

    Raises
    ------
    InputError
        If the file is missing, cut short, not a 3-D label map, does not fit into memory, or does not hold
        the label.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: there is no such file; correct the path or leave it out")
    reader = _checked_header(path)
    _check_length(path, reader)
    try:
        image = reader.Execute()
    except (RuntimeError, MemoryError) as error:
        raise InputError(f"{path}: may be cut short; copy or export it again ({_reason(error)})") from error
    return _segmentation(path, image, label)


def _checked_header(path: Path) -> Any:  # noqa: ANN401 - SimpleITK is untyped
    import SimpleITK

    SimpleITK.ProcessObject.SetGlobalWarningDisplay(False)
    reader = SimpleITK.ImageFileReader()
    reader.SetFileName(os.fspath(path))
    try:
        reader.ReadImageInformation()
    except RuntimeError as error:
        raise InputError(
            f"{path}: is no readable image; export it again, or leave it out ({_reason(error)})"
        ) from error
    size = reader.GetSize()
    shape = " x ".join(map(str, size))
    if len(size) != 3 or min(size) < 2:
        raise InputError(f"{path}: is not a 3-D volume but {shape}; export one label map per subject")
    if reader.GetNumberOfComponents() != 1:
        raise InputError(f"{path}: has {reader.GetNumberOfComponents()} values per voxel; export a label map")
    voxel = SimpleITK.GetArrayViewFromImage(SimpleITK.Image([1, 1, 1], reader.GetPixelID())).itemsize
    needed = float(np.prod(size, dtype=np.float64)) * (voxel + _MASKS)
    check_fits(f"{path} ({shape} voxels)", needed, "crop it or make it coarser, or mend its header")
    return reader


def _check_length(path: Path, reader: Any) -> None:  # noqa: ANN401 - SimpleITK is untyped
    """Refuse a NIfTI file that is cut short: its reader takes what is missing for zeros."""
    if not reader.HasMetaDataKey("vox_offset"):
        return
    bits = int(reader.GetMetaData("bitpix")) * int(np.prod(reader.GetSize()))
    needed = float(reader.GetMetaData("vox_offset")) + bits / 8
    length = 0
    try:
        with gzip.open(path) if path.suffix.lower() == ".gz" else path.open("rb") as stream:
            while length < needed and (block := stream.read(2**20)):
                length += len(block)
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{path}: is cut short or damaged; copy or export it again ({error})") from error
    if length < needed:
        raise InputError(f"{path}: is cut short, {length} of {needed:.0f} bytes; copy or export it again")


def _segmentation(path: Path, image: Any, label: int | None) -> Segmentation:  # noqa: ANN401
    import SimpleITK

    values: Array = SimpleITK.GetArrayViewFromImage(image).T
    rotation = np.array(image.GetDirection()).reshape(3, 3)
    spacing = np.array(image.GetSpacing())
    origin = np.array(image.GetOrigin())
    if not np.isfinite([*origin, *spacing]).all() or spacing.min() <= 0.0:
        raise InputError(f"{path}: has the spacing {spacing} and origin {origin}; mend the header")
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3):
        raise InputError(f"{path}: its axes are not at right angles; resample it to an orthogonal grid")
    mask = _mask(path, values, label)
    if np.linalg.det(rotation) < 0.0:
        mask = mask[::-1]
        origin = origin + rotation[:, 0] * spacing[0] * (len(mask) - 1)
        rotation = rotation * [-1.0, 1.0, 1.0]
    return Segmentation(mask, rotation, spacing, origin)


def _mask(path: Path, values: Array, label: int | None) -> BoolArray:
    if np.issubdtype(values.dtype, np.floating):
        if not np.isfinite(values).all():
            raise InputError(f"{path}: holds values that are not numbers; export the label map again")
        if (values != np.rint(values)).any():
            raise InputError(f"{path}: holds fractions, so it is no label map; threshold it first")
    mask: BoolArray = values > 0 if label is None else values == label
    if not mask.any():
        present = np.unique(values[values > 0])
        listed = ", ".join(f"{value:g}" for value in present[:10])
        wanted = "has no voxel above 0" if label is None else f"has no voxel of label {label}"
        remedy = f"it holds {listed}" if len(present) else "segment the structure or leave the subject out"
        raise InputError(f"{path}: {wanted}; {remedy}")
    return mask


def _reason(error: BaseException) -> str:
    """Return the last line of an ITK message, which says what happened."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[-1] if lines else type(error).__name__
