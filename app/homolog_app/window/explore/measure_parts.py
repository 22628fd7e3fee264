"""Parts of the page *Measure*: choosers of surfaces, plots; and the plot of a patient among controls."""

from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QComboBox,
    QHBoxLayout,
    QLabel,
    QSizePolicy,
    QStackedWidget,
    QVBoxLayout,
    QWidget,
)

from homolog.arrays import FloatArray
from homolog.cohort import MESH_SUFFIXES
from homolog.errors import InputError
from homolog.statistics.cautions import p_text
from homolog.statistics.welch import GroupMeasure, compare_measure
from homolog_app.rendering.text import short
from homolog_app.views.contents import MEAN_OF, mesh_file
from homolog_app.window.explore.mode_plots import ELLIPSES, ScatterPlot
from homolog_app.window.explore.plot import Plot
from homolog_app.window.theme import Theme, scaled
from homolog_app.window.widgets import GRID
from homolog_app.window.workspace import FileDialogs

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.backend_bases import MouseEvent
    from matplotlib.figure import Figure

    from homolog.patient import PatientComparison, Reference

__all__ = [
    "MEASURES",
    "BoxPlot",
    "GroupLegend",
    "MeasurePlot",
    "MeasurePlots",
    "PairPlot",
    "PercentileBars",
    "SurfaceChooser",
]


MEASURES = {"Distance": "mm", "Volume": "ml", "Area": "cm²", "Wall": "mm", "Deviation": "mm"}
"""The measures in the order of the table, with their units."""

_WIDTH = 112
_FILE = "Mesh file…"
_MESHES = f"Surfaces ({' '.join(f'*{suffix}' for suffix in MESH_SUFFIXES)})"


class SurfaceChooser(QComboBox):
    """Chooses a surface: a subject's, a group's mean, or a mesh file.

    Parameters
    ----------
    dialogs : FileDialogs
        The dialog that asks for a mesh file.
    name : str
        Accessible name.
    first : mapping of str to str or None
        Additional entries by label, listed first.
    """

    chosen = Signal()
    failed = Signal(object)

    def __init__(self, dialogs: FileDialogs, name: str, first: Mapping[str, str | None]) -> None:
        super().__init__()
        self._dialogs = dialogs
        self._first, self._files = dict(first), dict[str, str | None]()
        self.setAccessibleName(name)
        self.setToolTip(f"{name}. Mesh files must be in aligned coordinates (LPS, mm).")
        self.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self.setMinimumContentsLength(4)
        self.activated.connect(self._choose)

    def show_surfaces(self, subjects: Sequence[str], groups: Sequence[str | None]) -> None:
        """List subjects and the means of groups; the choice stays if it still exists."""
        before = self.currentData()
        means = {f"Mean of {group}": f"{MEAN_OF}{group}" for group in sorted(set(filter(None, groups)))}
        self.clear()
        for text, data in (self._first | means | {name: name for name in subjects} | self._files).items():
            self.addItem(text, data)
        self.addItem(_FILE, _FILE)
        self.setCurrentIndex(max(0, self.findData(before)))

    def _choose(self) -> None:
        if self.currentData() == _FILE:
            path = self._dialogs.file(self, "Surface in aligned coordinates", _MESHES)
            self.setCurrentIndex(0)
            if path:
                self._add(path)
        self.chosen.emit()

    def _add(self, path: Path) -> None:
        try:
            mesh_file(path)
        except InputError as error:
            self.failed.emit(error)
            return
        if path.name not in self._files:
            self.insertItem(self.count() - 1, path.name, str(path))
        self._files[path.name] = str(path)
        self.setItemData(self.findText(path.name), str(path))
        self.setCurrentIndex(self.findText(path.name))


class MeasurePlot(Plot):
    """A curve over standard deviations, with the position of the shape shown. A click moves it there."""

    chosen = Signal(float)

    def __init__(self, theme: Theme, name: str, unit: str) -> None:
        super().__init__(theme, name, f"{name} along the mode appears here.")
        self.setMinimumWidth(_WIDTH)
        self._unit, self._label = unit, ""
        self.positions: FloatArray = np.empty(0)
        self.values: FloatArray = np.empty(0)
        self._at = 0.0

    @property
    def is_empty(self) -> bool:
        """Whether there is no curve yet."""
        return not len(self.positions)

    def show_curve(self, x: FloatArray, y: FloatArray, label: str) -> None:
        """Show a measure at some standard deviations."""
        self.positions, self.values, self._label = x, y, label
        if len(x):
            ends = f"from {short(float(y[0]))} to {short(float(y[-1]))}"
            self.setAccessibleDescription(f"{ends} {self._unit} over {label}")
        self.redraw()

    def show_place(self, at: float) -> None:
        """Mark the shape shown [SD]."""
        self._at = at
        self.follow()

    def draw(self, figure: "Figure") -> None:
        """Draw the curve."""
        from homolog_app.plots import draw_measure

        title = f"{self.title}\n "  # the value is in the second line, since the plot may be narrow
        draw_measure(figure.subplots(), self.positions, self.values, title, self._label, self.theme.colours)

    def draw_moving(self, figure: "Figure") -> "Sequence[Artist]":
        """Draw the position, and the measure there."""
        from homolog_app.plots import draw_value

        value = float(np.interp(self._at, self.positions, self.values))
        text = f"{short(value)} {self._unit}"
        return draw_value(figure.axes[0], self._at, value, text, self.theme.colours)

    def press(self, event: "MouseEvent") -> None:
        """Go to the clicked position."""
        if len(self.positions) and event.xdata is not None:
            self.chosen.emit(float(np.clip(event.xdata, self.positions[0], self.positions[-1])))


_NOT_MEASURED = "The measures of the subjects appear here."


class BoxPlot(Plot):
    """Quartiles, range and mean of a measure in each group, and every subject."""

    def __init__(self, theme: Theme, name: str, unit: str) -> None:
        super().__init__(theme, name, _NOT_MEASURED)
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
        self.hint.setText("Assign groups in Cohort to see this measure by group.")
        labels = np.array(groups, dtype=object)
        self._parts = [values[(labels == name) & np.isfinite(values)] for name in measure.groups]
        test = "no test" if measure.p is None else p_text(measure.p)
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
        """Show the hint instead of a measure, as for a study without measures."""
        self.measure, self._parts, self.title = None, [], self._name
        self.hint.setText(_NOT_MEASURED)
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
            digits = int(np.clip(np.ceil(-np.log10(deviation / 2.0)), 0, 3)) if deviation > 0.0 else 1
            spread = f"±\u2009{deviation:.{digits}f}" if np.isfinite(deviation) else ""
            fixed = f"{mean:.{digits}f}"
            means.append((f"{fixed}\u2009{spread}".strip(), f"{fixed}\n{spread}".strip(), short(mean)))
        title, colours = self.title.replace(": ", "\n"), self.theme.colours  # the plot may be narrow
        draw_boxes(figure.subplots(), self._parts, measure.groups, means, title, self._unit, colours)


class GroupLegend(QLabel):
    """The groups in the order of the boxes, with their colours and numbers of subjects."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.setObjectName("PlotLegend")
        self.setTextFormat(Qt.TextFormat.RichText)
        self.setContentsMargins(2 * GRID, GRID // 2, GRID, 0)
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        self._theme, self._groups = theme, Counter[str]()
        theme.changed.connect(self._show)

    def show_groups(self, groups: Sequence[str]) -> None:
        """Show the groups of the subjects; subjects without a group have no box."""
        self._groups = Counter(filter(None, groups))
        self._show()

    def _show(self) -> None:
        from homolog_app.plots.model import group_style

        each = (
            f'<span style="color: {group_style(index, self._theme.colours)[0]}">■</span>&nbsp;'
            f"{escape(name)}&nbsp;({self._groups[name]})"
            for index, name in enumerate(sorted(self._groups))
        )
        self.setText("&nbsp;&nbsp; ".join(each))
        self.setVisible(bool(self._groups))


class PairPlot(ScatterPlot):
    """Two measures of every subject, one against the other, with their correlation."""

    is_marked = False

    def __init__(self, theme: Theme) -> None:
        super().__init__(theme)
        self.title = "One measure against another"
        self.setAccessibleName(self.title)
        self.hint.setText(_NOT_MEASURED)

    def show_pair(
        self, points: FloatArray, names: Sequence[str], groups: Sequence[str], labels: tuple[str, str]
    ) -> None:
        """Show two measures (M, 2) of subjects; incomplete ones are omitted."""
        known = np.flatnonzero(np.isfinite(points).all(axis=1)).tolist()
        own = [names[index] for index in known], [groups[index] for index in known]
        self.show_scores(points[known], *own, labels)

    def draw_data(self, axes: "Axes") -> None:
        """Draw the subjects by group, with the correlation of all of them."""
        from homolog_app.plots import draw_scores
        from homolog_app.plots.model import FONT_PT

        colours, ellipses = self.theme.colours, self.options[ELLIPSES]
        draw_scores(axes, self.points, self.groups, self.labels, colours, ellipses=ellipses)
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        rim = np.maximum(0.1 * (high - low), 1e-6)
        axes.set(xlim=(low[0] - rim[0], high[0] + rim[0]), ylim=(low[1] - rim[1], high[1] + rim[1]))
        if len(self.points) > 2 and (high > low).all():
            x, y = self.points.T - self.points.mean(axis=0)[:, None]
            r = f"r = {x @ y / np.sqrt((x @ x) * (y @ y)):.2f}".replace("-", "−")
            axes.set_title(r, loc="right", fontsize=FONT_PT, color=colours.text)  # not over points

    def text_of(self, name: str) -> str:
        """Return a subject's measures as text."""
        index = self.names.index(name)
        each = zip(self.labels, self.points[index].tolist(), strict=True)
        return f"{self.title_of(index)}: " + ", ".join(f"{label} {short(value)}" for label, value in each)


class MeasurePlots(QStackedWidget):
    """The measures side by side as curves along a mode or as boxes by group, or two against each other."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.each = tuple(MeasurePlot(theme, *measure) for measure in MEASURES.items())
        self.boxes = tuple(BoxPlot(theme, *measure) for measure in MEASURES.items())
        self.pairs = PairPlot(theme)
        self.pairs.offer_axes(list(MEASURES))
        self.pairs.axes = (1, 3)
        self.pairs.axes_chosen.connect(self._show_pair)
        self._measures: tuple[Sequence[FloatArray], Sequence[str], Sequence[str]] = ((), (), ())
        self.legend = GroupLegend(theme)
        for plots in (self.each, self.boxes):
            page, row = QWidget(), QHBoxLayout()
            column = QVBoxLayout(page)
            column.setContentsMargins(0, 0, 0, 0)
            for layout in (column, row):
                layout.setSpacing(0)
            if plots is self.boxes:
                column.addWidget(self.legend)
            for plot in plots:
                row.addWidget(plot)
            column.addLayout(row, 1)
            self.addWidget(page)
        self.addWidget(self.pairs)

    def show_measures(
        self, columns: Sequence[FloatArray], groups: Sequence[str], names: Sequence[str]
    ) -> None:
        """Show the columns (M,) of the table by group, and two of them against each other."""
        for plot, values in zip(self.boxes, columns, strict=True):
            plot.show_measure(values, groups)
        self._measures = columns, names, groups
        self.legend.show_groups(groups)
        self._show_pair()

    def _show_pair(self) -> None:
        columns, names, groups = self._measures
        texts = [f"{name.lower()} ({unit})" for name, unit in MEASURES.items()]
        points = np.column_stack([columns[axis] for axis in self.pairs.axes]) if columns else np.empty((0, 2))
        self.pairs.show_pair(points, names, groups, (texts[self.pairs.axes[0]], texts[self.pairs.axes[1]]))

    def clear_measures(self) -> None:
        """Clear the box plots and the scatter plot."""
        self._measures = ((), (), ())
        self.legend.show_groups(())
        self._show_pair()
        for plot in self.boxes:
            plot.clear()


_HIGH = 232


class PercentileBars(Plot):
    """Controls as marks, their middle 90 % as a band, the patient as a diamond."""

    usual = (400, 200)

    def __init__(self, theme: Theme) -> None:
        super().__init__(theme, "The patient among the controls", "")
        self._shown: tuple[PatientComparison, Reference] | None = None

    @property
    def is_empty(self) -> bool:
        """Whether there is no patient."""
        return self._shown is None

    def show_patient(self, comparison: "PatientComparison | None", reference: "Reference | None") -> None:
        """Show a patient, or nothing."""
        self._shown = None if comparison is None or reference is None else (comparison, reference)
        self.setFixedHeight(0 if self._shown is None else scaled(_HIGH))
        if self._shown is not None:
            from homolog_app.plots import percentile_rows

            texts = (f"{name}: {text}" for name, text, *_ in percentile_rows(*self._shown))
            self.setAccessibleDescription("; ".join(texts))
        self.redraw()

    def draw(self, figure: "Figure") -> None:
        """Draw the lines."""
        from homolog_app.plots import draw_percentiles

        assert self._shown is not None
        draw_percentiles(figure.subplots(4, 1), *self._shown, self.theme.colours)
