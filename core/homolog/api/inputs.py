"""Conversion of inputs to a cohort: meshes and label arrays of any library, files, folders."""

from collections.abc import Iterable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from homolog.arrays import Array, FloatArray
from homolog.cohort import Cohort, Subject, read_cohort, subject_at, suffix_of
from homolog.errors import InputError
from homolog.grooming.subject import Source
from homolog.io.volumes import Volume
from homolog.settings import GroomSettings
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["as_mesh", "cohort_of"]

_KINDS = (
    "a path, a TriangleMesh, a trimesh or pyvista mesh, a pair (vertices, faces), a SimpleITK image, a label "
    "array, or a pair (labels, index_to_world)"
)


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
    if hasattr(shape, "points") and hasattr(shape, "triangulate"):  # pyvista
        surface = shape.triangulate()
        return _checked(surface.points, np.asarray(surface.faces).reshape(-1, 4)[:, 1:])
    if isinstance(shape, tuple | list) and len(shape) == 2:
        first, second = (np.asarray(part) for part in shape)
        if first.ndim == 2 and second.ndim == 2:
            return _checked(first, second)
    return None


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
