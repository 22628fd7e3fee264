"""PLY surfaces where VTK falls short: it writes single precision only, and crashes on files cut short."""

import struct
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from homolog.arrays import Array, FloatArray
from homolog.errors import InputError
from homolog.files.atomic import replacing
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["check_ply", "write_ply"]

_CODES = {
    "char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "float": "f",
    "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "float32": "f",
    "double": "d", "float64": "d",
}  # fmt: skip


def check_ply(path: Path) -> None:
    """Refuse a PLY file whose body is shorter than its header says.

    Raises
    ------
    InputError
        If the header can't be understood or the body is cut short.
    """
    head, _, body = path.read_bytes().partition(b"end_header")
    lines = [line.split() for line in head.decode("latin-1").splitlines()]
    body = body.partition(b"\n")[2]
    try:
        form = next(line[1] for line in lines if line[:1] == ["format"])
        elements = _elements(lines)
        if form == "ascii":
            whole = len(body.split(b"\n")) >= sum(count for count, _ in elements)
        else:
            whole = len(body) >= _length(elements, body, "<" if form == "binary_little_endian" else ">")
    except (StopIteration, IndexError, KeyError, ValueError) as error:
        raise InputError(
            f"{path}: can't be read as a mesh, its header is damaged; export it again"
        ) from error
    except struct.error:
        whole = False
    if not whole:
        raise InputError(f"{path}: can't be read as a mesh, it is cut short; copy or export it again")


def write_ply(path: Path, mesh: TriangleMesh, point_data: Mapping[str, Array], comment: str) -> None:
    """Write a binary PLY with doubles and one float property per column of values."""
    columns: dict[str, FloatArray] = {}
    for name, values in point_data.items():
        table = np.asarray(values, dtype=np.float64).reshape(len(mesh.vertices), -1)
        names = [name] if table.shape[1] == 1 else [f"{name}_{index}" for index in range(table.shape[1])]
        columns.update(zip(["_".join(one.split()) for one in names], table.T, strict=True))
    points = np.empty(
        len(mesh.vertices), [(axis, "<f8") for axis in "xyz"] + [(one, "<f4") for one in columns]
    )
    for index, axis in enumerate("xyz"):
        points[axis] = mesh.vertices[:, index]
    for name, column in columns.items():
        points[name] = column
    triangles = np.empty(len(mesh.faces), [("count", "u1"), ("corners", "<i4", 3)])
    triangles["count"], triangles["corners"] = 3, mesh.faces
    header = [
        "ply", "format binary_little_endian 1.0", f"comment {comment}", f"element vertex {len(points)}",
        *(f"property double {axis}" for axis in "xyz"), *(f"property float {name}" for name in columns),
        f"element face {len(triangles)}", "property list uchar int vertex_indices", "end_header\n",
    ]  # fmt: skip
    with replacing(path) as part:
        part.write_bytes("\n".join(header).encode() + points.tobytes() + triangles.tobytes())


def _elements(lines: list[list[str]]) -> list[tuple[int, list[tuple[str, str]]]]:
    """Return each element's count and properties: type codes of a list's length ("" if none) and value."""
    elements: list[tuple[int, list[tuple[str, str]]]] = []
    for line in lines:
        if line[:1] == ["element"]:
            elements.append((int(line[2]), []))
        elif line[:2] == ["property", "list"]:
            elements[-1][1].append((_CODES[line[2]], _CODES[line[3]]))
        elif line[:1] == ["property"]:
            elements[-1][1].append(("", _CODES[line[1]]))
    return elements


def _length(elements: list[tuple[int, list[tuple[str, str]]]], body: bytes, order: str) -> int:
    """Return how many bytes the elements take, following the lengths of lists through the body."""
    at = 0
    for count, properties in elements:
        if not any(length for length, _ in properties):
            at += count * struct.calcsize(order + "".join(value for _, value in properties))
            continue
        for _ in range(count):
            for length, value in properties:
                many = 1
                if length:
                    (many,) = struct.unpack_from(order + length, body, at)
                    at += struct.calcsize(order + length)
                at += many * struct.calcsize(order + value)
    return at
