"""Surfaces, arrows and lines as VTK draws them; a surface that moves is moved in place."""

from typing import Any

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkFiltersCore import vtkGlyph3D, vtkPolyDataNormals
from vtkmodules.vtkFiltersSources import vtkArrowSource
from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper

from homolog.arrays import Array, FloatArray
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.mirroring import mirrors, scale_of
from homolog_app.window.scene.content import Arrows

__all__ = [
    "PLAIN",
    "ArrowActor",
    "LineActor",
    "light_surface",
    "move_surface",
    "paint_surface",
    "surface_actor",
    "surface_data",
]

PLAIN = (0.22, 0.78, 0.08)
"""Ambient, diffuse and specular part of the light on surfaces of one colour."""

_IN_FRONT = -66000.0
"""Units of depth, of which there are 65536 from the eye to the horizon."""
_FAINT = 0.35

Vtk = Any  # VTK is untyped


def surface_actor() -> Vtk:
    """Return an actor for surfaces, not yet visible."""
    mapper = vtkPolyDataMapper()
    mapper.ScalarVisibilityOff()
    mapper.SetColorModeToDirectScalars()
    actor = vtkActor()
    actor.SetMapper(mapper)
    actor.SetVisibility(False)
    actor.GetProperty().SetSpecularPower(20)
    light_surface(actor, PLAIN)
    return actor


def light_surface(actor: Vtk, parts: tuple[float, float, float]) -> None:
    """Set the ambient, diffuse and specular part of the light on a surface."""
    look = actor.GetProperty()
    look.SetAmbient(parts[0])
    look.SetDiffuse(parts[1])
    look.SetSpecular(parts[2])


def surface_data(mesh: TriangleMesh, alignment: FloatArray, normals: Array | None) -> Vtk:
    """Return a mesh for VTK, moved by a (4, 4) alignment; normals (V, 3) are computed if not given.

    Where the alignment is a reflection the faces are turned over, so that they still face outward.
    """
    mesh = TriangleMesh(mesh.vertices, mesh.faces[:, ::-1]) if mirrors(alignment) else mesh
    faces = np.column_stack([np.full(len(mesh.faces), 3), mesh.faces]).astype(np.int64).ravel()
    cells = vtkCellArray()
    cells.ImportLegacyFormat(numpy_to_vtkIdTypeArray(faces, deep=True))
    data = vtkPolyData()
    data.SetPoints(vtkPoints())
    data.SetPolys(cells)
    move_surface(data, mesh, alignment, normals)
    return data


def move_surface(data: Vtk, mesh: TriangleMesh, alignment: FloatArray, normals: Array | None) -> None:
    """Give VTK's surface the vertices of a mesh with the same faces; reflections stay reflections."""
    placed = mesh.vertices @ alignment[:3, :3].T + alignment[:3, 3]
    data.GetPoints().SetData(_array(placed))
    data.GetPoints().Modified()
    if normals is None:
        data.GetPointData().SetNormals(_normals(data))
    else:
        turned = normals @ alignment[:3, :3].T / scale_of(alignment)
        data.GetPointData().SetNormals(_array(turned))
    data.Modified()


def paint_surface(data: Vtk, colours: Array | None) -> None:
    """Give the vertices their colours (V, 3) uint8, or none."""
    scalars = None if colours is None else numpy_to_vtk(np.ascontiguousarray(colours, np.uint8), deep=True)
    data.GetPointData().SetScalars(scalars)
    data.Modified()


class ArrowActor:
    """Many arrows of one colour."""

    def __init__(self) -> None:
        self._data = vtkPolyData()
        source, glyphs = _arrow(), vtkGlyph3D()
        glyphs.SetSourceConnection(source.GetOutputPort())
        glyphs.SetInputData(self._data)
        glyphs.SetVectorModeToUseVector()
        glyphs.SetScaleModeToScaleByVector()
        self.actor, self.hidden = _plain_actor(), _hidden_actor()
        for actor in (self.actor, self.hidden):
            actor.GetMapper().SetInputConnection(glyphs.GetOutputPort())

    def show(self, arrows: Arrows | None, through: bool) -> None:
        """Show arrows, or none; also faintly what of them lies behind a surface."""
        shown = arrows is not None and len(arrows.points) > 0
        self.actor.SetVisibility(shown)
        self.hidden.SetVisibility(shown and through)
        if arrows is not None:
            points = vtkPoints()
            points.SetData(_array(arrows.points))
            self._data.SetPoints(points)
            self._data.GetPointData().SetVectors(_array(arrows.vectors))
            self._data.Modified()


class LineActor:
    """Line segments of one colour."""

    def __init__(self) -> None:
        self._data = vtkPolyData()
        self.actor, self.hidden = _plain_actor(), _hidden_actor()
        for actor in (self.actor, self.hidden):
            actor.GetMapper().SetInputData(self._data)
            actor.GetProperty().SetLineWidth(2.0)
            actor.GetProperty().LightingOff()

    def show(self, lines: FloatArray | None, through: bool) -> None:
        """Show segments (S, 2, 3), or none; also faintly what of them lies behind a surface."""
        shown = lines is not None and len(lines) > 0
        self.actor.SetVisibility(shown)
        self.hidden.SetVisibility(shown and through)
        if lines is not None:
            points = vtkPoints()
            points.SetData(_array(np.reshape(lines, (-1, 3))))
            ends = np.arange(2 * len(lines)).reshape(-1, 2)
            legacy = np.column_stack([np.full(len(lines), 2), ends]).astype(np.int64).ravel()
            cells = vtkCellArray()
            cells.ImportLegacyFormat(numpy_to_vtkIdTypeArray(legacy, deep=True))
            self._data.SetPoints(points)
            self._data.SetLines(cells)
            self._data.Modified()


def _arrow() -> Vtk:
    source = vtkArrowSource()
    source.SetTipResolution(10)
    source.SetShaftResolution(6)
    source.SetShaftRadius(0.028)
    source.SetTipRadius(0.095)
    source.SetTipLength(0.3)
    return source


def _plain_actor() -> Vtk:
    mapper = vtkPolyDataMapper()
    mapper.ScalarVisibilityOff()
    actor = vtkActor()
    actor.SetMapper(mapper)
    actor.SetVisibility(False)
    return actor


def _hidden_actor() -> Vtk:
    """Return an actor that is drawn in front of everything, but faintly."""
    actor = _plain_actor()
    mapper = actor.GetMapper()
    mapper.SetResolveCoincidentTopologyToPolygonOffset()
    mapper.SetRelativeCoincidentTopologyLineOffsetParameters(0.0, _IN_FRONT)
    mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(0.0, _IN_FRONT)
    actor.GetProperty().SetOpacity(_FAINT)
    return actor


def _normals(data: Vtk) -> Vtk:
    normals = vtkPolyDataNormals()
    normals.SetInputData(data)
    normals.SplittingOff()
    normals.ConsistencyOff()
    normals.Update()
    return normals.GetOutput().GetPointData().GetNormals()


def _array(values: Array) -> Vtk:
    return numpy_to_vtk(np.ascontiguousarray(values, dtype=np.float32), deep=True)
