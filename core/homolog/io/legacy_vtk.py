"""Legacy VTK files (``.vtk``), text and binary, versions 1 to 5; VTK's own reader crashes on damaged files.

After *VTK File Formats* (Kitware) and the sources of ``vtkDataReader``. Everything is big-endian.
"""

import re
from itertools import islice

import numpy as np

from homolog.arrays import Array
from homolog.io.polygons import Cells, Polygons, numbers_of
from homolog.io.volume_cells import surface_of_cells

__all__ = ["read_legacy_vtk"]

_HEAD = re.compile(
    rb"# vtk DataFile Version +([1-5])\.\d+[ \t\r]*\n([^\n]*)\n\s*(ascii|binary)\s+dataset\s+(\w+)",
    re.IGNORECASE,
)
_WORD = re.compile(rb"\S+")
_BLANK_LINE = re.compile(rb"\n[ \t\r]*(\n|$)")
_KINDS = {
    "unsigned_char": ">u1", "char": ">i1", "signed_char": ">i1", "unsigned_short": ">u2", "short": ">i2",
    "unsigned_int": ">u4", "int": ">i4", "unsigned_long": ">u8", "long": ">i8", "unsigned_long_long": ">u8",
    "long_long": ">i8", "float": ">f4", "double": ">f8", "vtkidtype": ">i4", "vtktypeint8": ">i1",
    "vtktypeuint8": ">u1", "vtktypeint16": ">i2", "vtktypeuint16": ">u2", "vtktypeint32": ">i4",
    "vtktypeuint32": ">u4", "vtktypeint64": ">i8", "vtktypeuint64": ">u8",
}  # fmt: skip
_TEXTS = ("string", "utf8_string")
_CELLS = ("vertices", "lines", "polygons", "triangle_strips", "cells")
_SETS = (b"polydata", b"unstructured_grid")


def read_legacy_vtk(content: bytes) -> Polygons:
    """Read the surface of a legacy file; of volume cells, the outer surface. Values are ignored.

    Raises
    ------
    ValueError
        If it is damaged, or neither POLYDATA nor UNSTRUCTURED_GRID.
    """
    head = _HEAD.match(content)
    if head is None or head[4].lower() not in _SETS:
        kind = "" if head is None else head[4].decode("latin-1").upper()
        raise ValueError(f"contains {kind}, not a surface; save images as NRRD" if head else "not a VTK file")
    file = _File(content, head.end(), binary=head[3].lower() == b"binary", version=int(head[1]))
    points, cells, space = np.empty((0, 3)), dict.fromkeys(_CELLS, Cells.of_lists([])), ""
    types: Array = np.empty(0, np.int64)
    while (part := file.word()) not in ("", "point_data", "cell_data"):
        if part == "points":
            count = file.number()
            points = file.values(3 * count, file.word()).astype(np.float64).reshape(-1, 3)
        elif part in _CELLS:
            cells[part] = file.cells()
        elif part == "cell_types":
            types = file.values(file.number(), "int")
        elif part == "field":
            space = file.field_data() or space
        elif part == "metadata":
            file.skip_metadata()
        else:
            raise ValueError(f"unknown part {part[:40]!r}")
    header = f"{head[2].decode('latin-1')} SPACE={space}"
    if head[4].lower() == _SETS[1]:
        return surface_of_cells(points, cells["cells"], types, header)
    return Polygons(points, cells["polygons"], cells["triangle_strips"], header)


class _File:
    """The unread part of a file."""

    def __init__(self, content: bytes, at: int, *, binary: bool, version: int) -> None:
        self._content = content
        self._at = at
        self._binary = binary
        self._version = version

    def word(self) -> str:
        """Return the next word in lower case; empty at the end."""
        return self._text().lower()

    def _text(self) -> str:
        match = _WORD.search(self._content, self._at)
        if match is None:
            return ""
        self._at = match.end()
        return match[0].decode("latin-1")

    def number(self) -> int:
        """Return a count, which can't be larger than the file."""
        count = int(self.word())
        if not 0 <= count <= len(self._content):
            raise ValueError("more values than it can contain")
        return count

    def values(self, count: int, kind: str) -> Array:
        """Return the next numbers of a kind."""
        if kind not in _KINDS:
            raise ValueError(f"unknown kind {kind[:40]!r}")
        dtype = np.dtype(_KINDS[kind])
        if self._binary:
            return np.frombuffer(self._bytes(count * dtype.itemsize), dtype)
        tokens = []
        for match in islice(_WORD.finditer(self._content, self._at), count):
            tokens.append(match[0])
            self._at = match.end()
        if len(tokens) < count:
            raise ValueError("cut short")
        return numbers_of(tokens, whole=dtype.kind != "f")

    def _bytes(self, count: int) -> bytes:
        """Return the bytes that begin with the next line."""
        start = self._content.index(b"\n", self._at) + 1
        return self._taken(start, count)

    def _taken(self, start: int, count: int) -> bytes:
        self._at = start + count
        if self._at > len(self._content):
            raise ValueError("cut short")
        return self._content[start : self._at]

    def cells(self) -> Cells:
        """Return lists of vertices in the format of the file's version."""
        count, size = self.number(), self.number()
        if self._version >= 5:
            starts, corners = (
                self._named(name, n) for name, n in (("offsets", count), ("connectivity", size))
            )
            return Cells.of(corners, starts) if count else Cells.of_lists([])
        flat = self.values(size, "int").astype(np.int64)
        step = size // max(count, 1)
        if count and size == step * count and (flat[::step] == step - 1).all():
            return Cells.of(flat.reshape(-1, step)[:, 1:].ravel(), (step - 1) * np.arange(count + 1))
        lists: list[list[int]] = []
        at = 0
        while len(lists) < count and at < size:
            lists.append(flat[at + 1 : at + 1 + max(int(flat[at]), 0)].tolist())
            at += 1 + len(lists[-1])
        if at != size or len(lists) != count:
            raise ValueError("inconsistent faces")
        return Cells.of_lists(lists)

    def _named(self, name: str, count: int) -> Array:
        if self.word() != name:
            raise ValueError(f"no {name} of faces")
        return self.values(count, self.word())

    def field_data(self) -> str:
        """Skip arrays of field data; return the text called SPACE, if there is one."""
        self.word()  # its name
        space = ""
        for _ in range(self.number()):
            name = self._text()
            if name.lower() == "metadata":  # of the preceding array
                self.skip_metadata()
                name = self._text()
            count, kind = self.number() * self.number(), self.word()
            if kind in _TEXTS:
                texts = self._texts(count)
                space = texts[0] if name == "SPACE" and texts else space
            elif kind == "bit" and self._binary:
                self._bytes((count + 7) // 8)
            else:
                self.values(count, "unsigned_char" if kind == "bit" else kind)
        return space

    def _texts(self, count: int) -> list[str]:
        """Return texts: lines, or bytes after a length whose first two bits give its own size."""
        self._bytes(0)
        strings = []
        for _ in range(count):
            if self._binary:
                size = 8 >> (self._taken(self._at, 1)[0] >> 6)
                length = int.from_bytes(self._taken(self._at - 1, size), "big") & ((1 << (8 * size - 2)) - 1)
                strings.append(self._taken(self._at, length))
            else:
                end = self._content.index(b"\n", self._at)
                strings.append(self._taken(self._at, end - self._at).strip())
                self._at = end + 1
        return [item.decode("latin-1") for item in strings]

    def skip_metadata(self) -> None:
        """Skip a block of metadata, which ends with an empty line."""
        blank = _BLANK_LINE.search(self._content, self._at)
        self._at = blank.end() if blank else len(self._content)
