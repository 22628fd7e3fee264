"""PLY surfaces where VTK falls short: it writes single precision only, and crashes on damaged files."""

import io
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from homolog.arrays import Array, FloatArray, IntArray
from homolog.errors import InputError
from homolog.files.atomic import replacing
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["read_ply", "write_ply"]


def read_ply(path: Path) -> tuple[FloatArray, IntArray, str]:
    """Read a PLY file, text or binary, through trimesh.

    Returns
    -------
    vertices : (V, 3) float64 array
    faces : (F, 3) int array
        Polygons are split; indices are as in the file.
    header : str

    Raises
    ------
    InputError
        If the file can't be understood or is cut short.
    """
    from trimesh.exchange.ply import load_ply

    content = path.read_bytes()
    header = content.partition(b"end_header")[0].decode("latin-1")
    try:
        counts = {kind: int(count) for kind, count in re.findall(r"element\s+(\w+)\s+(\d+)", header)}
        if max(counts["vertex"], counts["face"]) > len(content):
            raise ValueError("fewer bytes than points or faces")
        found = load_ply(io.BytesIO(content), skip_materials=True)
        vertices = np.array(found["vertices"], dtype=np.float64).reshape(-1, 3)
        faces = _triangles(found["faces"])
        if len(vertices) != counts["vertex"] or len(faces) < counts["face"]:
            raise ValueError("fewer points or faces than the header says")
    except Exception as error:  # what trimesh raises on damaged files is no short list
        raise InputError(
            f"{path}: can't be read as a mesh (cut short or damaged: {error}); copy or export it again"
        ) from error
    return vertices, faces, header


def _triangles(polygons: Any) -> IntArray:  # noqa: ANN401 - an array, or a list of polygons
    if isinstance(polygons, np.ndarray) and polygons.ndim == 2 and polygons.shape[1] == 3:
        return polygons.astype(np.int64)
    corners = [(one[0], one[place], one[place + 1]) for one in polygons for place in range(1, len(one) - 1)]
    return np.array(corners, dtype=np.int64).reshape(-1, 3)


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
