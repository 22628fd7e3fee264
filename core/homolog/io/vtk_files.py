"""Files of VTK: XML (``.vtp``, ``.vtu``), read and written, and legacy (``.vtk``), read.

They are read without VTK, whose readers end the program for one in 300 damaged files of either kind and
allocate gigabytes for others. VTK's XML writer takes five times as long.

After *VTK XML Formats* (docs.vtk.org), *VTK File Formats* (Kitware) and the sources of ``vtkXMLDataParser``
and ``vtkDataReader``. XML: text, base64 and raw, inline and appended, compressed by zlib, LZMA and LZ4; the
length of each array follows from the counts before it, and is compared with its declared length before
anything is unpacked. Legacy files are text or binary (big-endian), of versions 1 to 5.
"""

import binascii
import lzma
import re
import zlib
from collections.abc import Callable, Mapping
from html import escape
from itertools import islice, pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from homolog.arrays import Array
from homolog.io.atomic import atomic_write
from homolog.io.polygons import MOST, Cells, Polygons, TooLargeError, numbers_of, surface_of_cells
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["read_legacy_vtk", "read_vtp", "write_vtp"]

_APPENDED = re.compile(rb"<AppendedData[^>]*>\s*_")
_KINDS = {
    "Int8": "i1",
    "UInt8": "u1",
    "Int16": "i2",
    "UInt16": "u2",
    "Int32": "i4",
    "UInt32": "u4",
    "Int64": "i8",
    "UInt64": "u8",
    "Float32": "f4",
    "Float64": "f8",
    "String": "u1",
}
_DEFLATED = 1032  # largest number of bytes per compressed byte
_LONGEST_TEXT = 100
_SPACE = "FieldData/*[@Name='SPACE']"
_NAMES = {kind: name for name, kind in _KINDS.items() if name != "String"}
_BLOCK = 2**18  # bytes that are compressed at once
_LAYOUT = """<?xml version="1.0"?>
<VTKFile type="PolyData" version="0.1" byte_order="LittleEndian" header_type="UInt32" \
compressor="vtkZLibDataCompressor">
  <PolyData>
    <FieldData>
      <Array type="String" Name="SPACE" NumberOfTuples="1" format="ascii">{space}</Array>
    </FieldData>
    <Piece NumberOfPoints="{points}" NumberOfVerts="0" NumberOfLines="0" NumberOfStrips="0" \
NumberOfPolys="{faces}">
      <PointData>{values}</PointData>
      <Points>{vertices}</Points>
      <Polys>{polygons}</Polys>
    </Piece>
  </PolyData>
  <AppendedData encoding="base64">
   _"""


def read_vtp(content: bytes) -> Polygons:
    """Read the surface of an XML file; of volume cells, the outer surface. Values are ignored.

    Raises
    ------
    ValueError
        If it is damaged, or neither PolyData nor UnstructuredGrid.
    """
    appended = _APPENDED.search(content)
    head, tail = (
        (content, b"") if appended is None else (content[: appended.end()], content[appended.end() :])
    )
    if b"<!DOCTYPE" in head:
        raise ValueError("a document type declaration")
    root = ElementTree.fromstring(head + (b"</AppendedData></VTKFile>" if appended else b""))
    kind = root.get("type", "")
    if root.tag != "VTKFile" or kind not in ("PolyData", "UnstructuredGrid"):
        raise ValueError("neither PolyData nor UnstructuredGrid of a VTK file")
    file = _File(root, tail)
    whole = root.find(kind)
    pieces: list[Polygons] = []
    for item in [] if whole is None else whole.findall("Piece"):
        pieces.append(_piece(file, item, len(content)))
        if sum(len(piece.points) + len(piece.faces.corners) for piece in pieces) > 2 * MOST:
            raise TooLargeError(f"more than {MOST} points or corners")
    if whole is None or not pieces:
        raise ValueError("no points")
    shifts = np.cumsum([0, *(len(piece.points) for piece in pieces)])[:-1]
    return Polygons(
        np.concatenate([piece.points for piece in pieces]),
        Cells.joined(
            _moved(piece.faces, len(piece.points), shift) for piece, shift in zip(pieces, shifts, strict=True)
        ),
        Cells.joined(
            _moved(piece.strips, len(piece.points), shift)
            for piece, shift in zip(pieces, shifts, strict=True)
        ),
        f"SPACE={file.text(whole.find(_SPACE))}",
    )


def write_vtp(path: Path, mesh: TriangleMesh, point_data: Mapping[str, Array], space: str) -> None:
    """Write a surface as VTK does: appended arrays in base64, compressed by zlib.

    Parameters
    ----------
    path : Path
        The file, replaced atomically.
    mesh : TriangleMesh
    point_data : mapping of str to (V,) or (V, C) array
        Values at the vertices.
    space : str
        The frame of its coordinates, such as ``"LPS"``.

    Raises
    ------
    InputError
        If the file can't be written.
    """
    appended = _Appended()
    content = _LAYOUT.format(
        space=" ".join(str(code) for code in (*space.encode(), 0)),
        points=len(mesh.vertices),
        faces=len(mesh.faces),
        values="".join(appended.add(name, values) for name, values in point_data.items()),
        vertices=appended.add("Points", mesh.vertices),
        polygons=appended.add("connectivity", mesh.faces.astype(np.int64).ravel())
        + appended.add("offsets", np.arange(3, mesh.faces.size + 1, 3, dtype=np.int64)),
    )
    with atomic_write(path) as part:
        part.write_bytes(b"".join([content.encode(), *appended.stored, b"\n  </AppendedData>\n</VTKFile>\n"]))


class _Appended:
    """Compressed arrays for the end of a file."""

    def __init__(self) -> None:
        self.stored: list[bytes] = []

    def add(self, name: str, values: Array) -> str:
        """Append an array and return the element that refers to it."""
        kind = values.dtype.newbyteorder("<")
        flat = values.astype(kind).tobytes()
        offset = sum(map(len, self.stored))
        packed = [_deflated(flat[at : at + _BLOCK], kind) for at in range(0, len(flat), _BLOCK)]
        sizes = [len(packed), _BLOCK, len(flat) % _BLOCK, *map(len, packed)]
        self.stored += [
            binascii.b2a_base64(part, newline=False)
            for part in (np.array(sizes, "<u4").tobytes(), b"".join(packed))
        ]
        columns = 1 if values.ndim == 1 else values.shape[1]
        return (
            f'<DataArray type="{_NAMES[kind.str[1:]]}" Name="{escape(name)}" '
            f'NumberOfComponents="{columns}" format="appended" offset="{offset}"/>'
        )


def _deflated(part: bytes, kind: np.dtype[Any]) -> bytes:
    """Compress bytes fast. Coordinates have no repeated parts that a slower method would find."""
    deflate = zlib.compressobj(1, strategy=zlib.Z_RLE if kind.kind == "f" else zlib.Z_DEFAULT_STRATEGY)
    return deflate.compress(part) + deflate.flush()


def _piece(file: "_File", piece: ElementTree.Element, size: int) -> Polygons:
    def count(name: str) -> int:
        count = int(piece.get(f"NumberOf{name}", "0"))
        if not 0 <= count <= min(_DEFLATED * size, MOST):
            raise ValueError("claims more points or faces than it can contain")
        return count

    def cells(name: str) -> Cells:
        ends = file.values(piece.find(f"{name}/DataArray[@Name='offsets']"), count(name))
        starts = np.append(0, ends).astype(np.int64)
        if starts[-1] > MOST:
            raise TooLargeError(f"more than {MOST} corners")
        corners = file.values(piece.find(f"{name}/DataArray[@Name='connectivity']"), int(starts[-1]))
        return Cells.of(corners, starts)

    stored = file.values(piece.find("Points/DataArray"), 3 * count("Points"))
    points = stored.astype(np.float64).reshape(-1, 3)
    if piece.get("NumberOfCells") is None:
        return Polygons(points, cells("Polys"), cells("Strips"))
    types = file.values(piece.find("Cells/DataArray[@Name='types']"), count("Cells"))
    return surface_of_cells(points, cells("Cells"), types)


def _moved(cells: Cells, count: int, shift: int) -> Cells:
    """Return lists with shifted indices of points; invalid indices stay invalid."""
    inside = (cells.corners >= 0) & (cells.corners < count)
    return Cells.of(np.where(inside, cells.corners + shift, -1), cells.starts)


class _File:
    """The arrays of a file, inline or appended."""

    def __init__(self, root: ElementTree.Element, tail: bytes) -> None:
        self._order = ">" if root.get("byte_order") == "BigEndian" else "<"
        self._word = np.dtype(
            self._order + {"UInt32": "u4", "UInt64": "u8"}[root.get("header_type", "UInt32")]
        )
        compressor = root.get("compressor")
        self._unpack = _UNPACK[compressor] if compressor else None
        self._tail = tail
        appended = root.find("AppendedData")
        self._tail_is_raw = appended is not None and appended.get("encoding") == "raw"

    def text(self, node: ElementTree.Element | None) -> str:
        """Return a short text, stored as codes with a final zero; empty if it is missing."""
        if node is None or node.get("type") != "String":
            return ""
        codes = self._codes(node)[:_LONGEST_TEXT]
        return bytes(codes.tolist()).partition(b"\0")[0].decode("latin-1")

    def _codes(self, node: ElementTree.Element) -> Array:
        if node.get("format") == "ascii":
            return numbers_of((node.text or "").split()[:_LONGEST_TEXT], whole=True).astype(np.uint8)
        return np.frombuffer(self._stored(node, None), np.uint8)

    def values(self, node: ElementTree.Element | None, count: int) -> Array:
        """Return the numbers of an array, whose length must be `count`."""
        if count == 0:
            return np.empty(0)
        if node is None:
            raise ValueError("lacks an array")
        dtype = np.dtype(self._order + _KINDS[node.get("type", "")])
        if node.get("format") == "ascii":
            tokens = (node.text or "").split()
            if len(tokens) != count:
                raise ValueError("cut short")
            return numbers_of(tokens, whole=dtype.kind != "f")
        return np.frombuffer(self._stored(node, count * dtype.itemsize), dtype)

    def _stored(self, node: ElementTree.Element, size: int | None) -> bytes:
        """Return an array's bytes, whose number must be `size` if that is given."""
        if node.get("format") == "appended":
            offset = int(node.get("offset", "-1"))
            if not 0 <= offset < len(self._tail):
                raise ValueError("cut short")
            source = _Source(self._tail, offset, raw=self._tail_is_raw)
        else:
            source = _Source("".join((node.text or "").split()).encode(), 0, raw=False)
        width = self._word.itemsize
        if self._unpack is None:
            (claimed,) = self._words(source.peek(width))
            _check(claimed, size)
            return source.take(width + claimed)[width:]
        blocks, block, last = self._words(source.peek(3 * width))
        sizes = [block] * max(blocks - 1, 0) + [last or block] * (blocks > 0) if blocks < len(source) else []
        if blocks != len(sizes):
            raise ValueError("claims more blocks than it can contain")
        _check(sum(sizes), size)
        packed = self._words(source.take((3 + blocks) * width))[3:]
        body = source.take(sum(packed))
        ends = np.cumsum([0, *packed]).tolist()
        parts = (body[start:end] for start, end in pairwise(ends))
        return b"".join(_whole(self._unpack(part, n), n) for part, n in zip(parts, sizes, strict=True))

    def _words(self, stored: bytes) -> list[int]:
        integers: list[int] = np.frombuffer(stored, self._word).tolist()
        return integers


class _Source:
    """Raw or base64 bytes from an offset on; each part is encoded separately."""

    def __init__(self, stored: bytes, at: int, *, raw: bool) -> None:
        self._stored = stored
        self._at = at
        self._raw = raw

    def __len__(self) -> int:
        return len(self._stored) - self._at

    def peek(self, count: int) -> bytes:
        """Return the next bytes without advancing."""
        size = count if self._raw else (count + 2) // 3 * 4
        encoded = self._stored[self._at : self._at + size]
        decoded = encoded if self._raw else binascii.a2b_base64(encoded)
        return _whole(decoded[:count], count)

    def take(self, count: int) -> bytes:
        """Return the next bytes and advance past them."""
        taken = self.peek(count)
        self._at += count if self._raw else (count + 2) // 3 * 4
        return taken


def _check(claimed: int, size: int | None) -> None:
    if claimed > _LONGEST_TEXT if size is None else claimed != size:
        raise ValueError("the length of its arrays does not match its points and faces")


def _whole(content: bytes, size: int) -> bytes:
    if len(content) != size:
        raise ValueError("cut short")
    return content


def _inflated(part: bytes, size: int) -> bytes:
    return zlib.decompressobj().decompress(part, size + 1)


def _from_lzma(part: bytes, size: int) -> bytes:
    return lzma.LZMADecompressor(memlimit=2**28).decompress(part, size + 1)


def _from_lz4(part: bytes, size: int) -> bytes:
    from vtkmodules.vtkIOCore import vtkLZ4DataCompressor

    unpacker, unpacked = vtkLZ4DataCompressor(), bytearray(size)
    unpacker.AddObserver("ErrorEvent", lambda *_: None)  # an observer prevents printing
    return bytes(unpacked[: unpacker.Uncompress(part, len(part), unpacked, size)])


_UNPACK: dict[str, Callable[[bytes, int], bytes]] = {
    "vtkZLibDataCompressor": _inflated,
    "vtkLZMADataCompressor": _from_lzma,
    "vtkLZ4DataCompressor": _from_lz4,
}


_HEAD = re.compile(
    rb"# vtk DataFile Version +([1-5])\.\d+[ \t\r]*\n([^\n]*)\n\s*(ascii|binary)\s+dataset\s+(\w+)",
    re.IGNORECASE,
)
_WORD = re.compile(rb"\S+")
_BLANK_LINE = re.compile(rb"\n[ \t\r]*(\n|$)")
_LEGACY_KINDS = {
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
    file = _LegacyFile(content, head.end(), binary=head[3].lower() == b"binary", version=int(head[1]))
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


class _LegacyFile:
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
        if kind not in _LEGACY_KINDS:
            raise ValueError(f"unknown kind {kind[:40]!r}")
        dtype = np.dtype(_LEGACY_KINDS[kind])
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
