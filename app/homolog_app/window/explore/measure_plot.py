"""Measures: curves along the range of a mode, and box plots by group."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import Signal
from PySide6.QtWidgets import QHBoxLayout, QStackedWidget, QWidget

from homolog.analysis.group_measures import GroupMeasure, compare_measure
from homolog.arrays import FloatArray
from homolog_app.window.explore.plot import Plot
from homolog_app.window.quantities import short
from homolog_app.window.theme import Theme

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.backend_bases import MouseEvent
    from matplotlib.figure import Figure

__all__ = ["BoxPlot", "MeasurePlot", "MeasurePlots"]

_MEASURES = (("Distance", "mm"), ("Volume", "ml"), ("Area", "cm²"), ("Wall", "mm"))
_WIDTH = 150


class MeasurePlot(Plot):
    """A curve over standard deviations, with the place of the shape that is shown. A click moves it there."""

    chosen = Signal(float)

    def __init__(self, theme: Theme, name: str, unit: str) -> None:
        super().__init__(theme, name, "")
        self.setMinimumWidth(_WIDTH)
        self._unit, self._label = unit, ""
        self._x: FloatArray = np.empty(0)
        self._y: FloatArray = np.empty(0)
        self._at = 0.0

    @property
    def is_empty(self) -> bool:
        """Whether there is no curve yet."""
        return not len(self._x)

    def show_curve(self, x: FloatArray, y: FloatArray, label: str) -> None:
        """Show a measure at some standard deviations."""
        self._x, self._y, self._label = x, y, label
        if len(x):
            ends = f"from {short(float(y[0]))} to {short(float(y[-1]))}"
            self.setAccessibleDescription(f"{ends} {self._unit} over {label}")
        self.redraw()

    def show_place(self, at: float) -> None:
        """Mark the shape that is shown [SD]."""
        self._at = at
        self.follow()

    def draw(self, figure: "Figure") -> None:
        """Draw the curve."""
        from homolog_app.plots import draw_measure

        draw_measure(figure.subplots(), self._x, self._y, self.title, self._label, self.theme.colours)

    def draw_moving(self, figure: "Figure") -> "Sequence[Artist]":
        """Draw the place, and the measure there."""
        from homolog_app.plots import draw_value

        value = float(np.interp(self._at, self._x, self._y))
        text = f"{short(value)} {self._unit}"
        return draw_value(figure.axes[0], self._at, value, text, self.theme.colours)

    def press(self, event: "MouseEvent") -> None:
        """Go to the place that is clicked."""
        if len(self._x) and event.xdata is not None:
            self.chosen.emit(float(np.clip(event.xdata, self._x[0], self._x[-1])))


class BoxPlot(Plot):
    """Quartiles, range and mean of a measure in each group, and every subject."""

    def __init__(self, theme: Theme, name: str, unit: str) -> None:
        super().__init__(theme, name, "Give subjects groups in Cohort to see this measure by group.")
        self.setMinimumWidth(_WIDTH)
        self._name, self._unit = name, unit
        self._parts: list[FloatArray] = []
        self.measure: GroupMeasure | None = None

    @property
    def is_empty(self) -> bool:
        """Whether there are no groups."""
        return self.measure is None or not self.measure.groups

    def show_measure(self, values: FloatArray, groups: Sequence[str]) -> None:
        """Show a measure of subjects (M,), with the group of each."""
        self.measure = measure = compare_measure(values, groups)
        labels = np.array(groups, dtype=object)
        self._parts = [values[(labels == name) & np.isfinite(values)] for name in measure.groups]
        test = (
            "no test" if measure.p is None else "p < 0.001" if measure.p < 0.001 else f"p = {measure.p:.2g}"
        )
        self.title = f"{self._name}: {test}"
        rows = zip(measure.groups, measure.means, measure.deviations, measure.counts, strict=True)
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
        self.redraw()

    def clear(self) -> None:
        """Show no measure: those of this study are not there yet."""
        self.measure, self._parts, self.title = None, [], self._name
        self.setAccessibleDescription("")
        self.setToolTip("")
        self.redraw()

    def draw(self, figure: "Figure") -> None:
        """Draw a box for each group, with its name and mean below."""
        from homolog_app.plots import draw_boxes

        measure = self.measure
        assert measure is not None
        means = []
        for mean, deviation in zip(measure.means, measure.deviations, strict=True):
            digits = int(np.clip(-np.floor(np.log10(deviation)), 0, 3)) if deviation > 0.0 else 1
            spread = f"\u2009±\u2009{deviation:.{digits}f}" if np.isfinite(deviation) else ""
            means.append((f"{mean:.{digits}f}{spread}", short(mean)))
        title, colours = self.title.replace(": ", "\n"), self.theme.colours  # there may be little width
        draw_boxes(figure.subplots(), self._parts, measure.groups, means, title, self._unit, colours)


class MeasurePlots(QStackedWidget):
    """The measures side by side: as curves along a mode, or as boxes by group."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.each = tuple(MeasurePlot(theme, *measure) for measure in _MEASURES)
        self.boxes = tuple(BoxPlot(theme, *measure) for measure in _MEASURES)
        for plots in (self.each, self.boxes):
            page = QWidget()
            row = QHBoxLayout(page)
            row.setContentsMargins(0, 0, 0, 0)
            row.setSpacing(0)
            for plot in plots:
                row.addWidget(plot)
            self.addWidget(page)

    def show_measures(self, columns: Sequence[FloatArray], groups: Sequence[str]) -> None:
        """Show the columns (M,) of the table by group."""
        for plot, values in zip(self.boxes, columns, strict=True):
            plot.show_measure(values, groups)

    def clear_measures(self) -> None:
        """Empty the boxes."""
        for plot in self.boxes:
            plot.clear()
