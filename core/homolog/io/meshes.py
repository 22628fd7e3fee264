"""Surface meshes as files: VTP, VTU, VTK, PLY, STL, OBJ, OFF, glTF, 3MF, GIFTI and FreeSurfer's.

Files are read without VTK, whose readers access invalid memory on damaged files, which ends the program: also
that of a user's script, which has no process to read them in. The modules of the formats say what
speaks against trimesh.
"""

import gzip
import os
import re
import zlib
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from homolog.arrays import Array, FloatArray, IntArray
from homolog.errors import InputError, path_of
from homolog.io.atomic import atomic_write, write_text
from homolog.io.brain_surfaces import read_freesurfer, read_gifti
from homolog.io.ply import read_ply, write_ply
from homolog.io.polygons import Polygons, TooLargeError
from homolog.io.scenes import read_3mf, read_gltf
from homolog.io.stl_obj import read_obj, read_off, read_stl
from homolog.io.vtk_files import read_legacy_vtk, read_vtp, write_vtp
from homolog.memory import check_fits
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import first_of_twins, may_have_twins

__all__ = ["read_mesh", "write_mesh"]

_READERS: dict[str, Callable[[bytes], Polygons]] = {
    ".vtp": read_vtp,
    ".vtu": read_vtp,
    ".vtk": read_legacy_vtk,
    ".ply": read_ply,
    ".stl": read_stl,
    ".obj": read_obj,
    ".off": read_off,
    ".glb": read_gltf,
    ".gltf": read_gltf,
    ".3mf": read_3mf,
    ".gii": read_gifti,
    **dict.fromkeys((".pial", ".white", ".smoothwm", ".midthickness", ".surf"), read_freesurfer),
}
_WRITTEN = (".vtp", ".vtk", ".ply", ".stl", ".obj")
_PACKED = (".vtk", ".ply", ".stl", ".obj", ".off")
"""Types that may also be compressed by gzip."""
_PART = 2**24  # bytes that are unpacked at once
_READ_BYTES = 32  # approximate largest memory per byte of a file
_MOST_LOST = 0.01
"""Largest fraction of faces with vertices that are not finite; with more the file counts as damaged."""
_DECIMAL_COMMA = re.compile(rb"(?<=\d),(?=\d)")
"""As some programs write numbers of text on computers set to German or French."""
_OWN_REMEDY = re.compile(r"; (save|export) ")
"""In messages of readers that say themselves what to do."""
_LPS_HEADER = "SPACE=LPS"  # 3D Slicer's mark for the patient frame used here


def read_mesh(path: str | PathLike[str]) -> TriangleMesh:
    """Read a triangle surface; polygons are split and coinciding points merged.

    Parameters
    ----------
    path : path
        A file that ends in .vtp, .vtu, .vtk, .ply, .stl, .obj, .off, .glb, .gltf, .3mf, .gii (GIFTI), or
        .pial, .white, .smoothwm, .midthickness or .surf (FreeSurfer); .vtk, .ply, .stl, .obj and .off also
        compressed (.stl.gz). Coordinates are millimetres, LPS unless
        the file says ``SPACE=RAS``; those of GIFTI and FreeSurfer are RAS. Volume cells give their outer
        surface.

    Returns
    -------
    TriangleMesh
        The surface in LPS [mm]; it may be open.

    Raises
    ------
    InputError
        If the file is missing or can't be read, contains no triangles, or more than 1 % of them have vertices
        that are not finite (fewer are removed).

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> import homolog as hl
    >>> vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    >>> faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]
    >>> with TemporaryDirectory() as folder:
    ...     hl.write_mesh(f"{folder}/corner.ply", hl.TriangleMesh(vertices, faces))
    ...     hl.read_mesh(f"{folder}/corner.ply")
    TriangleMesh(4 vertices, 4 faces)
    """
    path = path_of(path)
    packed = path.suffix.lower() == ".gz" and path.with_suffix("").suffix.lower() in _PACKED
    reader = _READERS.get((path.with_suffix("") if packed else path).suffix.lower())
    if reader is None:
        raise _unknown(path, _READERS)
    if not path.is_file():
        raise InputError(f"{path}: does not exist; correct the path or exclude it")
    check_fits(path, _READ_BYTES * path.stat().st_size, "simplify the surface")
    content = _unpacked(path) if packed else path.read_bytes()
    try:
        surface = read_gltf(content, path.parent) if reader is read_gltf else _surface_of(reader, content)
        every = surface.triangles()
    except ModuleNotFoundError:  # not a fault of the file
        raise
    except TooLargeError as error:
        raise InputError(f"{path}: has {error}; simplify the surface") from error
    except Exception as error:  # parsers raise many kinds of errors on damaged files
        raise InputError(f"{path}: can't be read as a mesh{_fault(error)}") from error
    faces = every[np.isfinite(surface.points[every]).all(axis=(1, 2))]
    if len(every) - len(faces) > _MOST_LOST * len(every):
        raise InputError(f"{path}: contains coordinates that aren't numbers; export the surface again")
    if not len(faces):
        raise InputError(f"{path}: contains no triangles; export the surface, not only its points")
    turn = (-1.0, -1.0, 1.0) if "SPACE=RAS" in surface.header else (1.0, 1.0, 1.0)
    return TriangleMesh(*_welded(surface.points * turn, faces))


def _surface_of(reader: Callable[[bytes], Polygons], content: bytes) -> Polygons:
    """Return the surface of a file; of one of text that can't be read otherwise, with decimal commas."""
    try:
        return reader(content)
    except ValueError:
        if b"\0" in content or not _DECIMAL_COMMA.search(content):
            raise
        with suppress(ValueError):
            return reader(_DECIMAL_COMMA.sub(b".", content))
        raise  # the fault of the file as it is


def _unpacked(path: Path) -> bytes:
    """Return the content of a file compressed by gzip."""
    parts: list[bytes] = []
    try:
        with gzip.open(path) as stream:
            while part := stream.read(_PART):
                parts.append(part)
                check_fits(path, _READ_BYTES * len(parts) * _PART, "simplify the surface")
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{path}: can't be unpacked ({error}); copy or export it again") from error
    return b"".join(parts)


def _welded(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Merge coinciding vertices and drop unused ones, keeping the order; drop faces that lose a corner."""
    if may_have_twins(vertices):
        faces = first_of_twins(vertices)[faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    if (np.bincount(faces.ravel(), minlength=len(vertices)) > 0).all():
        return vertices, faces
    used, numbers = np.unique(faces, return_inverse=True)
    return vertices[used], numbers.reshape(-1, 3)


def write_mesh(
    path: str | PathLike[str], mesh: TriangleMesh, point_data: Mapping[str, Array] | None = None
) -> None:
    """Write a surface, marked as LPS if the format permits.

    Parameters
    ----------
    path : path
        File with suffix .vtp, .vtk, .ply, .stl or .obj, replaced atomically.
    mesh : TriangleMesh
        The surface in LPS [mm].
    point_data : mapping of str to (V,) or (V, C) array, optional
        Values at the vertices, for .vtp, .vtk and, as float properties, .ply.

    Raises
    ------
    InputError
        If the suffix is unknown, the file can't be written, values are given for .stl or .obj, or `mesh` is
        not a TriangleMesh.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> import homolog as hl
    >>> vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    >>> faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]
    >>> with TemporaryDirectory() as folder:
    ...     hl.write_mesh(f"{folder}/corner.ply", hl.TriangleMesh(vertices, faces))
    ...     hl.read_mesh(f"{folder}/corner.ply")
    TriangleMesh(4 vertices, 4 faces)
    """
    if not isinstance(mesh, TriangleMesh):
        raise InputError(f"{path}: the mesh must be a TriangleMesh, not {type(mesh).__name__}")
    path = path_of(path)
    suffix, point_data = (
        path.suffix.lower(),
        {name: np.asarray(data) for name, data in (point_data or {}).items()},
    )
    if wrong := [name for name, data in point_data.items() if data.shape[:1] != mesh.vertices.shape[:1]]:
        raise InputError(f"{path}: {wrong[0]} needs a value for each of {len(mesh.vertices)} vertices")
    if point_data and suffix in (".stl", ".obj"):
        raise InputError(f"{path}: {suffix} files can't store values at vertices; use .vtp or .ply")
    if suffix == ".ply":
        write_ply(path, mesh, point_data, _LPS_HEADER)
        return
    if suffix == ".vtp":
        write_vtp(path, mesh, point_data, "LPS")
        return
    if suffix == ".obj":
        _write_obj(path, mesh)
        return
    writer = _writer(path)
    for item in (writer, writer.GetExecutive()):
        item.AddObserver("ErrorEvent", lambda *_: None)  # an observer prevents printing
    writer.SetInputData(_as_polydata(mesh, point_data))
    writer.SetHeader(_LPS_HEADER)
    writer.SetFileTypeToBinary()
    with atomic_write(path) as part:
        writer.SetFileName(os.fspath(part))
        if not writer.Write() or writer.GetErrorCode():
            raise OSError("the disk may be full")


def _write_obj(path: Path, mesh: TriangleMesh) -> None:
    """Write an OBJ file; VTK's writer writes six digits and does not detect a full disk."""
    points = (" ".join(map(repr, point)) for point in mesh.vertices.tolist())
    corners = (" ".join(map(str, face)) for face in (mesh.faces + 1).tolist())
    lines = [f"# {_LPS_HEADER}", *(f"v {point}" for point in points), *(f"f {face}" for face in corners)]
    write_text(path, "\n".join(lines) + "\n")


def _unknown(path: Path, known: Iterable[str]) -> InputError:
    return InputError(f"{path}: is not a mesh file; known types are {', '.join(known)}")


def _writer(path: Path) -> Any:  # noqa: ANN401 - VTK has no common type for its writers
    from vtkmodules.vtkIOGeometry import vtkSTLWriter
    from vtkmodules.vtkIOLegacy import vtkPolyDataWriter

    writers = {".vtk": vtkPolyDataWriter, ".stl": vtkSTLWriter}
    if path.suffix.lower() not in writers:
        raise _unknown(path, _WRITTEN)
    return writers[path.suffix.lower()]()


def _as_polydata(mesh: TriangleMesh, point_data: Mapping[str, Array]) -> Any:  # noqa: ANN401
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData

    polydata, points, cells = vtkPolyData(), vtkPoints(), vtkCellArray()
    points.SetData(numpy_to_vtk(mesh.vertices, deep=True))
    faces = np.array(mesh.faces, dtype=np.int64)
    cells.SetData(3, numpy_to_vtk(faces.ravel(), deep=True))
    polydata.SetPoints(points)
    polydata.SetPolys(cells)
    for name, values in point_data.items():
        array = numpy_to_vtk(np.array(values), deep=True)
        array.SetName(name)
        polydata.GetPointData().AddArray(array)
    return polydata


def _fault(error: Exception) -> str:
    """Return a parser's message, without the bytes that it could not parse, and what to do."""
    text = str(error) or type(error).__name__
    plain = "".join(sign if sign.isascii() and sign.isprintable() else "?" for sign in text[:80])
    if _OWN_REMEDY.search(plain):
        return f": {plain}"
    return f" (truncated, damaged or of another type: {plain}); copy or export it again"
