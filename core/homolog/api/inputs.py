"""Conversion of what users have: meshes, images and tables of any library, files, folders."""

from collections.abc import Iterable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from homolog.arrays import Array, FloatArray
from homolog.cohort import Cohort, Subject, read_cohort, subject_at, suffix_of
from homolog.comparison.sample import matched_rows
from homolog.errors import InputError
from homolog.grooming.subject import Source
from homolog.io.nifti import voxels_in_memory
from homolog.io.polygons import Cells, Polygons, surface_of_cells
from homolog.io.volumes import Volume
from homolog.settings import GroomSettings
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["as_mesh", "by_structure", "cohort_of", "column_of", "columns_of"]

_KINDS = (
    "a path, a TriangleMesh, a mesh of trimesh, pyvista, VTK or meshio, a pair (vertices, faces), an image "
    "of SimpleITK or nibabel, a label array, or a pair (labels, index_to_world)"
)
_MESHIO = {
    "vertex": 1, "line": 3, "line3": 21, "triangle": 5, "triangle6": 22, "quad": 9, "quad8": 23, "quad9": 28,
    "polygon": 7, "tetra": 10, "tetra10": 24, "hexahedron": 12, "hexahedron20": 25, "hexahedron27": 29,
    "wedge": 13, "wedge15": 26, "pyramid": 14, "pyramid13": 27,
}  # fmt: skip
"""VTK's numbers of meshio's types of cells."""


def cohort_of(
    shapes: object, voxel_size: float | Iterable[float] | None, settings: GroomSettings
) -> tuple[Cohort, dict[str, Source]]:
    """Return shapes as a cohort, and the shapes in memory.

    Parameters
    ----------
    shapes : Cohort, path, mapping or iterable
        Shapes as in `homolog.correspond`.
    voxel_size : float or three floats, optional
        Voxel size of label arrays [mm].
    settings : GroomSettings
        Its `label` is the value of the structure in label arrays; every value above 0 if it is None.

    Returns
    -------
    Cohort
        Subjects in memory have their name in place of a path.
    dict of str to Segmentation or TriangleMesh
        Shapes in memory, by name.

    Raises
    ------
    InputError
        If a shape is of an unknown kind or damaged, or two shapes have the same name.
    """
    if isinstance(shapes, Cohort):
        return shapes, {}
    if isinstance(shapes, str | PathLike):
        return read_cohort(shapes), {}
    if isinstance(shapes, Mapping):
        pairs = [(str(name), shape) for name, shape in shapes.items()]
    elif isinstance(shapes, Iterable):
        pairs = [(_name(shape, number), shape) for number, shape in enumerate(shapes, start=1)]
    else:
        raise InputError(
            f"shapes: {type(shapes).__name__} is not a cohort; give a folder or a list of shapes"
        )
    names = [name for name, _ in pairs]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise InputError(f"several shapes are named {', '.join(twice[:5])}; give a dict with other names")
    subjects, sources = [], {}
    for name, shape in pairs:
        if isinstance(shape, str | PathLike):
            subjects.append(subject_at(Path(shape).absolute(), name))
            continue
        subjects.append(Subject(name, Path(name)))
        sources[name] = _source(name, shape, voxel_size, settings)
    return Cohort(tuple(subjects), Path()), sources


def by_structure(shapes: object) -> dict[str, object] | None:
    """Return shapes that are given by structure, as names and shapes for `cohort_of`; None if they are not.

    They are a mapping of structures to mappings of subjects to shapes, or to lists with an item a subject;
    None stands for a structure that a subject lacks.
    """
    if not isinstance(shapes, Mapping) or not shapes:
        return None
    result: dict[str, object] = {}
    for name, own in shapes.items():
        if isinstance(own, Mapping):
            pairs = {str(key): shape for key, shape in own.items()}
        elif isinstance(own, list) and not _is_pair(own):
            pairs = {f"shape_{number}": shape for number, shape in enumerate(own, start=1)}
        else:
            return None
        result[str(name)] = {key: shape for key, shape in pairs.items() if shape is not None}
    return result


def _is_pair(shape: Sequence[object]) -> bool:
    """Return whether a list is a mesh or an array, and not a list of shapes."""
    first = shape[0] if shape else ()
    return isinstance(first, list) or (len(shape) == 2 and isinstance(first, np.ndarray) and first.ndim == 2)


def as_mesh(shape: Any) -> TriangleMesh | None:  # noqa: ANN401 - meshes of any library
    """Return a mesh of this or another library, or a pair (vertices, faces); None if it is something else.

    Raises
    ------
    InputError
        If it is a mesh with invalid arrays.
    """
    if isinstance(shape, TriangleMesh):
        return _checked(shape.vertices, shape.faces)
    if hasattr(shape, "vertices") and hasattr(shape, "faces"):  # trimesh
        return _checked(shape.vertices, shape.faces)
    if hasattr(shape, "dump") and hasattr(shape, "geometry"):  # a scene of trimesh, as it reads GLB and OBJ
        return as_mesh(shape.to_mesh())
    if hasattr(shape, "IsA"):  # VTK, and so pyvista
        return _of_cells(*_cells_of_vtk(shape))
    if hasattr(shape, "points") and hasattr(shape, "cells_dict"):  # meshio
        return _of_cells(*_cells_of_meshio(shape))
    if isinstance(shape, tuple | list) and len(shape) == 2:
        first, second = (np.asarray(part) for part in shape)
        if first.ndim == 2 and second.ndim == 2:
            return _checked(first, second)
    return None


def _of_cells(points: Array, cells: Cells, types: Array) -> TriangleMesh:
    """Return the surface of flat or volume cells, with the vertices that it needs."""
    try:
        polygons: Polygons = surface_of_cells(np.asarray(points, np.float64), cells, types)
        corners, faces = np.unique(polygons.triangles(), return_inverse=True)
    except ValueError as error:
        raise InputError(f"is not a surface: {error}") from error
    return _checked(polygons.points[corners], faces.reshape(-1, 3))


def _cells_of_vtk(dataset: Any) -> tuple[Array, Cells, Array]:  # noqa: ANN401 - VTK has no types
    """Return points, cells and types of a vtkPolyData or vtkUnstructuredGrid."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    flat = dataset.IsA("vtkPolyData")
    if not (flat or dataset.IsA("vtkUnstructuredGrid")) or not dataset.GetPoints():
        raise InputError(
            f"{type(dataset).__name__} is not a surface with points; extract one, or give an array of labels"
        )
    groups = [(dataset.GetPolys(), 7), (dataset.GetStrips(), 6)] if flat else [(dataset.GetCells(), 0)]
    lists = [
        Cells.of(vtk_to_numpy(item.GetConnectivityArray()), vtk_to_numpy(item.GetOffsetsArray()))
        for item, _ in groups
    ]
    if flat:
        kinds = np.repeat([kind for _, kind in groups], [item.GetNumberOfCells() for item, _ in groups])
    else:
        kinds = np.asarray([dataset.GetCellType(number) for number in range(dataset.GetNumberOfCells())])
    return vtk_to_numpy(dataset.GetPoints().GetData()), Cells.joined(lists), kinds


def _cells_of_meshio(mesh: Any) -> tuple[Array, Cells, Array]:  # noqa: ANN401 - an optional library
    """Return points, cells and types of a mesh of meshio; types that it alone knows are refused later."""
    points = np.asarray(mesh.points, np.float64)
    if points.shape[1] == 2:
        raise InputError("is a mesh in a plane; give points with three coordinates")
    blocks = [Cells.of_lists(np.asarray(block.data).tolist()) for block in mesh.cells]
    unknown = {block.type for block in mesh.cells} - _MESHIO.keys()
    if unknown:
        raise InputError(f"has cells of the types {', '.join(sorted(unknown))}; extract its surface")
    kinds = np.repeat(
        [_MESHIO[block.type] for block in mesh.cells], [len(block.data) for block in mesh.cells]
    )
    return points, Cells.joined(blocks), kinds


def _checked(vertices: Any, faces: Any) -> TriangleMesh:  # noqa: ANN401 - whatever numpy takes as arrays
    points, corners = np.asarray(vertices), np.asarray(faces)
    if corners.dtype.kind not in "iu" or not len(corners):
        raise InputError("faces must be integers, one row for each triangle, at least one")
    mesh = TriangleMesh(points, corners)
    if corners.min() < 0 or corners.max() >= len(points):
        raise InputError("faces refer to vertices that do not exist; indices start at 0")
    if not np.isfinite(points).all():
        raise InputError("vertices are not finite numbers; export the mesh again")
    return mesh


def _source(
    name: str, shape: object, voxel_size: float | Iterable[float] | None, settings: GroomSettings
) -> Source:
    try:
        if (mesh := as_mesh(shape)) is not None:
            return mesh
        labels, matrix = _labels(shape, voxel_size)
        if settings.segment is not None:
            raise InputError("the labels of an array have no names; choose one by its value (label)")
    except InputError as error:
        raise InputError(f"{name}: {error}") from error
    except (TypeError, ValueError) as error:  # such as rows of different lengths
        raise InputError(f"{name}: {type(shape).__name__} is not a shape; give {_KINDS}") from error
    return Volume(Path(name), [labels], matrix).segmentation(settings.label)


def _labels(
    shape: Any,  # noqa: ANN401 - what users pass
    voxel_size: float | Iterable[float] | None,
) -> tuple[Array, FloatArray]:
    """Return a label array (I, J, K), and the matrix from its indices to millimetres."""
    if hasattr(shape, "GetDirection") and hasattr(shape, "GetSpacing"):  # SimpleITK
        import SimpleITK

        labels, matrix = SimpleITK.GetArrayFromImage(shape).T, np.eye(4)
        if labels.ndim == 3:
            matrix[:3, :3] = np.reshape(shape.GetDirection(), (3, 3)) * shape.GetSpacing()
            matrix[:3, 3] = shape.GetOrigin()
    elif hasattr(shape, "dataobj") and hasattr(shape, "affine"):  # nibabel
        labels, matrix = voxels_in_memory(shape)
    elif isinstance(shape, tuple | list) and len(shape) == 2:
        labels, matrix = np.asarray(shape[0]), np.asarray(shape[1], np.float64)
        if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
            raise InputError("the matrix of a label array must be (4, 4), from indices to LPS millimetres")
    else:
        labels, matrix = np.asarray(shape), np.eye(4)
        if labels.ndim == 3 and voxel_size is None:
            raise InputError("is a label array; give its voxel_size [mm]")
        size = np.broadcast_to(np.asarray(1.0 if voxel_size is None else voxel_size, np.float64), 3)
        if not (np.isfinite(size).all() and (size > 0.0).all()):
            raise InputError(f"voxel_size {voxel_size} must be one or three lengths above 0 [mm]")
        matrix[:3, :3] = np.diag(size)
    if labels.ndim != 3 or labels.dtype.kind not in "biuf":
        raise InputError(f"{type(shape).__name__} is not a shape; give {_KINDS}")
    return labels.astype(np.uint8) if labels.dtype.kind == "b" else labels, matrix


def _name(shape: object, number: int) -> str:
    """Return a shape's name: that of its file, otherwise its number."""
    if not isinstance(shape, str | PathLike):
        return f"shape_{number}"
    path = Path(shape)
    return path.name[: len(path.name) - len(suffix_of(path))] or path.name


def columns_of(
    table: object, names: Sequence[str] | None = None, what: str = "covariates"
) -> dict[str, Sequence[Any]]:
    """Return the columns of a pandas DataFrame or mapping; missing values are None.

    Parameters
    ----------
    table : pandas.DataFrame or mapping of str to sequence, optional
        Rows whose index has texts are matched with the names of subjects; others are in their order.
    names : sequence of str, optional
        The subjects.
    what : str
        The argument, for messages.

    Raises
    ------
    InputError
        If it is something else, or a subject has no row.
    """
    if table is None:
        return {}
    if not hasattr(table, "keys") or not hasattr(table, "__getitem__") or hasattr(table, "to_frame"):
        raise InputError(f"{what}: give a DataFrame or a dict of columns, not {type(table).__name__}")
    return {str(name): column_of(table[name], names, what) for name in table.keys()}  # noqa: SIM118


def column_of(values: Any, names: Sequence[str] | None, what: str) -> Sequence[Any]:  # noqa: ANN401
    """Return a sequence, or the values of a pandas Series in the order of the names, as `columns_of` does."""
    if isinstance(values, str) or not hasattr(values, "__len__") or hasattr(values, "columns"):
        raise InputError(f"{what}: give a value for each subject, not {type(values).__name__}")
    if not hasattr(values, "notna"):
        return values  # type: ignore[no-any-return]
    if not hasattr(values, "index"):  # an array of pandas, such as a Categorical
        return values.astype(object).tolist()  # type: ignore[no-any-return]
    if names is not None and all(isinstance(row, str) for row in values.index):
        values = values.iloc[matched_rows(names, {}, list(values.index))]
    return values.astype(object).where(values.notna(), None).tolist()  # type: ignore[no-any-return]
