"""Surfaces as binary glTF, for slides, web pages and tablets."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from trimesh.exchange.gltf import export_glb

from homolog.arrays import Array, FloatArray
from homolog.files.atomic import atomic_write
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["write_glb"]

# glTF is in metres with y up and the viewer at +z: left stays at the right, superior up, anterior in front.
_LPS_TO_GLTF = 0.001 * np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def write_glb(
    path: Path, mesh: TriangleMesh, colours: FloatArray, point_data: Mapping[str, Array] | None = None
) -> None:
    """Write a coloured surface; its vertices are stored in LPS millimetres, the node turns and scales them.

    Parameters
    ----------
    path : Path
        Replaced whole or not at all.
    mesh : TriangleMesh
        The surface.
    colours : (3,) or (V, 3) array
        Red, green, blue in [0, 1].
    point_data : mapping of str to (V,) array, optional
        Values at the vertices, kept as attributes ``_NAME``.

    Raises
    ------
    InputError
        If the file can't be written.
    """
    tints = np.empty((len(mesh.vertices), 4), dtype=np.uint8)
    tints[:, :3], tints[:, 3] = np.rint(255.0 * np.broadcast_to(colours, mesh.vertices.shape)), 255
    values: dict[str, Any] = {
        f"_{name.upper()}": np.asarray(item, dtype=np.float32) for name, item in (point_data or {}).items()
    }
    surface = trimesh.Trimesh(
        mesh.vertices, mesh.faces, vertex_normals=mesh.vertex_normals, vertex_colors=tints,
        vertex_attributes=values, process=False,
    )  # fmt: skip
    surface.metadata["coordinates"] = "LPS millimetres"
    placed = np.eye(4)
    placed[:3, :3] = _LPS_TO_GLTF
    scene = trimesh.Scene()
    scene.add_geometry(surface, node_name=path.stem, geom_name=path.stem, transform=placed)
    with atomic_write(path) as part:
        part.write_bytes(export_glb(scene, include_normals=True))  # type: ignore[no-untyped-call]
