"""Surfaces in scene files, with transformed parts: glTF, and 3MF, for which trimesh needs lxml besides."""

import io
import re
import zipfile
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from homolog.arrays import FloatArray, IntArray
from homolog.io.polygons import MOST, Cells, Polygons, TooLargeError, numbers_of

__all__ = ["read_3mf", "read_gltf"]

_METRE = 1000.0
_LONGEST = 3.0
"""Length [m] above which units are assumed to be millimetres: nothing in a body is longer."""
_UNITS = {"micron": 1e-3, "millimeter": 1.0, "centimeter": 10.0, "inch": 25.4, "foot": 304.8, "meter": _METRE}
_MOST_BYTES = 100 * MOST
_DEEPEST = 20
"""Largest depth of nested components."""

_OF_LOOKS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "MSFT_texture_", "KHR_lights_")
"""Beginnings of glTF extensions that leave the shape alone."""

_Part = tuple[FloatArray, IntArray]


def read_gltf(content: bytes, folder: Path | None = None) -> Polygons:
    """Read the triangles of a glTF scene, through trimesh.

    The standard's unit is the metre, but medical programs write millimetres: if metres would give a shape of
    more than 3 m, the unit is assumed to be the millimetre.

    Parameters
    ----------
    content : bytes
        Content of a ``.glb`` or ``.gltf`` file.
    folder : Path, optional
        Folder of a ``.gltf`` file's buffers.

    Raises
    ------
    ValueError
        If it needs an extension of the format that changes coordinates (Draco, meshopt, quantized ones), or
        contains no mesh. trimesh raises further errors on damaged files.
    """
    import trimesh

    if needed := [name for name in _required(content) if not name.startswith(_OF_LOOKS)]:
        raise ValueError(f"compressed ({', '.join(needed)}); export it without compression")
    is_binary = content.startswith(b"glTF")
    scene = trimesh.load_scene(
        io.BytesIO(content),
        file_type="glb" if is_binary else "gltf",
        resolver=None if folder is None else trimesh.resolvers.FilePathResolver(str(folder)),
        skip_materials=True,
        process=False,
    )
    parts = [item for item in scene.dump() if isinstance(item, trimesh.Trimesh) and len(item.faces)]
    if not parts:
        raise ValueError("no triangles")
    surface = _joined([(np.asarray(item.vertices), np.asarray(item.faces)) for item in parts])
    longest = float(np.nanmax(np.ptp(surface.points, axis=0)))
    scale = _METRE if longest <= _LONGEST else 1.0
    return Polygons(scale * surface.points, surface.faces)


def _required(content: bytes) -> list[str]:
    """Return the extensions of the format without which a glTF file can't be read."""
    listed = re.search(rb'"extensionsRequired"\s*:\s*\[([^\]]*)\]', content)
    return re.findall(r'"([^"]*)"', listed[1].decode(errors="replace")) if listed else []


def read_3mf(content: bytes) -> Polygons:
    """Read the triangles of a 3MF file: the items of its build list, in its unit.

    Raises
    ------
    ValueError
        If it contains no model, or parts refer to each other in cycles.
    """
    try:
        archive = zipfile.ZipFile(io.BytesIO(content))
    except zipfile.BadZipFile as error:
        raise ValueError("not a 3MF file") from error
    models = [item for item in archive.infolist() if item.filename.lower().endswith(".model")]
    if sum(item.file_size for item in models) > _MOST_BYTES:
        raise ValueError("unpacks to an implausible size")
    roots = {item.filename.lstrip("/"): _parsed(archive.read(item)) for item in models}
    scene = _Scene(roots)
    parts: list[_Part] = []
    for name, root in roots.items():
        scale = _UNITS[root.get("unit", "millimeter")]
        for item in root.findall("./{*}build/{*}item"):
            parts += [(scale * points, faces) for points, faces in scene.placed(item, name, 0)]
    if not parts:
        raise ValueError("the build list is empty")
    return _joined(parts)


def _parsed(content: bytes) -> ElementTree.Element:
    if b"<!DOCTYPE" in content:
        raise ValueError("a document type declaration")
    return ElementTree.fromstring(content)


class _Scene:
    """The objects of all models of a 3MF file."""

    def __init__(self, roots: dict[str, ElementTree.Element]) -> None:
        self._objects = {
            (name, item.get("id", "")): item
            for name, root in roots.items()
            for item in root.findall("./{*}resources/{*}object")
        }
        self._count = 0

    def placed(self, use: ElementTree.Element, name: str, depth: int) -> list[_Part]:
        """Return the meshes of an item or component, in the frame of the item or component that uses it."""
        elsewhere = next((value for key, value in use.attrib.items() if key.endswith("}path")), name)
        name = elsewhere.lstrip("/")
        item = self._objects.get((name, use.get("objectid", "")))
        if item is None or depth > _DEEPEST:
            raise ValueError("parts that are missing, or refer to each other in cycles")
        parts = [_mesh(mesh) for mesh in item.findall("./{*}mesh")]
        for component in item.findall("./{*}components/{*}component"):
            parts += self.placed(component, name, depth + 1)
        self._count += sum(len(points) for points, _ in parts)
        if self._count > MOST:
            raise TooLargeError(f"more than {MOST} points")
        if not (numbers := (use.get("transform") or "").split()):
            return parts
        matrix = numbers_of(numbers, whole=False).reshape(4, 3)
        turned = np.linalg.det(matrix[:3]) < 0.0
        return [
            (points @ matrix[:3] + matrix[3], faces[:, ::-1] if turned else faces) for points, faces in parts
        ]


def _mesh(mesh: ElementTree.Element) -> _Part:
    def numbers(path: str, keys: Sequence[str]) -> list[str]:
        return [item.get(key, "") for item in mesh.findall(path) for key in keys]

    points = numbers_of(numbers("./{*}vertices/{*}vertex", "xyz"), whole=False).reshape(-1, 3)
    corners = numbers("./{*}triangles/{*}triangle", ("v1", "v2", "v3"))
    faces = numbers_of(corners, whole=True).reshape(-1, 3)
    if len(faces) and not 0 <= faces.min() <= faces.max() < len(points):
        raise ValueError("refers to vertices that it does not contain")
    return points, faces


def _joined(parts: list[_Part]) -> Polygons:
    shifts = np.cumsum([0, *(len(points) for points, _ in parts)])[:-1]
    faces = [item + shift for (_, item), shift in zip(parts, shifts, strict=True)]
    return Polygons(
        np.concatenate([points for points, _ in parts]), Cells.of_triangles(np.concatenate(faces))
    )
