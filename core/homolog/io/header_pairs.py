"""Volumes in two files, optionally compressed by gzip: Analyze 7.5 and NIfTI pairs (``.hdr``, ``.img``)."""

import gzip
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from nibabel.imageglobals import ErrorLevel
from nibabel.nifti1 import Nifti1PairHeader
from nibabel.spatialimages import HeaderDataError
from nibabel.spm99analyze import Spm99AnalyzeHeader

from homolog.arrays import FloatArray
from homolog.errors import InputError
from homolog.io.nifti import DUBIOUS, placement, stored_values
from homolog.io.scans import StoredScan
from homolog.io.volumes import Volume, check_size
from homolog.progress import Tick, no_tick

__all__ = ["read_pair", "read_pair_scan"]

_HEADER, _MAGIC = 348, 344  # bytes
_TO_LPS = np.diag([-1.0, -1.0, 1.0, 1.0])
_ASSUMED = (
    "Analyze headers do not distinguish left from right: LAS axes were assumed, as in FSL and SPM; shapes "
    "are mirror images if the files use other axes"
)


def read_pair(path: Path) -> Volume:
    """Read a volume of labels from a header and the file of voxels next to it.

    Parameters
    ----------
    path : Path
        The header, ending in .hdr or .hdr.gz. The file of voxels has the same name and ends in .img or
        .img.gz.

    Raises
    ------
    InputError
        If a file is missing, can't be read, or is not a 3-D volume of single numbers.
    """
    values, matrix, slope, intercept, notes = read_pair_scan(path, no_tick)
    if (slope, intercept) != (1.0, 0.0):
        values = values * slope + intercept
    return Volume(path, [values], matrix, notes=notes)


def read_pair_scan(path: Path, tick: Tick) -> StoredScan:
    """Read grey values as stored from a header and the file of voxels next to it, as `read_pair` does."""
    header, is_nifti = _header(path)
    shape, kind = list(header.get_data_shape()), header.get_data_dtype()
    while len(shape) > 3 and shape[-1] == 1:
        shape.pop()
    if kind.fields is not None or kind.kind not in "iuf":
        raise InputError(f"{path}: has {kind} voxels instead of single numbers; export a label map")
    check_size(path, shape, 2.0 * kind.itemsize)
    slope, intercept = header.get_slope_inter()
    notes: tuple[str, ...]
    if is_nifti:
        in_ras, notes = placement(path, header, shape)
        matrix = _TO_LPS @ in_ras
    else:
        matrix, notes = _las_matrix(path, header), (_ASSUMED,)
    values = stored_values(_voxels(path), int(header["vox_offset"]), shape, kind, tick)
    values = values.astype(kind.newbyteorder("="), copy=False)
    return values, matrix, 1.0 if slope is None else float(slope), float(intercept or 0.0), notes


def _header(path: Path) -> tuple[Any, bool]:
    """Return nibabel's header, and whether it is NIfTI's."""
    try:
        with gzip.open(path) if path.name.lower().endswith(".gz") else path.open("rb") as stream:
            content = stream.read(_HEADER)
        is_nifti = content[_MAGIC : _MAGIC + 3] == b"ni1"
        kind: Any = Nifti1PairHeader if is_nifti else Spm99AnalyzeHeader
        if len(content) < _HEADER or _HEADER not in (
            int.from_bytes(content[:4], "little"),
            int.from_bytes(content[:4], "big"),
        ):
            raise ValueError("it does not begin with its size")
        with ErrorLevel(DUBIOUS):  # type: ignore[no-untyped-call]
            return kind(content), is_nifti
    except (HeaderDataError, ValueError, EOFError, zlib.error, gzip.BadGzipFile, KeyError) as error:
        raise InputError(
            f"{path}: has no valid Analyze or NIfTI header; save the volume as .nii.gz or .nrrd ({error})"
        ) from error


def _voxels(path: Path) -> Path:
    """Return the file of voxels that belongs to a header, whatever the case of its name."""
    stem = path.name[: path.name.lower().rindex(".hdr")]
    wanted = (f"{stem}.img".casefold(), f"{stem}.img.gz".casefold())
    for entry in sorted(path.parent.iterdir()):
        if entry.name.casefold() in wanted:
            return entry
    raise InputError(f"{path}: its voxels, {stem}.img or {stem}.img.gz, are not next to it; copy them there")


def _las_matrix(path: Path, header: Any) -> FloatArray:  # noqa: ANN401 - half of nibabel is untyped
    zooms = np.array(header.get_zooms()[:3], np.float64)
    if not (np.isfinite(zooms).all() and (zooms > 0.0).all()):
        raise InputError(f"{path}: its voxels are {zooms} mm large; correct the header")
    return np.diag([*(zooms * (1.0, -1.0, 1.0)), 1.0])
