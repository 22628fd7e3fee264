"""The views in the window: VTK widget, rotation, pages, clicks, drawing speed, and the colour bar below."""

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from PySide6.QtCore import QEvent, QObject, QPoint, QPointF, QSize, Qt, QTimer, Signal, Slot
from PySide6.QtGui import QColor, QImage, QKeyEvent, QMouseEvent, QPainter, QPaintEvent, QResizeEvent
from PySide6.QtWidgets import QVBoxLayout, QWidget
from pyvistaqt import QtInteractor
from vtkmodules.vtkInteractionWidgets import vtkImplicitPlaneRepresentation, vtkImplicitPlaneWidget2
from vtkmodules.vtkRenderingCore import vtkCellPicker  # pyvista picks with a plotter, not in a renderer

from homolog.arrays import Array, FloatArray
from homolog_app.rendering.camera import Box, CameraState, Canvas, Clip, ClipPlane
from homolog_app.rendering.colour_bar import HEIGHT, SIDE, WIDEST, scale_height, scale_picture
from homolog_app.rendering.colours import DARK_SCHEME, LIGHT_SCHEME, Colours, ColourScale
from homolog_app.rendering.content import MOST, Content, SubjectContents, ViewContents
from homolog_app.rendering.grid import Grid, drawn
from homolog_app.rendering.opengl import SMOOTH
from homolog_app.rendering.text import short
from homolog_app.window.theme import text_scale

if TYPE_CHECKING:
    from homolog_app.rendering.grid import ViewCell

__all__ = ["ColourBar", "Interactor", "Pick", "Picker", "Scene", "aim"]


_SOFTWARE = ("llvmpipe", "softpipe", "swiftshader", "swrast", "basic render")


class Interactor(QtInteractor):  # type: ignore[misc] # pyvistaqt is untyped
    """A QtInteractor that renders only in paint events, once for each.

    VTK's interactor style renders at every mouse move, and Qt then requests a paint, which renders again.
    Here a request to render only schedules a paint event. Qt merges these, so that mouse moves never queue up
    behind rendering.
    """

    def __init__(self, parent: QWidget) -> None:
        self.draw_ms = self.last_ms = 0.0
        self._painting = False
        super().__init__(parent, border=False, auto_update=False, multi_samples=0, lighting="none")
        self.setAcceptDrops(False)
        self._vtk: Any = self.ren_win.GetInteractor()
        self._vtk.EnableRenderOff()
        self._observer = self._vtk.AddObserver("RenderEvent", self._schedule_paint)

    @property
    def smoothing(self) -> int:
        """Antialiasing samples per pixel: none with software rendering."""
        capabilities = str(self.ren_win.ReportCapabilities()).lower()
        return 0 if any(name in capabilities for name in _SOFTWARE) else SMOOTH

    def paintGL(self) -> None:
        """Draw, and measure the time."""
        began = time.perf_counter()
        self._painting = True
        self._vtk.EnableRenderOn()
        super().paintGL()
        self._vtk.EnableRenderOff()
        self._painting = False
        self.last_ms = 1000.0 * (time.perf_counter() - began)
        self.draw_ms = self.last_ms if not self.draw_ms else 0.8 * self.draw_ms + 0.2 * self.last_ms

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Leave the keys to the window's commands instead of VTK's."""
        event.ignore()

    def keyReleaseEvent(self, event: QKeyEvent) -> None:
        """Leave the keys to the window's commands."""
        event.ignore()

    def close(self) -> None:
        """Release the graphics."""
        if getattr(self, "_vtk", None) is not None:
            self._vtk.RemoveObserver(self._observer)
            self._vtk = None
        super().close()

    def _schedule_paint(self, *_: object) -> None:
        if not self._painting:
            self.update()


_STILL = 4.0
"""Largest movement of a click [pixels]."""
_BUTTONS = (Qt.MouseButton.LeftButton, Qt.MouseButton.RightButton)
_CLOSE = 2.0
"""Largest distance of a clicked point from its particle, in ball radii."""


@dataclass(frozen=True, slots=True, eq=False)
class Pick:
    """A clicked point.

    Attributes
    ----------
    name : str
        Name of the content: a subject or a shape.
    place : (3,) array
        Position on the surface [mm], in the displayed coordinates.
    particle : int or None
        The particle at this position.
    """

    name: str
    place: FloatArray
    particle: int | None


class Picker(QObject):
    """Detects clicks (not drags) and emits what was hit."""

    picked = Signal(object)
    menu_wanted = Signal(str, QPoint)

    def __init__(
        self, plot: "Interactor", cells: "Sequence[ViewCell]", particles_of: "Callable[[ViewCell], Any]"
    ) -> None:
        super().__init__(plot)
        self.plot, self._cells, self._particles_of = plot, cells, particles_of
        self._pressed: dict[Qt.MouseButton, QPointF] = {}

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Pick where the button is released close to where it was pressed."""
        if isinstance(event, QMouseEvent) and event.button() in _BUTTONS:
            button = event.button()
            if event.type() == QEvent.Type.MouseButtonPress:
                self._pressed[button] = event.position()
            elif event.type() == QEvent.Type.MouseButtonRelease and button in self._pressed:
                moved = event.position() - self._pressed.pop(button)
                if moved.manhattanLength() <= _STILL and button == Qt.MouseButton.LeftButton:
                    self.pick_at(event.position())
                elif moved.manhattanLength() <= _STILL:
                    name = self.name_at(event.position())
                    self.menu_wanted.emit(name, event.globalPosition().toPoint())
        return False

    def name_at(self, at: QPointF | QPoint) -> str:
        """Return the name of the shape whose view is at a position of the widget; empty if there is none."""
        cell = self._cell_at(QPointF(at))
        return cell.content.name if cell is not None and cell.content is not None else ""

    def pick_at(self, at: QPointF) -> None:
        """Emit the object at a position of the widget, if any."""
        if (pick := self.surface_at(at)) is not None:
            self.picked.emit(pick)

    def surface_at(self, at: QPointF) -> Pick | None:
        """Return the point of a surface at a position of the widget, if any."""
        cell = self._cell_at(at)
        return None if cell is None else self._pick_in(cell, *self._pixel(at))

    def _pixel(self, at: QPointF) -> tuple[float, float]:
        """Return a position of the widget in VTK's pixels."""
        ratio = self.plot.devicePixelRatioF()
        return at.x() * ratio, (self.plot.height() - 1 - at.y()) * ratio

    def _cell_at(self, at: QPointF) -> "ViewCell | None":
        """Return the non-empty view at a position of the widget."""
        x, y = (int(value) for value in self._pixel(at))
        for cell in self._cells:
            shown = cell.content is not None and cell.renderer.GetDraw()
            if shown and cell.renderer.IsInViewport(x, y):
                return cell
        return None

    def _pick_in(self, cell: "ViewCell", x: float, y: float) -> Pick | None:
        picker = vtkCellPicker()
        picker.SetTolerance(0.0)
        picker.PickFromListOn()
        for actor in cell.surface_actors:
            picker.AddPickList(actor)
        if cell.content is None or not picker.Pick(x, y, 0.0, cell.renderer):
            return None
        if cell.is_cap(picker.GetActor()):  # inside the shape, not on its surface
            return None
        place = np.array(picker.GetPickPosition())
        return Pick(cell.content.name, place, self._particle_near(cell, place))

    def _particle_near(self, cell: "ViewCell", place: FloatArray) -> int | None:
        particles, radius = self._particles_of(cell)
        if particles is None or len(particles) == 0:
            return None
        distances = np.linalg.norm(np.asarray(particles) - place, axis=1)
        nearest = int(distances.argmin())
        return nearest if distances[nearest] <= _CLOSE * radius else None


def aim(camera: Any, place: FloatArray, normal: FloatArray, height: float) -> None:  # noqa: ANN401 - VTK is untyped
    """Look at a point of a surface from outside, with a view height in millimetres."""
    up = np.array(camera.GetViewUp())
    if abs(np.dot(up, normal)) > 0.9:
        up = np.array((0.0, 1.0, 0.0) if abs(normal[1]) < 0.7 else (0.0, 0.0, 1.0))
    far = camera.GetDistance()
    camera.SetFocalPoint(*place)
    camera.SetPosition(*(place + far * normal))
    camera.SetViewUp(*up)
    camera.OrthogonalizeViewUp()
    camera.SetParallelScale(height / 2.0)


class PlaneHandle:
    """VTK's handle of a plane: its arrow turns it, and it can be pushed.

    Parameters
    ----------
    plot : Interactor
    turned : callable
        Receives the unit normal (3,) and a point (3,) of the plane.
    drawn : bool
        Whether the plane itself is drawn.
    """

    def __init__(
        self, plot: Interactor, turned: "Callable[[FloatArray, FloatArray], object]", *, drawn: bool = False
    ) -> None:
        self._turned = turned
        self.plane: Any = vtkImplicitPlaneRepresentation()
        self.plane.SetPlaceFactor(1.0)
        self.plane.SetDrawPlane(drawn)
        self.plane.SetDrawOutline(False)
        self.plane.SetOutlineTranslation(False)
        self.plane.SetScaleEnabled(False)
        self.plane.SetConstrainToWidgetBounds(True)
        self.widget: Any = vtkImplicitPlaneWidget2()
        self.widget.SetRepresentation(self.plane)
        self.widget.SetInteractor(plot.ren_win.GetInteractor())
        self._observers = [self.widget.AddObserver("InteractionEvent", self._follow)]

    def ended(self, then: "Callable[[], object]") -> None:
        """Call a function whenever the handle is let go."""
        self._observers.append(self.widget.AddObserver("EndInteractionEvent", lambda *_: then()))

    def show(self, renderer: Any, box: Box, normal: FloatArray, origin: FloatArray) -> None:  # noqa: ANN401
        """Show the handle in a view, with the plane's unit normal and a point of it."""
        self.widget.SetDefaultRenderer(renderer)
        self.plane.PlaceWidget(box)
        self.plane.SetNormal(*normal)
        self.plane.SetOrigin(*origin)
        self.widget.On()

    def hide(self) -> None:
        """Hide the handle."""
        if self.widget.GetEnabled():
            self.widget.Off()

    def close(self) -> None:
        """Release the graphics."""
        for observer in self._observers:
            self.widget.RemoveObserver(observer)
        self.hide()
        self.widget.SetInteractor(None)

    def _follow(self, *_: object) -> None:
        self._turned(np.array(self.plane.GetNormal()), np.array(self.plane.GetOrigin()))


class ColourBar(QWidget):
    """Shows the colour scale as saved pictures do. A click asks for another range."""

    clicked = Signal()

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setFixedHeight(round(HEIGHT * text_scale()))
        self._scale: ColourScale | None = None
        self._colours = LIGHT_SCHEME
        self._drawn: tuple[object, QImage] | None = None
        self.setAccessibleName("Colour scale")
        self.setCursor(Qt.CursorShape.PointingHandCursor)
        self.hide()

    @property
    def scale(self) -> ColourScale | None:
        """The scale; None hides the bar."""
        return self._scale

    def show_scale(self, scale: ColourScale | None) -> None:
        """Show a scale, or none."""
        if scale is self._scale:
            return
        self._scale = scale
        self.setVisible(scale is not None)
        if scale is not None:
            text = (
                f"{scale.title} in {scale.unit}, from {short(scale.low)} {scale.low_label} "
                f"to {short(scale.high)} {scale.high_label}"
            )
            self.setAccessibleDescription(text)
            text += f"; grey: {scale.grey_label}" if scale.grey_label else ""
            hollow = " On the inner wall of a hollow organ, out of the tissue means a smaller cavity."
            self.setToolTip(text + ". Click to set the range." + hollow * ("tissue" in scale.high_label))
        self._fit_height()
        self.update()

    def _fit_height(self) -> None:
        """Take the height of the scale, which may have a title of two lines."""
        if self._scale is not None:
            self.setFixedHeight(scale_height(self._scale, self.width(), text_scale()))

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Fit the title into the new width."""
        super().resizeEvent(event)
        self._fit_height()

    def paint(self, colours: Colours) -> None:
        """Apply the colours of the scheme."""
        self._colours = colours
        self.update()

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        """Ask for another range."""
        if event.button() == Qt.MouseButton.LeftButton and self.rect().contains(event.position().toPoint()):
            self.clicked.emit()

    def sizeHint(self) -> QSize:
        """Return the preferred size."""
        return QSize(WIDEST + 2 * SIDE, self.height())

    def paintEvent(self, event: QPaintEvent) -> None:
        """Paint the bar."""
        painter = QPainter(self)
        painter.fillRect(self.rect(), QColor(self._colours.scene))
        if self._scale is not None:
            painter.drawImage(0, 0, self._picture(self._scale))
        painter.end()

    def _picture(self, scale: ColourScale) -> QImage:
        """Return the cached picture of the scale."""
        ratio, text = self.devicePixelRatioF(), text_scale()
        state = scale, self._colours, self.width(), ratio, text
        if self._drawn is None or self._drawn[0] != state:
            pixels = scale_picture(scale, self._colours, round(self.width() * ratio), ratio * text)
            height, width, _ = pixels.shape
            image = QImage(pixels.tobytes(), width, height, 4 * width, QImage.Format.Format_RGBA8888).copy()
            image.setDevicePixelRatio(ratio)
            self._drawn = state, image
        return self._drawn[1]


_SLOW_MS = 40.0
_LIVE_MS = (30.0, 55.0)
_REFINE_MS = 400
_CLOSE_UP, _CLOSE_UP_BALLS = 0.6, 36.0
"""Largest height of a close-up: as a fraction of the shapes' extent, and in radii of the balls."""


class Scene(QWidget):
    """A grid of views, rotated together unless unlinked, and the colour scale below it."""

    page_changed = Signal()
    display_changed = Signal()
    plane_turned = Signal(object)
    closing = Signal()

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.plot = Interactor(self)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        self.bar = ColourBar(self)
        layout.addWidget(self.plot, 1)
        layout.addWidget(self.bar)
        window: Any = self.plot.ren_win
        for renderer in self.plot.renderers:  # pyvista's; the grid creates one for each view
            window.RemoveRenderer(renderer)
        window.SetMultiSamples(self.plot.smoothing)
        self._observers = (
            window.AddObserver("StartEvent", self._before_drawing),
            window.AddObserver("EndEvent", self._after_drawing),
        )
        self.grid = Grid(window)
        self._watchers: list[QObject] = []
        self.picker = Picker(self.plot, self.grid.cells, self.grid.particles_of)
        self.watch_by(self.picker)
        self.handle, self._turning = PlaneHandle(self.plot, self._turn_plane), False
        self.displayed = ViewContents(())
        self._reported = (-1, 0, 0)
        self._focus: tuple[str, int, FloatArray] | None = None
        """What a close-up shows: a content by its name, a vertex of its surface, and where that was."""
        self._subjects_page = 0  # the page of subjects to return to from shapes of the model
        self.share, self._turn, self._partial = MOST, 0, False
        self._size: object = None
        self._fitted = False
        self.fitted: list[object] = []
        self.refine_timer = QTimer(self, interval=_REFINE_MS, singleShot=True)
        self.refine_timer.timeout.connect(self._draw_fine)
        self.set_layout(4)
        self.plot.iren.add_observer("StartInteractionEvent", self._draw_quick)
        self.plot.iren.add_observer("EndInteractionEvent", lambda *_: self.refine_timer.start())

    @property
    def shown(self) -> Sequence[Content]:
        """The contents of the page."""
        return self.grid.shown

    def set_layout(self, count: int) -> None:
        """Show 1, 4, 9 or 16 views of subjects; the first one remains visible."""
        first = self.grid.page * self.grid.display.layout
        self.change(layout=count)
        if not self.grid.columns:
            self.show_page(first // count)
            self._keep_whole()

    def display(self, shown: ViewContents) -> None:
        """Show other contents.

        Parameters
        ----------
        shown : ViewContents
            At most sixteen contents if they define the grid.
        """
        had, before = self.grid.contents, self.grid.shape
        stays = shown.stays and self.displayed.stays and self.fitted != self.looks
        if not self.grid.columns:
            self._subjects_page = self.grid.page
        self.displayed = shown
        self.grid.take(shown)
        self.bar.show_scale(shown.scale)
        self.show_page(0 if shown.columns else min(self._subjects_page, self.grid.pages - 1))
        if shown.contents and (not had or not self._fitted):
            self.look("corner")
        elif self.grid.shape != before:
            if not stays:
                self.fit()
        elif len(shown.contents) != len(had):
            self._keep_whole()
        elif self.fitted == self.looks:
            # The shapes may have grown, as along a mode. The user's zoom is kept.
            self.grid.widen(self.plot.width(), self.plot.height())
            self.fitted = self.looks
        self._follow_focus()

    def begin_anew(self) -> None:
        """Reset camera, zoom and page for the next contents."""
        self._fitted, self._subjects_page = False, 0
        self.change(page=0)

    def show_page(self, page: int) -> None:
        """Show a page of the contents."""
        self._refresh(page)
        grid = self.grid
        if (grid.page, grid.pages, grid.columns) != self._reported:
            self._reported = (grid.page, grid.pages, grid.columns)
            self.page_changed.emit()

    def turn_page(self, step: int) -> None:
        """Show the previous (-1) or next (1) page, with whole shapes."""
        self.show_page(self.grid.page + step)
        self._keep_whole()

    def show_name(self, name: str) -> None:
        """Show the page with a subject."""
        contents = self.grid.contents
        if isinstance(contents, SubjectContents):
            index = contents.place_of(name)
        else:
            index = next((place for place, content in enumerate(contents) if content.name == name), None)
        if index is not None and index // self.grid.count != self.grid.page:
            self.show_page(index // self.grid.count)

    def change(self, **fields: object) -> None:
        """Display the contents in another way: new values of fields of `Display`."""
        before = self.grid.display
        display = before.changed(**fields)
        if display != before:
            self.grid.show(display)
            self._refresh()
            if display.clip is not before.clip and not self._turning:
                self._place_handle()
            self.display_changed.emit()

    @property
    def principal_axes(self) -> FloatArray | None:
        """The long, middle and short axis (3, 3) of the first shape of the page; None without one."""
        cell = self.grid.cells[0]
        if not len(cell.vertices):
            return None
        return np.asarray(np.linalg.svd(cell.vertices - cell.vertices.mean(axis=0), full_matrices=False)[2])

    def _place_handle(self) -> None:
        """Show the handle of a plane that is not anatomical in the first view."""
        clip, box, cell = self.grid.display.clip, self.grid.box or self.grid.bounds, self.grid.cells[0]
        if clip is None or clip.plane is not ClipPlane.FREE or box is None:
            self.handle.hide()
        else:
            self.handle.show(cell.renderer, clip.box or box, *clip.cut(box, cell.axes[2]))

    def _turn_plane(self, normal: FloatArray, origin: FloatArray) -> None:
        box = self.grid.box or self.grid.bounds
        if box is not None:
            self._turning = True  # the handle is where it was dragged
            self.plane_turned.emit(Clip.free(normal, origin, box))
            self._turning = False

    def show_particles(
        self, particles: Mapping[str, FloatArray], tints: Array | None = None, *, live: bool = False
    ) -> None:
        """Show particles by subject, (N, 3) [mm] each in common coordinates.

        Colours (N, 3) that are not given are computed when the number of particles changes, and when a
        run has ended. Live particles may be drawn on simpler surfaces.
        """
        count = len(next(iter(particles.values()))) if particles else 0
        before = self.grid.tints
        if tints is None and live and before is not None and not isinstance(before, Mapping):
            tints = before if len(before) == count else None
        self.grid.set_particles(particles, tints)
        if live:
            self._draw_quick()
            self.refine_timer.start()
            self._refresh_some()
        else:
            self._refresh()

    def set_linked(self, linked: bool) -> None:
        """Rotate all views together, or each independently."""
        self.grid.cameras.link(linked)
        self._refresh()

    def look(self, view: str) -> None:
        """Set the direction to one of `VIEWS` and fit the shapes."""
        self.grid.cameras.turn(view)
        self.fit()

    def set_camera(self, state: CameraState) -> None:
        """Set the direction of a camera, and fit the shapes."""
        for camera in self.grid.cameras.each:
            state.set(camera)
        self.fit()

    @Slot(str, object, object)
    def face(self, name: str, place: FloatArray, normal: FloatArray) -> None:
        """Turn whole shapes so that a point of a content's surface faces the viewer, and uncover it."""
        for camera in self.grid.cameras.each:
            aim(camera, np.array(camera.GetFocalPoint()), normal, 2.0 * camera.GetParallelScale())
        self.fit()
        cell = self.grid.cell_of(name)
        if cell is not None and len(cell.vertices):
            self._watch(name, cell, place)

    def _watch(self, name: str, cell: "ViewCell", place: FloatArray) -> None:
        """Keep the point of a content that is nearest to a place uncovered."""
        vertex = int(np.linalg.norm(cell.vertices - place, axis=1).argmin())
        self._focus = name, vertex, cell.vertices[vertex]
        self._uncover(cell, place)

    def fit(self) -> None:
        """Zoom to the whole shapes."""
        self.grid.uncovering = self._focus = None
        self._fitted = self.grid.fit(self.plot.width(), self.plot.height()) or self._fitted
        self.fitted = self.looks
        self.plot.update()

    def _keep_whole(self) -> None:
        """Zoom out if new shapes would be cut off, unless the user has zoomed."""
        if self.fitted != self.looks:
            return
        cameras = self.grid.cameras.each
        before = [camera.GetParallelScale() for camera in cameras]
        self.fit()
        for camera, scale in zip(cameras, before, strict=True):
            camera.SetParallelScale(max(scale, camera.GetParallelScale()))  # sizes stay comparable
        self.fitted = self.looks

    @property
    def looks(self) -> list[object]:
        """Focal point and scale of each camera: those of `fit` unless the user zooms."""
        return [(camera.GetFocalPoint(), camera.GetParallelScale()) for camera in self.grid.cameras.each]

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Keep whole shapes visible."""
        super().resizeEvent(event)
        if self.fitted == self.looks:
            focus = self._focus
            self.fit()
            cell = self.grid.cell_of(focus[0]) if focus is not None else None
            if cell is not None and focus is not None and focus[1] < len(cell.vertices):
                self._watch(focus[0], cell, cell.vertices[focus[1]])

    def go_to(self, name: str, place: FloatArray, normal: FloatArray) -> None:
        """Show a subject's page and a close-up of a point of its surface from outside.

        The point stays in the middle while the surface moves. A wall in front of it, as of a hollow organ, is
        cut away, and the user's cut ends if it removes the point.
        """
        self.show_name(name)
        cell, bounds = self.grid.cell_of(name), self.grid.bounds
        if cell is None or bounds is None or not len(cell.vertices):
            return
        low, high = np.reshape(np.array(bounds), (3, 2)).T
        height = _CLOSE_UP * float((high - low).max())
        if self.grid.particles and not self.grid.columns:  # close-up of a subject's particles
            height = min(height, _CLOSE_UP_BALLS * self.grid.radius)
        for camera in self.grid.cameras.each:
            aim(camera, place, normal, height)
        self._watch(name, cell, place)

    def _follow_focus(self) -> None:
        """Keep the point of a close-up in the middle after its surface has moved."""
        if self._focus is None:
            return
        name, vertex, before = self._focus
        cell = self.grid.cell_of(name)
        if cell is None or vertex >= len(cell.vertices) or np.array_equal(cell.vertices[vertex], before):
            return
        move = cell.vertices[vertex] - before
        for camera in self.grid.cameras.each:
            camera.SetPosition(*(camera.GetPosition() + move))
            camera.SetFocalPoint(*(camera.GetFocalPoint() + move))
        self._focus = name, vertex, cell.vertices[vertex]
        self._uncover(cell, cell.vertices[vertex])

    @Slot()
    def leave_close_up(self) -> None:
        """Show whole shapes again after a close-up."""
        if self._focus is not None:
            self.fit()

    def _uncover(self, cell: "ViewCell", place: FloatArray) -> None:
        """Cut away what hides a point from the camera, and nothing that removes the point."""
        bounds, toward = self.grid.bounds, -cell.axes[2]
        clip = self.grid.display.clip
        if clip is not None and bounds is not None:
            normal, origin = clip.cut(self.grid.box or bounds, cell.axes[2])
            if (place - origin) @ normal < self.grid.radius:
                self.change(clip=None)
        self.grid.uncovering = None if bounds is None else self._plane_before(cell, place, toward, bounds)
        self.plot.update()

    def _plane_before(self, cell: "ViewCell", place: FloatArray, toward: FloatArray, box: Box) -> Clip | None:
        """Return the plane midway between a point and what hides it; it stays when the view turns."""
        ahead = (cell.vertices - place) @ toward
        aside = np.linalg.norm(cell.vertices - place - ahead[:, None] * toward, axis=1)
        room = 4.0 * self.grid.radius
        hiding = ahead[(aside < 0.5 * room) & (ahead > room)]
        return Clip.free(-toward, place + 0.5 * hiding.min() * toward, box) if len(hiding) else None

    def paint(self, colours: Colours) -> None:
        """Apply the colours of the scheme."""
        self.change(scheme="dark" if colours is DARK_SCHEME else "light")
        self.bar.paint(colours)

    @property
    def canvas(self) -> Canvas:
        """The canvas of the views, from which a picture can be drawn again."""
        grid = self.grid
        return Canvas(
            width=self.plot.width(),
            height=self.plot.height(),
            ratio=self.devicePixelRatioF(),
            text=grid.text,
            cameras=tuple(CameraState.of(camera) for camera in grid.cameras.each),
            **dict(grid.display.changed(clip=grid.full_clip)),
        )

    @property
    def shown_now(self) -> ViewContents:
        """A copy of the views' contents, with particles and their colours."""
        grid = self.grid
        return ViewContents(
            grid.contents, grid.columns or None, self.displayed.scale, grid.particles, grid.tints
        )

    def picture(self, scale: int = 1, *, transparent: bool = False) -> QImage:
        """Return a picture of the views, up to four times as large."""
        pixels = np.ascontiguousarray(drawn(self.shown_now, self.canvas, scale, transparent=transparent))
        height, width, _ = pixels.shape
        return QImage(pixels.tobytes(), width, height, 4 * width, QImage.Format.Format_RGBA8888).copy()

    def watch_by(self, watcher: QObject) -> None:
        """Let an object filter the events of the views, until they close."""
        self.plot.installEventFilter(watcher)
        self._watchers.append(watcher)

    def close_scene(self) -> None:
        """Release all VTK objects before the window closes."""
        self.refine_timer.stop()
        self.closing.emit()
        self.handle.close()
        for watcher in self._watchers:  # they would receive events of the half destroyed widget
            self.plot.removeEventFilter(watcher)
        window: Any = self.plot.ren_win
        if window is not None:
            for observer in self._observers:
                window.RemoveObserver(observer)
            self.grid.close()
        self.plot.close()

    def _refresh(self, page: int | None = None) -> None:
        self._after_drawing()
        self.grid.ratio, self.grid.text = self.devicePixelRatioF(), text_scale()
        if page is None:
            self.grid.refresh()
        else:
            self.grid.show_page(page)
        self.plot.update()

    def _refresh_some(self) -> None:
        """Move and draw the particles of as many views as can be drawn fast enough.

        Other views keep their last picture, because each renderer clears only its own part of the window. A
        slow machine therefore updates the views in turn and remains responsive.
        """
        spent, count = self.plot.last_ms, self.grid.count
        if spent > _LIVE_MS[1]:
            self.share = max(1, min(self.share, count) * 2 // 3)
        elif spent < _LIVE_MS[0]:
            self.share = min(MOST, self.share + 1)
        share = min(self.share, count)
        chosen = {(self._turn + step) % count for step in range(share)}
        self._turn = (self._turn + share) % count
        self.grid.refresh_particles(chosen)
        self._draw_cells(chosen)
        self._partial = share < count
        self.plot.update()

    def _draw_cells(self, chosen: Collection[int]) -> None:
        count = self.grid.count
        for index, cell in enumerate(self.grid.cells[:count]):
            cell.renderer.SetDraw(index in chosen)
        self.grid.show_backdrop(len(chosen) == count)

    def _after_drawing(self, *_: object) -> None:
        if self._partial:
            self._partial = False
            self._draw_cells(range(self.grid.count))

    def _before_drawing(self, *_: object) -> None:
        size = self.plot.ren_win.GetSize()
        if size != self._size:  # the last picture of views that are not drawn is lost
            self._size = size
            self._after_drawing()

    def _draw_quick(self, *_: object) -> None:
        self._set_quick(self.grid.quick or self.plot.draw_ms > _SLOW_MS)

    def _draw_fine(self) -> None:
        self._set_quick(False)

    def _set_quick(self, quick: bool) -> None:
        if quick != self.grid.quick:
            self.grid.quick = quick
            self._refresh()
