"""The page *Modes*: shapes along the modes of variation."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import (
    QSignalBlocker,
    Signal,
)
from PySide6.QtWidgets import (
    QButtonGroup,
    QComboBox,
    QPushButton,
    QWidget,
)

from homolog.arrays import FloatArray
from homolog_app.rendering.content import SubjectContents, ViewContents
from homolog_app.rendering.text import short
from homolog_app.scenes.shapes import mode_scene
from homolog_app.scenes.states import REACH, ModesView
from homolog_app.scenes.structures import POSES, SHAPES
from homolog_app.window.actions import Actions
from homolog_app.window.explore.controls import STEPS, Player
from homolog_app.window.explore.mode_plots import ModePlots
from homolog_app.window.explore.page import CompareBox, ExplorePage, ModelCache
from homolog_app.window.form import tab_before
from homolog_app.window.widgets import (
    GRID,
    ValueEdit,
    button,
    choice,
    column,
    enable_all,
    fill,
    grid,
    label,
    link,
    named_rows,
    say,
    slider,
    tick,
)
from homolog_app.window.workspace import Workspace

if TYPE_CHECKING:
    from homolog_app.scenes.model_shape import ModelShape

__all__ = ["ModeSliders", "ModesPage"]


_MORE = 3


class ModeSliders(QWidget):
    """One slider per retained mode, more on demand; they combine freely.

    The chosen mode is the one that plays.
    """

    moved = Signal()
    chosen_changed = Signal(int)

    def __init__(self) -> None:
        super().__init__()
        self.rows: list[_Row] = []
        self._shape: ModelShape | None = None
        self._choice = QButtonGroup(self)
        self._choice.idClicked.connect(self.chosen_changed)
        self._column = column()
        self.more = button("Show more modes", "flat", lambda: self._show_rows(len(self.rows) + _MORE))
        zero = "Set all sliders to zero (M)"
        self.reset = button("Mean shape", "flat", lambda: self.show_values(np.zeros(0)), toolTip=zero)
        column(self._column, [self.more, ..., self.reset], on=self)

    @property
    def values(self) -> FloatArray:
        """The values of the sliders [SD], shape (k,)."""
        return np.array([row.value for row in self.rows])

    @property
    def model(self) -> "ModelShape | None":
        """The model whose sliders are shown."""
        return self._shape

    @property
    def chosen(self) -> int:
        """The mode that plays, counted from 0."""
        return max(0, self._choice.checkedId())

    def show_model(self, shape: "ModelShape | None") -> None:
        """Show the sliders of another model, all at zero."""
        for row in self.rows:
            self._choice.removeButton(row.name)
            self._column.removeWidget(row)
            row.hide()  # the event loop deletes it later
            row.deleteLater()
        self.rows, self._shape = [], shape
        if shape is not None:
            self._show_rows(max(1, shape.parallel.n_retained))
            self.choose(0)

    def choose(self, mode: int) -> None:
        """Choose a mode; its slider is shown if hidden."""
        if self._shape is not None and mode < self._shape.modes:
            self._show_rows(mode + 1)
            self.rows[mode].name.setChecked(True)
            self.chosen_changed.emit(mode)

    def show_values(self, values: FloatArray | Sequence[float]) -> None:
        """Set the sliders of the first modes [SD], the others to zero; `moved` follows once."""
        for index, row in enumerate(self.rows):
            row.show_value(float(values[index]) if index < len(values) else 0.0)
        self.moved.emit()

    def show_value(self, mode: int, value: float) -> None:
        """Set one slider [SD]; `moved` follows."""
        self._show_rows(mode + 1)
        self.rows[mode].show_value(value)
        self.moved.emit()

    def _show_rows(self, count: int) -> None:
        shape = self._shape
        if shape is None:
            return
        for mode in range(len(self.rows), min(count, shape.modes)):
            rms, share = shape.model.standard_deviations_[mode], shape.model.explained_variance_ratio_[mode]
            row = _Row(mode, float(rms), float(share), above=mode < shape.parallel.n_retained)
            row.slider.valueChanged.connect(lambda _, mode=mode: self._follow(mode))
            self._choice.addButton(row.name, mode)
            self._column.addWidget(row)
            self.rows.append(row)
            tab_before(self.more, row.name, row.slider, row.typed)
        self.more.setVisible(len(self.rows) < shape.modes)

    def _follow(self, mode: int) -> None:
        if self._choice.checkedId() != mode:
            self.rows[mode].name.setChecked(True)
            self.chosen_changed.emit(mode)
        self.moved.emit()


class _Row(QWidget):
    """One mode: name, slider, value, and its variance below."""

    def __init__(self, mode: int, rms: float, share: float, *, above: bool) -> None:
        super().__init__()
        name = f"Mode {mode + 1}"
        self.name: QPushButton = button(name, "pick", checkable=True, toolTip="Play this mode")
        of, retained = (" of variance", "") if above else ("", " · not retained")
        text = f"{100 * share:.1f} %{of} · {short(rms)} mm at 1 SD{retained}"
        reach, about = round(REACH * STEPS), label(text, "FieldHelp")
        about.setToolTip("Root-mean-square displacement of the particles at one standard deviation")
        steps = {"singleStep": STEPS // 10, "pageStep": STEPS // 2}
        titled = f"{name} in standard deviations"
        self.slider = slider(titled, -reach, reach, accessibleDescription=text, **steps)
        self.typed = ValueEdit(f"Standard deviations of mode {mode + 1}", -REACH, REACH)
        cells = grid(self, down=0)
        for place, part in enumerate((self.name, self.slider, self.typed, label("SD", "Unit"))):
            cells.addWidget(part, 0, place)
        cells.addWidget(about, 1, 1, 1, 3)
        cells.setColumnStretch(1, 1)
        self.slider.valueChanged.connect(self._update)
        self.typed.entered.connect(lambda value: self.slider.setValue(round(value * STEPS)))
        self._update()

    @property
    def value(self) -> float:
        """Standard deviations."""
        return self.slider.value() / STEPS

    def show_value(self, value: float) -> None:
        """Move the slider without a signal."""
        with QSignalBlocker(self.slider):
            self.slider.setValue(round(value * STEPS))
        self._update()

    def _update(self) -> None:
        self.typed.show_value(self.value)


_MODEL = "Mean and modes"
_RANGES = {"± 1 SD": 1.0, "± 2 SD": 2.0, "± 3 SD": 3.0}
_LAYOUTS = {
    "The shape": 1,
    "− and + of two modes": 4,
    "− mean + of three modes": 9,
    "Steps along four modes": 16,
}


class ModesPage(ExplorePage):
    """Sliders of the modes, playback, subjects and their reconstruction."""

    title = "Modes"
    compares = True
    hint = "Move the mean shape along its modes of variation, alone or combined."

    def __init__(self, workspace: Workspace, actions: Actions, fitted: ModelCache) -> None:
        super().__init__(workspace, actions, fitted)
        self.sliders = ModeSliders()
        self.player: Player = Player(actions, lambda: fitted.draw_ms, _RANGES)
        self.who = choice("Shape shown")
        self.views: QComboBox = choice("Views", _LAYOUTS)
        self.colours, self.arrows = tick("Displacement colours", checked=True), tick("Arrows")
        self.mark, self.state = label("", "Problem", wrap=True), label("", "Hint", wrap=True)
        self.compare = CompareBox(actions, fitted)
        self.plots = self.charts = ModePlots(workspace.theme)
        self._was_preliminary = False
        self.base.hide()
        fill(
            self.body,
            *(self.mark, self.state, self.sliders, self.player, GRID),
            named_rows((("Show", self.who), ("Views", self.views))),
            [self.colours, self.arrows, ...],
            *(GRID, self.compare, ...),
        )
        self._connect()
        self._show_model()

    def _connect(self) -> None:
        scatter = self.charts.scatter
        self.fitted.changed.connect(self._show_model)
        self.sliders.moved.connect(self._follow_sliders)
        self.player.swung.connect(lambda value: self.sliders.show_value(self.sliders.chosen, value))
        self.who.activated.connect(lambda _: self._choose_subject(self.who.currentText()))
        link(self.shown_changed, self.views.activated, self.player.reach.activated)
        link(self.shown_changed, self.colours.toggled, self.arrows.toggled)
        self.charts.scree.mode_chosen.connect(self.sliders.choose)
        scatter.follow_selection(self.workspace.session)
        scatter.morphed.connect(self._morph)
        scatter.axes_chosen.connect(self._choose_axes)
        self.workspace.session.study_changed.connect(self._show_scores)

    def shown(self, subjects: SubjectContents) -> ViewContents:
        """Return the shape at the sliders, with the chosen subject next to it."""
        view = self.chosen
        if view is None:
            return ViewContents(subjects)
        own = subjects.named(view.subject)
        own = own and replace(own, raw=None, note="groomed surface")
        early = self.fitted.preliminary
        if early is None:
            return mode_scene(view, self.fitted.both, own)
        shown = mode_scene(view, (early.shape,), own)
        marks = (f"{content.note} · {early.description}".removeprefix(" · ") for content in shown.contents)
        marked = [replace(content, note=mark) for content, mark in zip(shown.contents, marks, strict=True)]
        return replace(shown, contents=marked)

    @property
    def chosen(self) -> ModesView | None:
        """The state of the controls; None until the model is fitted."""
        if self._shape is None:
            return None
        return ModesView(
            count=self.views.currentData(),
            deviations=tuple(self.sliders.values.tolist()),
            axes=self.charts.scatter.axes,
            reach=self.player.reach.currentData(),
            subject=self._subject,
            colours=self.colours.isChecked(),
            arrows=self.arrows.isChecked(),
            colour_range=self.colour_range,
            from_middle=self.fitted.from_middle,
        )

    @property
    def _subject(self) -> str:
        return self.who.currentText() if self.who.currentIndex() > 0 else ""

    @property
    def _shape(self) -> "ModelShape | None":
        """The model of the result, or of a run that has not finished."""
        early = self.fitted.preliminary
        return self.fitted.shape if early is None else early.shape

    def _show_model(self) -> None:
        shape, before = self._shape, self.sliders.model
        refines = self._was_preliminary and shape is not None and before is not None
        self._was_preliminary = self.fitted.preliminary is not None
        if shape is None or before is not shape:
            values, chosen, subject = self.sliders.values, self.sliders.chosen, self.who.currentIndex()
            if not refines:
                self.player.stop()
            self.sliders.show_model(shape)
            self.charts.show_model(shape)
            self.charts.scatter.show_cursor(0.0, 0.0)
            self.who.clear()
            self.who.addItems([_MODEL, *(shape.result.names if shape else ())])
            self._show_scores()
            if refines:  # the same modes with more particles: keep the sliders
                self.who.setCurrentIndex(subject)
                self.sliders.choose(chosen)
                self.sliders.show_values(values)
        self.show_state()
        self.shown_changed.emit()

    def show_state(self) -> None:
        """Update status and buttons."""
        shape, job = self._shape, self.workspace.session.job
        enable_all(shape is not None, self.sliders, self.player, self.views)
        apart = self.workspace.session.aspect in (SHAPES, POSES)  # on which no subject's particles lie
        self.who.setEnabled(shape is not None and not apart)
        self.compare.setEnabled(self.fitted.shape is not None)
        self._update_preliminary_mark()
        text = ""  # without a model and work, the panel above has a button for it
        if shape is not None:
            kept = shape.parallel.n_retained
            verb = "mode is" if kept == 1 else "modes are"
            share = 100.0 * float(shape.model.explained_variance_ratio_[:kept].sum())
            text = f"{kept} {verb} retained by parallel analysis: {share:.1f} % of the variance."
        elif job.kind == "model" and job.status is not None:
            text = f"Fitting the shape model: {100 * job.status.fraction:.0f} %"
        elif job.is_busy:
            text = "The shape model is fitted when the current job has ended."
        self.state.setText(text)

    def _update_preliminary_mark(self) -> None:
        """Mark a model of a run that has not finished."""
        early, session = self.fitted.preliminary, self.workspace.session
        text = "The model of the result is being fitted."
        if session.job.run is not None:
            text = "The model is replaced as the run continues."
        elif session.result is None:
            text = "The run was cancelled: keep the particles or resume the run in Correspond."
        say(self.mark, f"{early.description.capitalize()}. {text}" if early is not None else "")

    def _follow_sliders(self) -> None:
        first, second = self.charts.scatter.axes
        values = self.sliders.values
        at = [float(values[mode]) if mode < len(values) else 0.0 for mode in (first, second)]
        self.charts.scatter.show_cursor(at[0], at[1])
        if self.views.currentData() == 1:  # the rows of modes don't depend on the sliders
            self.shown_changed.emit()

    def _choose_axes(self) -> None:
        self._show_scores()
        self._follow_sliders()

    def _morph(self, x: float, y: float) -> None:
        self.player.stop()
        first, second = self.charts.scatter.axes
        self.sliders.show_value(first, x)
        if second != first:
            self.sliders.show_value(second, y)

    def _choose_subject(self, name: str) -> None:
        shape = self._shape
        self.player.stop()
        if shape is not None and self._subject:
            self.workspace.session.select([name])
            self.sliders.show_values(self._scores()[shape.result.names.index(name)])
        else:
            self.sliders.show_values(())

    def _scores(self) -> FloatArray:
        shape = self._shape
        assert shape is not None
        return np.asarray(shape.model.scores_ / shape.model.standard_deviations_)

    def _show_scores(self) -> None:
        shape = self._shape
        if shape is None:
            return
        present = {member.name: member.subject.group or "" for member in self.workspace.session.study.members}
        groups = [present.get(name, "") for name in shape.result.names]
        self.charts.show_scores(self._scores(), shape, groups)
        self.charts.scatter.show_selection(self.workspace.session.selection)
