"""Controls of the pages of *Explore*."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import (
    QAbstractTableModel,
    QModelIndex,
    QObject,
    QPersistentModelIndex,
    Qt,
    QTimer,
    Signal,
)
from PySide6.QtWidgets import (
    QButtonGroup,
    QCheckBox,
    QGridLayout,
    QHBoxLayout,
    QPushButton,
    QSlider,
    QVBoxLayout,
    QWidget,
)

from homolog.arrays import FloatArray
from homolog_app.rendering.text import short, typeset
from homolog_app.window.actions import Actions
from homolog_app.window.explore.page import ModelCache
from homolog_app.window.form import tab_before
from homolog_app.window.widgets import GRID, ActionButton, ValueEdit, button, choice, label

if TYPE_CHECKING:
    from homolog_app.studies.model_shape import ModelShape

__all__ = ["REACH", "CompareBox", "ModeSliders", "NumbersTable", "Pace", "Player", "SubjectTable"]


class NumbersTable(QWidget):
    """Names at the left, values at the right; the text can be selected and copied."""

    def __init__(self) -> None:
        super().__init__()
        self._grid = QGridLayout(self)
        self._grid.setContentsMargins(0, 0, 0, 0)
        self._grid.setHorizontalSpacing(2 * GRID)
        self._grid.setVerticalSpacing(GRID // 2)
        self.texts: list[tuple[str, ...]] = []

    def show_rows(self, headings: Sequence[str], rows: Sequence[tuple[str, ...]]) -> None:
        """Show rows of a name and one value per heading; a single heading is hidden."""
        while (item := self._grid.takeAt(0)) is not None:
            widget = item.widget()
            if widget is not None:
                widget.hide()  # it would be painted until it is deleted
                widget.deleteLater()
        self.texts = list(rows)
        lines = [("", *headings), *rows] if len(headings) > 1 else list(rows)
        for line, (name, *values) in enumerate(lines):
            self._grid.addWidget(label(name, "FieldHelp", wrap=True), line, 0, Qt.AlignmentFlag.AlignTop)
            for column, value in enumerate(values, start=1):
                text = label(typeset(value), "FieldHelp" if name == "" else "", wrap=True)
                text.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
                text.setAccessibleName(f"{name}: {value}")
                self._grid.addWidget(text, line, column)
        for column in range(self._grid.columnCount()):
            share = 0 if column > len(headings) else 2 if column == 0 else 3
            self._grid.setColumnStretch(column, share)


_Index = QModelIndex | QPersistentModelIndex
SORTED_BY = Qt.ItemDataRole.UserRole


class SubjectTable(QAbstractTableModel):
    """Rows of texts and numbers; a column of numbers has equal decimals and numeric sorting."""

    def __init__(self, heads: Sequence[str], parent: QObject) -> None:
        super().__init__(parent)
        self._heads = heads
        self._rows: list[tuple[str | float, ...]] = []
        self._digits: list[int] = []

    def show_rows(self, rows: Sequence[tuple[str | float, ...]]) -> None:
        """Set the rows."""
        self.beginResetModel()
        self._rows = list(rows)
        columns = zip(*rows, strict=True) if rows else ()
        self._digits = [
            _digits([value for value in column if isinstance(value, float)]) for column in columns
        ]
        self.endResetModel()

    def rowCount(self, parent: _Index = QModelIndex()) -> int:  # noqa: B008 - Qt's
        """Return the number of subjects."""
        return 0 if parent.isValid() else len(self._rows)

    def columnCount(self, parent: _Index = QModelIndex()) -> int:  # noqa: B008 - Qt's
        """Return the number of columns."""
        return 0 if parent.isValid() else len(self._heads)

    def headerData(
        self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole
    ) -> object:
        """Return a column's name, or its alignment."""
        across = orientation == Qt.Orientation.Horizontal
        if across and role == Qt.ItemDataRole.TextAlignmentRole:
            is_number = any(isinstance(row[section], float) for row in self._rows)
            side = Qt.AlignmentFlag.AlignRight if is_number else Qt.AlignmentFlag.AlignLeft
            return side | Qt.AlignmentFlag.AlignVCenter
        return self._heads[section] if across and role == Qt.ItemDataRole.DisplayRole else None

    def data(self, index: _Index, role: int = Qt.ItemDataRole.DisplayRole) -> object:
        """Return the text, sort value or alignment of a cell."""
        value = self._rows[index.row()][index.column()]
        is_number = isinstance(value, float)
        if role == Qt.ItemDataRole.DisplayRole:
            return f"{value:.{self._digits[index.column()]}f}".replace("-", "−") if is_number else value
        if role == Qt.ItemDataRole.TextAlignmentRole and is_number:
            return Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        return value if role == SORTED_BY else None


def _digits(values: Sequence[float]) -> int:
    """Return the decimals that give the largest value three digits."""
    most = max((abs(value) for value in values), default=0.0)
    return max(0, 2 - math.floor(math.log10(most))) if most > 0.0 else 0


class CompareBox(QWidget):
    """Shows the model that is compared with the open result, and buttons to choose or remove it."""

    def __init__(self, actions: Actions, fitted: ModelCache) -> None:
        super().__init__()
        self._fitted = fitted
        self.choose = ActionButton("Compare with…", actions["explore.compare"])
        self.leave = button("Stop comparing", "flat")
        self.leave.clicked.connect(fitted.compare_no_more)
        self.hint = label("", "Hint", wrap=True)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(GRID)
        row.addWidget(self.choose)
        row.addWidget(self.hint, 1)
        row.addWidget(self.leave)
        fitted.changed.connect(self._show)
        self._show()

    def _show(self) -> None:
        other = self._fitted.other
        self.hint.setText(
            f"Compared with: {other.title}" if other else "Another run or method, for comparison."
        )
        self.leave.setVisible(other is not None)


_PERIOD_S = 4.0
_LEAST_MS = 33
_DRAWING_SHARE = 2.0
_SPEEDS = {"½ ×": 0.5, "1 ×": 1.0, "2 ×": 2.0}


class Pace(QTimer):
    """A timer for pictures that follow each other: its interval is at least twice the drawing time.

    Parameters
    ----------
    parent : QObject
    draw_ms : callable
        Current drawing time [ms].
    """

    def __init__(self, parent: QObject, draw_ms: Callable[[], float]) -> None:
        super().__init__(parent, interval=_LEAST_MS)
        self.timeout.connect(lambda: self.setInterval(max(_LEAST_MS, round(_DRAWING_SHARE * draw_ms()))))


class Player(QWidget):
    """Playback: button, speed, range and loop.

    Parameters
    ----------
    actions : Actions
    draw_ms : callable
        Current drawing time [ms].
    ranges : mapping of str to float
        Amplitudes by label; a single range is not offered.
    """

    swung = Signal(float)

    def __init__(self, actions: Actions, draw_ms: Callable[[], float], ranges: Mapping[str, float]) -> None:
        super().__init__()
        self._timer = Pace(self, draw_ms)
        self._timer.timeout.connect(self._step)
        self._phase = self._seen = 0.0
        self.go = ActionButton("Play", actions["run.play"])
        self.speed, self.reach = choice("Speed", _SPEEDS), choice("Range", ranges)
        for box in (self.speed, self.reach):
            box.setMinimumContentsLength(6 if box is self.reach else 3)
            box.setToolTip(box.accessibleName())
            box.setCurrentIndex(min(1, box.count() - 1))
        self.reach.setVisible(len(ranges) > 1)
        self.loop = QCheckBox("Loop")
        self.loop.setChecked(True)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(GRID)
        for widget in (self.go, self.reach, self.speed, self.loop):
            row.addWidget(widget)
        row.addStretch()

    @property
    def is_playing(self) -> bool:
        """Whether it plays."""
        return self._timer.isActive()

    def play_or_stop(self) -> None:
        """Resume or pause."""
        if self.is_playing:
            self.stop()
        else:
            self._seen = time.perf_counter()
            self._timer.start()
            self.go.setText("Pause")

    def stop(self) -> None:
        """Stop."""
        self._timer.stop()
        self.go.setText("Play")

    def _step(self) -> None:
        now = time.perf_counter()
        self._phase += (now - self._seen) * float(self.speed.currentData()) / _PERIOD_S
        self._seen = now
        if self._phase >= 1.0 and not self.loop.isChecked():
            self.stop()
            self._phase = 0.0
            self.swung.emit(0.0)
            return
        self.swung.emit(float(self.reach.currentData()) * math.sin(2.0 * math.pi * self._phase))


REACH = 3.0
"""Range of sliders in standard deviations."""

_STEPS = 100
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
        self._column = QVBoxLayout()
        self._column.setSpacing(GRID)
        self.more = button("Show more modes", "flat")
        self.more.clicked.connect(lambda: self._show_rows(len(self.rows) + _MORE))
        self.reset = button("Mean shape", "flat")
        self.reset.setToolTip("Set all sliders to zero (M)")
        self.reset.clicked.connect(lambda: self.show_values(np.zeros(0)))
        buttons = QHBoxLayout()
        buttons.addWidget(self.more)
        buttons.addStretch()
        buttons.addWidget(self.reset)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(GRID)
        layout.addLayout(self._column)
        layout.addLayout(buttons)

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
            rms, share = shape.model.standard_deviations[mode], shape.model.explained_variance_ratio[mode]
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
        self.name: QPushButton = button(f"Mode {mode + 1}", "pick")
        self.name.setCheckable(True)
        self.name.setToolTip("Play this mode")
        self.slider = QSlider(Qt.Orientation.Horizontal)
        self.slider.setRange(round(-REACH * _STEPS), round(REACH * _STEPS))
        self.slider.setSingleStep(_STEPS // 10)
        self.slider.setPageStep(_STEPS // 2)
        self.slider.setAccessibleName(f"Mode {mode + 1} in standard deviations")
        self.typed = ValueEdit(f"Standard deviations of mode {mode + 1}", -REACH, REACH)
        of, retained = (" of variance", "") if above else ("", " · not retained")
        text = f"{100 * share:.1f} %{of} · {short(rms)} mm at 1 SD{retained}"
        self._about = label(text, "FieldHelp")
        self._about.setToolTip("Root-mean-square displacement of the particles at one standard deviation")
        self.slider.setAccessibleDescription(self._about.text())
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setHorizontalSpacing(GRID)
        grid.setVerticalSpacing(0)
        grid.addWidget(self.name, 0, 0)
        grid.addWidget(self.slider, 0, 1)
        grid.addWidget(self.typed, 0, 2)
        grid.addWidget(label("SD", "Unit"), 0, 3)
        grid.addWidget(self._about, 1, 1, 1, 3)
        grid.setColumnStretch(1, 1)
        self.slider.valueChanged.connect(self._update)
        self.typed.entered.connect(lambda value: self.slider.setValue(round(value * _STEPS)))
        self._update()

    @property
    def value(self) -> float:
        """Standard deviations."""
        return self.slider.value() / _STEPS

    def show_value(self, value: float) -> None:
        """Move the slider without a signal."""
        self.slider.blockSignals(True)
        self.slider.setValue(round(value * _STEPS))
        self.slider.blockSignals(False)
        self._update()

    def _update(self) -> None:
        self.typed.show_value(self.value)
