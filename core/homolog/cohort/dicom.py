"""DICOM files in folders: slices of a series, or segmentation objects."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from homolog.cohort.entries import readable_entries

__all__ = [
    "dicom_files",
    "dicom_segmentations",
    "dicom_slices",
    "is_dicom_seg",
    "scan_beside",
]

_SEG_CLASSES = (b"1.2.840.10008.5.1.4.1.1.66.4", b"1.2.840.10008.5.1.4.1.1.66.7")
"""Storage classes of segments that may overlap, and of label maps."""
_RADIOTHERAPY = b"1.2.840.10008.5.1.4.1.1.481."
"""Begin of the storage classes of doses, plans and structures."""
_RTSTRUCT = _RADIOTHERAPY + b"3"


def dicom_files(folder: Path) -> list[Path]:
    """Return the DICOM files of a folder, identified by content, with any suffix.

    A DICOMDIR, the table of contents of a disc, is excluded.
    """
    return list(_dicom_files(folder))


def _dicom_files(folder: Path) -> Iterator[Path]:
    for path in readable_entries(folder):
        if path.is_file() and path.name.upper() != "DICOMDIR" and _beginning(path)[128:132] == b"DICM":
            yield path


def is_dicom_seg(path: Path) -> bool:
    """Return whether a DICOM file is a segmentation object."""
    begin = _beginning(path)
    return any(item in begin for item in _SEG_CLASSES)


def _is_rtstruct(path: Path) -> bool:
    """Return whether a DICOM file contains the contours of radiotherapy structures."""
    return _RTSTRUCT in _beginning(path)


def dicom_segmentations(files: Sequence[Path]) -> list[Path]:
    """Return the DICOM SEGs among files; if there are none, the contours of radiotherapy structures."""
    return [file for file in files if is_dicom_seg(file)] or [file for file in files if _is_rtstruct(file)]


def dicom_slices(folder: Path) -> list[Path]:
    """Return the DICOM files of a folder without segmentations, doses and plans."""
    return list(_slices(folder))


def _slices(folder: Path) -> Iterator[Path]:
    for file in _dicom_files(folder):
        if not is_dicom_seg(file) and _RADIOTHERAPY not in _beginning(file):
            yield file


def scan_beside(segmentation: Path) -> Path | None:
    """Return the folder of a DICOM SEG's or RTSTRUCT's scan: its own, or the only one next to that."""
    if not segmentation.is_file() or _beginning(segmentation)[128:132] != b"DICM":
        return None
    if any(_slices(segmentation.parent)):
        return segmentation.parent
    folders = [path for path in readable_entries(segmentation.parent.parent) if path.is_dir()]
    scans = [path for path in folders if path != segmentation.parent and any(_slices(path))]
    return scans[0] if len(scans) == 1 else None


def _beginning(path: Path) -> bytes:
    try:
        with path.open("rb") as stream:
            return stream.read(1024)
    except OSError:
        return b""
