"""Label maps as series of DICOM slices, read by pydicom: GDCM allocates gigabytes for damaged lengths."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from homolog.arrays import Array, FloatArray
from homolog.errors import InputError
from homolog.io.dicom_faults import dicom_faults
from homolog.io.volumes import Volume, check_size
from homolog.progress import Tick, no_tick

__all__ = ["read_series", "series_voxels"]

_KIND = "a slice of a DICOM series"
_UNEVEN = 0.01  # tolerance of positions, as a fraction of the slice distance
_SPACINGS = ("PixelSpacing", "NominalScannedPixelSpacing", "ImagerPixelSpacing")
"""Attributes that give the pixel size, depending on the kind of image; the first one present is used."""


@dataclass(frozen=True, slots=True, eq=False)
class _Slice:
    """Header of a slice: series, size (columns, rows), position and axes [mm, LPS], slope and intercept."""

    path: Path
    series: str
    size: tuple[int, int]
    place: FloatArray
    axes: FloatArray
    scale: tuple[float, float]

    @property
    def height(self) -> float:
        """Position along the normal [mm]."""
        return float(np.cross(self.axes[0], self.axes[1]) @ self.place)


def read_series(folder: Path, files: Sequence[Path]) -> Volume:
    """Read the slices of one series, ordered by position.

    Raises
    ------
    InputError
        If there are none or several series, slices are missing, not parallel, of several sizes or damaged.
    """
    values, matrix, slope, intercept = series_voxels(folder, files, no_tick)
    if (slope, intercept) != (1.0, 0.0):
        values = values * slope + intercept
    return Volume(folder, [values], matrix)


def series_voxels(folder: Path, files: Sequence[Path], tick: Tick) -> tuple[Array, FloatArray, float, float]:
    """Read the slices of one series into one array, (I, J, K), of the files' type.

    Parameters
    ----------
    folder : Path
        Folder of the files.
    files : sequence of Path
        The slices, in any order.
    tick : Tick
        Progress and cancellation.

    Returns
    -------
    values : array
        As stored if all slices have the same slope and intercept, else scaled float64.
    index_to_world : (4, 4) array
    slope, intercept : float
        Grey value = slope * value + intercept.
    """
    slices = []
    for number, path in enumerate(files):
        tick(0.3 * number / len(files), f"reading {folder.name}")
        slices.append(_header(path))
    count = len({item.series for item in slices})
    if count != 1:
        raise InputError(
            f"{folder}: contains {count or 'no readable'} DICOM series; give each its own folder"
        )
    slices.sort(key=lambda item: item.height)
    step = _step(folder, slices)
    check_size(folder, (*slices[0].size, len(slices)), 4.0)
    scales = {item.scale for item in slices}
    slope, intercept = scales.pop() if len(scales) == 1 else (1.0, 0.0)
    first = _pixels(slices[0])
    kind = first.dtype if not scales else np.dtype(np.float64)
    values: Array = np.empty((*slices[0].size, len(slices)), kind, order="F")
    for number, item in enumerate(slices):
        tick(0.3 + 0.7 * number / len(slices), f"reading {folder.name}")
        pixels = _pixels(item) if number else first
        if not scales and pixels.dtype != values.dtype:
            values = values.astype(np.promote_types(values.dtype, pixels.dtype), order="F")
        values[..., number] = pixels * item.scale[0] + item.scale[1] if scales else pixels
    matrix = np.eye(4)
    matrix[:3, :2], matrix[:3, 2], matrix[:3, 3] = slices[0].axes.T, step, slices[0].place
    return values, matrix, slope, intercept


def _header(path: Path) -> _Slice:
    with dicom_faults(path, _KIND):
        content = _read(path, without_pixels=True)
        if int(content.get("NumberOfFrames") or 1) > 1:
            raise ValueError("it has several frames")
        sizes = [content[name].value for name in _SPACINGS if name in content]
        if not sizes:
            raise ValueError(f"it lacks {_SPACINGS[0]}")
        spacing = np.array(sizes[0], np.float64)
        axes = np.array(content.ImageOrientationPatient, np.float64).reshape(2, 3)
        place = np.array(content.ImagePositionPatient, np.float64).reshape(3)
        axes = axes * spacing[::-1].reshape(2, 1)
        if not np.isfinite([*place, *axes.ravel()]).all() or spacing.min() <= 0.0:
            raise ValueError(f"its pixels are {spacing} mm large, at {place}")
        size = int(content.Columns), int(content.Rows)
        scale = float(content.get("RescaleSlope", 1)), float(content.get("RescaleIntercept", 0))
        return _Slice(path, str(content.SeriesInstanceUID), size, place, axes, scale)


def _read(path: Path, *, without_pixels: bool) -> Any:  # noqa: ANN401 - pydicom's datasets have any attribute
    import pydicom

    syntax = pydicom.filereader.read_file_meta_info(path).get("TransferSyntaxUID")
    if syntax is not None and syntax.is_deflated:
        raise InputError(f"{path}: uses deflate compression; export it without that")
    return pydicom.dcmread(path, stop_before_pixels=without_pixels)


def _step(folder: Path, slices: Sequence[_Slice]) -> FloatArray:
    """Return the step from slice to slice [mm]; refuse slices that are not parallel and evenly spaced."""
    alike = all(
        item.size == slices[0].size and np.allclose(item.axes, slices[0].axes, rtol=0.0, atol=1e-3)
        for item in slices
    )
    steps = np.diff([item.place for item in slices], axis=0) if len(slices) > 1 else np.zeros((1, 3))
    usual: FloatArray = np.median(steps, axis=0)
    length = float(np.linalg.norm(usual))
    if np.linalg.norm(steps, axis=1).min() <= _UNEVEN * length and len(slices) > 1:
        raise InputError(
            f"{folder}: several of its {len(slices)} slices have the same position (copies, or several time "
            "points); keep one at each position"
        )
    if not alike or not length > 0.0 or np.abs(steps - usual).max() > _UNEVEN * length:
        raise InputError(
            f"{folder}: its {len(slices)} slices are not equal in size, parallel and {length:.3g} mm apart "
            "throughout; copy the missing ones, or export a label map with evenly spaced slices"
        )
    whole: FloatArray = steps.mean(axis=0)  # the mean, since many files round positions
    return whole


def _pixels(_slice: _Slice) -> Array:
    """Return a slice's stored values by column and row."""
    with dicom_faults(_slice.path, _KIND):
        content = _read(_slice.path, without_pixels=False)
        values: Array = content.pixel_array
        if values.shape != _slice.size[::-1]:
            raise ValueError("it has several frames or colours")
        return values.T
