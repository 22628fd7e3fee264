"""The numbers of a test in rows, one column for each run that was tested."""

from collections.abc import Sequence

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QGridLayout, QWidget

from homolog_app.window.widgets import GRID, label

__all__ = ["NumbersTable"]


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
        """Show rows of a name and one value for each heading; headings are shown if there are several."""
        while (item := self._grid.takeAt(0)) is not None:
            widget = item.widget()
            if widget is not None:
                widget.hide()  # what is deleted later is painted until then
                widget.deleteLater()
        self.texts = list(rows)
        lines = [("", *headings), *rows] if len(headings) > 1 else list(rows)
        for line, (name, *values) in enumerate(lines):
            self._grid.addWidget(label(name, "FieldHelp"), line, 0, Qt.AlignmentFlag.AlignTop)
            for column, value in enumerate(values, start=1):
                text = label(value, "FieldHelp" if name == "" else "", wrap=True)
                text.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
                text.setAccessibleName(f"{name}: {value}")
                self._grid.addWidget(text, line, column)
        self._grid.setColumnStretch(len(headings), 1)
