"""What is cut away, as texts: the column `cut`, ShapeWorks' constraints (JSON), flags of vertices."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from homolog.arrays import FloatArray
from homolog.cohort import Subject, column_of
from homolog.errors import InputError
from homolog.io.atomic import write_text
from homolog.io.bounded import check_is_file, read_json
from homolog.io.meshes import read_mesh
from homolog.settings import OWN
from homolog.surfaces.clipping import Ball, Cut, Plane, covering

__all__ = [
    "COLUMN",
    "cut_column",
    "cuts_of",
    "own_text",
    "parse_cuts",
    "read_constraints",
    "read_flags",
    "read_painted",
    "text_of",
    "write_planes",
]

COLUMN = "cut"
"""Column of the table with the cuts of a subject, several separated by semicolons.

Six numbers are a plane: x y z of a point, then of the direction that is kept. Four are a dab of a brush: x y
z and a radius, within which the surface is left out, or put back if the radius is negative.
"""


def cut_column(structure: str) -> str:
    """Return the column with the cuts of a structure, of several; without a name that of a single one."""
    return f"{COLUMN}:{structure}".casefold() if structure else COLUMN


def cuts_of(subject: Subject, structure: str = "") -> tuple[Cut, ...]:
    """Return the cuts in a subject's column ``cut:STRUCTURE``, or without one in its column ``cut``.

    Raises
    ------
    InputError
        If the column can't be read.
    """
    text = column_of(subject.columns, cut_column(structure))
    return parse_cuts(text or column_of(subject.columns, COLUMN), subject.name)


def own_text(columns: Mapping[str, str]) -> str:
    """Return how a subject is to be groomed in its own way, and in a second line what is cut away of it."""
    titles = {name.strip().casefold(): name for name in columns}
    cuts = [
        columns[own] if title == COLUMN else f"{title} {columns[own]}"
        for title, own in sorted(titles.items())
        if title.partition(":")[0] == COLUMN and columns[own].strip()
    ]
    return "\n".join([column_of(columns, OWN), *cuts])


def parse_cuts(text: str, name: str) -> tuple[Cut, ...]:
    """Return the cuts of a cell; raises InputError with the subject's name if it can't be read."""
    cuts: list[Cut] = []
    for part in text.split(";"):
        if not part.strip():
            continue
        try:
            numbers = np.array([float(item) for item in part.replace(",", " ").split()])
            if len(numbers) == 6:
                cuts.append(Plane.of(numbers[:3], numbers[3:]))
            elif len(numbers) == 4 and np.isfinite(numbers).all() and numbers[3] != 0.0:
                cuts.append(Ball(numbers[:3], abs(float(numbers[3])), keeps=bool(numbers[3] < 0.0)))
            else:
                raise ValueError
        except (ValueError, InputError) as error:
            raise InputError(
                f"{name}: its cut is {part.strip()[:60]!r}; give six numbers for a plane, x y z of a point "
                "and of the direction towards the part that is kept, or four for a painted place, x y z and "
                "its radius"
            ) from error
    return tuple(cuts)


def text_of(cuts: Sequence[Cut]) -> str:
    """Return cuts as a subject's column `cut`."""
    return "; ".join(
        " ".join(f"{number:.6g}" for number in (*cut.point, *cut.direction))
        if isinstance(cut, Plane)
        else " ".join(f"{number:.5g}" for number in (*cut.centre, -cut.radius if cut.keeps else cut.radius))
        for cut in cuts
    )


_PLANES, _FREE_FORM = "planes", "free_form_constraints"


def read_constraints(path: Path) -> tuple[Cut, ...]:
    """Read ShapeWorks' constraints of a shape: cutting planes and a free-form (painted) region.

    The normal of a plane's three points is towards the part that is kept; of a region, points with the value
    1 are kept, and others follow the nearest point. Coordinates are those of the shape's file.

    Raises
    ------
    InputError
        If the file is damaged, or has other constraints, which it names.
    """
    content = read_json(path, "constraints of ShapeWorks")
    if unknown := sorted(content.keys() - {_PLANES, _FREE_FORM}):
        raise InputError(f"{path}: has {', '.join(unknown)}, which are not supported; remove them")
    cuts: list[Cut] = []
    try:
        for item in content.get(_PLANES) or ():
            points = _points(item["points"])
            if len(points) != 3:
                raise ValueError
            cuts.append(Plane.of(points.mean(axis=0), np.cross(points[1] - points[0], points[2] - points[0])))
        if free := content.get(_FREE_FORM):
            if not free.get("field"):
                raise InputError(
                    "its free-form constraint has boundaries only, as of old versions; save it with "
                    "ShapeWorks 6.5 or later"
                )
            points, values = _points(free["field"]["points"]), np.array(free["field"]["scalars"], np.float64)
            if values.shape != (len(points),):
                raise ValueError
            cuts += covering(points, values > 0.5)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise InputError(f"{path}: its constraints are damaged; save them again") from error
    return tuple(cuts)


def _points(values: Any) -> FloatArray:  # noqa: ANN401 - of a file
    points = np.array(values, np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise ValueError("not points")
    return points


def read_flags(path: Path, surface: Path) -> tuple[Cut, ...]:
    """Read a text with a number for each vertex of a mesh file, as it stores them: 0 is left out, 1 kept.

    Raises
    ------
    InputError
        If there is another number of vertices, or a value is neither 0 nor 1.
    """
    check_is_file(path)
    vertices = read_mesh(surface).vertices
    values = path.read_text("utf-8", "replace").replace(",", " ").split()
    if len(values) != len(vertices):
        raise InputError(
            f"{path}: has {len(values)} values, and {surface.name} {len(vertices)} different vertices; write "
            "one for each"
        )
    if not set(values) <= {"0", "1"}:
        raise InputError(f"{path}: has values other than 0 and 1; write 0 where a vertex is removed")
    try:
        return tuple(covering(vertices, np.array(values) == "1"))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


_PAINT = {"cut": False, "ffc_paint": True}
"""Arrays of a mesh with what is painted, and whether 1 is kept; the second is that of ShapeWorks."""


def read_painted(path: Path) -> tuple[Cut, ...]:
    """Read what is left out of a surface by an array of its file (.vtp): of its vertices or its faces.

    In an array ``cut``, 1 is left out and 0 kept; in ``ffc_paint`` of ShapeWorks 1 is kept.

    Raises
    ------
    InputError
        If the file can't be read, has no such array, or nothing would be kept.
    """
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

    surface = KDTree(read_mesh(path).vertices)  # in the frame of all meshes, without what VTK would add
    reader = vtkXMLPolyDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    content = reader.GetOutput()
    points = vtk_to_numpy(content.GetPoints().GetData()).astype(np.float64)
    of_points, of_faces = content.GetPointData(), content.GetCellData()
    for name, keeps in _PAINT.items():
        if of_points.HasArray(name):
            kept = (vtk_to_numpy(of_points.GetArray(name)) > 0.5) == keeps
            break
        if of_faces.HasArray(name):
            of_kept = (vtk_to_numpy(of_faces.GetArray(name)) > 0.5) == keeps
            kept, corners = np.zeros(len(points), bool), content.GetPolys()
            ends = vtk_to_numpy(corners.GetOffsetsArray())
            kept[vtk_to_numpy(corners.GetConnectivityArray())[np.repeat(of_kept, np.diff(ends))]] = True
            break
    else:
        raise InputError(f"{path}: has no array named {' or '.join(_PAINT)} of its vertices or faces")
    frames = [points * axes for axes in ((1.0, 1.0, 1.0), (-1.0, -1.0, 1.0))]
    placed = min(frames, key=lambda each: float(np.median(surface.query(each)[0])))
    try:
        return tuple(covering(placed, kept))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def write_planes(path: Path, planes: list[Plane]) -> None:
    """Write cutting planes as constraints of ShapeWorks."""
    rows = []
    for plane in planes:
        across = np.linalg.svd(plane.direction[None])[2][1:]
        turn = 1.0 if np.cross(*across) @ plane.direction > 0.0 else -1.0
        rows.append({"points": [(plane.point + step).tolist() for step in _triangle(across, turn)]})
    write_text(path, json.dumps({_PLANES: rows}, indent=4) + "\n")


def _triangle(across: FloatArray, turn: float) -> FloatArray:
    """Return the corners (3, 3) of a triangle about 0 in the plane of two unit vectors (2, 3)."""
    angles = turn * np.arange(3) * 2.0 * np.pi / 3.0
    return np.asarray(np.stack([np.cos(angles), np.sin(angles)], axis=1) @ across)
