"""Controls of the pages of *Explore*."""

import math
import time
from collections.abc import Callable, Mapping, Sequence

from PySide6.QtCore import (
    QAbstractTableModel,
    QModelIndex,
    QObject,
    QPersistentModelIndex,
    Qt,
    QTimer,
    Signal,
)
from PySide6.QtGui import QAction
from PySide6.QtWidgets import (
    QCheckBox,
    QGridLayout,
    QHBoxLayout,
    QMenu,
    QPushButton,
    QWidget,
)

from homolog_app.rendering.text import typeset
from homolog_app.window.actions import Actions
from homolog_app.window.explore.page import ModelCache
from homolog_app.window.widgets import GRID, ActionButton, button, choice, label

__all__ = ["STEPS", "CompareBox", "NumbersTable", "Pace", "Player", "SubjectTable"]

STEPS = 100
"""Steps of a slider per standard deviation."""


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
            if not isinstance(value, float):
                return value
            return "–" if math.isnan(value) else f"{value:.{self._digits[index.column()]}f}".replace("-", "−")
        if role == Qt.ItemDataRole.TextAlignmentRole and is_number:
            return Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        return value if role == SORTED_BY else None


def _digits(values: Sequence[float]) -> int:
    """Return the decimals that give the largest value three digits."""
    most = max((abs(value) for value in values if not math.isnan(value)), default=0.0)
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


class ColumnPicker(QPushButton):
    """A button with a list of columns of the table that are ticked."""

    def __init__(self, name: str, none: str) -> None:
        super().__init__(none)
        self.setAccessibleName(name)
        self._none, self._columns = none, QMenu(self)
        self._columns.setToolTipsVisible(True)
        self.setMenu(self._columns)

    def offer(self, columns: Mapping[str, str]) -> None:
        """Offer columns, each with the reason why it can't be used, or an empty text; ticks are kept."""
        kept = self.chosen
        self._columns.clear()
        for name, problem in columns.items():
            action = QAction(name.replace("&", "&&"), self._columns, checkable=True)
            action.setData(name)
            action.setEnabled(not problem)
            action.setToolTip(problem)
            action.setChecked(name in kept and not problem)
            action.toggled.connect(self._show)
            self._columns.addAction(action)
        self._show()

    @property
    def chosen(self) -> list[str]:
        """The ticked columns."""
        return [str(action.data()) for action in self._columns.actions() if action.isChecked()]

    def _show(self) -> None:
        self.setText(", ".join(self.chosen).replace("&", "&&") or self._none)


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
