"""DICOM segmentation objects (SEG) through highdicom, which is an extra."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, overload

import numpy as np

from homolog.arrays import Array
from homolog.errors import InputError
from homolog.grooming.dicom_deflated import unpacked
from homolog.grooming.dicom_faults import dicom_faults
from homolog.grooming.volumes import Segment, Volume, check_size

__all__ = ["read_seg"]

_KIND = "DICOM SEG"
_EXTRA = 'DICOM SEG needs the package highdicom; install it: pip install "homolog[dicom]"'


_ROOM = ((1, 1), (0, 0), (0, 0))
"""Omitted frames are empty: an empty frame at either end shows that the structure is not cut off there."""


class _Layers(Sequence[Array]):
    """The segments of a DICOM SEG as layers, each assembled from its frames on access."""

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
            return [self[item] for item in range(*index.indices(len(self)))]
        if index < 0 or index >= len(self):
            raise IndexError(index)
        if self._last is None or self._last[0] != index:
            with dicom_faults(self._path, _KIND):
                volume = self._seg.get_volume(segment_numbers=[self._numbers[index]])
            self._last = (index, np.pad(np.asarray(volume.array)[..., 0], _ROOM))
        return self._last[1]


def read_seg(path: Path) -> Volume:
    """Read a segmentation object; its segments are layers, which may overlap.

    Raises
    ------
    InputError
        If the package is missing, or the file is damaged, too large or not a stack of slices.
    """
    try:
        from highdicom.seg import segread
    except ImportError as error:
        raise InputError(f"{path}: {_EXTRA}") from error
    with dicom_faults(path, _KIND):
        seg = segread(unpacked(path), lazy_frame_retrieval=True)
        if seg.BitsAllocated == 1 and seg.Rows * seg.Columns % 8 > 0:
            seg = segread(unpacked(path))  # highdicom's lazy reader cuts off frames that end within a byte
        if len(seg.PerFrameFunctionalGroupsSequence) != seg.get("NumberOfFrames", 1):
            raise InputError(f"{path}: describes more or fewer frames than it contains; export it again")
        numbers = [int(segment_number) for segment_number in seg.segment_numbers]
        names = [str(seg.get_segment_description(number).segment_label) for number in numbers]
        geometry = seg.get_volume_geometry(allow_missing_positions=True)
        if geometry is None:
            raise InputError(
                f"{path}: its frames are not a stack of parallel, evenly spaced slices; export it again"
            )
        check_size(path, geometry.spatial_shape, 8.0)
    named = tuple(Segment(name, 1, layer) for layer, name in enumerate(names))
    affine = np.array(geometry.affine, np.float64)
    affine[:3, 3] -= affine[:3, 0]
    return Volume(path, _Layers(path, seg, numbers), affine, named)
