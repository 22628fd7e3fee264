"""The VTK widget, picking by clicks, and the colour bar below it."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from PySide6.QtCore import QEvent, QObject, QPoint, QPointF, QSize, Qt, Signal
from PySide6.QtGui import QColor, QImage, QKeyEvent, QMouseEvent, QPainter, QPaintEvent, QResizeEvent
from PySide6.QtWidgets import QWidget
from pyvistaqt import QtInteractor
from vtkmodules.vtkRenderingCore import vtkCellPicker  # pyvista picks with a plotter, not in a renderer

from homolog.arrays import FloatArray
from homolog_app.rendering.colours import LIGHT_SCHEME, Colours, ColourScale
from homolog_app.rendering.opengl import SMOOTH
from homolog_app.rendering.text import short
from homolog_app.views.colour_bar import HEIGHT, MOST, SIDE, scale_height, scale_picture
from homolog_app.window.theme import text_scale

if TYPE_CHECKING:
    from homolog_app.views.cell import ViewCell

__all__ = ["ColourBar", "Interactor", "Pick", "Picker", "aim"]


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
        plot.installEventFilter(self)

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
        cell = self._cell_at(at)
        pick = None if cell is None else self._pick_in(cell, *self._pixel(at))
        if pick is not None:
            self.picked.emit(pick)

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
            text = (f"{scale.title} in {scale.unit}, from {short(scale.low)} {scale.low_label} "
                     f"to {short(scale.high)} {scale.high_label}")  # fmt: skip
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
        return QSize(MOST + 2 * SIDE, self.height())

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
