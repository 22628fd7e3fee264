"""Measures by group as box plots, with mean, standard deviation and test."""

from collections.abc import Sequence

import numpy as np
from PySide6.QtCore import QRectF, Qt
from PySide6.QtGui import QColor, QPainter, QPen
from PySide6.QtWidgets import QHBoxLayout, QWidget

from homolog.analysis.group_measures import GroupMeasure, compare_measure
from homolog.arrays import FloatArray
from homolog_app.window.explore.plot import Plot, group_colour, marker
from homolog_app.window.quantities import short
from homolog_app.window.theme import Theme

__all__ = ["BoxPlot", "GroupBoxes"]

_HALF, _ROOM, _REACH = 0.28, 0.1, 1.5
_VEIL = 60
_WHOLE, _LARGE = 5.0, 50.0
_APART = 8  # pixels between the texts of neighbouring groups


class BoxPlot(Plot):
    """Quartiles, range and mean of a measure in each group, and every subject.

    A box goes from the first to the third quartile, with a line at the median. Whiskers go to the last value
    within 1.5 times the box's height. The diamond is the mean.
    """

    def __init__(self, theme: Theme, name: str, unit: str) -> None:
        super().__init__(theme, name, "Give subjects groups in Cohort to see this measure by group.")
        self._name, self._unit = name, unit
        self._parts: list[FloatArray] = []
        self.found: GroupMeasure | None = None
        self.setMinimumWidth(150)
        self.x_ticks = []

    @property
    def is_empty(self) -> bool:
        """Whether there are no groups."""
        return self.found is None or not self.found.groups

    def show_measure(self, values: FloatArray, groups: Sequence[str]) -> None:
        """Show a measure of subjects (M,), with the group of each."""
        self.found = found = compare_measure(values, groups)
        labels = np.array(groups, dtype=object)
        self._parts = [values[(labels == name) & np.isfinite(values)] for name in found.groups]
        if self._parts:
            everything = np.concatenate(self._parts)
            low, high = float(everything.min()), float(everything.max())
            room = _ROOM * (high - low) or 0.05 * abs(high) or 1.0
            self.x_range, self.y_range = (-0.6, len(self._parts) - 0.4), (low - room, high + room)
        test = "no test" if found.p is None else "p < 0.001" if found.p < 0.001 else f"p = {found.p:.2g}"
        self.title, self.y_label = f"{self._name}: {test}", self._unit
        rows = zip(found.groups, found.means, found.deviations, found.counts, strict=True)
        each = [
            f"{name}: {short(mean)} ± {short(deviation)} {self._unit} (n = {count})"
            if np.isfinite(deviation)
            else f"{name}: {short(mean)} {self._unit} (n = 1)"
            for name, mean, deviation, count in rows
        ]
        self.setAccessibleDescription("; ".join([*each, test]))
        self.setToolTip(
            "\n".join(["Mean ± SD", *each, f"{test} (Welch, not corrected for several measures)"])
        )
        self.update()

    def paint_data(self, painter: QPainter) -> None:
        """Paint a box for each group, and its name below."""
        assert self.found is not None
        step = self.frame.width() / len(self._parts)
        for index, (name, part) in enumerate(zip(self.found.groups, self._parts, strict=True)):
            self._paint_box(painter, index, part)
            at, metrics = self.place(index, self.y_range[0]), painter.fontMetrics()
            painter.setPen(QColor(self.theme.colours.dim))
            deviation = self.found.deviations[index]
            digits = 1 if deviation < _WHOLE and abs(self.found.means[index]) < _LARGE else 0
            mean = f"{self.found.means[index]:.{digits}f}"
            both = f"{mean}\u2009±\u2009{deviation:.{digits}f}"
            room = round(step) - _APART
            if np.isfinite(deviation) and metrics.horizontalAdvance(both) <= room:
                mean = both  # the tooltip has it always
            for row, text in enumerate((name, mean)):
                box = QRectF(at.x() - step / 2, at.y() + 3 + 16 * row, step, 16)
                text = metrics.elidedText(text, Qt.TextElideMode.ElideMiddle, room)
                painter.drawText(box, Qt.AlignmentFlag.AlignCenter, text)

    def _paint_box(self, painter: QPainter, index: int, part: FloatArray) -> None:
        colour = group_colour(index, self.theme)
        low, middle, high = np.percentile(part, [25, 50, 75])
        reach = _REACH * (high - low)
        ends = part[(part >= low - reach) & (part <= high + reach)]
        painter.setPen(QPen(colour, 1.5))
        pale = QColor(colour)
        pale.setAlpha(_VEIL)
        painter.setBrush(pale)
        painter.drawRect(QRectF(self.place(index - _HALF, high), self.place(index + _HALF, low)))
        painter.drawLine(self.place(index - _HALF, middle), self.place(index + _HALF, middle))
        for inner, outer in ((low, ends.min()), (high, ends.max())):
            painter.drawLine(self.place(index, inner), self.place(index, outer))
            tip = _HALF / 2.0
            painter.drawLine(self.place(index - tip, outer), self.place(index + tip, outer))
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(colour)
        across = np.linspace(-0.5, 0.5, len(part)) * _HALF if len(part) > 1 else np.zeros(1)
        for shift, value in zip(across, part, strict=True):
            painter.drawEllipse(self.place(index + float(shift), float(value)), 2.5, 2.5)
        painter.setBrush(QColor(self.theme.colours.text))
        painter.drawPath(marker(3, self.place(index, float(part.mean())), 4.0))


class GroupBoxes(QWidget):
    """The four measures side by side."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.distance = BoxPlot(theme, "Distance", "mm")
        self.volume = BoxPlot(theme, "Volume", "ml")
        self.area = BoxPlot(theme, "Area", "cm²")
        self.wall = BoxPlot(theme, "Wall", "mm")
        self.each = (self.distance, self.volume, self.area, self.wall)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(0)
        for plot in self.each:
            row.addWidget(plot)

    def show_measures(self, columns: Sequence[FloatArray], groups: Sequence[str]) -> None:
        """Show the columns (M,) of the table by group."""
        for plot, values in zip(self.each, columns, strict=True):
            plot.show_measure(values, groups)
