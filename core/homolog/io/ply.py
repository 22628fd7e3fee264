"""PLY surfaces. trimesh reads no binary faces of mixed sizes, and VTK crashes on a third of damaged files."""

import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from homolog.arrays import Array, FloatArray
from homolog.io.atomic import atomic_write
from homolog.io.polygons import Cells, Polygons, numbers_of
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["read_ply", "write_ply"]

_END = re.compile(rb"end_header[ \t]*(\r\n|\n|\r)")
_ORDERS = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}
_KINDS = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Property:
    """A number, or a list of numbers after their count, of each row of an element."""

    name: str
    kind: np.dtype[Any]
    count: np.dtype[Any] | None = None

    def fields(self, length: int) -> list[tuple[Any, ...]]:
        """Return the parts of a row, for a numpy type."""
        values = (self.name, self.kind, (length,))
        return [values] if self.count is None else [(f"count of {self.name}", self.count), values]


@dataclass(frozen=True, slots=True)
class _Element:
    rows: int
    properties: list[_Property] = field(default_factory=list)


def read_ply(content: bytes) -> Polygons:
    """Read the points and faces of a PLY file, text or binary; colours, textures and normals are ignored.

    Raises
    ------
    ValueError
        If its length is not that of the header, or it has no points.
    """
    end = _END.search(content)
    if end is None or not content.startswith(b"ply"):
        raise ValueError("no header of a PLY file")
    header = content[: end.start()].decode("latin-1")
    layout, elements = _declared(header)
    if "vertex" not in elements:
        raise ValueError("no points")
    if "tristrips" in elements:
        raise ValueError("contains triangle strips; save it with triangles")
    body = content[end.end() :]
    if layout == "ascii":  # as if all were double
        body = numbers_of(body.split(), whole=False).tobytes()
    points: dict[str, Array] = {}
    faces, at = Cells.of_lists([]), 0
    for name, element in elements.items():
        columns, at = _columns(body, at, element, _ORDERS[layout])
        if name == "vertex":
            points = {key: values for key, (values, _) in columns.items()}
        elif name == "face" and element.rows:
            corners, counts = next(
                columns[key] for key in ("vertex_indices", "vertex_index") if key in columns
            )
            if not np.array_equal(corners, np.rint(corners)):
                raise ValueError("corners that are not whole numbers")
            faces = Cells.of(corners, np.append(0, np.cumsum(counts)))
    if at != len(body):
        raise ValueError("more points or faces than the header says")
    return Polygons(
        np.stack([points[axis] for axis in "xyz"], axis=1).astype(np.float64), faces, header=header
    )


def _declared(header: str) -> tuple[str, dict[str, _Element]]:
    """Return the layout and the elements that a header declares."""
    layout, elements = "", dict[str, _Element]()
    lines = [line.split() for line in header.splitlines()]
    for tokens in lines:
        if tokens[:1] == ["format"]:
            layout = tokens[1]
    order = _ORDERS[layout]

    def kind(name: str) -> np.dtype[Any]:
        return np.dtype(order + ("f8" if layout == "ascii" else _KINDS[name]))

    for tokens in lines:
        if tokens[:1] == ["element"]:
            elements[tokens[1]] = element = _Element(int(tokens[2]))
        elif tokens[:2] == ["property", "list"]:
            element.properties.append(_Property(tokens[4], kind(tokens[3]), kind(tokens[2])))
        elif tokens[:1] == ["property"]:
            element.properties.append(_Property(tokens[2], kind(tokens[1])))
    return layout, elements


def _columns(
    body: bytes, at: int, element: _Element, order: str
) -> tuple[dict[str, tuple[Array, Array]], int]:
    """Return the values of each property, with their numbers in each row, and the end of the element."""
    rows, properties = element.rows, element.properties
    if not 0 <= rows <= len(body):
        raise ValueError("fewer bytes than points or faces")
    lengths, end = _lengths(body, at, properties) if rows else ([1] * len(properties), at)
    if at + rows * (end - at) <= len(body):
        pairs = list(zip(properties, lengths, strict=True))
        table = np.frombuffer(
            body, np.dtype([part for item, n in pairs for part in item.fields(n)]), rows, at
        )
        if all((table[f"count of {item.name}"] == n).all() for item, n in pairs if item.count is not None):
            columns = {item.name: (table[item.name].ravel(), np.full(rows, n)) for item, n in pairs}
            return columns, at + table.nbytes
    values: dict[str, list[float]] = {item.name: [] for item in properties}
    counts: dict[str, list[int]] = {item.name: [] for item in properties}
    for _ in range(rows):  # lists of several lengths
        lengths, end = _lengths(body, at, properties)
        for item, length in zip(properties, lengths, strict=True):
            at += 0 if item.count is None else item.count.itemsize
            values[item.name] += struct.unpack_from(f"{order}{length}{item.kind.char}", body, at)
            counts[item.name].append(length)
            at += length * item.kind.itemsize
    return {name: (np.array(values[name]), np.array(counts[name])) for name in values}, at


def _lengths(body: bytes, at: int, properties: list[_Property]) -> tuple[list[int], int]:
    """Return the numbers of values of each property in the row that begins at a byte, and the row's end."""
    lengths = []
    for item in properties:
        length = 1
        if item.count is not None:
            length = int(np.frombuffer(body, item.count, 1, at)[0])
            at += item.count.itemsize
        if not 0 <= length * item.kind.itemsize <= len(body) - at:
            raise ValueError("cut short")
        lengths.append(length)
        at += length * item.kind.itemsize
    return lengths, at


def write_ply(path: Path, mesh: TriangleMesh, point_data: Mapping[str, Array], comment: str) -> None:
    """Write a binary PLY with doubles and one float property per column of values.

    Parameters
    ----------
    path : Path
        The file.
    mesh : TriangleMesh
        The surface.
    point_data : mapping of str to array
        Values (V,) or (V, c) at the vertices.
    comment : str
        Comment line of the header; may be empty.
    """
    columns: dict[str, FloatArray] = {}
    for name, values in point_data.items():
        table = np.asarray(values, dtype=np.float64).reshape(len(mesh.vertices), -1)
        names = [name] if table.shape[1] == 1 else [f"{name}_{index}" for index in range(table.shape[1])]
        columns.update(zip(["_".join(item.split()) for item in names], table.T, strict=True))
    points = np.empty(
        len(mesh.vertices), [(axis, "<f8") for axis in "xyz"] + [(item, "<f4") for item in columns]
    )
    for index, axis in enumerate("xyz"):
        points[axis] = mesh.vertices[:, index]
    for name, column in columns.items():
        points[name] = column
    triangles = np.empty(len(mesh.faces), [("count", "u1"), ("corners", "<i4", 3)])
    triangles["count"], triangles["corners"] = 3, mesh.faces
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment {comment}",
        f"element vertex {len(points)}",
        *(f"property double {axis}" for axis in "xyz"),
        *(f"property float {name}" for name in columns),
        f"element face {len(triangles)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    with atomic_write(path) as part:
        part.write_bytes("\n".join(header).encode() + points.tobytes() + triangles.tobytes())
