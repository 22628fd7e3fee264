"""PLY surfaces without VTK, which only writes single precision, and crashes on damaged files."""

import io
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from homolog.arrays import Array, FloatArray
from homolog.io.atomic import atomic_write
from homolog.io.polygons import Cells, Polygons
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["read_ply", "write_ply"]


def read_ply(content: bytes) -> Polygons:
    """Read a PLY file, text or binary, through trimesh.

    Raises
    ------
    ValueError
        If the file is cut short or contains no surface. trimesh raises further errors on damaged files.
    """
    from trimesh.exchange.ply import load_ply

    head, end, rest = content.partition(b"end_header")
    header = head.decode("latin-1")
    counts = {kind: int(count) for kind, count in re.findall(r"element\s+(\w+)\s+(\d+)", header)}
    if "vertex" not in counts or not end:
        raise ValueError("no points")
    if counts.get("tristrips"):
        raise ValueError("contains triangle strips; save it with triangles")
    if not counts.get("face"):  # a point cloud
        return Polygons(np.empty((0, 3)), Cells.of_lists([]), header=header)
    if max(counts["vertex"], counts["face"]) > len(content):
        raise ValueError("fewer bytes than points or faces")
    plain = header.encode("ascii", "replace")  # comments may be in Latin-1, which trimesh does not read
    model = load_ply(io.BytesIO(plain + end + rest), skip_materials=True)
    points = np.array(model["vertices"], dtype=np.float64).reshape(-1, 3)
    faces = model["faces"]
    if len(points) != counts["vertex"] or len(faces) < counts["face"]:
        raise ValueError("fewer points or faces than the header says")
    if isinstance(faces, np.ndarray) and faces.ndim == 2 and faces.shape[1] == 3:
        return Polygons(points, Cells.of_triangles(faces), header=header)
    return Polygons(points, Cells.of_lists([list(face) for face in faces]), header=header)


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
        "ply", "format binary_little_endian 1.0", f"comment {comment}", f"element vertex {len(points)}",
        *(f"property double {axis}" for axis in "xyz"), *(f"property float {name}" for name in columns),
        f"element face {len(triangles)}", "property list uchar int vertex_indices", "end_header\n",
    ]  # fmt: skip
    with atomic_write(path) as part:
        part.write_bytes("\n".join(header).encode() + points.tobytes() + triangles.tobytes())
