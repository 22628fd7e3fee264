"""A slider for each mode, with its value, its variance and its share."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QButtonGroup,
    QGridLayout,
    QHBoxLayout,
    QPushButton,
    QSlider,
    QVBoxLayout,
    QWidget,
)

from homolog.arrays import FloatArray
from homolog_app.rendering.text import short
from homolog_app.window.widgets import GRID, ValueEdit, button, label

if TYPE_CHECKING:
    from homolog_app.studies.model_shape import ModelShape

__all__ = ["REACH", "ModeSliders"]

REACH = 3.0
"""Standard deviations that sliders go to on both sides."""

_STEPS = 100
_MORE = 3


class ModeSliders(QWidget):
    """As many sliders as modes are above chance, more on demand; they combine freely.

    One mode is the chosen one: it plays, and the name of its row is pressed.
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
        self.reset.setToolTip("Put all sliders to zero (M)")
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
        """What the sliders say [SD], shape (k,)."""
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
            row.hide()  # it goes only when the event loop comes round
            row.deleteLater()
        self.rows, self._shape = [], shape
        if shape is not None:
            self._show_rows(max(1, shape.parallel.n_retained))
            self.choose(0)

    def choose(self, mode: int) -> None:
        """Choose a mode; its slider is shown if it was not."""
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
            rms = float(shape.model.standard_deviations[mode]) / len(shape.model.mean) ** 0.5
            share = float(shape.model.explained_variance_ratio[mode])
            row = _Row(mode, rms, share, above=mode < shape.parallel.n_retained)
            row.slider.valueChanged.connect(lambda _, mode=mode: self._follow(mode))
            self._choice.addButton(row.name, mode)
            self._column.addWidget(row)
            self.rows.append(row)
        self.more.setVisible(len(self.rows) < shape.modes)

    def _follow(self, mode: int) -> None:
        if self._choice.checkedId() != mode:
            self.rows[mode].name.setChecked(True)
            self.chosen_changed.emit(mode)
        self.moved.emit()


class _Row(QWidget):
    """One mode: its name, the slider, the value, and below them how much it varies."""

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
        text = f"{100 * share:.1f} % of variance · {short(rms)} mm at 1 SD"
        self._about = label(text if above else f"{text} · not retained", "FieldHelp")
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
