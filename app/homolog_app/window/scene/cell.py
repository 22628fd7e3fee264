"""One view of the grid: a subject's surfaces, its particles, a caption and the anatomical letters."""

from typing import Any

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkPolyData
from vtkmodules.vtkRenderingCore import vtkActor, vtkLight
from vtkmodules.vtkRenderingOpenGL2 import vtkOpenGLPointGaussianMapper

from homolog.arrays import Array, FloatArray
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.mirroring import mirrors
from homolog_app.clipping import Box, Clip, around
from homolog_app.window.scene.content import Content
from homolog_app.window.scene.cutting import Cutter
from homolog_app.window.scene.scale_bar import ScaleBar
from homolog_app.window.scene.surface import (
    PLAIN,
    ArrowActor,
    LineActor,
    light_surface,
    move_surface,
    paint_surface,
    surface_actor,
    surface_data,
)
from homolog_app.window.scene.words import Words
from homolog_app.window.scheme import Colours, rgb

__all__ = ["Cell"]

_BALL = """//VTK::Color::Impl
float r2 = dot(offsetVCVSOutput.xy, offsetVCVSOutput.xy);
if (r2 > 1.0) { discard; }
float shade = 0.35 + 0.65 * sqrt(1.0 - r2);
vec2 off = offsetVCVSOutput.xy - vec2(-0.35, 0.4);
float shine = max(0.0, 1.0 - 6.0 * dot(off, off));
ambientColor = ambientColor * shade + vec3(0.25 * shine);
diffuseColor *= shade;
"""
_MARGIN, _SPARSE = 1.22, 5
_LIGHTS = (
    ((-0.3, 0.5, 1.0), 0.9),
    ((0.8, -0.9, 0.5), 0.35),
)  # the second lights what would be too dark
_COLOURED = (0.4, 0.6, 0.0)  # colours that mean numbers shall neither drown in shade nor in shine


class Cell:
    """One renderer and its actors; made once and filled again and again."""

    def __init__(self, renderer: Any) -> None:  # noqa: ANN401 - VTK is untyped
        self.renderer = renderer
        self.content: Content | None = None
        self._surfaces = {name: surface_actor() for name in ("raw", "groomed")}
        self._meshes: dict[str, Any] = {}
        self._arrows, self._lines = ArrowActor(), LineActor()
        self._balls = vtkActor()
        self._ball_mapper = vtkOpenGLPointGaussianMapper()
        self._ball_data = vtkPolyData()
        self._radius = 1.0
        self._make_balls()
        self._marks = [one for mark in (self._arrows, self._lines) for one in (mark.actor, mark.hidden)]
        self._cutter = Cutter(tuple(self._surfaces.values()), self._marks)
        self._points: tuple[FloatArray, Array] | None = None
        for actor in (*self._surfaces.values(), *self._marks, self._balls, *self._cutter.caps):
            renderer.AddActor(actor)
        self._words, self._bar = Words(renderer), ScaleBar(renderer)
        for place, strength in _LIGHTS:
            light = vtkLight()
            light.SetLightTypeToCameraLight()
            light.SetPosition(*place)
            light.SetIntensity(strength)
            renderer.AddLight(light)

    def place(self, viewport: tuple[float, float, float, float] | None) -> None:
        """Give the view a part of the window, or none."""
        self.renderer.SetViewport(*(viewport or (0.0, 0.0, 0.0, 0.0)))
        self.renderer.SetDraw(viewport is not None)
        self.renderer.SetInteractive(viewport is not None)

    def fill(self, content: Content | None) -> None:
        """Show a content, or nothing; surfaces that only moved are moved in place."""
        if content is self.content:
            return
        before, self.content = self.content, content
        self._meshes = self._take_meshes(content, before) if content is not None else {}
        if content is not None and content.groomed is not None:
            paint_surface(self._meshes["groomed"], content.colours)
        through = content is not None and content.through
        self._arrows.show(content.arrows if content is not None else None, through)
        self._lines.show(content.lines if content is not None else None, through)
        if before is None or content is None or before.name != content.name:
            self.show_particles(None, None, 1.0)

    def _take_meshes(self, content: Content, before: Content | None) -> dict[str, Any]:
        taken = {}
        turned = before is not None and bool(mirrors(before.alignment) != mirrors(content.alignment))
        for name in ("raw", "groomed", "coarse"):
            mesh: TriangleMesh | None = getattr(content, name)
            earlier: TriangleMesh | None = getattr(before, name, None)
            normals = content.normals if name == "groomed" else None
            if mesh is None:
                continue
            if before is None or earlier is None or not _same_faces(earlier, mesh) or turned:
                taken[name] = surface_data(mesh, content.alignment, normals)
                continue
            taken[name] = self._meshes[name]
            if earlier is not mesh or before.alignment is not content.alignment:
                move_surface(taken[name], mesh, content.alignment, normals)
        return taken

    def show(self, raw: bool, groomed: bool, quick: bool, opacity: float) -> None:
        """Switch the surfaces; the raw one is drawn as a shell where both are shown.

        Quick drawing takes the light surface, but where colours belong to the vertices of the full one.
        """
        both = raw and groomed and "groomed" in self._meshes
        coloured = self.content is not None and self.content.colours is not None
        light = quick and not coloured and "coarse" in self._meshes
        for name, wanted in (("raw", raw), ("groomed", groomed)):
            source = "coarse" if name == "groomed" and light else name
            actor = self._surfaces[name]
            actor.SetVisibility(wanted and source in self._meshes)
            mapper = actor.GetMapper()
            if actor.GetVisibility() and mapper.GetInput() is not self._meshes[source]:
                mapper.SetInputData(self._meshes[source])
            mapper.SetScalarVisibility(name == "groomed" and coloured)
            light_surface(actor, _COLOURED if coloured and name == "groomed" else PLAIN)
            actor.GetProperty().SetOpacity(0.35 * opacity if name == "raw" and both else opacity)
        self._cutter.cap()

    def cut(self, clip: Clip | None, box: Box) -> None:
        """Before each drawing: cut the shapes open, as the camera sees them now, or leave them whole."""
        if self._cutter.move(None if clip is None else clip.cut(box, self._axes[2])):
            self._cutter.cap()
            self._place_balls()

    def show_particles(self, points: FloatArray | None, colours: Array | None, radius: float) -> None:
        """Move the particles, or hide them."""
        self._points = (
            None if points is None or colours is None else (np.asarray(points), np.asarray(colours))
        )
        self._radius = radius
        self._place_balls()

    def _place_balls(self) -> None:
        """Give VTK the particles that the cutting plane leaves."""
        self._balls.SetVisibility(self._points is not None)
        if self._points is None:
            return
        kept = self._cutter.keeps(self._points[0], self._radius)
        points, colours = (part[kept] for part in self._points)
        held = vtkPoints()
        held.SetData(numpy_to_vtk(np.ascontiguousarray(points, dtype=np.float32), deep=True))
        self._ball_data.SetPoints(held)
        self._ball_data.GetPointData().SetScalars(numpy_to_vtk(np.ascontiguousarray(colours), deep=True))
        self._ball_data.Modified()
        self._ball_mapper.SetScaleFactor(self._radius)

    def show_words(self, size: int, *, small: bool, letters: bool, bar: bool) -> None:
        """Write the subject's name and note, the letters and a scale bar, so many pixels high."""
        lines = [self.content.name, self.content.note] if self.content is not None else []
        self._words.show([one for one in lines if one], size, small=small, letters=letters)
        self._bar.show(bar and self.content is not None, round(0.85 * size))

    def paint(self, colours: Colours) -> None:
        """Take the colours of the scheme."""
        self.renderer.SetBackground(*rgb(colours.scene))
        self._surfaces["groomed"].GetProperty().SetColor(*rgb(colours.bone))
        self._surfaces["raw"].GetProperty().SetColor(*rgb(colours.raw))
        for actor in self._marks:
            actor.GetProperty().SetColor(*rgb(colours.mark))
        self._cutter.paint(rgb(colours.cut))
        self._words.paint(colours)
        self._bar.paint(rgb(colours.text))

    def face_camera(self, bounds: tuple[float, ...]) -> None:
        """Before each drawing: depth range, letters, and particles lifted off the surface towards the eye."""
        self.renderer.ResetCameraClippingRange(bounds)
        right, up, ahead = self._axes
        self._balls.SetPosition(*(-self._radius * ahead))
        self._bar.face()
        if self.content is not None:
            self._words.face(self.content.patient_axes, right, up)

    @property
    def _axes(self) -> FloatArray:
        """What is to the right, upwards and ahead in the view as it is seen now, (3, 3)."""
        camera = self.renderer.GetActiveCamera()
        ahead = np.array(camera.GetDirectionOfProjection())
        right = np.cross(ahead, camera.GetViewUp())
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(right, ahead), ahead])

    @property
    def points(self) -> FloatArray:
        """Some vertices of the surfaces [mm], (n, 3), whether shown or not."""
        parts = [vtk_to_numpy(mesh.GetPoints().GetData())[::_SPARSE] for mesh in self._meshes.values()]
        return np.concatenate([np.empty((0, 3)), *parts])

    def fit(self, points: FloatArray, shape: float) -> None:
        """Let points (n, 3) fill the view as it is seen now; `shape` is the view's width by its height."""
        camera, axes = self.renderer.GetActiveCamera(), self._axes
        low, high = (pick(points @ axes.T, axis=0) for pick in (np.min, np.max))
        middle = axes.T @ ((low + high) / 2.0)
        camera.SetFocalPoint(*middle)
        camera.SetPosition(*(middle - max(np.linalg.norm(high - low), 1e-6) * axes[2]))
        across, along, _ = (high - low) / 2.0
        camera.SetParallelScale(_MARGIN * max(along, across / shape, 1e-6))

    def widen(self, points: FloatArray, shape: float) -> None:
        """Zoom out if points (n, 3) would be cut; the view's middle stays, so that what moves is seen to."""
        camera = self.renderer.GetActiveCamera()
        across, along, _ = np.abs((points - camera.GetFocalPoint()) @ self._axes.T).max(axis=0)
        needed = max(along, across / shape)
        if needed > camera.GetParallelScale():
            camera.SetParallelScale(_MARGIN * needed)

    @property
    def surface_actors(self) -> tuple[Any, ...]:
        """What of the surfaces can be clicked, shown or not: caps hide what is behind them."""
        return (*self._surfaces.values(), *self._cutter.caps)

    def is_cap(self, actor: Any) -> bool:  # noqa: ANN401 - VTK is untyped
        """Whether an actor of VTK is the surface of the cut."""
        return actor in self._cutter.caps

    @property
    def bounds(self) -> Box | None:
        """Extent of the surfaces [mm], of the input's only where it is shown; None if there are none."""
        raw = self._surfaces["raw"].GetVisibility() or len(self._meshes) == 1
        boxes = [mesh.GetBounds() for name, mesh in self._meshes.items() if raw or name != "raw"]
        if not boxes:
            return None
        return around(boxes)

    def _make_balls(self) -> None:
        verts = self._ball_mapper
        verts.SetInputData(self._ball_data)
        verts.EmissiveOff()
        verts.SetSplatShaderCode(_BALL)
        verts.SetColorModeToDirectScalars()
        self._balls.SetMapper(verts)
        self._balls.GetProperty().SetAmbient(1.0)
        self._balls.GetProperty().SetDiffuse(0.0)


def _same_faces(one: TriangleMesh, other: TriangleMesh) -> bool:
    alike = one.faces.shape == other.faces.shape and one.vertices.shape == other.vertices.shape
    return alike and np.may_share_memory(one.faces, other.faces)
