"""DICOM: a file, a folder with one file, or a folder of slices."""

from pathlib import Path

from homolog.cohort import dicom_files, dicom_segmentations, dicom_slices, is_dicom_seg
from homolog.errors import InputError
from homolog.io.dicom_seg import read_seg
from homolog.io.dicom_series import read_series, series_voxels
from homolog.io.rtstruct import read_rtstruct
from homolog.io.scans import StoredScan
from homolog.io.volumes import Volume
from homolog.progress import Tick

__all__ = ["read_dicom", "read_dicom_scan"]

_SHOWN = 3


def read_dicom(path: Path) -> Volume:
    """Read a DICOM SEG or RTSTRUCT, a folder with one of them, or a folder with the slices of one series.

    Raises
    ------
    InputError
        If a package is missing, the file is neither, or the folder contains several series or lacks slices.
    """
    files = dicom_files(path) if path.is_dir() else [path]
    segmentations = dicom_segmentations(files)
    if path.is_file() and not segmentations:
        raise InputError(
            f"{path}: is neither DICOM SEG nor RTSTRUCT; if it is one slice of a label map, give the folder "
            "of its series"
        )
    if len(segmentations) == 1 == len(files):
        read = read_seg if is_dicom_seg(segmentations[0]) else read_rtstruct
        return read(segmentations[0])
    if segmentations:
        names = [file.name for file in segmentations]
        listed = ", ".join(names[:_SHOWN]) + (", …" if len(names) > _SHOWN else "")
        raise InputError(
            f"{path}: contains segmentations ({listed}) among {len(files)} DICOM files; enter one of them in "
            "the column path of a table, or keep each segmentation in a folder of its own"
        )
    return read_series(path, files)


def read_dicom_scan(path: Path, tick: Tick) -> StoredScan:
    """Read a folder with the slices of one series of grey values; see `homolog.io.scans.Scan`.

    Raises
    ------
    InputError
        If the path is a single file, or the folder contains no or several series or lacks slices.
    """
    if not path.is_dir():
        raise InputError(f"{path}: is one DICOM file; give the folder of the scan's slices")
    return *series_voxels(path, dicom_slices(path), tick), ()
