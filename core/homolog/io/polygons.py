"""Polygonal surfaces in files: faces of any number of corners, strips, volume cells; their triangles."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from homolog.arrays import Array, FloatArray, IntArray

__all__ = ["MOST", "Cells", "Polygons", "TooLargeError", "numbers_of", "surface_of_cells"]

MOST = 60_000_000
"""Largest number of points or corners of a surface; a file of a few bytes may unpack to more."""
_MOST_CORNERS = 1000
"""Largest number of corners of a face: the time to triangulate it is quadratic."""
_ASTRAY = "refers to vertices that it does not contain"


class TooLargeError(ValueError):
    """A surface has more points or corners than can be read."""


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Lists of vertex numbers, one after another.

    Attributes
    ----------
    corners : (N,) int64 array
        Vertex numbers of all lists.
    starts : (C + 1,) int64 array
        Start of each list, and the end of the last one.
    """

    corners: IntArray
    starts: IntArray

    @classmethod
    def of(cls, corners: Array, starts: Array) -> "Cells":
        """Return checked lists; raises ValueError if they overlap or omit entries."""
        corners, starts = np.asarray(corners, np.int64), np.asarray(starts, np.int64)
        whole = len(starts) > 0 and starts[0] == 0 and starts[-1] == len(corners)
        if not whole or (np.diff(starts) < 0).any():
            raise ValueError(_ASTRAY)
        return cls(corners, starts)

    @classmethod
    def of_lists(cls, lists: Sequence[Sequence[int]]) -> "Cells":
        """Return the lists as one object."""
        corners = [corner for item in lists for corner in item]
        return cls.of(np.array(corners, np.int64), np.cumsum([0, *map(len, lists)]))

    @classmethod
    def of_triangles(cls, triangles: Array) -> "Cells":
        """Return the rows of a table (F, 3)."""
        return cls.of(np.reshape(triangles, -1), 3 * np.arange(len(triangles) + 1))

    @classmethod
    def joined(cls, parts: Iterable["Cells"]) -> "Cells":
        """Return the lists of several objects, in their order."""
        several = list(parts)
        counts = np.concatenate([np.empty(0, np.int64), *(np.diff(item.starts) for item in several)])
        corners = np.concatenate([np.empty(0, np.int64), *(item.corners for item in several)])
        return cls.of(corners, np.append(0, np.cumsum(counts)))


@dataclass(frozen=True, slots=True, eq=False)
class Polygons:
    """A surface as stored in a file.

    Attributes
    ----------
    points : (V, 3) float64 array
        Points in the file's frame.
    faces : Cells
        Polygons.
    strips : Cells
        Triangle strips.
    header : str
        Header text, which may contain ``SPACE=RAS`` or ``SPACE=LPS``.
    """

    points: FloatArray
    faces: Cells
    strips: Cells = field(default_factory=lambda: Cells.of_lists([]))
    header: str = ""

    def triangles(self) -> IntArray:
        """Return the triangles, (F, 3); faces of fewer than three corners are omitted.

        Raises
        ------
        ValueError
            If a face refers to a missing point, or the surface or a face is implausibly large.
        """
        corners = [self.faces.corners, self.strips.corners]
        if max(len(self.points), *map(len, corners)) > MOST:
            raise TooLargeError(f"more than {MOST} points or corners")
        if any(((corner < 0) | (corner >= len(self.points))).any() for corner in corners):
            raise ValueError(_ASTRAY)
        counts, starts = np.diff(self.faces.starts), self.faces.starts[:-1]
        if counts.max(initial=0) > _MOST_CORNERS:
            raise ValueError(f"a face of more than {_MOST_CORNERS} corners")
        plain = self.faces.corners[starts[counts == 3][:, None] + np.arange(3)]
        return np.concatenate([plain, self._split(counts > 3), _of_strips(self.strips)])

    def _split(self, chosen: Array) -> IntArray:
        """Return the triangles of some polygons, which need not be convex."""
        if not chosen.any():
            return np.empty((0, 3), np.int64)
        from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy
        from vtkmodules.vtkCommonCore import vtkPoints
        from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
        from vtkmodules.vtkFiltersCore import vtkTriangleFilter

        pairs = zip(self.faces.starts[:-1][chosen], self.faces.starts[1:][chosen], strict=True)
        part = Cells.of_lists([self.faces.corners[start:end].tolist() for start, end in pairs])
        points, cells, surface = vtkPoints(), vtkCellArray(), vtkPolyData()
        points.SetData(numpy_to_vtk(self.points, deep=True))
        cells.SetData(*(numpy_to_vtkIdTypeArray(item, deep=True) for item in (part.starts, part.corners)))
        surface.SetPoints(points)
        surface.SetPolys(cells)
        splitter = vtkTriangleFilter(pass_verts=False, pass_lines=False)
        splitter.AddObserver("ErrorEvent", lambda *_: None)  # an observer prevents printing
        splitter.SetInputData(surface)
        splitter.Update()
        corners = vtk_to_numpy(splitter.GetOutput().GetPolys().GetConnectivityArray())
        triangles: IntArray = corners.astype(np.int64).reshape(-1, 3)
        return triangles


def _of_strips(strips: Cells) -> IntArray:
    """Return the triangles of strips: three successive corners each, every second one reversed."""
    parts: list[IntArray] = [np.empty((0, 3), np.int64)]
    for start, end in pairwise(strips.starts.tolist()):
        corners = strips.corners[start:end]
        rows = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
        rows[1::2] = rows[1::2, ::-1]
        parts.append(rows)
    return np.concatenate(parts)


def numbers_of(tokens: Sequence[str] | Sequence[bytes], *, whole: bool) -> Array:
    """Return numbers written as text, int64 or float64.

    They are converted one by one: an array of texts would be as wide as the longest.
    """
    if whole:
        return np.array([int(word) for word in tokens], np.int64)
    return np.array([float(word) for word in tokens])


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
