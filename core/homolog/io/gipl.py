"""GIPL volumes (Guy's Image Processing Lab), the usual label maps of SPHARM-PDM.

SimpleITK allocates what a damaged header claims: up to gigabytes, 0.1 s for each of 3000 such files.
"""

import gzip
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from homolog.arrays import FloatArray
from homolog.errors import InputError
from homolog.io.nifti import stored_values
from homolog.io.volumes import StoredScan, Volume, check_size
from homolog.progress import Tick, no_tick

__all__ = ["read_gipl", "read_gipl_scan"]

_HEADER = struct.Struct(">4HH4f80x80x2x16x4d16xI")
"""Sizes, type, spacing, text, matrix (unused), flags, range, origin, floats, one of the magic numbers."""
_MAGIC = (0xEFFFE9B0, 0x2AE389B8)
_GZIP = b"\x1f\x8b"
_KINDS = {1: "u1", 7: "i1", 8: "u1", 15: ">i2", 16: ">u2", 31: ">u4", 32: ">i4", 64: ">f4", 65: ">f8"}
_NO_DIRECTION = "GIPL stores no orientation; LPS axes were assumed"


def read_gipl(path: Path) -> Volume:
    """Read a label map.

    Raises
    ------
    InputError
        If it can't be read, is cut short, not a 3-D volume, or too large.
    """
    values, matrix, _, _, notes = read_gipl_scan(path, no_tick)
    return Volume(path, [values.astype(values.dtype.newbyteorder("="))], matrix, notes=notes)


def read_gipl_scan(path: Path, tick: Tick) -> StoredScan:
    """Read grey values as stored; see `homolog.io.scans.Scan`."""
    shape, kind, matrix = _header(path)
    values = stored_values(path, _HEADER.size, shape, kind, tick)
    return values, matrix, 1.0, 0.0, (_NO_DIRECTION,)


def _header(path: Path) -> tuple[list[int], np.dtype[Any], FloatArray]:
    """Return the size of a volume, the type of its voxels and its matrix to LPS."""
    try:
        with path.open("rb") as stream:
            begin = stream.read(_HEADER.size)
        if begin.startswith(_GZIP):
            with gzip.open(path) as packed:
                begin = packed.read(_HEADER.size)
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{path}: is not a readable image; copy or export it again ({error})") from error
    if len(begin) < _HEADER.size:
        raise InputError(f"{path}: is cut short ({len(begin)} bytes); copy or export it again")
    header = _HEADER.unpack(begin)
    if header[-1] not in _MAGIC or header[4] not in _KINDS:
        raise InputError(f"{path}: is not a GIPL image of single numbers; export it again, or as .nrrd")
    shape = [*header[:3], *(size for size in header[3:4] if size > 1)]
    spacing, origin = np.array(header[5:8]), np.array(header[9:12])
    if not (np.isfinite(origin).all() and np.isfinite(spacing).all() and (spacing > 0.0).all()):
        raise InputError(f"{path}: has voxels without a size or position; export it again")
    kind = np.dtype(_KINDS[header[4]])
    check_size(path, shape, kind.itemsize * 2)
    matrix = np.diag([*spacing, 1.0])
    matrix[:3, 3] = origin
    return shape, kind, matrix
