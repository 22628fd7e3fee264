"""Surface meshes as files: VTP, VTK, PLY, STL and OBJ, through VTK's own readers and writers."""

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from homolog.arrays import Array, FloatArray, IntArray
from homolog.errors import InputError
from homolog.files.atomic import replacing, write_text
from homolog.files.ply import read_ply, write_ply
from homolog.memory import check_fits
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["read_mesh", "write_mesh"]

# (module, class name) pieces of `vtkmodules`, by suffix: reader and writer.
_MODULES = {
    ".vtp": ("vtkIOXML", "vtkXMLPolyData"),
    ".vtk": ("vtkIOLegacy", "vtkPolyData"),
    ".ply": ("vtkIOPLY", "vtkPLY"),
    ".stl": ("vtkIOGeometry", "vtkSTL"),
    ".obj": ("vtkIOGeometry", "vtkOBJ"),
}
_DEFLATED = 1032  # bytes that one compressed byte can stand for
_LPS_HEADER = "SPACE=LPS"  # 3D Slicer's mark for the patient frame used here


def read_mesh(path: Path) -> TriangleMesh:
    """Read a triangle surface; polygons are split and coinciding points merged.

    Parameters
    ----------
    path : Path
        A file that ends in .vtp, .vtk, .ply, .stl or .obj. Coordinates are millimetres, LPS unless the
        file says ``SPACE=RAS``.

    Raises
    ------
    InputError
        If the file is missing or can't be read, or holds no triangles or values that aren't finite.
        Whether the surface is closed is not looked at.
    """
    path = Path(path)
    vertices, faces, space = _read_ply(path) if path.suffix.lower() == ".ply" else _read_vtk(path)
    if not len(faces):
        raise InputError(f"{path}: holds no triangles; export the surface again")
    if not np.isfinite(vertices).all():
        raise InputError(f"{path}: holds coordinates that aren't numbers; export the surface again")
    if space == "RAS":
        vertices[:, :2] *= -1.0
    return TriangleMesh(*_welded(vertices, faces))


def _read_ply(path: Path) -> tuple[FloatArray, IntArray, str]:
    if not path.is_file():
        raise _missing(path)
    vertices, faces, header = read_ply(path)
    if len(faces) and not 0 <= faces.min() <= faces.max() < len(vertices):
        raise InputError(f"{path}: refers to vertices that it does not hold; export the surface again")
    return vertices, faces, "RAS" if "SPACE=RAS" in header else "LPS"


def _read_vtk(path: Path) -> tuple[FloatArray, IntArray, str]:
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersCore import vtkTriangleFilter

    polydata, space = _read_polydata(path)
    triangles = vtkTriangleFilter(pass_verts=False, pass_lines=False)
    triangles.SetInputData(_sound(path, polydata))
    triangles.Update()
    surface = triangles.GetOutput()
    vertices = vtk_to_numpy(surface.GetPoints().GetData()).astype(np.float64)
    faces = vtk_to_numpy(surface.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    return vertices, faces, space


def _missing(path: Path) -> InputError:
    return InputError(f"{path}: there is no such file; correct the path or leave it out")


def _sound(path: Path, polydata: Any) -> Any:  # noqa: ANN401 - VTK objects
    """Return points and faces alone, refusing faces that VTK's filters would follow out of memory."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import vtkPolyData

    count = polydata.GetNumberOfPoints()
    for cells in (polydata.GetPolys(), polydata.GetStrips()):
        corners, starts = (
            vtk_to_numpy(one) for one in (cells.GetConnectivityArray(), cells.GetOffsetsArray())
        )
        starts = np.append(starts, len(corners))
        whole = starts[0] == 0 and starts[-2] == starts[-1] and (np.diff(starts) >= 0).all()
        if len(starts) > 1 and not (whole and ((corners >= 0) & (corners < count)).all()):
            raise InputError(f"{path}: refers to vertices that it does not hold; export the surface again")
    bare = vtkPolyData()
    bare.SetPoints(polydata.GetPoints())
    bare.SetPolys(polydata.GetPolys())
    bare.SetStrips(polydata.GetStrips())
    return bare


def _welded(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Merge coinciding vertices and drop unused ones, the rest in order; drop faces that lost a corner."""
    _, first, same = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    faces = first[same.ravel()][faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    used, numbers = np.unique(faces, return_inverse=True)
    return vertices[used], numbers.reshape(-1, 3)


def write_mesh(path: Path, mesh: TriangleMesh, point_data: Mapping[str, Array] | None = None) -> None:
    """Write a surface, marked as LPS where the format has room for it.

    Parameters
    ----------
    path : Path
        Ends in .vtp, .vtk, .ply, .stl or .obj. Replaced only after everything is written.
    mesh : TriangleMesh
        The surface, in LPS millimetres.
    point_data : mapping of str to (V,) or (V, C) array, optional
        Values at the vertices; kept by .vtp, .vtk and, as float properties, .ply.

    Raises
    ------
    InputError
        If the suffix is unknown, the file can't be written, or .stl or .obj was asked to keep values.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if point_data and suffix in (".stl", ".obj"):
        raise InputError(f"{path}: {suffix} files can't hold values at vertices; use .vtp or .ply")
    if suffix == ".ply":
        write_ply(path, mesh, point_data or {}, _LPS_HEADER)
        return
    if suffix == ".obj":
        _write_obj(path, mesh)
        return
    writer = _piece(path, "Writer")
    for one in (writer, writer.GetExecutive()):
        one.AddObserver("ErrorEvent", lambda *_: None)  # observed, so that nothing is printed
    writer.SetInputData(_as_polydata(mesh, point_data or {}))
    if suffix == ".vtk" or suffix == ".stl":
        writer.SetHeader(_LPS_HEADER)
        writer.SetFileTypeToBinary()
    with replacing(path) as part:
        writer.SetFileName(os.fspath(part))
        if not writer.Write() or writer.GetErrorCode():
            raise OSError("the disk may be full")


def _write_obj(path: Path, mesh: TriangleMesh) -> None:
    """Write an OBJ file; VTK's writer keeps six digits and does not notice when the disk is full."""
    points = (" ".join(map(repr, point)) for point in mesh.vertices.tolist())
    corners = (" ".join(map(str, face)) for face in (mesh.faces + 1).tolist())
    lines = [f"# {_LPS_HEADER}", *(f"v {point}" for point in points), *(f"f {face}" for face in corners)]
    write_text(path, "\n".join(lines) + "\n")


def _piece(path: Path, kind: str) -> Any:  # noqa: ANN401 - VTK has no common type for its readers
    import importlib

    if path.suffix.lower() not in _MODULES:
        raise InputError(f"{path}: is no mesh file; known are {', '.join(_MODULES)}")
    module, name = _MODULES[path.suffix.lower()]
    return getattr(importlib.import_module(f"vtkmodules.{module}"), name + kind)()


def _read_polydata(path: Path) -> tuple[Any, str]:
    """Return what the file holds and its frame, ``"LPS"`` or ``"RAS"``."""
    reader = _piece(path, "Reader")
    if not path.is_file():
        raise _missing(path)
    if path.suffix.lower() == ".vtp":
        _check_counts(path)
    if path.suffix.lower() == ".vtk":
        _check_parts(path)
    complaints: list[str] = []
    for event in ("ErrorEvent", "WarningEvent"):  # observed, so that nothing is printed either
        reader.AddObserver(event, lambda *_: complaints.append("cut short"))
    reader.SetFileName(os.fspath(path))
    reader.Update()
    polydata = reader.GetOutput()
    if complaints or reader.GetErrorCode() or polydata is None or polydata.GetNumberOfPoints() == 0:
        raise InputError(f"{path}: can't be read as a mesh (cut short, or of another kind?); export it again")
    return polydata, "RAS" if "SPACE=RAS" in _header(reader, polydata, path) else "LPS"


def _check_parts(path: Path) -> None:
    """Refuse a legacy file without version, points and faces: VTK crashes on some that lack them."""
    parts = rb"# vtk DataFile Version [1-5]\.\d\r?\n.*POINTS.*(POLYGONS|TRIANGLE_STRIPS)"
    if not re.match(parts, path.read_bytes(), re.DOTALL):
        raise InputError(f"{path}: can't be read as a mesh (cut short, or of another kind?); export it again")


def _check_counts(path: Path) -> None:
    """Refuse an XML file that claims more than it can hold; VTK would end the program for lack of memory."""
    content = path.read_bytes()
    claims = [int(one) for one in re.findall(rb'NumberOf\w+\s*=\s*["\']\s*\+?(\d{1,30})', content)]
    if max(claims, default=0) > _DEFLATED * len(content):
        raise InputError(f"{path}: claims more points or faces than it can hold; export it again")
    check_fits(path, 64.0 * max(claims, default=0), "simplify the surface")


def _header(reader: Any, polydata: Any, path: Path) -> str:  # noqa: ANN401 - VTK objects
    """Return the text in which 3D Slicer notes the frame, for the formats that carry one."""
    array = polydata.GetFieldData().GetAbstractArray("SPACE")
    if array is not None:
        return f"SPACE={array.GetValue(0)}"
    if path.suffix.lower() in (".vtk", ".stl"):
        return str(reader.GetHeader() or "")
    with path.open("rb") as stream:
        return stream.read(2000).decode("latin-1")


def _as_polydata(mesh: TriangleMesh, point_data: Mapping[str, Array]) -> Any:  # noqa: ANN401
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkPoints, vtkStringArray
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData

    polydata, points, cells, space = vtkPolyData(), vtkPoints(), vtkCellArray(), vtkStringArray()
    points.SetData(numpy_to_vtk(mesh.vertices, deep=True))
    faces = np.array(mesh.faces, dtype=np.int64)
    cells.SetData(3, numpy_to_vtk(faces.ravel(), deep=True))
    polydata.SetPoints(points)
    polydata.SetPolys(cells)
    for name, values in point_data.items():
        array = numpy_to_vtk(np.array(values), deep=True)
        array.SetName(name)
        polydata.GetPointData().AddArray(array)
    space.SetName("SPACE")
    space.InsertNextValue("LPS")
    polydata.GetFieldData().AddArray(space)
    return polydata
