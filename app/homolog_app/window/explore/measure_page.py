"""Measures: distances, volume, area, wall thickness, along a mode and for each subject."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QModelIndex, QSortFilterProxyModel, Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import (
    QHBoxLayout,
    QHeaderView,
    QSlider,
    QTableView,
)

from homolog.arrays import FloatArray
from homolog.progress import Tick, part_of
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.studies.study import with_current_table
from homolog_app.views.content import SubjectContents, ViewContents
from homolog_app.views.contents import MEAN, aligned_surfaces, named_surface, single_subject
from homolog_app.views.scenes import deviations_of, measured_scene
from homolog_app.views.view_states import MeasureView
from homolog_app.window.actions import Actions
from homolog_app.window.explore.controls import SORTED_BY, SubjectTable
from homolog_app.window.explore.measure_parts import MeasurePlots, SurfaceChooser
from homolog_app.window.explore.page import ExplorePage, ModelCache
from homolog_app.window.form import named_rows
from homolog_app.window.theme import scaled
from homolog_app.window.widgets import (
    ActionButton,
    NumberBox,
    ValueEdit,
    choice,
    dress_table,
    label,
    rule,
)
from homolog_app.window.workspace import Workspace

if TYPE_CHECKING:
    from homolog_app.exports.tables import Measures
    from homolog_app.studies.model_shape import ModelShape
    from homolog_app.window.interactor import Pick

__all__ = ["MeasurePage"]

_REACH = 3.0
_SAMPLES = 13
_STEPS = 100
_NAME_PX, _NUMBER_PX, _GROUP_PX, _PADDING_PX = 88, 44, 80, 12
_HEADS = ("Subject", "Group", "Dist.\n(mm)", "Vol.\n(ml)", "Area\n(cm²)", "Wall\n(mm)", "Dev.\n(mm)")
_PARTICLES = ("First particle", "Second particle")
_MAPS = {"None": "none", "Wall thickness": "thickness", "Distance from a surface": "distance"}
_PLOTS = {"Along the mode": 0, "By group": 1, "Scatter plot": 2}


class _SubjectView(QTableView):
    """A table whose names take the free width, with a minimum."""

    def fit_names(self) -> None:
        """Distribute the width."""
        head = self.horizontalHeader()
        others = sum(head.sectionSize(column) for column in range(1, len(_HEADS)))
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
        self.particles = (NumberBox(), NumberBox())
        self.mode, self.place = choice("Mode"), QSlider(Qt.Orientation.Horizontal)
        self.at = ValueEdit("Standard deviations", -_REACH, _REACH)
        model: dict[str, str | None] = {"Shape along the mode": ""}
        self.who = SurfaceChooser(workspace.files, "Shape shown", model)
        self.beside = SurfaceChooser(workspace.files, "Shape shown next to it", {"None": None} | model)
        self.origin = SurfaceChooser(
            workspace.files, "Surface from which distances are measured", {"Mean surface": MEAN}
        )
        self.map = choice("Map", _MAPS)
        self.kind = choice("Plots", _PLOTS)
        self.map.setToolTip("Quantity shown by the colours, in mm")
        self.table = SubjectTable(_HEADS, self)
        self._rows = QSortFilterProxyModel(self)
        self._rows.setSourceModel(self.table)
        self._rows.setSortRole(SORTED_BY)
        self.view = _SubjectView()
        actions.offer(self.view, "explore.table")
        self.write_button = ActionButton("Export CSV…", actions["explore.table"])
        self.distances_button = ActionButton("Export distances…", actions["explore.distances"])
        self.plots = self.charts = MeasurePlots(workspace.theme)
        self._lay_out()
        self._connect(actions)

    def _lay_out(self) -> None:
        for title, box in zip(_PARTICLES, self.particles, strict=True):
            box.setAccessibleName(title)
            box.setToolTip("Or click on the shape to set the two particles in turn")
        self.mode.setMinimumContentsLength(8)
        self.place.setRange(round(-_REACH * _STEPS), round(_REACH * _STEPS))
        self.place.setSingleStep(_STEPS // 10)
        self.place.setPageStep(_STEPS // 2)
        self.place.setAccessibleName("Position along the mode in standard deviations")
        along = QHBoxLayout()
        along.addWidget(self.mode)
        along.addWidget(self.place, 1)
        along.addWidget(self.at)
        along.addWidget(label("SD", "Unit"))
        dress_table(self.view, "Measures of the subjects", 200)
        self.view.setModel(self._rows)
        self.view.setSortingEnabled(True)
        self.view.sortByColumn(0, Qt.SortOrder.AscendingOrder)
        self.view.horizontalHeader().setSectionResizeMode(0, QHeaderView.ResizeMode.Fixed)
        for column in range(1, len(_HEADS)):
            self.view.horizontalHeader().setSectionResizeMode(column, QHeaderView.ResizeMode.Fixed)
            self.view.horizontalHeader().resizeSection(
                column, scaled(_NUMBER_PX if column > 1 else _GROUP_PX)
            )
        particles = zip(_PARTICLES, self.particles, strict=True)
        rows = (
            *particles,
            ("Show", self.who),
            ("Beside", self.beside),
            ("Map", self.map),
            ("Distance from", self.origin),
            ("Plots", self.kind),
        )
        self.choose_plots()
        self.body.addLayout(named_rows(rows))
        self.body.addLayout(along)
        self.body.addWidget(rule())
        self.body.addWidget(label("Groomed surfaces at their original size", "SectionTitle"))
        self.view.setToolTip("Deviation: mean distance of the aligned particles from the mean surface, in mm")
        self.body.addWidget(self.view, 1)
        buttons = QHBoxLayout()
        buttons.addWidget(self.write_button, 1)
        buttons.addWidget(self.distances_button, 1)
        self.footer.addLayout(buttons)
        self._show_map()

    def _connect(self, actions: Actions) -> None:
        self.fitted.changed.connect(self._show_model)
        self.workspace.session.job_changed.connect(self._measure)
        self.workspace.session.study_changed.connect(self._show_table)
        for box in self.particles:
            box.valueChanged.connect(self._show_measures)
        self.mode.currentIndexChanged.connect(self._show_mode)
        self.place.valueChanged.connect(self._show_place)
        self.at.entered.connect(lambda value: self.place.setValue(round(value * _STEPS)))
        for chooser in (self.who, self.beside, self.origin):
            chooser.chosen.connect(self.shown_changed)
            chooser.failed.connect(partial(self.workspace.session.failed.emit, "open"))
        self.map.activated.connect(self._show_map)
        self.kind.activated.connect(self.choose_plots)
        self.charts.pairs.subject_chosen.connect(lambda name: self.workspace.session.select([name]))
        self.charts.pairs.subject_toggled.connect(self.workspace.session.toggle_selected)
        self.workspace.session.selection_changed.connect(
            lambda: self.charts.pairs.show_selection(self.workspace.session.selection)
        )
        self.view.selectionModel().currentRowChanged.connect(self._select)
        for plot in self.charts.each:
            plot.chosen.connect(lambda at: self.place.setValue(round(_STEPS * at)))

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
                else self.fitted.shape.model.instance(deviations_of(view))
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
            mode=max(0, self.mode.currentIndex()), at=self.place.value() / _STEPS, particles=self.pair,
            subject=self.who.currentData() or "", beside=self.beside.currentData(),
            map=self.map.currentData(), colour_range=self.colour_range,
            distance_from=self.origin.currentData() or MEAN,
        )  # fmt: skip

    def write(self, path: Path) -> None:
        """Write the table of the subjects; raises InputError if it can't be written."""
        from homolog_app.exports.tables import write_measures

        result = self.workspace.session.result
        if result is not None and self._subjects is not None:
            present = with_current_table(result.result, self.workspace.session.study)
            write_measures(path, present, self._subjects, *self.pair)

    def write_distances(self, path: Path) -> str:
        """Write the shown surface with its distances from the other one; return their description.

        Raises
        ------
        InputError
            If the file can't be written.
        """
        from homolog_app.exports.meshes import write_distances

        view, shape, loaded = self.chosen, self.fitted.shape, self.workspace.session.result
        if view is None or shape is None or loaded is None:
            return ""
        own = aligned_surfaces(loaded)
        other, _ = named_surface(view.distance_from, shape, own, self._groups)
        if view.subject:
            surface, _ = named_surface(view.subject, shape, own, self._groups)
        else:
            moved = shape.moved(deviations_of(view))
            surface = TriangleMesh(shape.mean.vertices + moved, shape.mean.faces)
        return write_distances(path, surface, other)

    @property
    def _groups(self) -> Sequence[str | None]:
        """The current group of each subject of the model."""
        assert self.fitted.shape is not None
        return with_current_table(self.fitted.shape.result, self.workspace.session.study).groups

    @property
    def pair(self) -> tuple[int, int]:
        """The two particles."""
        first, second = self.particles
        return first.value(), second.value()

    def _show_model(self) -> None:
        shape = self.fitted.shape
        if shape is not self._of:
            self._of, self._subjects, self._along, self._request = shape, None, {}, (None, -1)
            mean = shape.model.mean if shape else np.zeros((1, 3))
            along = mean[:, np.ptp(mean, axis=0).argmax()]
            for box, value in zip(self.particles, (along.argmin(), along.argmax()), strict=True):
                box.setRange(0, len(mean) - 1)
                box.setValue(int(value))
            self.mode.clear()
            self.mode.addItems([f"Mode {mode + 1}" for mode in range(shape.modes if shape else 0)])
            self.place.setValue(0)
            self._show_measures()
        self._measure()
        self.shown_changed.emit()

    def _fill_choosers(self) -> None:
        """List the surfaces that can be shown or compared."""
        shape = self.fitted.shape
        for chooser in (self.who, self.beside, self.origin):
            chooser.show_surfaces(shape.result.names if shape else (), self._groups if shape else ())

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
        loaded, request = self.workspace.session.result, (shape, mode)
        done = self._subjects is not None and mode in self._along
        if not self.isVisible() or shape is None or loaded is None or mode < 0 or done or busy:
            return
        if request == self._request:
            return
        self._request, known = request, self._subjects

        def measure(tick: Tick) -> "tuple[Measures, Measures]":
            from homolog_app.exports.tables import distances_from_mean, measure_meshes

            world, centre, amounts = loaded.result.world, shape.model.mean, _amounts()
            own = [loaded.surfaces[name][0] for name in loaded.result.names]
            steps = [amount * np.eye(mode + 1)[mode] for amount in amounts]
            meshes = [TriangleMesh(shape.mean.vertices + shape.moved(at), shape.mean.faces) for at in steps]
            instances = np.stack([shape.model.instance(at) for at in steps])
            curve, apart = (distances_from_mean(item, centre, shape.mean) for item in (instances, world))
            along = measure_meshes(meshes, curve, part_of(tick, 0.0, 0.4))
            return along, known or measure_meshes(own, apart, part_of(tick, 0.4, 1.0))

        def take(measured: "tuple[Measures, Measures]") -> None:
            self._along[mode], self._subjects = measured
            self._show_measures()

        work.compute("measure", measure, "measuring", take)

    def _show_mode(self) -> None:
        self._measure()
        self._show_measures()
        self.shown_changed.emit()

    def _show_place(self) -> None:
        at = self.place.value() / _STEPS
        self.at.show_value(at)
        for plot in self.charts.each:
            plot.show_place(at)
        self.shown_changed.emit()

    def _show_measures(self) -> None:
        """Show the curves and the table for the chosen particles."""
        shape, mode = self.fitted.shape, self.mode.currentIndex()
        measures = self._along.get(mode)
        x, none = _amounts(), np.empty(0)
        axis = f"mode {mode + 1} (SD)"
        if shape is None or measures is None:
            for plot in self.charts.each:
                plot.show_curve(none, none, axis)
        else:
            apart = [float(_apart(shape, mode, amount, self.pair)) for amount in x]
            for plot, y in zip(
                self.charts.each,
                (np.array(apart), measures.volumes, measures.areas, measures.walls, measures.from_mean),
                strict=True,
            ):
                plot.show_curve(x, y, axis)
        self._show_table()
        self._show_place()

    def _show_table(self) -> None:
        self._fill_choosers()
        loaded = self.workspace.session.result
        if loaded is None or self._subjects is None:
            self.table.show_rows([])
            self.charts.clear_measures()
            return
        from homolog_app.exports.tables import distances

        result, measures = with_current_table(loaded.result, self.workspace.session.study), self._subjects
        apart = distances(result.local, *self.pair)
        columns = (apart, measures.volumes, measures.areas, measures.walls, measures.from_mean)
        groups = [group or "" for group in result.groups]
        rows = zip(result.names, groups, *(column.tolist() for column in columns), strict=True)
        self.table.show_rows(list(rows))
        head = self.view.horizontalHeader().fontMetrics().horizontalAdvance(_HEADS[1]) + _PADDING_PX
        widest = max(self.view.sizeHintForColumn(1), head)  # without space for the sort indicator
        self.view.setColumnWidth(1, min(widest, scaled(_GROUP_PX)))
        for column in range(2, len(_HEADS)):
            self.view.setColumnWidth(column, max(scaled(_NUMBER_PX), self.view.sizeHintForColumn(column)))
        self.view.fit_names()
        self.charts.show_measures(columns, groups, result.names)

    def choose_plots(self) -> None:
        """Show curves, boxes, or one measure against another."""
        self.charts.setCurrentIndex(self.kind.currentData())

    def _select(self, row: QModelIndex, _: QModelIndex) -> None:
        name = self._rows.index(row.row(), 0).data()
        if name:
            self.workspace.session.select([name])


def _amounts() -> FloatArray:
    return np.linspace(-_REACH, _REACH, _SAMPLES)


def _apart(shape: "ModelShape", mode: int, amount: float, pair: tuple[int, int]) -> FloatArray:
    ends = [
        shape.model.mean[particle]
        + amount * shape.model.standard_deviations[mode] * shape.model.components[mode, particle]
        for particle in pair
    ]
    return np.asarray(np.linalg.norm(ends[1] - ends[0]))
