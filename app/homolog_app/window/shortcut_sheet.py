"""Every shortcut on one page."""

from PySide6.QtCore import Qt
from PySide6.QtGui import QKeySequence
from PySide6.QtWidgets import QDialog, QGridLayout, QHBoxLayout, QVBoxLayout, QWidget

from homolog_app.window.actions import shortcuts
from homolog_app.window.commands import COMMANDS
from homolog_app.window.widgets import GRID, button, label

__all__ = ["ShortcutSheet"]

_COLUMNS = (("File", "Edit", "Run", "Help"), ("View", "Explore"))


class ShortcutSheet(QDialog):
    """The command table as keys and titles, menu by menu."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setWindowTitle("Keyboard shortcuts")
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        row = QHBoxLayout()
        row.setSpacing(5 * GRID)
        for menus in _COLUMNS:
            column = QVBoxLayout()
            column.setSpacing(GRID)
            for menu in menus:
                column.addWidget(label(menu, "SectionTitle"))
                column.addLayout(_rows(menu))
                column.addSpacing(GRID)
            column.addStretch()
            row.addLayout(column)
        close = button("Close", "primary")
        close.clicked.connect(self.accept)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(3 * GRID, 3 * GRID, 3 * GRID, 2 * GRID)
        layout.setSpacing(2 * GRID)
        layout.addWidget(label("Keyboard shortcuts", "PanelTitle"))
        layout.addLayout(row)
        layout.addWidget(close, alignment=Qt.AlignmentFlag.AlignRight)


def _rows(menu: str) -> QGridLayout:
    grid = QGridLayout()
    grid.setHorizontalSpacing(3 * GRID)
    grid.setVerticalSpacing(2)
    listed = [command for command in COMMANDS if command.menu.split("/")[0] == menu and command.shortcut]
    for row, command in enumerate(listed):
        keys = shortcuts(command)[0].toString(QKeySequence.SequenceFormat.NativeText)
        grid.addWidget(label(command.title.rstrip("…")), row, 0)
        grid.addWidget(label(keys, "Hint"), row, 1, alignment=Qt.AlignmentFlag.AlignRight)
    grid.setColumnStretch(0, 1)
    return grid
