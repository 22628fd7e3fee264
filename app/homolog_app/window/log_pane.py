"""What the program reported: a pane with levels and copy, and the last lines for problem reports."""

import logging
from collections import deque

from PySide6.QtCore import Qt, QTimer
from PySide6.QtWidgets import QApplication, QComboBox, QHBoxLayout, QPlainTextEdit, QVBoxLayout, QWidget

from homolog_app.window.widgets import GRID, button

__all__ = ["LogMemory", "LogPane"]

_KEPT = 2000
_LEVELS = {
    "Everything": logging.DEBUG,
    "Information": logging.INFO,
    "Warnings": logging.WARNING,
    "Errors": logging.ERROR,
}


class LogMemory(logging.Handler):
    """Keeps the last records; any thread may log, the window looks when it has time."""

    def __init__(self) -> None:
        super().__init__()
        self.setFormatter(logging.Formatter("%(asctime)s  %(levelname)-7s  %(message)s", "%H:%M:%S"))
        self.lines: deque[tuple[int, str]] = deque(maxlen=_KEPT)
        self.count = 0

    def emit(self, record: logging.LogRecord) -> None:
        """Take a record."""
        self.lines.append((record.levelno, self.format(record)))
        self.count += 1


class LogPane(QWidget):
    """The lines of a `LogMemory`, from a level on."""

    def __init__(self, memory: LogMemory) -> None:
        super().__init__()
        self.setObjectName("LogPane")
        self.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        self._memory = memory
        self._shown = -1
        self.text = QPlainTextEdit(readOnly=True)
        self.text.setAccessibleName("Log")
        self.level = QComboBox()
        self.level.setAccessibleName("Least level")
        self.level.addItems(list(_LEVELS))
        self.level.setCurrentText("Information")
        self.level.currentTextChanged.connect(self._fill)
        copy = button("Copy")
        copy.clicked.connect(lambda: QApplication.clipboard().setText(self.text.toPlainText()))
        row = QHBoxLayout()
        row.addWidget(self.level)
        row.addStretch()
        row.addWidget(copy)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(2 * GRID, GRID, 2 * GRID, GRID)
        layout.addLayout(row)
        layout.addWidget(self.text)
        self._timer = QTimer(self, interval=250)
        self._timer.timeout.connect(self._look)

    def showEvent(self, event: object) -> None:
        """Look for new lines while visible."""
        self._look()
        self._timer.start()

    def hideEvent(self, event: object) -> None:
        """Rest while hidden."""
        self._timer.stop()

    def _look(self) -> None:
        if self._memory.count != self._shown:
            self._fill()

    def _fill(self) -> None:
        self._shown = self._memory.count
        least = _LEVELS[self.level.currentText()]
        self.text.setPlainText("\n".join(line for level, line in list(self._memory.lines) if level >= least))
        bar = self.text.verticalScrollBar()
        bar.setValue(bar.maximum())
