"""What a click in a view meets: a place on a surface, and the particle there."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from PySide6.QtCore import QEvent, QObject, QPoint, QPointF, Qt, Signal
from PySide6.QtGui import QMouseEvent
from vtkmodules.vtkRenderingCore import vtkCellPicker

from homolog.arrays import FloatArray

if TYPE_CHECKING:
    from homolog_app.window.scene.cell import ViewCell
    from homolog_app.window.scene.interactor import Interactor

__all__ = ["Pick", "Picker", "aim"]

_STILL = 4.0
"""Pixels that the mouse may move between press and release of a click."""
_BUTTONS = (Qt.MouseButton.LeftButton, Qt.MouseButton.RightButton)
_CLOSE = 2.0
"""Radii of a ball from the place that was clicked, within which the particle is meant."""


@dataclass(frozen=True, slots=True, eq=False)
class Pick:
    """What was clicked.

    Attributes
    ----------
    name : str
        Of the content: a subject's name, or a shape's.
    place : (3,) array
        On the surface [mm], in the coordinates that are shown.
    particle : int or None
        The particle there.
    """

    name: str
    place: FloatArray
    particle: int | None


class Picker(QObject):
    """Watches the mouse for clicks that are no drags and tells what they met."""

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
        """Remember where the button went down, and pick where it comes up close by."""
        if isinstance(event, QMouseEvent) and event.button() in _BUTTONS:
            button = event.button()
            if event.type() == QEvent.Type.MouseButtonPress:
                self._pressed[button] = event.position()
            elif event.type() == QEvent.Type.MouseButtonRelease and button in self._pressed:
                moved = event.position() - self._pressed.pop(button)
                if moved.manhattanLength() <= _STILL and button == Qt.MouseButton.LeftButton:
                    self.pick_at(event.position())
                elif moved.manhattanLength() <= _STILL:
                    cell = self._cell_at(event.position())
                    name = cell.content.name if cell is not None and cell.content is not None else ""
                    self.menu_wanted.emit(name, event.globalPosition().toPoint())
        return False

    def pick_at(self, at: QPointF) -> None:
        """Tell what is at a place of the widget, if anything."""
        cell = self._cell_at(at)
        pick = None if cell is None else self._pick_in(cell, *self._pixel(at))
        if pick is not None:
            self.picked.emit(pick)

    def _pixel(self, at: QPointF) -> tuple[float, float]:
        """Return a place of the widget in VTK's pixels."""
        ratio = self.plot.devicePixelRatioF()
        return at.x() * ratio, (self.plot.height() - 1 - at.y()) * ratio

    def _cell_at(self, at: QPointF) -> "ViewCell | None":
        """Return the view at a place of the widget that shows something."""
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
        if cell.is_cap(picker.GetActor()):  # inside the shape: no place of its surface
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
    """Look at a place of a surface from outside, so that the view is so many millimetres high."""
    up = np.array(camera.GetViewUp())
    if abs(np.dot(up, normal)) > 0.9:
        up = np.array((0.0, 1.0, 0.0) if abs(normal[1]) < 0.7 else (0.0, 0.0, 1.0))
    far = camera.GetDistance()
    camera.SetFocalPoint(*place)
    camera.SetPosition(*(place + far * normal))
    camera.SetViewUp(*up)
    camera.OrthogonalizeViewUp()
    camera.SetParallelScale(height / 2.0)
