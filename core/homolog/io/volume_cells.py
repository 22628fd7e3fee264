"""The outer surface of volume meshes: tetrahedra, hexahedra and other cells of VTK's unstructured grids.

Cell types and the order of their corners follow *VTK File Formats* and ``vtkCellType.h``.
"""

from collections.abc import Mapping

import numpy as np

from homolog.arrays import Array, FloatArray, IntArray
from homolog.io.polygons import Cells, Polygons

__all__ = ["surface_of_cells"]

_TETRAHEDRON = ((0, 1, 3), (1, 2, 3), (2, 0, 3), (0, 2, 1))
_HEXAHEDRON = ((0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7))
_VOXEL = ((0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6))
_WEDGE = ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0))
_PYRAMID = ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4))
_SOLIDS = {
    10: _TETRAHEDRON, 24: _TETRAHEDRON, 71: _TETRAHEDRON, 78: _TETRAHEDRON,
    11: _VOXEL,
    12: _HEXAHEDRON, 25: _HEXAHEDRON, 29: _HEXAHEDRON, 33: _HEXAHEDRON, 72: _HEXAHEDRON, 79: _HEXAHEDRON,
    13: _WEDGE, 26: _WEDGE, 31: _WEDGE, 32: _WEDGE, 73: _WEDGE, 80: _WEDGE,
    14: _PYRAMID, 27: _PYRAMID, 37: _PYRAMID, 74: _PYRAMID, 81: _PYRAMID,
}  # fmt: skip
"""Faces of volume cells by type; curved cells use only their corners, which come first."""
_PIXEL = ((0, 1, 3, 2),)
_TRIANGLE, _QUAD = ((0, 1, 2),), ((0, 1, 2, 3),)
_FLAT = {
    5: _TRIANGLE, 22: _TRIANGLE, 34: _TRIANGLE, 69: _TRIANGLE, 76: _TRIANGLE,
    8: _PIXEL, 9: _QUAD, 23: _QUAD, 28: _QUAD, 30: _QUAD, 70: _QUAD, 77: _QUAD,
}  # fmt: skip
_STRIP, _POLYGON = 6, 7
_WITHOUT_AREA = (0, 1, 2, 3, 4, 21, 35, 68, 75)


def surface_of_cells(points: FloatArray, cells: Cells, types: Array, header: str = "") -> Polygons:
    """Return the faces that belong to a single volume cell; without volume cells, the flat cells.

    Parameters
    ----------
    points : (V, 3) float64 array
        Points; coinciding ones are identified.
    cells : Cells
        Corners of each cell.
    types : (C,) int array
        VTK's number of each cell's type.
    header : str
        See `Polygons`.

    Raises
    ------
    ValueError
        If there are cells of other types (polyhedra), too few corners, or missing points.
    """
    types = np.asarray(types, np.int64)
    if len(types) != len(cells.starts) - 1:
        raise ValueError("cells without a type")
    if cells.corners.size and not 0 <= cells.corners.min() <= cells.corners.max() < len(points):
        raise ValueError("refers to vertices that it does not contain")
    known = (*_SOLIDS, *_FLAT, _STRIP, _POLYGON, *_WITHOUT_AREA)
    if unknown := set(np.unique(types).tolist()).difference(known):
        raise ValueError(f"cells of the types {', '.join(map(str, sorted(unknown)))} are not supported")
    if np.isin(types, list(_SOLIDS)).any():
        same = np.unique(points, axis=0, return_index=True, return_inverse=True)
        cells = Cells.of(same[1][same[2].ravel()][cells.corners], cells.starts)
        faces = _faces(cells, types, _SOLIDS)
        return Polygons(points, Cells.joined(_table(_met_once(item)) for item in faces), header=header)
    plain = [_table(item) for item in _faces(cells, types, _FLAT)]
    polygons = Cells.joined([*plain, _chosen(cells, types == _POLYGON)])
    return Polygons(points, polygons, _chosen(cells, types == _STRIP), header)


def _faces(
    cells: Cells, types: IntArray, kinds: Mapping[int, tuple[tuple[int, ...], ...]]
) -> tuple[IntArray, IntArray]:
    """Return the triangles (T, 3) and the quadrangles (Q, 4) of all cells of some kinds."""
    tables: dict[int, list[IntArray]] = {3: [np.empty((0, 3), np.int64)], 4: [np.empty((0, 4), np.int64)]}
    for kind, faces in kinds.items():
        chosen = np.flatnonzero(types == kind)
        corners = 1 + max(map(max, faces))
        if (np.diff(cells.starts)[chosen] < corners).any():
            raise ValueError("cells with too few corners")
        table = cells.corners[cells.starts[chosen][:, None] + np.arange(corners)]
        for face in faces:
            tables[len(face)].append(table[:, face])
    return np.concatenate(tables[3]), np.concatenate(tables[4])


def _met_once(faces: IntArray) -> IntArray:
    """Return the faces whose corners differ from those of all other faces."""
    _, same, counts = np.unique(np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True)
    return np.asarray(faces[counts[same.ravel()] == 1])


def _table(faces: IntArray) -> Cells:
    return Cells.of(faces.ravel(), faces.shape[1] * np.arange(len(faces) + 1))


def _chosen(cells: Cells, chosen: Array) -> Cells:
    pairs = zip(cells.starts[:-1][chosen].tolist(), cells.starts[1:][chosen].tolist(), strict=True)
    return Cells.of_lists([cells.corners[start:end].tolist() for start, end in pairs])
