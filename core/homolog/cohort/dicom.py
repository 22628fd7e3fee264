"""DICOM files in folders: slices of a series, or segmentation objects."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from homolog.cohort.entries import readable_entries

__all__ = [
    "dicom_files",
    "dicom_segmentations",
    "dicom_slices",
    "holds_dicom",
    "is_dicom_seg",
    "scan_beside",
    "series_below",
    "series_of",
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


def holds_dicom(folder: Path) -> bool:
    """Return whether a folder contains a DICOM file."""
    return any(True for _ in _dicom_files(folder))


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


def series_below(folder: Path) -> list[Path]:
    """Return the folders of a patient's series, as hospitals export them: PATIENT/STUDY/SERIES.

    If there are DICOM SEGs, only these are returned, otherwise contours of radiotherapy structures.
    """
    places = [folder]
    for _ in range(2):
        places = [path for place in places for path in readable_entries(place) if path.is_dir()]
        series = [series_of(path) for path in places if holds_dicom(path)]
        if series:
            return dicom_segmentations([path for path in series if path.is_file()]) or series
    return []


def series_of(folder: Path) -> Path:
    """Return the single DICOM SEG or RTSTRUCT among the slices of a scan, otherwise the folder."""
    segmentations = dicom_segmentations(dicom_files(folder))
    return segmentations[0] if len(segmentations) == 1 else folder


def scan_beside(segmentation: Path) -> Path | None:
    """Return the folder of a DICOM SEG's or RTSTRUCT's scan: its own, or the only one next to that."""
    if not segmentation.is_file():
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
