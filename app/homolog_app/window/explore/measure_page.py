"""The page *Measure*: distances, volume, area, wall thickness, along a mode and for each subject."""

from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QModelIndex, QSortFilterProxyModel, Qt, Signal
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import (
    QComboBox,
    QFrame,
    QHeaderView,
    QLabel,
    QScrollArea,
    QSizePolicy,
    QStackedWidget,
    QTableView,
    QWidget,
)

from homolog.arrays import FloatArray
from homolog.cohort import MESH_SUFFIXES
from homolog.errors import InputError
from homolog.progress import Tick, part_of
from homolog.statistics.cautions import p_text
from homolog.statistics.design import reference_first
from homolog.statistics.welch import GroupMeasure, compare_measure
from homolog_app.rendering.content import SubjectContents, ViewContents
from homolog_app.rendering.text import short
from homolog_app.scenes.shapes import (
    MEAN,
    MEAN_OF,
    aligned_surfaces,
    deviations_of,
    measured_scene,
    mesh_file,
    named_surface,
)
from homolog_app.scenes.states import REACH, MeasureView
from homolog_app.scenes.subjects import single_subject
from homolog_app.window.actions import Actions
from homolog_app.window.explore.controls import SORTED_BY, STEPS, SubjectTable
from homolog_app.window.explore.mode_plots import ELLIPSES, ScatterPlot
from homolog_app.window.explore.page import ExplorePage, ModelCache
from homolog_app.window.explore.plot import Plot
from homolog_app.window.theme import Theme, scaled
from homolog_app.window.widgets import (
    GRID,
    ActionButton,
    NumberBox,
    ValueEdit,
    choice,
    dress_choice,
    dress_table,
    fill,
    having,
    held,
    label,
    link,
    named_rows,
    offer,
    row,
    rule,
    slider,
)
from homolog_app.window.workspace import FileDialogs, Workspace

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.backend_bases import MouseEvent
    from matplotlib.figure import Figure

    from homolog_app.exports.tables import Measures
    from homolog_app.scenes.model_shape import ModelShape
    from homolog_app.window.scene import Pick

__all__ = [
    "MEASURES",
    "BoxPlot",
    "GroupLegend",
    "MeasurePage",
    "MeasurePlot",
    "MeasurePlots",
    "PairPlot",
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
        dress_choice(self, name, f"{name}. Mesh files must be in aligned coordinates (LPS, mm).")
        self.activated.connect(self._choose)

    def show_surfaces(self, subjects: Sequence[str], groups: Sequence[str | None]) -> None:
        """List subjects and the means of groups; the choice stays if it still exists."""
        means = {f"Mean of {group}": f"{MEAN_OF}{group}" for group in reference_first(filter(None, groups))}
        own = {name: name for name in subjects}
        offer(self, self._first | means | own | self._files | {_FILE: _FILE})

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
        self._groups: list[str] = []
        self.measure: GroupMeasure | None = None

    @property
    def is_empty(self) -> bool:
        """Whether there are no groups."""
        return self.measure is None or not self.measure.groups

    def show_measure(self, values: FloatArray, groups: Sequence[str]) -> None:
        """Show a measure of subjects (M,), with the group of each."""
        self.measure = measure = compare_measure(values, groups)
        self.hint.setText("Assign groups in Cohort to see this measure by group.")
        self._groups = reference_first(filter(None, groups))
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
        self.measure, self.title = None, self._name
        self.hint.setText(_NOT_MEASURED)
        self.setAccessibleDescription("")
        self.setToolTip("")
        self.redraw()

    def draw(self, figure: "Figure") -> None:
        """Draw a box for each group, with its name and mean below."""
        from homolog_app.plots import draw_boxes

        measure = self.measure
        assert measure is not None
        title, colours = self.title.replace(": ", "\n"), self.theme.colours  # the plot may be narrow
        places = [self._groups.index(name) for name in measure.groups]
        draw_boxes(figure.subplots(), measure, title, self._unit, colours, places)


class GroupLegend(QLabel):
    """The groups in the order of the boxes, with their colours and numbers of subjects."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        having(self, objectName="PlotLegend", textFormat=Qt.TextFormat.RichText)
        self.setContentsMargins(2 * GRID, GRID // 2, GRID, 0)
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        self._theme, self._groups = theme, Counter[str]()
        theme.changed.connect(self._show)

    def show_groups(self, groups: Sequence[str]) -> None:
        """Show the groups of the subjects; subjects without a group have no box."""
        self._groups = Counter(filter(None, groups))
        self._show()

    def _show(self) -> None:
        from homolog_app.plots.model import group_order, group_style

        each = (
            f'<span style="color: {group_style(index, self._theme.colours)[0]}">■</span>&nbsp;'
            f"{escape(name)}&nbsp;({self._groups[name]})"
            for index, name in enumerate(group_order(list(self._groups)))
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
        from homolog_app.plots import draw_pair

        ellipses = self.options[ELLIPSES]
        draw_pair(axes, self.points, self.groups, self.labels, self.theme.colours, ellipses=ellipses)

    def text_of(self, name: str) -> str:
        """Return a subject's measures as text."""
        index = self.names.index(name)
        each = zip(self.labels, self.points[index].tolist(), strict=True)
        return f"{self.title_of(index)}: " + ", ".join(f"{label} {short(value)}" for label, value in each)


class MeasurePlots(QStackedWidget):
    """The measures side by side as curves along a mode or as boxes by group, or two against each other."""

    chosen = Signal(float)

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
        for above, plots in (((), self.each), ((self.legend,), self.boxes)):
            self.addWidget(held(*above, (row(*plots, gap=0), 1), gap=0))
        self.addWidget(self.pairs)
        self.structures: dict[str, MeasurePlot] = {}
        self._theme, self._page = theme, QWidget()
        self._row = row(on=self._page, gap=0)
        area = QScrollArea(widgetResizable=True)
        area.setFrameShape(QFrame.Shape.NoFrame)
        area.setWidget(self._page)
        self.addWidget(area)

    def show_structures(self, curves: Mapping[str, FloatArray], x: FloatArray, axis: str) -> None:
        """Show volumes of structures and distances between them at positions (n,) [SD], by title."""
        if list(curves) != list(self.structures):
            for plot in self.structures.values():
                plot.hide()  # the event loop deletes it later
                plot.deleteLater()
            heads = {title: _heading(title).removesuffix(")").split("\n(") for title in curves}
            self.structures = {title: MeasurePlot(self._theme, *head) for title, head in heads.items()}
            for plot in self.structures.values():
                plot.chosen.connect(self.chosen)
                self._row.addWidget(plot)
        for title, plot in self.structures.items():
            plot.show_curve(x, curves[title], axis)

    def show_measures(
        self, columns: Sequence[FloatArray], groups: Sequence[str], names: Sequence[str]
    ) -> None:
        """Show the columns (M,) of the table by group, and two of them against each other."""
        measured = [bool(np.isfinite(values).any()) for values in columns]
        for plot, curve, values, shown in zip(self.boxes, self.each, columns, measured, strict=True):
            plot.show_measure(values, groups)
            plot.setVisible(shown)  # open surfaces have no volume
            curve.setVisible(shown)
        if not all(measured[axis] for axis in self.pairs.axes):
            self.pairs.axes = (2, 3)
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


_SAMPLES = 13
_NAME_PX, _NUMBER_PX, _GROUP_PX, _PADDING_PX = 88, 44, 80, 12
_HEADS = ("Subject", "Group", "Dist.\n(mm)", "Vol.\n(ml)", "Area\n(cm²)", "Wall\n(mm)", "Dev.\n(mm)")
_VOLUME = 3
_PARTICLES = ("First particle", "Second particle")
_MAPS = {"None": "none", "Wall thickness": "thickness", "Distance from a surface": "distance"}
_PLOTS = {"Along the mode": 0, "By group": 1, "Scatter plot": 2}
_OF_STRUCTURES, _SEVERAL = "Structures along the mode", 3


class _SubjectView(QTableView):
    """A table whose names take the free width, with a minimum."""

    def show_rows_of(self, rows: QSortFilterProxyModel) -> None:
        """Show sorted rows in columns of fixed widths."""
        dress_table(self, "Measures of the subjects", 200)
        self.setModel(rows)
        self.setSortingEnabled(True)
        self.sortByColumn(0, Qt.SortOrder.AscendingOrder)
        self.setToolTip("Deviation: mean distance of the aligned particles from the mean surface, in mm")
        self.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.Fixed)
        self.fit_columns()

    def fit_columns(self) -> None:
        """Make the columns as wide as their contents."""
        head = self.horizontalHeader().fontMetrics().horizontalAdvance(_HEADS[1]) + _PADDING_PX
        self.setColumnWidth(1, min(max(self.sizeHintForColumn(1), head), scaled(_GROUP_PX)))
        for number in range(2, self.model().columnCount()):
            wide = self.horizontalHeader().sectionSizeHint(number) if number >= len(_HEADS) else 0
            self.setColumnWidth(number, max(scaled(_NUMBER_PX), self.sizeHintForColumn(number), wide))
        self.fit_names()

    def fit_names(self) -> None:
        """Distribute the width."""
        head = self.horizontalHeader()
        others = sum(head.sectionSize(column) for column in range(1, head.count()))
        head.resizeSection(0, max(scaled(_NAME_PX), self.viewport().width() - others))

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Give free width to the names."""
        super().resizeEvent(event)
        self.fit_names()


class MeasurePage(ExplorePage):
    """Two particles, a mode, and the table of the subjects."""

    title = "Measure"
    hint = (
        "Distances, volume, area and wall thickness. Enter two particles, or click two points on the shape."
    )

    def __init__(self, workspace: Workspace, actions: Actions, fitted: ModelCache) -> None:
        super().__init__(workspace, actions, fitted)
        self._of: ModelShape | None = None
        self._subjects: Measures | None = None
        self._along: dict[int, Measures] = {}
        self._request: tuple[object, int] = (None, -1)
        self._next = 0
        tip = "Or click on the shape to set the two particles in turn"
        first, second = (having(NumberBox(), accessibleName=name, toolTip=tip) for name in _PARTICLES)
        self.particles = (first, second)
        self.mode, reach = having(choice("Mode"), minimumContentsLength=8), round(REACH * STEPS)
        about = "Position along the mode in standard deviations"
        self.place = slider(about, -reach, reach, singleStep=STEPS // 10, pageStep=STEPS // 2)
        self.at = ValueEdit("Standard deviations", -REACH, REACH)
        model: dict[str, str | None] = {"Shape along the mode": ""}
        self.who = SurfaceChooser(workspace.files, "Shape shown", model)
        self.beside = SurfaceChooser(workspace.files, "Shape shown next to it", {"None": None} | model)
        self.origin = SurfaceChooser(
            workspace.files, "Surface from which distances are measured", {"Mean surface": MEAN}
        )
        self.map = choice("Map", _MAPS, "Quantity shown by the colours, in mm")
        self.kind = choice("Plots", _PLOTS)
        self.table = SubjectTable(_HEADS, self)
        self._rows = QSortFilterProxyModel(self)
        self._rows.setSourceModel(self.table)
        self._rows.setSortRole(SORTED_BY)
        self.view = _SubjectView()
        self.view.show_rows_of(self._rows)
        actions.offer(self.view, "explore.table")
        self.write_button = ActionButton("Export CSV…", actions["explore.table"])
        self.distances_button = ActionButton("Export distances…", actions["explore.distances"])
        self.plots = self.charts = MeasurePlots(workspace.theme)
        surfaces = (("Show", self.who), ("Beside", self.beside), ("Map", self.map))
        others = (("Distance from", self.origin), ("Plots", self.kind))
        fill(
            self.body,
            named_rows((*zip(_PARTICLES, self.particles, strict=True), *surfaces, *others)),
            [self.mode, (self.place, 1), self.at, label("SD", "Unit")],
            rule(),
            label("Groomed surfaces at their original size", "SectionTitle"),
            (self.view, 1),
        )
        fill(self.footer, [(self.write_button, 1), (self.distances_button, 1)])
        self.choose_plots()
        self._show_map()
        self._connect()

    def _connect(self) -> None:
        session = self.workspace.session
        self.fitted.changed.connect(self._show_model)
        session.job_changed.connect(self._measure)
        session.study_changed.connect(self._show_table)
        link(self._show_measures, *(box.valueChanged for box in self.particles))
        self.mode.currentIndexChanged.connect(self._show_mode)
        self.place.valueChanged.connect(self._show_place)
        self.at.entered.connect(lambda value: self.place.setValue(round(value * STEPS)))
        for chooser in (self.who, self.beside, self.origin):
            chooser.chosen.connect(self.shown_changed)
            chooser.failed.connect(partial(session.failed.emit, "open"))
        self.map.activated.connect(self._show_map)
        self.kind.activated.connect(self.choose_plots)
        self.charts.pairs.follow_selection(session)
        self.view.selectionModel().currentRowChanged.connect(self._select)
        link(lambda at: self.place.setValue(round(STEPS * at)), *(plot.chosen for plot in self.charts.each))

    def enter(self) -> None:
        """Measure the subjects unless already done."""
        self._request = (None, -1)
        self._measure()

    def handle_pick(self, pick: "Pick") -> None:
        """Set the first or the second particle to the nearest one, in turn."""
        view = self.chosen
        if self.fitted.shape is not None and view is not None:
            result = self.fitted.shape.result
            particles = (
                result.world[result.names.index(pick.name)]
                if pick.name in (view.subject, view.beside)
                else self.fitted.shape.particles(deviations_of(view))
            )
            nearest = int(np.square(particles - pick.place).sum(axis=1).argmin())
            self.particles[self._next].setValue(nearest)
            self._next = 1 - self._next

    def shown(self, subjects: SubjectContents) -> ViewContents:
        """Return the shape at the slider, with a line between the two particles."""
        view, shape = self.chosen, self.fitted.shape
        if view is None or shape is None:
            return ViewContents(subjects)
        contents = [subjects.named(name) for name in (view.subject, view.beside, view.distance_from) if name]
        own = {subject.name: single_subject(subject) for subject in contents if subject is not None}
        return measured_scene(view, shape, own, self._groups)

    @property
    def chosen(self) -> MeasureView | None:
        """The state of the controls; None until the model is fitted."""
        if self.fitted.shape is None:
            return None
        return MeasureView(
            mode=max(0, self.mode.currentIndex()),
            at=self.place.value() / STEPS,
            particles=self.pair,
            subject=self.who.currentData() or "",
            beside=self.beside.currentData(),
            map=self.map.currentData(),
            colour_range=self.colour_range,
            distance_from=self.origin.currentData() or MEAN,
        )

    def write(self, path: Path) -> None:
        """Write the table of the subjects; raises InputError if it can't be written."""
        from homolog_app.exports.tables import write_measures

        result = self.workspace.session.part
        if result is not None and self._subjects is not None:
            present = result.result.with_table_of(self.workspace.session.study.whole.subjects)
            write_measures(path, present, self._subjects, *self.pair)

    def write_distances(self, path: Path) -> str:
        """Write the shown surface with its distances from the other one; return their description.

        Raises
        ------
        InputError
            If the file can't be written.
        """
        from homolog_app.exports.meshes import write_distances

        view, shape, loaded = self.chosen, self.fitted.shape, self.workspace.session.part
        if view is None or shape is None or loaded is None:
            return ""
        own = aligned_surfaces(loaded)
        other, _ = named_surface(view.distance_from, shape, own, self._groups)
        if view.subject:
            surface, _ = named_surface(view.subject, shape, own, self._groups)
        else:
            surface = shape.mean.moved(shape.mean.vertices + shape.moved(deviations_of(view)))
        return write_distances(path, surface, other)

    @property
    def _groups(self) -> Sequence[str | None]:
        """The current group of each subject of the model."""
        assert self.fitted.shape is not None
        return self.fitted.shape.result.with_table_of(self.workspace.session.study.whole.subjects).groups

    @property
    def pair(self) -> tuple[int, int]:
        """The two particles."""
        first, second = self.particles
        return first.value(), second.value()

    def _show_model(self) -> None:
        shape = self.fitted.shape
        if shape is not self._of:
            self._of, self._subjects, self._along, self._request = shape, None, {}, (None, -1)
            mean = shape.model.mean_ if shape else np.zeros((1, 3))
            along = mean[:, np.ptp(mean, axis=0).argmax()]
            for box, value in zip(self.particles, (along.argmin(), along.argmax()), strict=True):
                box.setRange(0, len(mean) - 1)
                box.setValue(int(value))
            self.kind.removeItem(_SEVERAL)
            if shape is not None and shape.result.parts:
                self.kind.addItem(_OF_STRUCTURES, _SEVERAL)
            self.choose_plots()
            self.mode.clear()
            self.mode.addItems([f"Mode {mode + 1}" for mode in range(shape.modes if shape else 0)])
            self.place.setValue(0)
            self._show_measures()
        self._measure()
        self.shown_changed.emit()

    def _show_map(self) -> None:
        """Show the map, and enable the controls of distances."""
        measures = self.map.currentData() == "distance"
        self.origin.setEnabled(measures)
        self.distances_button.setVisible(measures)
        self.shown_changed.emit()

    def _measure(self) -> None:
        """Measure subjects and mode in the computing thread, unless already done."""
        shape, mode, work = self.fitted.shape, self.mode.currentIndex(), self.workspace.work
        busy = self.workspace.session.job.is_busy
        loaded, request = self.workspace.session.part, (shape, mode)
        done = self._subjects is not None and mode in self._along
        if not self.isVisible() or shape is None or loaded is None or mode < 0 or done or busy:
            return
        if request == self._request:
            return
        self._request, known = request, self._subjects

        def measure(tick: Tick) -> "tuple[Measures, Measures]":
            from homolog_app.exports.tables import measures_along, measures_of

            along = measures_along(shape, mode, _amounts(), part_of(tick, 0.0, 0.4))
            return along, known or measures_of(loaded, shape.mean, part_of(tick, 0.4, 1.0))

        def take(measured: "tuple[Measures, Measures]") -> None:
            self._along[mode], self._subjects = measured
            self._show_measures()

        work.compute("measure", measure, "measuring", take)

    def _show_mode(self) -> None:
        self._measure()
        self._show_measures()
        self.shown_changed.emit()

    def _show_place(self) -> None:
        at = self.place.value() / STEPS
        self.at.show_value(at)
        for plot in (*self.charts.each, *self.charts.structures.values()):
            plot.show_place(at)
        self.shown_changed.emit()

    def _show_measures(self) -> None:
        shape, mode = self.fitted.shape, self.mode.currentIndex()
        measures, x = self._along.get(mode), _amounts()
        curves: Sequence[FloatArray] = [np.empty(0)] * len(MEASURES)
        if shape is None or measures is None:
            x = np.empty(0)
        else:
            curves = measures.columns(shape.distances_along(mode, x, self.pair))
        for plot, y in zip(self.charts.each, curves, strict=True):
            plot.show_curve(x, y, f"mode {mode + 1} (SD)")
        self.charts.show_structures(measures.structures if measures else {}, x, f"mode {mode + 1} (SD)")
        self._show_table()
        self._show_place()

    def _show_table(self) -> None:
        shape, loaded = self.fitted.shape, self.workspace.session.part
        for chooser in (self.who, self.beside, self.origin):
            chooser.show_surfaces(shape.result.names if shape else (), self._groups if shape else ())
        if loaded is None or self._subjects is None:
            self.table.show_rows([])
            self.charts.clear_measures()
            return
        from homolog_app.exports.tables import distances

        result = loaded.result.with_table_of(self.workspace.session.study.whole.subjects)
        columns = self._subjects.columns(distances(result.local, *self.pair))
        groups = [group or "" for group in result.groups]
        several = self._subjects.structures
        every = (*columns, *several.values())
        rows = zip(result.names, groups, *(column.tolist() for column in every), strict=True)
        self.table.show_rows(list(rows), [_heading(title) for title in several])
        self.view.fit_columns()
        self.view.setColumnHidden(_VOLUME, bool(np.isnan(self._subjects.volumes).all()))
        self.charts.show_measures(columns, groups, result.names)

    def choose_plots(self) -> None:
        """Show curves, boxes, or one measure against another."""
        self.charts.setCurrentIndex(self.kind.currentData())

    def _select(self, row: QModelIndex, _: QModelIndex) -> None:
        name = self._rows.index(row.row(), 0).data()
        if name:
            self.workspace.session.select([name])


def _heading(title: str) -> str:
    """Return the heading of a measure of structures by its title in tables."""
    kind, *names, unit = title.split("_")
    return f"{'–'.join(names)}\n({unit})" if kind == "distance" else f"{' '.join(names)}\n({unit})"


def _amounts() -> FloatArray:
    return np.linspace(-REACH, REACH, _SAMPLES)
