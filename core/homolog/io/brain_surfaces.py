"""Surfaces of brain imaging: GIFTI (``.gii``) and FreeSurfer's (``lh.pial``), in the scanner's RAS frame.

This module does not use nibabel, which unpacks arrays of any length and prints to the standard error.
"""

import base64
import binascii
import re
import zlib
from xml.etree import ElementTree

import numpy as np

from homolog.arrays import Array, FloatArray
from homolog.geometry import transform_points
from homolog.io.polygons import MOST, Cells, Polygons, numbers_of

__all__ = ["read_freesurfer", "read_gifti"]

_RAS = "SPACE=RAS"
_KINDS = {
    "NIFTI_TYPE_UINT8": "u1", "NIFTI_TYPE_INT8": "i1", "NIFTI_TYPE_INT16": "i2", "NIFTI_TYPE_UINT16": "u2",
    "NIFTI_TYPE_INT32": "i4", "NIFTI_TYPE_UINT32": "u4", "NIFTI_TYPE_INT64": "i8", "NIFTI_TYPE_UINT64": "u8",
    "NIFTI_TYPE_FLOAT32": "f4", "NIFTI_TYPE_FLOAT64": "f8",
}  # fmt: skip
_CODES = {"2": "u1", "256": "i1", "4": "i2", "8": "i4", "16": "f4", "64": "f8"}
_SCANNER, _UNKNOWN = "NIFTI_XFORM_SCANNER_ANAT", "NIFTI_XFORM_UNKNOWN"

_AMIRA = b"# HyperSurface"  # also named .surf
_TRIANGLES, _QUADRANGLES = b"\xff\xff\xfe", (b"\xff\xff\xff", b"\xff\xff\xfd")
_VECTOR = re.compile(rb"(?:^|\x14)(valid|xras|yras|zras|cras)\s*=([^\n]*)", re.MULTILINE)
_SURFACE_AXES = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Axes (columns) of a volume in the frame of FreeSurfer's surfaces, which is the same for any orientation."""
_REAL_RAS = b"\x00\x00\x00\x02\x00\x00\x00\x01"
"""Tag of a surface whose points are already in the scanner's frame."""


def read_gifti(content: bytes) -> Polygons:
    """Read the points and triangles of a GIFTI file; its matrix is applied if it maps to the scanner's frame.

    Raises
    ------
    ValueError
        If it is damaged, contains no surface, or its arrays are in other files.
    """
    if b"<!ENTITY" in content:
        raise ValueError("a document type with entities")
    root = ElementTree.fromstring(content)
    if root.tag != "GIFTI":
        raise ValueError("not a GIFTI file")
    arrays = {item.get("Intent", ""): item for item in reversed(root.findall("DataArray"))}
    points, faces = arrays.get("NIFTI_INTENT_POINTSET"), arrays.get("NIFTI_INTENT_TRIANGLE")
    if points is None or faces is None:
        raise ValueError("values of a surface, but no surface")
    table = transform_points(_to_scanner(points), _table(points).astype(np.float64))
    return Polygons(table, Cells.of_triangles(_table(faces).astype(np.int64)), header=_RAS)


def _to_scanner(points: ElementTree.Element) -> FloatArray:
    """Return the matrix of the points, or the identity if their frame is already a named one."""
    for system in points.findall("CoordinateSystemTransformMatrix"):
        source = (system.findtext("DataSpace") or "").strip()
        target = (system.findtext("TransformedSpace") or "").strip()
        if source not in (_SCANNER, target) and (target == _SCANNER or source in ("", _UNKNOWN)):
            matrix = numbers_of((system.findtext("MatrixData") or "").split(), whole=False).reshape(4, 4)
            if not np.isfinite(matrix).all() or np.linalg.det(matrix[:3, :3]) == 0.0:
                raise ValueError("an invalid coordinate system")
            return matrix
    return np.eye(4)


def _table(item: ElementTree.Element) -> Array:
    """Return an array (N, 3), unpacking no more than its declared size."""
    rows, columns = int(item.get("Dim0", "0")), int(item.get("Dim1", "1"))
    if columns != 3 or not 0 <= rows <= MOST:
        raise ValueError("an array whose shape is not that of points or triangles")
    name, order = item.get("DataType", ""), item.get("ArrayIndexingOrder", "RowMajorOrder")
    kind = np.dtype(("<" if "Little" in item.get("Endian", "") else ">") + (_KINDS | _CODES)[name])
    encoding, text = item.get("Encoding", ""), item.findtext("Data") or ""
    if encoding == "ASCII":
        flat = numbers_of(text.split(), whole=kind.kind != "f")
    elif encoding in ("Base64Binary", "GZipBase64Binary"):
        flat = np.frombuffer(_bytes(text, encoding, rows * columns * kind.itemsize), kind)
    else:
        raise ValueError("arrays in another file; save the surface as one file")
    if len(flat) != rows * columns:
        raise ValueError("cut short, or an array whose length differs from the declared one")
    return flat.reshape(rows, columns, order="F" if order.startswith("Column") else "C")


def _bytes(text: str, encoding: str, size: int) -> bytes:
    try:
        packed = base64.b64decode("".join(text.split()), validate=True)
        if encoding == "Base64Binary":
            return packed
        return zlib.decompressobj(wbits=47).decompress(packed, size + 1)  # zlib's header or gzip's
    except (binascii.Error, zlib.error) as error:
        raise ValueError(f"damaged data: {error}") from error


def read_freesurfer(content: bytes) -> Polygons:
    """Read a triangle surface of FreeSurfer, positioned by the volume that it names, if any.

    Raises
    ------
    ValueError
        If it is damaged, or not a triangle surface.
    """
    if content.startswith(_QUADRANGLES):
        raise ValueError("values of a surface or FreeSurfer's old quadrangles, not a triangle surface")
    if content.startswith(_AMIRA):
        raise ValueError("a surface of Amira; save it as STL or PLY")
    begin = content.find(b"\n", content.find(b"\n") + 1) + 1  # after a line with the author, and an empty one
    if not content.startswith(_TRIANGLES) or begin == 0:
        raise ValueError("not a FreeSurfer surface")
    points, faces = (int(number) for number in np.frombuffer(content, ">i4", 2, begin))
    if not (0 <= points <= MOST and 0 <= faces <= MOST):
        raise ValueError("claims more points or faces than it can contain")
    begin += 8
    table = np.frombuffer(content, ">f4", 3 * points, begin).astype(np.float64).reshape(-1, 3)
    corners = np.frombuffer(content, ">i4", 3 * faces, begin + 12 * points).reshape(-1, 3)
    rotation, centre = _volume(content[begin + 12 * (points + faces) :])
    return Polygons(table @ rotation.T + centre, Cells.of_triangles(corners), header=_RAS)


def _volume(footer: bytes) -> tuple[FloatArray, FloatArray]:
    """Return the surface's frame in the scanner's: its rotation, and the volume's centre (``cras``)."""
    tags = {name.decode(): value for name, value in _VECTOR.findall(footer)}
    if footer.startswith(_REAL_RAS) or not tags.get("valid", b"").strip().startswith(b"1"):
        return np.eye(3), np.zeros(3)
    axes = [numbers_of(tags.get(name, b"").split(), whole=False) for name in ("xras", "yras", "zras", "cras")]
    if any(len(axis) != 3 or not np.isfinite(axis).all() for axis in axes):
        raise ValueError("a volume whose axes are not given")
    rotation = np.stack(axes[:3], axis=1) @ _SURFACE_AXES.T
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3):
        raise ValueError("a volume whose axes are not orthogonal")
    return rotation, axes[3]
