"""Polygonal surfaces in files: faces with any number of corners, strips, and their triangles."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from homolog.arrays import Array, FloatArray, IntArray

__all__ = ["MOST", "Cells", "Polygons", "TooLargeError", "numbers_of"]

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
