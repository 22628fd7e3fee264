"""Headers of NRRD and MetaImage files: position of the voxels, and names of segments.

Invalid headers that SimpleITK accepts silently are refused here.
"""

import math
import os
import re
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from homolog.errors import InputError
from homolog.io.volumes import Segment

__all__ = ["Header", "check_gipl", "read_header", "segments_of"]

_LONGEST = 2**20
"""Longest text header in bytes; longer ones are refused."""
_MOST_FILES = 100_000
_MOST_DIMENSIONS = 10  # of MetaIO, which ends the process at other numbers
_ZLIB_OR_GZIP = 47
_GIPL_HEADER = 256  # bytes
_MILLIMETRES = ("", "mm", "millimeter", "millimeters", "millimetre", "millimetres")
_NO_SIZE = "its header gives no voxel size; 1 mm was assumed"
_RESCUE = "correct its header or export it again"


@dataclass(frozen=True, slots=True)
class Header:
    """A text header.

    Attributes
    ----------
    path : Path
        The file that begins with the header.
    is_nrrd : bool
        Whether it is NRRD rather than MetaImage.
    values : mapping of str to str
        Values by key, in lower case without blanks.
    files : tuple of str
        Names of the files of voxels next to the header; empty if the voxels follow the header.
    length : int
        Bytes of the header before the voxels.
    """

    path: Path
    is_nrrd: bool
    values: Mapping[str, str]
    files: tuple[str, ...]
    length: int

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the user."""
        keys = ("spacedirections", "spacings") if self.is_nrrd else ("elementspacing", "elementsize")
        return () if any(key in self.values for key in keys) else (_NO_SIZE,)

    def check_length(self, needed: int) -> None:
        """Refuse more or fewer bytes of voxels than the header declares: its sizes or its offset are wrong.

        Parameters
        ----------
        needed : int
            Number of bytes of all voxels.
        """
        if self._is("compresseddata") and not self.is_nrrd:
            self._check_deflated(needed)
            return
        skip = self._number("byteskip" if self.is_nrrd else "headersize")
        encoding = self.values.get("encoding", "").lower()
        packed = encoding in ("gzip", "gz") and len(self.files) < 2
        plain = (
            encoding == "raw" if self.is_nrrd else not self._is("compresseddata") and self._is("binarydata")
        )
        if skip < 0 or not (packed or plain):
            return  # the voxels are at the end of the file, or the decoder determines their number
        places = [self.path.parent / name for name in self.files] or [self.path]
        there = sum(os.path.getsize(place) for place in places)
        before = (skip + self._skipped_lines(places[0])) * len(places) if self.files else self.length + skip
        if packed:
            with places[0].open("rb") as stream:
                stream.seek(max(there - 4, 0))
                there, before = int.from_bytes(stream.read(4), "little"), skip
            if there - before > needed:  # of several compressed parts only the last one counts
                raise InputError(
                    f"{self.path}: may be cut short, or contains more than the {needed} bytes of voxels that "
                    "its header declares; copy or export it again"
                )
        elif there - before < needed:
            raise InputError(
                f"{self.path}: may be cut short ({there - before} of {needed} bytes of voxels); copy or "
                "export it again"
            )
        elif there - before > needed:
            raise InputError(
                f"{self.path}: contains {there - before} bytes of voxels, and its header declares {needed}: "
                "its sizes or the skipped bytes are wrong; correct it or export it again"
            )

    def _check_deflated(self, needed: int) -> None:
        """Refuse incomplete compressed voxels of a MetaImage: SimpleITK would read noise."""
        place, begin = (self.path.parent / self.files[0], 0) if self.files else (self.path, self.length)
        size, is_whole = _unpacked_size(place, begin, needed)
        stored = os.path.getsize(place) - begin
        declared = self._number("compresseddatasize")
        if size == needed and is_whole and declared == 0:  # SimpleITK then reads the whole data file
            if self.files:
                return
            raise InputError(
                f"{self.path}: its header lacks the size of the compressed voxels; insert the line "
                f"'CompressedDataSize = {stored}' above ElementDataFile, or save it again uncompressed"
            )
        if size != needed or not is_whole or declared != stored:
            raise InputError(
                f"{self.path}: its compressed voxels are not the {needed} bytes that its header declares, or "
                "of another size when compressed; copy or export it again"
            )

    def check(self) -> None:
        """Refuse inconsistent headers, and data files that are missing or outside the header's folder."""
        for name in self.files:
            self._check_beside(name)
        (self._check_nrrd if self.is_nrrd else self._check_metaimage)()

    def _check_nrrd(self) -> None:
        if self.values.get("encoding", "").lower() in ("bzip2", "bz2"):
            raise InputError(
                f"{self.path}: is compressed by bzip2, which can't be read; save it again with gzip"
            )
        self._check_spacing("spacings")
        units = re.findall(r'"([^"]*)"', self.values.get("spaceunits", ""))
        if not all(unit.strip().lower() in _MILLIMETRES for unit in units):
            raise InputError(f"{self.path}: has the units {', '.join(units)}; save it again in mm")

    def _check_metaimage(self) -> None:
        if "ndims" in self.values and not 0 < self._number("ndims") <= _MOST_DIMENSIONS:
            raise InputError(f"{self.path}: has {self.values['ndims']} dimensions; {_RESCUE}")
        self._check_spacing("elementspacing")
        self._check_spacing("elementsize")
        for key in ("offset", "position", "origin"):
            if not np.isfinite(self._numbers(key)).all():
                raise InputError(f"{self.path}: has the origin {self.values[key]}; {_RESCUE}")
        for key in ("transformmatrix", "rotation", "orientation"):
            numbers = self._numbers(key)
            edge = math.isqrt(len(numbers))
            turn = np.reshape(numbers[: edge**2], (edge, edge))
            if not np.allclose(turn @ turn.T, np.eye(edge), atol=1e-3):
                raise InputError(f"{self.path}: its axes {self.values[key]} are not a rotation; {_RESCUE}")
        if not self.files and self._number("headersize") > 0:
            raise InputError(f"{self.path}: declares voxels both in this file and in another one; {_RESCUE}")

    def _check_spacing(self, key: str) -> None:
        sizes = [number for number in self._numbers(key) if not (self.is_nrrd and math.isnan(number))]
        if key in self.values and (len(sizes) < 2 or not all(0.0 < size < math.inf for size in sizes)):
            raise InputError(f"{self.path}: has the spacing {self.values[key]}; {_RESCUE}")

    def _number(self, key: str) -> int:
        try:
            return int(self.values.get(key, "0"))
        except ValueError as error:
            raise InputError(f"{self.path}: its {key} is {self.values[key]!r}; {_RESCUE}") from error

    def _numbers(self, key: str) -> list[float]:
        try:
            return [float(part) for part in self.values.get(key, "").split()]
        except ValueError as error:
            raise InputError(f"{self.path}: its {key} is {self.values[key]!r}; {_RESCUE}") from error

    def _is(self, key: str) -> bool:
        return self.values.get(key, "").lower() in ("true", "t", "yes", "1")

    def _skipped_lines(self, place: Path) -> int:
        """Return the number of bytes that the `line skip` of a NRRD header omits."""
        with place.open("rb") as stream:
            return sum(
                len(stream.readline(_LONGEST)) for _ in range(min(self._number("lineskip"), _MOST_FILES))
            )

    def _check_beside(self, name: str) -> None:
        place = PurePosixPath(os.path.normpath(name))
        if place.is_absolute() or ".." in place.parts or ":" in name:
            raise InputError(
                f"{self.path}: its voxels are in {name}; put that file next to the header, and "
                "name it there without a folder"
            )
        if not os.path.isfile(self.path.parent / place):  # accepts names of any length
            raise InputError(
                f"{self.path}: its voxels are in {name}, which is missing; put that file next to it"
            )


def _unpacked_size(place: Path, begin: int, most: int) -> tuple[int, bool]:
    """Return the number of unpacked bytes from an offset on, up to about `most`, and whether these are all.

    The file is unpacked in parts to save memory. The number is -1 for damaged files.
    """
    unpacker = zlib.decompressobj(_ZLIB_OR_GZIP)
    size = 0
    with place.open("rb") as stream:
        stream.seek(begin)
        try:
            while size <= most and not unpacker.eof and (part := stream.read(_LONGEST)):
                unpacked = unpacker.decompress(part, _LONGEST)
                while unpacked and size <= most:
                    size += len(unpacked)
                    unpacked = unpacker.decompress(unpacker.unconsumed_tail, _LONGEST)
        except zlib.error:
            return -1, False
    return size, unpacker.eof


def check_gipl(path: Path, needed: int) -> None:
    """Refuse a GIPL file with more or fewer bytes of voxels than its header declares."""
    packed = path.name.lower().endswith(".gz")
    needed += _GIPL_HEADER
    there = _unpacked_size(path, 0, needed)[0] if packed else os.path.getsize(path)
    if there != needed:
        raise InputError(
            f"{path}: is cut short, or contains more voxels than its header declares ({there} of {needed} "
            "bytes); copy or export it again"
        )


def read_header(path: Path) -> Header:
    """Read the header of a NRRD or MetaImage file, unchecked."""
    with path.open("rb") as stream:
        text = stream.read(_LONGEST).decode("latin-1")
    is_nrrd = text.startswith("NRRD")
    if is_nrrd and (blank := re.search(r"\r?\n\r?\n", text)):
        text = text[: blank.end()]
    values: dict[str, str] = {}
    files: tuple[str, ...] = ()
    length = 0
    lines = text.splitlines(keepends=True)
    for number, line in enumerate(lines):
        length += len(line)
        key, _, value = (part.strip() for part in line.partition(":" if is_nrrd else "="))
        key = key.lower().replace(" ", "")
        if not (is_nrrd and value.startswith("=")):  # a key defined by the user
            values.setdefault(key, value)
        if key == ("datafile" if is_nrrd else "elementdatafile"):
            files = tuple(_names(value.replace("\\", "/"), lines[number + 1 :]))
            if not is_nrrd:
                break  # the voxels follow
    return Header(path, is_nrrd, values, files, length)


def segments_of(path: Path, values: Mapping[str, str]) -> tuple[Segment, ...]:
    """Return the segments of 3D Slicer in a header, ``Segment0_Name`` and so on.

    Raises
    ------
    InputError
        If a value or layer is not a number.
    """
    segments = []
    for number in sorted(int(key[1]) for key in map(_NAMED.fullmatch, values) if key):
        name = values[f"Segment{number}_Name"]
        try:
            value, layer = (int(values.get(f"Segment{number}_{key}", default)) for key, default in _DEFAULTS)
        except ValueError as error:
            raise InputError(
                f"{path}: its header has an invalid entry for segment {name!r} ({error}); save it again"
            ) from error
        segments.append(Segment(name, value, layer))
    return tuple(segments)


_NAMED = re.compile(r"Segment(0|[1-9][0-9]{0,5})_Name")  # some programs begin with 1 or skip numbers
_DEFAULTS = (("LabelValue", "1"), ("Layer", "0"))


def _names(value: str, following: list[str]) -> list[str]:
    """Return the files that a header names: a single one, a list, or a pattern."""
    tokens = value.split()
    if not tokens or tokens[0].upper() == "LOCAL":
        return []
    if tokens[0].upper() == "LIST":
        return [line.strip() for line in following if line.strip()]
    if len(tokens) >= 3 and len(re.findall("%", tokens[0])) == 1 and re.search(r"%0?\d?d", tokens[0]):
        first, last, step = (int(word) if word.isdecimal() else 0 for word in (*tokens[1:4], "1")[:3])
        return [tokens[0] % number for number in range(first, last + 1, step or 1)[:_MOST_FILES]]
    return [value]
