"""Masks without a voxel, found without unpacking every file."""

import gzip
import io
import struct
import zlib
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

__all__ = ["empty_masks"]

_GZIP, _TRAILER = b"\x1f\x8b", 8
_HEADER, _PART = 540, 2**22  # bytes
_MOST_PARTS = 2**10  # of a file; packed zeros may be endless
_FAULTS = (OSError, EOFError, OverflowError, zlib.error, struct.error, ValueError)


def empty_masks(paths: Iterable[Path]) -> set[Path]:
    """Return which of one subject's NIfTI files contain zeros only; one that can't be read is not among them.

    Nothing packs better than zeros: of packed files as long as each other, the smallest are unpacked, up to
    the first with a voxel. Where headers are equal, the checksum at the end tells others that are empty, too.
    """
    empty: set[Path] = set()
    packed: dict[bytes, list[tuple[int, bytes, Path]]] = {}
    for path in paths:
        if path.name.lower().endswith((".nii", ".nii.gz")):
            with suppress(*_FAULTS), path.open("rb") as file:
                if file.read(len(_GZIP)) == _GZIP:
                    file.seek(-_TRAILER, io.SEEK_END)
                    end = file.read()
                    packed.setdefault(end[4:], []).append((file.tell(), end, path))
                    continue
                file.seek(0)
                if _holds_zeros(file):
                    empty.add(path)
    for files in packed.values():
        empty |= _smallest(sorted(files))
    return empty


def _smallest(files: list[tuple[int, bytes, Path]]) -> set[Path]:
    """Return the packed files that hold zeros, of files as long as each other: sizes, ends, and paths."""
    empty: set[Path] = set()
    known: set[bytes] = set()
    for _, end, path in files:
        if end not in known:
            try:
                with gzip.open(path) as stream:
                    if not _holds_zeros(stream):
                        break
            except _FAULTS:
                continue
            known.add(end)
        empty.add(path)
    return empty


def _holds_zeros(stream: BinaryIO | gzip.GzipFile) -> bool:
    """Return whether all voxels of a NIfTI 1 or 2 file are zero, as far as the first that is not."""
    header = stream.read(_HEADER)
    order = next((item for item in "<>" if struct.unpack(f"{item}i", header[:4])[0] in (348, _HEADER)), None)
    if order is None:
        return False
    if struct.unpack(f"{order}i", header[:4])[0] == _HEADER:
        begin, offset = struct.unpack(f"{order}q", header[168:176])[0], header[184:192]
    else:
        begin, offset = int(struct.unpack(f"{order}f", header[108:112])[0]), header[116:120]
    if any(offset):  # added to every value
        return False
    stream.seek(max(begin, 0))
    for index in range(_MOST_PARTS):
        part = stream.read(_PART)
        if not part:
            return index > 0
        if part.count(0) < len(part):
            return False
    return False
