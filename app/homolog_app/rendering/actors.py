"""A scene as VTK draws it; what has only moved is moved in place."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyvista as pv
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkPlane
from vtkmodules.vtkFiltersCore import vtkCutter
from vtkmodules.vtkFiltersGeneral import vtkContourTriangulator
from vtkmodules.vtkRenderingCore import vtkActor, vtkGlyph3DMapper, vtkPolyDataMapper

from homolog.arrays import Array
from homolog_app.rendering.scene import AMBIENT, DIFFUSE, LIGHTS, Balls, Scene, Surface

__all__ = ["SceneActors", "add_lights"]

Vtk = Any  # VTK is untyped


def add_lights(renderer: Vtk) -> None:
    """Give a renderer the lights of all pictures."""
    for place, strength in LIGHTS:
        renderer.AddLight(pv.Light(position=place, intensity=strength, light_type="camera light"))


class SceneActors:
    """Draws one scene after another in a renderer of VTK."""

    def __init__(self, renderer: Vtk) -> None:
        self._renderer = renderer
        self._plane = vtkPlane()
        self._surfaces: list[SurfaceActor] = []
        self._balls = _BallActor()
        renderer.AddActor(self._balls.actor)

    def show(self, scene: Scene) -> None:
        """Draw this scene from now on."""
        while len(self._surfaces) < len(scene.surfaces):
            self._surfaces.append(SurfaceActor(self._plane))
            for actor in (self._surfaces[-1].actor, self._surfaces[-1].cap):
                self._renderer.AddActor(actor)
        if scene.cut is not None:
            self._plane.SetNormal(*scene.cut[0])
            self._plane.SetOrigin(*scene.cut[1])
        shown: Sequence[Surface | None] = (*scene.surfaces, *[None] * len(self._surfaces))
        for actor, surface in zip(self._surfaces, shown, strict=False):
            actor.show(surface)
            actor.cut(scene.cut is not None, scene.cap)
        self._balls.show(scene.balls, self._plane if scene.cut is not None else None)


class SurfaceActor:
    """A surface and the cap that fills its outline where it is cut: solid parts look solid."""

    def __init__(self, plane: Vtk) -> None:
        self._plane = plane
        self._shown: Surface | None = None
        self._data = pv.PolyData()
        self.actor, self.cap = _actor(), _actor()
        self.actor.GetProperty().SetAmbient(AMBIENT)
        self.actor.GetProperty().SetDiffuse(DIFFUSE)
        self.cap.GetProperty().LightingOff()
        self._cutter, filled = vtkCutter(), vtkContourTriangulator()
        self._cutter.SetCutFunction(plane)
        filled.SetInputConnection(self._cutter.GetOutputPort())
        self.cap.GetMapper().ScalarVisibilityOff()
        self.cap.GetMapper().SetInputConnection(filled.GetOutputPort())

    def show(self, surface: Surface | None) -> None:
        """Draw a surface, or none."""
        before, self._shown = self._shown, surface
        self.actor.SetVisibility(surface is not None)
        if surface is None:
            return
        if before is None or not np.array_equal(before.faces, surface.faces):
            self._data = pv.PolyData.from_regular_faces(_floats(surface.vertices), surface.faces)
            self.actor.GetMapper().SetInputData(self._data)
        elif surface.vertices is not before.vertices:
            self._data.points = _floats(surface.vertices)
        places = self._data.GetPointData()
        places.SetNormals(numpy_to_vtk(_floats(surface.normals), deep=True))
        coloured = surface.colours.ndim > 1
        places.SetScalars(
            numpy_to_vtk(np.ascontiguousarray(surface.colours), deep=True) if coloured else None
        )
        self.actor.GetMapper().SetScalarVisibility(coloured)
        if not coloured:
            self.actor.GetProperty().SetColor(*(surface.colours / 255.0))
        self._data.Modified()

    def cut(self, cut: bool, colour: tuple[int, int, int]) -> None:
        """Cut it at the plane, or leave it whole."""
        _clip(self.actor.GetMapper(), self._plane if cut else None)
        seen = cut and self._shown is not None
        self.cap.SetVisibility(seen)
        if seen:
            self._cutter.SetInputData(self._data)
            self.cap.GetProperty().SetColor(*(part / 255.0 for part in colour))


class _BallActor:
    """Balls of one size."""

    def __init__(self) -> None:
        self._data = pv.PolyData()
        self.actor = _actor(vtkGlyph3DMapper())
        self.actor.GetProperty().SetAmbient(AMBIENT)
        self.actor.GetProperty().SetDiffuse(DIFFUSE)
        self._mapper = self.actor.GetMapper()
        self._mapper.SetSourceData(pv.Sphere(radius=1.0, theta_resolution=16, phi_resolution=12))
        self._mapper.ScalingOn()
        self._mapper.SetScaleModeToNoDataScaling()

    def show(self, balls: Balls | None, plane: Vtk | None) -> None:
        """Draw balls, or none."""
        self.actor.SetVisibility(balls is not None)
        if balls is None:
            return
        self._data = pv.PolyData(_floats(balls.centres))
        colours = np.broadcast_to(balls.colours, (len(balls.centres), 3))
        self._data.GetPointData().SetScalars(_bytes(colours))
        self._mapper.SetInputData(self._data)
        self._mapper.SetScaleFactor(balls.radius)
        _clip(self._mapper, plane)


def _actor(mapper: Vtk | None = None) -> Vtk:
    mapper = vtkPolyDataMapper() if mapper is None else mapper
    mapper.SetColorModeToDirectScalars()
    actor = vtkActor()
    actor.SetMapper(mapper)
    actor.SetVisibility(False)
    return actor


def _clip(mapper: Vtk, plane: Vtk | None) -> None:
    mapper.RemoveAllClippingPlanes()
    if plane is not None:
        mapper.AddClippingPlane(plane)


def _floats(values: Array) -> Array:
    return np.ascontiguousarray(values, dtype=np.float32)


def _bytes(colours: Array) -> Vtk:
    return numpy_to_vtk(np.ascontiguousarray(colours, np.uint8), deep=True)
