"""Measures along the range of a mode."""

import numpy as np
from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QMouseEvent, QPainter, QPen, QPolygonF
from PySide6.QtWidgets import QHBoxLayout, QStackedWidget, QWidget

from homolog.arrays import FloatArray
from homolog_app.window.explore.group_boxes import GroupBoxes
from homolog_app.window.explore.plot import Plot, group_colour
from homolog_app.window.quantities import short
from homolog_app.window.theme import Theme

__all__ = ["MeasurePlot", "MeasurePlots"]

_ROOM = 0.08


class MeasurePlot(Plot):
    """A curve over standard deviations, with the place of the shape that is shown. A click moves it there."""

    chosen = Signal(float)

    def __init__(self, theme: Theme, name: str, unit: str) -> None:
        super().__init__(theme, name, "")
        self._name, self._unit = name, unit
        self._x: FloatArray = np.empty(0)
        self._y: FloatArray = np.empty(0)
        self._at = 0.0

    @property
    def is_empty(self) -> bool:
        """Whether there is no curve yet."""
        return not len(self._x)

    def show_curve(self, x: FloatArray, y: FloatArray, label: str) -> None:
        """Show a measure at some standard deviations."""
        self._x, self._y, self.x_label = x, y, label
        if len(x):
            low, high = float(y.min()), float(y.max())
            room = _ROOM * (high - low) or 0.05 * abs(high) or 1.0
            self.x_range, self.y_range = (float(x[0]), float(x[-1])), (low - room, high + room)
            self.setAccessibleDescription(
                f"from {short(float(y[0]))} to {short(float(y[-1]))} {self._unit} over {label}"
            )
        self.show_place(self._at)

    def show_place(self, at: float) -> None:
        """Mark the shape that is shown [SD]."""
        self._at = at
        if len(self._x):
            value = float(np.interp(at, self._x, self._y))
            self.title = f"{self._name}: {short(value)} {self._unit}"
        self.update()

    def paint_data(self, painter: QPainter) -> None:
        """Paint the curve and the place."""
        painter.setPen(QPen(group_colour(0, self.theme), 2))
        line = [self.place(x, y) for x, y in zip(self._x, self._y, strict=True)]
        painter.drawPolyline(QPolygonF(line))
        at = self.place(self._at, float(np.interp(self._at, self._x, self._y)))
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(group_colour(1, self.theme))
        painter.drawEllipse(at, 5, 5)

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Go to the place that is clicked."""
        if len(self._x):
            at = self.value(event.position())[0]
            self.chosen.emit(float(np.clip(at, self._x[0], self._x[-1])))


class MeasurePlots(QStackedWidget):
    """The measures side by side: as curves along a mode, or as boxes by group."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.boxes = GroupBoxes(theme)
        self.distance = MeasurePlot(theme, "Distance", "mm")
        self.volume = MeasurePlot(theme, "Volume", "ml")
        self.area = MeasurePlot(theme, "Area", "cm²")
        self.wall = MeasurePlot(theme, "Wall", "mm")
        self.each = (self.distance, self.volume, self.area, self.wall)
        curves = QWidget()
        row = QHBoxLayout(curves)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(0)
        for plot in self.each:
            plot.setMinimumWidth(150)
            row.addWidget(plot)
        self.addWidget(curves)
        self.addWidget(self.boxes)
