"""Scenes drawn by VTK, in the window and off screen; moved objects are updated in place.

VTK classes are used only where pyvista has no equivalent: a surface mapper with clipping planes and depth
offsets, a mapper that draws a ball for each point, and filters that follow a moving surface.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyvista as pv
from pyvista.plotting.mapper import PointGaussianMapper
from vtkmodules.vtkFiltersCore import vtkCutter
from vtkmodules.vtkFiltersGeneral import vtkContourTriangulator
from vtkmodules.vtkRenderingCore import (
    vtkActor2D,
    vtkPolyDataMapper,
    vtkPolyDataMapper2D,
    vtkRenderer,
)

from homolog.arrays import Array, FloatArray
from homolog_app.rendering.colours import Colours, rgb
from homolog_app.rendering.scene import (
    AMBIENT,
    DIFFUSE,
    LIGHTS,
    Arrows,
    Balls,
    Colour,
    Scene,
    Surface,
)

__all__ = ["Overview", "SceneActors"]

_BALL = """//VTK::Color::Impl
float r2 = dot(offsetVCVSOutput.xy, offsetVCVSOutput.xy);
if (r2 > 1.0) { discard; }
float shade = 0.35 + 0.65 * sqrt(1.0 - r2);
vec2 off = offsetVCVSOutput.xy - vec2(-0.35, 0.4);
float shine = max(0.0, 1.0 - 6.0 * dot(off, off));
ambientColor = ambientColor * shade + vec3(0.25 * shine);
diffuseColor *= shade;
"""
_IN_FRONT = -66000.0
"""Depth offset, in units of 1/65536 of the depth range."""
_FAINT = 0.35

Vtk = Any  # VTK is untyped


class SceneActors:
    """Draws scenes in a VTK renderer.

    Parameters
    ----------
    renderer : vtkRenderer
        Renderer, which receives the standard lights.
    """

    def __init__(self, renderer: Vtk) -> None:
        self._renderer = renderer
        self._plane = pv.generate_plane((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
        self._surfaces: list[_SurfaceActor] = []
        self._balls, self._arrows, self._lines = _BallActor(), _ArrowActor(), _LineActor()
        self._marks = [actor for mark in (self._arrows, self._lines) for actor in (mark.actor, mark.hidden)]
        self._scene: Scene | None = None
        for actor in (self._balls.actor, *self._marks):
            renderer.AddActor(actor)
        for place, strength in LIGHTS:
            renderer.AddLight(pv.Light(position=place, intensity=strength, light_type="camera light"))

    @property
    def clickable(self) -> list[Vtk]:
        """Actors of surfaces and of their caps, visible or not: caps occlude objects behind them."""
        return [actor for surface in self._surfaces for actor in (surface.actor, surface.cap)]

    def is_cap(self, actor: Vtk) -> bool:
        """Whether an actor is the surface of a cut."""
        return any(actor is surface.cap for surface in self._surfaces)

    def show(self, scene: Scene) -> None:
        """Draw this scene in place of the previous one."""
        self._scene, before = scene, self._scene
        while len(self._surfaces) < len(scene.surfaces):
            self._surfaces.append(_SurfaceActor(self._plane))
            for actor in (self._surfaces[-1].actor, self._surfaces[-1].cap):
                self._renderer.AddActor(actor)
        cut = scene.cut is not None
        if scene.cut is not None:
            self._plane.SetNormal(*scene.cut[0])
            self._plane.SetOrigin(*scene.cut[1])
        hidden = [None] * (len(self._surfaces) - len(scene.surfaces))
        for surface_actor, surface in zip(self._surfaces, (*scene.surfaces, *hidden), strict=True):
            surface_actor.show(surface)
            surface_actor.cut(cut, scene.cap)
        if before is None or before.balls is not scene.balls or before.cut is not scene.cut:
            self._balls.show(scene.balls_left)
        if before is None or before.arrows is not scene.arrows:
            self._arrows.show(scene.arrows)
        if before is None or before.lines is not scene.lines:
            self._lines.show(scene.lines)
        for mark in (self._arrows, self._lines):
            mark.hidden.SetVisibility(scene.through and mark.actor.GetVisibility())
        for actor in self._marks:
            actor.prop.SetColor(*_parts(scene.marks))
            _clip(actor.GetMapper(), self._plane if cut else None)

    def lift(self, way: FloatArray) -> None:
        """Shift the balls by a vector (3,) [mm], such as off the surface towards the eye."""
        self._balls.actor.SetPosition(*way)


_CUT_OFF, _INSET, _RIM, _SMALLEST = 0.1, 0.36, 1.12, 48
"""Fraction of half a shape beyond which it counts as cut off; size, margin and least pixels of the
overview."""


class Overview:
    """The whole shape, small in the lower right corner of a view that shows a part, which is framed.

    Parameters
    ----------
    renderer : vtkRenderer
        Renderer of the view, in its window.
    """

    def __init__(self, renderer: Vtk) -> None:
        self._renderer, self._inset = renderer, vtkRenderer()
        self._inset.InteractiveOff()
        self._inset.SetDraw(False)
        self._inset.GetActiveCamera().ParallelProjectionOn()
        for light in renderer.GetLights():
            self._inset.AddLight(light)
        self._frame = pv.PolyData(np.zeros((8, 3)), lines=[5, 0, 1, 2, 3, 0, 5, 4, 5, 6, 7, 4])
        mapper = vtkPolyDataMapper2D()
        mapper.SetInputData(self._frame)
        self._lines = vtkActor2D()
        self._lines.SetMapper(mapper)
        self._inset.AddViewProp(self._lines)
        renderer.GetRenderWindow().AddRenderer(self._inset)

    def hide(self) -> None:
        """Hide it until the next drawing of its view."""
        self._inset.SetDraw(False)

    @property
    def shown(self) -> bool:
        """Whether it is drawn."""
        return bool(self._inset.GetDraw())

    @property
    def box(self) -> FloatArray:
        """Its left, lower, right and upper edge as fractions of its view; an empty box if it is not drawn."""
        left, bottom, right, top = self._renderer.GetViewport()
        start = np.array([left, bottom, left, bottom])
        box = (np.array(self._inset.GetViewport()) - start) / np.tile([right - left, top - bottom], 2)
        return box if self.shown else np.zeros(4)

    def paint(self, colours: Colours) -> None:
        """Apply the scheme's colours."""
        self._inset.SetBackground(*rgb(colours.raised))
        self._lines.GetProperty().SetColor(*rgb(colours.accent))

    def face(self, actors: Sequence[Vtk], points: FloatArray, axes: FloatArray) -> None:
        """Before each drawing, show the whole surfaces if the view shows only a part of the points.

        Parameters
        ----------
        actors : sequence of vtkActor
        points : (n, 3) array
            Points on the surfaces [mm].
        axes : (3, 3) array
            Unit vectors to the right, upwards and forward.
        """
        width, height = self._renderer.GetSize()
        camera, side = self._renderer.GetActiveCamera(), round(_INSET * min(width, height))
        if not len(points):
            self.hide()
            return
        low, high = (pick(points @ axes.T, axis=0) for pick in (np.min, np.max))
        extent, middle = np.maximum((high - low) / 2.0, 1e-6), (low + high) / 2.0
        centre = axes[:2] @ np.array(camera.GetFocalPoint()) - middle[:2]
        half = camera.GetParallelScale() * np.array([width / max(height, 1), 1.0])
        beyond = extent[:2] + np.abs(centre) - half
        is_cut = bool((beyond > _CUT_OFF * extent[:2]).any())
        self._inset.SetDraw(is_cut and self._renderer.GetDraw() and side >= _SMALLEST)
        if not self.shown:
            return
        for actor in actors:
            if not self._inset.HasViewProp(actor):
                self._inset.AddViewProp(actor)
        left, bottom, right, top = self._renderer.GetViewport()
        share = side / width * (right - left), side / height * (top - bottom)
        self._inset.SetViewport(right - share[0], bottom, right, bottom + share[1])
        own, scale = self._inset.GetActiveCamera(), _RIM * max(extent[:2])
        own.SetFocalPoint(*(axes.T @ middle))
        own.SetPosition(*(axes.T @ (middle - [0.0, 0.0, 4.0 * scale])))
        own.SetViewUp(*axes[1])
        own.SetParallelScale(scale)
        self._inset.ResetCameraClippingRange()
        corners = centre + half * [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
        pixels = (np.clip(corners / scale, -1.0, 1.0) + 1.0) / 2.0 * (side - 1)
        rim = [(0, 0), (side - 1, 0), (side - 1, side - 1), (0, side - 1)]
        self._frame.points = np.column_stack([np.concatenate([pixels, rim]), np.zeros(8)])


class _SurfaceActor:
    """A surface, and the cap that fills its outline in the cutting plane, so that solids look solid."""

    def __init__(self, plane: Vtk) -> None:
        self._plane = plane
        self._shown: Surface | None = None
        self._data = pv.PolyData()
        self.actor, self.cap = _actor(), _actor()
        self.actor.prop.ambient, self.actor.prop.diffuse = AMBIENT, DIFFUSE
        self.cap.prop.lighting = False
        self._cutter, filled = vtkCutter(), vtkContourTriangulator()
        self._cutter.SetCutFunction(plane)
        filled.SetInputConnection(self._cutter.GetOutputPort())
        self.cap.GetMapper().ScalarVisibilityOff()
        self.cap.GetMapper().SetInputConnection(filled.GetOutputPort())

    def show(self, surface: Surface | None) -> None:
        """Draw a surface, or hide it if None."""
        self.actor.SetVisibility(surface is not None)
        if surface is None or surface is self._shown:
            return
        before, self._shown = self._shown, surface
        if before is None or not np.array_equal(before.faces, surface.faces):
            self._data = pv.PolyData.from_regular_faces(_floats(surface.vertices), surface.faces)
            self.actor.GetMapper().SetInputData(self._data)
            self._cutter.SetInputData(self._data)
            before = None
        elif surface.vertices is not before.vertices:
            self._data.points = _floats(surface.vertices)
        if before is None or surface.normals is not before.normals:
            self._data.GetPointData().SetNormals(_held(_floats(surface.normals)))
        if before is None or surface.colours is not before.colours:
            self._paint(surface.colours)
        for actor in (self.actor, self.cap):
            actor.prop.SetOpacity(surface.opacity)
        self._data.Modified()

    def cut(self, cut: bool, colour: Colour) -> None:
        """Cut the surface at the plane, or leave it whole."""
        _clip(self.actor.GetMapper(), self._plane if cut else None)
        self.cap.SetVisibility(cut and self.actor.GetVisibility())
        self.cap.prop.SetColor(*_parts(colour))

    def _paint(self, colours: Array) -> None:
        coloured = colours.ndim > 1
        self._data.GetPointData().SetScalars(_held(_bytes(colours)) if coloured else None)
        self.actor.GetMapper().SetScalarVisibility(coloured)
        if not coloured:
            self.actor.prop.SetColor(*_parts(colours))


class _BallActor:
    """Balls drawn as one shaded square each: fast if many of them move."""

    def __init__(self) -> None:
        mapper = PointGaussianMapper(emissive=False)
        mapper.SetSplatShaderCode(_BALL)
        self.actor = _actor(mapper)
        self.actor.prop.ambient, self.actor.prop.diffuse = 1.0, 0.0

    def show(self, balls: Balls | None) -> None:
        """Draw balls, or none."""
        self.actor.SetVisibility(balls is not None and len(balls.centres) > 0)
        if balls is None or not len(balls.centres):
            return
        data = pv.PolyData(_floats(balls.centres))
        data.GetPointData().SetScalars(_held(_bytes(np.broadcast_to(balls.colours, balls.centres.shape))))
        self.actor.GetMapper().SetInputData(data)
        self.actor.GetMapper().SetScaleFactor(balls.radius)


class _ArrowActor:
    """Many arrows of one colour."""

    def __init__(self) -> None:
        self._arrow = pv.Arrow(
            tip_resolution=10, shaft_resolution=6, shaft_radius=0.028, tip_radius=0.095, tip_length=0.3
        )
        self.actor, self.hidden = _plain_actor(), _hidden_actor()

    def show(self, arrows: Arrows | None) -> None:
        """Show arrows, or none."""
        self.actor.SetVisibility(arrows is not None and len(arrows.points) > 0)
        if arrows is not None and len(arrows.points):
            data = pv.PolyData(_floats(arrows.points))
            data["way"] = _floats(arrows.vectors)
            drawn = data.glyph(geom=self._arrow, orient="way", scale="way")
            for actor in (self.actor, self.hidden):
                actor.mapper.SetInputData(drawn)


class _LineActor:
    """Line segments of one colour."""

    def __init__(self) -> None:
        self._data = pv.PolyData()
        self.actor, self.hidden = _plain_actor(), _hidden_actor()
        for actor in (self.actor, self.hidden):
            actor.GetMapper().SetInputData(self._data)
            actor.prop.line_width, actor.prop.lighting = 2.0, False

    def show(self, lines: FloatArray | None) -> None:
        """Show segments (S, 2, 3), or none."""
        self.actor.SetVisibility(lines is not None and len(lines) > 0)
        if lines is not None and len(lines):
            self._data.copy_structure(pv.line_segments_from_points(_floats(np.reshape(lines, (-1, 3)))))


def _actor(mapper: Vtk | None = None) -> Vtk:
    mapper = vtkPolyDataMapper() if mapper is None else mapper
    mapper.SetColorModeToDirectScalars()
    actor = pv.Actor(mapper=mapper, prop=pv.Property(color="white", interpolation="Gouraud"))
    actor.visibility = False
    return actor


def _plain_actor() -> Vtk:
    actor = _actor()
    actor.GetMapper().ScalarVisibilityOff()
    return actor


def _hidden_actor() -> Vtk:
    """Return a faint actor that is drawn in front of everything."""
    actor = _plain_actor()
    mapper = actor.GetMapper()
    mapper.SetResolveCoincidentTopologyToPolygonOffset()
    mapper.SetRelativeCoincidentTopologyLineOffsetParameters(0.0, _IN_FRONT)
    mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(0.0, _IN_FRONT)
    actor.prop.opacity = _FAINT
    return actor


def _clip(mapper: Vtk, plane: Vtk | None) -> None:
    planes = mapper.GetClippingPlanes()
    if (plane is not None) is (planes is not None and planes.GetNumberOfItems() > 0):
        return
    if plane is None:
        mapper.RemoveAllClippingPlanes()
    else:
        mapper.AddClippingPlane(plane)


def _parts(colour: Colour | Array) -> list[float]:
    return [part / 255.0 for part in colour]


def _floats(values: Array) -> Array:
    return np.ascontiguousarray(values, dtype=np.float32)


def _bytes(colours: Array) -> Array:
    return np.ascontiguousarray(colours, np.uint8)


def _held(values: Array) -> Vtk:
    return pv.convert_array(values, deep=True)
