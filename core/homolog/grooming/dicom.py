"""DICOM: segmentation objects (SEG) through highdicom, label maps as a series of slices through SimpleITK."""

import io
import os
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stderr
from pathlib import Path
from typing import Any, overload

import numpy as np

from homolog.arrays import Array
from homolog.cohort import dicom_files, is_dicom_seg
from homolog.errors import InputError
from homolog.grooming.volumes import Segment, Volume, check_size

__all__ = ["read_dicom"]

_UNEVEN = 0.01  # of the slice distance
_EXTRA = 'DICOM SEG needs the package highdicom; install it: pip install "homolog[dicom]"'


def read_dicom(path: Path) -> Volume:
    """Read a DICOM SEG file, a folder that holds one, or a folder with the slices of one series.

    Raises
    ------
    InputError
        If a package is missing, the file is no SEG, or the folder holds several series or lacks slices.
    """
    if path.is_file():
        if not is_dicom_seg(path):
            raise InputError(
                f"{path}: is no DICOM SEG; if it is one slice of a label map, give the folder of its series"
            )
        return _read_seg(path)
    files = dicom_files(path)
    segs = [one for one in files if is_dicom_seg(one)]
    if len(segs) == 1 and len(files) == 1:
        return _read_seg(segs[0])
    if segs:
        raise InputError(f"{path}: holds a DICOM SEG among other files; give the file itself")
    return _read_series(path)


class _Layers(Sequence[Array]):
    """The segments of a DICOM SEG as layers, each made of its frames when it is asked for."""

    def __init__(self, path: Path, seg: Any, numbers: list[int]) -> None:  # noqa: ANN401 - highdicom's
        self._path, self._seg, self._numbers = path, seg, numbers
        self._last: tuple[int, Array] | None = None

    def __len__(self) -> int:
        return len(self._numbers)

    @overload
    def __getitem__(self, index: int) -> Array: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Array]: ...
    def __getitem__(self, index: int | slice) -> Array | Sequence[Array]:
        if isinstance(index, slice):
            return [self[one] for one in range(*index.indices(len(self)))]
        if index < 0 or index >= len(self):
            raise IndexError(index)
        if self._last is None or self._last[0] != index:
            with _faults(self._path):
                found = self._seg.get_volume(segment_numbers=[self._numbers[index]])
            self._last = (index, np.asarray(found.array)[..., 0])
        return self._last[1]


@contextmanager
def _faults(path: Path) -> Iterator[None]:
    """Turn what highdicom and pydicom say of a bad file into an InputError, and hear nothing else of them.

    They write file names and values of the header, which may be a patient's, to the standard error.
    """
    with redirect_stderr(io.StringIO()), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            yield
        except InputError:
            raise
        except Exception as error:  # what they raise on bad files is no short list
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise InputError(f"{path}: can't be read as DICOM SEG; export it again ({reason})") from error


def _read_seg(path: Path) -> Volume:
    try:
        from highdicom.seg import segread
    except ImportError as error:
        raise InputError(f"{path}: {_EXTRA}") from error
    with _faults(path):
        seg = segread(os.fspath(path), lazy_frame_retrieval=True)
        if len(seg.PerFrameFunctionalGroupsSequence) != seg.NumberOfFrames:
            raise InputError(f"{path}: describes more or fewer frames than it holds; export it again")
        numbers = [int(one) for one in seg.segment_numbers]
        names = [str(seg.get_segment_description(one).segment_label) for one in numbers]
        geometry = seg.get_volume_geometry(allow_missing_positions=True)
        if geometry is None:
            raise InputError(
                f"{path}: its frames are no stack of parallel, evenly spaced slices; export it again"
            )
        check_size(path, geometry.spatial_shape, 8.0)
    named = tuple(Segment(name, 1, layer) for layer, name in enumerate(names))
    return Volume(path, _Layers(path, seg, numbers), np.asarray(geometry.affine, np.float64), named)


def _read_series(path: Path) -> Volume:
    import SimpleITK

    SimpleITK.ProcessObject.SetGlobalWarningDisplay(False)
    names = SimpleITK.ImageSeriesReader.GetGDCMSeriesIDs(os.fspath(path))
    if len(names) != 1:
        raise InputError(
            f"{path}: holds {len(names) or 'no readable'} DICOM series; give each its own folder"
        )
    files = SimpleITK.ImageSeriesReader.GetGDCMSeriesFileNames(os.fspath(path), names[0])
    reader = SimpleITK.ImageSeriesReader()
    reader.SetFileNames(files)
    try:
        _check_slices(path, files)
        image = reader.Execute()
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1]
        raise InputError(f"{path}: can't be read as a DICOM series; export it again ({reason})") from error
    if image.GetNumberOfComponentsPerPixel() != 1 or image.GetDimension() != 3:
        raise InputError(f"{path}: is no stack of slices with single values; export a label map")
    matrix = np.eye(4)
    matrix[:3, :3] = np.reshape(image.GetDirection(), (3, 3)) * image.GetSpacing()
    matrix[:3, 3] = image.GetOrigin()
    return Volume(path, [SimpleITK.GetArrayFromImage(image).T], matrix)


def _check_slices(path: Path, files: Sequence[str]) -> None:
    """Refuse a series that is too large, or whose slices are not parallel and evenly spaced."""
    import SimpleITK

    places, turns, size = [], set(), (0, 0)
    for name in files:
        reader = SimpleITK.ImageFileReader()
        reader.SetImageIO("GDCMImageIO")
        reader.SetFileName(name)
        reader.ReadImageInformation()
        places.append(reader.GetOrigin())
        turns.add(tuple(np.round(reader.GetDirection(), 4)))
        size = reader.GetSize()[:2]
    check_size(path, (*size, len(files)), 4.0)
    steps = np.linalg.norm(np.diff(np.array(places), axis=0), axis=1)
    if len(turns) > 1 or np.ptp(steps) > _UNEVEN * np.median(steps) or not np.median(steps) > 0.0:
        raise InputError(
            f"{path}: its {len(files)} slices are not parallel and {np.median(steps):.3g} mm apart "
            "throughout; copy the missing ones, or export a label map of even slices"
        )
