"""Bounded decompression of wholly deflated DICOM files, such as SEGs by dcmqi and 3D Slicer."""

import os
import zlib
from pathlib import Path
from typing import BinaryIO

from homolog.errors import InputError
from homolog.io.bounded import read_bytes

__all__ = ["unpacked"]

LARGEST = 256 * 2**20
_PREAMBLE, _GROUP_LENGTH = 132, 12  # bytes before the file's meta information


def unpacked(path: Path) -> str | BinaryIO:
    """Return a file's path, or the unpacked content of a deflated file (explicit, little-endian).

    Raises
    ------
    InputError
        If it unpacks to more than 256 MB.
    Exception
        Any error of pydicom on damaged files.
    """
    from pydicom.filebase import DicomBytesIO
    from pydicom.filereader import read_file_meta_info
    from pydicom.filewriter import write_file_meta_info
    from pydicom.uid import ExplicitVRLittleEndian

    meta = read_file_meta_info(path)
    if not meta.TransferSyntaxUID.is_deflated:
        return os.fspath(path)
    content = read_bytes(path, "DICOM file")
    start = _PREAMBLE + _GROUP_LENGTH + meta.FileMetaInformationGroupLength
    plain = zlib.decompressobj(-zlib.MAX_WBITS).decompress(content[start:], LARGEST + 1)
    if len(plain) > LARGEST:
        raise InputError(f"{path}: unpacks to more than 256 MB; export it without compression")
    stream = DicomBytesIO(content[:_PREAMBLE])
    stream.seek(_PREAMBLE)
    meta.TransferSyntaxUID = ExplicitVRLittleEndian
    write_file_meta_info(stream, meta)
    stream.write(plain)
    stream.seek(0)
    return stream.parent  # type: ignore[return-value]
