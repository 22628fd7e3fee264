"""DICOM: a file, a folder with one file, or a folder of slices."""

from pathlib import Path

from homolog.cohort import dicom_files, is_dicom_seg, is_rtstruct
from homolog.errors import InputError
from homolog.grooming.dicom_seg import read_seg
from homolog.grooming.dicom_series import read_series, series_voxels
from homolog.grooming.scans import StoredScan
from homolog.grooming.volumes import Volume
from homolog.progress import Tick

__all__ = ["read_dicom", "read_dicom_scan"]

_SHOWN = 3


def read_dicom(path: Path) -> Volume:
    """Read a DICOM SEG file, a folder that holds one, or a folder with the slices of one series.

    Raises
    ------
    InputError
        If a package is missing, the file is not a SEG, or the folder contains several series or lacks slices.
    """
    files = dicom_files(path) if path.is_dir() else [path]
    if contours := [file for file in files if is_rtstruct(file)]:
        raise InputError(
            f"{contours[0]}: is a DICOM RTSTRUCT, whose contours are not read; open it in 3D Slicer (with "
            "SlicerRT) and save its segmentation as .seg.nrrd"
        )
    if path.is_file():
        if not is_dicom_seg(path):
            raise InputError(
                f"{path}: is not a DICOM SEG; if it is one slice of a label map, give the folder of its "
                "series"
            )
        return read_seg(path)
    segs = [file for file in files if is_dicom_seg(file)]
    if len(segs) == 1 and len(files) == 1:
        return read_seg(segs[0])
    if segs:
        listed = ", ".join(file.name for file in segs[:_SHOWN]) + (", …" if len(segs) > _SHOWN else "")
        raise InputError(
            f"{path}: contains DICOM SEGs ({listed}) among {len(files)} files; enter the file to use in the "
            "column path of a table, or keep each SEG in a folder of its own"
        )
    return read_series(path, files)


def read_dicom_scan(path: Path, tick: Tick) -> StoredScan:
    """Read a folder with the slices of one series of grey values; see `homolog.grooming.scans.Scan`.

    Raises
    ------
    InputError
        If the path is a single file, or the folder contains no or several series or lacks slices.
    """
    if not path.is_dir():
        raise InputError(f"{path}: is one DICOM file; give the folder of the scan's slices")
    slices = [file for file in dicom_files(path) if not is_dicom_seg(file)]
    return *series_voxels(path, slices, tick), ()
