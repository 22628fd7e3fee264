"""DICOM segmentation objects (SEG) through highdicom, which is an extra."""

from pathlib import Path

import numpy as np

from homolog.arrays import Array
from homolog.errors import InputError
from homolog.io.dicom_deflated import unpacked
from homolog.io.dicom_faults import dicom_faults
from homolog.io.layers import Layers
from homolog.io.volumes import Segment, Volume, check_size

__all__ = ["read_seg"]

_KIND = "DICOM SEG"
_EXTRA = 'DICOM SEG needs the package highdicom; install it: pip install "homolog[dicom]"'


_ROOM = ((1, 1), (0, 0), (0, 0))
"""Omitted frames are empty: an empty frame at either end shows that the structure is not cut off there."""


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

    def segment(layer: int) -> Array:
        with dicom_faults(path, _KIND):
            volume = seg.get_volume(segment_numbers=[numbers[layer]])
        return np.pad(np.asarray(volume.array)[..., 0], _ROOM)

    return Volume(path, Layers(len(numbers), segment), affine, named)
