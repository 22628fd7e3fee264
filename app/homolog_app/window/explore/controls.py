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
    QMenu,
    QPushButton,
    QWidget,
)

from homolog_app.rendering.text import typeset
from homolog_app.window.actions import Actions
from homolog_app.window.glossary import explanation
from homolog_app.window.widgets import (
    GRID,
    ActionButton,
    choice,
    clear_grid,
    grid,
    having,
    label,
    link,
    prose,
    row,
    tick,
)

__all__ = ["STEPS", "ColumnPicker", "NumbersTable", "Pace", "Player", "SubjectTable"]

STEPS = 100
"""Steps of a slider per standard deviation."""


class NumbersTable(QWidget):
    """Names at the left, values at the right; the text can be selected and copied."""

    def __init__(self) -> None:
        super().__init__()
        self._grid = grid(self, 2 * GRID, GRID // 2)
        self.texts: list[tuple[str, ...]] = []

    def show_rows(self, headings: Sequence[str], rows: Sequence[tuple[str, ...]]) -> None:
        """Show rows of a name and one value per heading; a single heading is hidden."""
        clear_grid(self._grid)
        self.texts = list(rows)
        lines = [("", *headings), *rows] if len(headings) > 1 else list(rows)
        for line, (name, *values) in enumerate(lines):
            self._grid.addWidget(label(name, "FieldHelp", wrap=True), line, 0, Qt.AlignmentFlag.AlignTop)
            for column, value in enumerate(values, start=1):
                text = having(prose("FieldHelp" if name == "" else ""), accessibleName=f"{name}: {value}")
                text.setText(typeset(value))
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
        self._heads, self._more = heads, tuple[str, ...]()
        self._rows: list[tuple[str | float, ...]] = []
        self._digits: list[int] = []

    def show_rows(self, rows: Sequence[tuple[str | float, ...]], more: Sequence[str] = ()) -> None:
        """Set the rows, and the headings of more columns than usual."""
        self.beginResetModel()
        self._rows, self._more = list(rows), tuple(more)
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
        return 0 if parent.isValid() else len(self._heads) + len(self._more)

    def headerData(
        self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole
    ) -> object:
        """Return a column's name, explanation or alignment."""
        across = orientation == Qt.Orientation.Horizontal
        if across and role == Qt.ItemDataRole.TextAlignmentRole:
            is_number = any(isinstance(row[section], float) for row in self._rows)
            side = Qt.AlignmentFlag.AlignRight if is_number else Qt.AlignmentFlag.AlignLeft
            return side | Qt.AlignmentFlag.AlignVCenter
        heads = (*self._heads, *self._more)
        if across and role == Qt.ItemDataRole.ToolTipRole:
            return explanation(heads[section])
        return heads[section] if across and role == Qt.ItemDataRole.DisplayRole else None

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


_PERIOD_S = 4.0
_LEAST_MS = 33
_DRAWING_SHARE = 2.0
_SPEEDS = {"½ ×": 0.5, "1 ×": 1.0, "2 ×": 2.0}


class ColumnPicker(QPushButton):
    """A button with a list of columns or groups that are ticked.

    Parameters
    ----------
    name, tip : str
        Accessible name and tooltip.
    text : callable
        The text of the button, from the ticked names.
    """

    edited = Signal()

    def __init__(self, name: str, tip: str, text: Callable[[list[str]], str]) -> None:
        super().__init__()
        having(self, accessibleName=name, toolTip=tip)
        self._text, self._entries = text, having(QMenu(self), toolTipsVisible=True)
        self.setMenu(self._entries)

    def offer(
        self,
        problems: Mapping[str, str],
        *,
        title: Callable[[str], str] = str,
        tip: str = "",
        ticked: bool = False,
    ) -> None:
        """Offer names; ticks are kept.

        Parameters
        ----------
        problems : mapping of str to str
            The names, each with the reason why it can't be used, or an empty text.
        title : callable
            The text of an entry, from its name.
        tip : str
            Tooltip of an entry that can be used; ``{}`` is its name.
        ticked : bool
            Whether new names are ticked.
        """
        kept = {action.data(): action.isChecked() for action in self._entries.actions()}
        self._entries.clear()
        for name, problem in problems.items():
            action = QAction(title(name).replace("&", "&&"), self._entries, checkable=True)
            action.setData(name)
            action.setEnabled(not problem)
            action.setToolTip(problem or tip.format(name))
            action.setChecked(kept.get(name, ticked) and not problem)
            link(self._report, action.toggled)
            self._entries.addAction(action)
        self.show_chosen()

    @property
    def chosen(self) -> list[str]:
        """The ticked names."""
        return [str(action.data()) for action in self._entries.actions() if action.isChecked()]

    def choose(self, chosen: Callable[[str], bool]) -> None:
        """Tick the names for which a function is true, if they can be used."""
        for action in self._entries.actions():
            action.setChecked(action.isEnabled() and chosen(action.data()))

    def show_chosen(self) -> None:
        """Name the ticked ones on the button."""
        self.setText(self._text(self.chosen).replace("&", "&&"))

    def _report(self) -> None:
        self.show_chosen()
        self.edited.emit()


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
        self.go, self.loop = ActionButton("Play", actions["run.play"]), tick("Loop", checked=True)
        self.speed, self.reach = choice("Speed", _SPEEDS, "Speed"), choice("Range", ranges, "Range")
        for box, least in ((self.speed, 3), (self.reach, 6)):
            having(box, minimumContentsLength=least, currentIndex=min(1, box.count() - 1))
        self.reach.setVisible(len(ranges) > 1)
        row(self.go, self.reach, self.speed, self.loop, ..., on=self)

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
