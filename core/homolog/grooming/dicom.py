"""DICOM: which of a file, a folder with one file, and a folder of slices it is."""

from pathlib import Path

from homolog.cohort import dicom_files, is_dicom_seg
from homolog.errors import InputError
from homolog.grooming.dicom_seg import read_seg
from homolog.grooming.dicom_series import read_series
from homolog.grooming.volumes import Volume

__all__ = ["read_dicom"]


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
                f"{path}: is not a DICOM SEG; if it is one slice of a label map, give the folder of its "
                "series"
            )
        return read_seg(path)
    files = dicom_files(path)
    segs = [file for file in files if is_dicom_seg(file)]
    if len(segs) == 1 and len(files) == 1:
        return read_seg(segs[0])
    if segs:
        raise InputError(f"{path}: contains a DICOM SEG among other files; give the file itself")
    return read_series(path, files)
