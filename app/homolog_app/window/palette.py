"""The command palette, and the list of shortcuts."""

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QAction, QKeyEvent, QKeySequence
from PySide6.QtWidgets import (
    QDialog,
    QGridLayout,
    QHBoxLayout,
    QHeaderView,
    QLineEdit,
    QTreeWidget,
    QTreeWidgetItem,
    QVBoxLayout,
    QWidget,
)

from homolog_app.window.actions import Actions, shortcuts
from homolog_app.window.commands import COMMANDS, Command
from homolog_app.window.widgets import GRID, button, label

__all__ = ["CommandPalette", "ShortcutSheet", "matches", "ranked"]


def matches(query: str, command: Command) -> bool:
    """Whether every word of the query occurs in the command's menu, title or help."""
    text = f"{command.menu} {command.title} {command.help}".casefold()
    return all(word in text for word in query.casefold().split())


def ranked(query: str) -> list[Command]:
    """Return the commands that match, best first: by title, then help, then menu."""
    return sorted(
        (command for command in COMMANDS if matches(query, command)),
        key=lambda command: _distance(query, command),
    )


def _distance(query: str, command: Command) -> int:
    title, about = command.title.casefold(), f"{command.title} {command.help}".casefold()
    parts = query.casefold().split()
    starts = [
        all(any(part.startswith(word) for part in text.split()) for word in parts) for text in (title, about)
    ]
    if not parts or title.startswith(query.casefold().strip()):
        return 0
    if starts[0]:
        return 1
    if all(word in title for word in parts):
        return 2
    if starts[1]:
        return 3
    return 4 if all(word in about for word in parts) else 5


class CommandPalette(QDialog):
    """A list of all enabled commands, filtered by the typed text."""

    def __init__(self, parent: QWidget, actions: Actions) -> None:
        super().__init__(parent, Qt.WindowType.Popup)
        self._actions = actions
        self._chosen: QAction | None = None
        self.setAccessibleName("Command palette")
        self.resize(560, 420)
        self.query = QLineEdit(placeholderText="Find a command…")
        self.query.setAccessibleName("Find a command")
        self.list = QTreeWidget()
        self.list.setColumnCount(2)
        self.list.setHeaderHidden(True)
        self.list.setRootIsDecorated(False)
        self.list.header().setStretchLastSection(False)
        self.list.header().setSectionResizeMode(0, QHeaderView.ResizeMode.Stretch)
        self.list.header().setSectionResizeMode(1, QHeaderView.ResizeMode.ResizeToContents)
        self.list.setAccessibleName("Commands")
        layout = QVBoxLayout(self)
        layout.setContentsMargins(8, 8, 8, 8)
        layout.addWidget(self.query)
        layout.addWidget(self.list)
        self.query.textChanged.connect(self._fill)
        self.query.returnPressed.connect(self._choose)
        self.list.itemActivated.connect(self._choose)
        self.list.itemClicked.connect(self._choose)
        self.query.installEventFilter(self)
        self.query.setFocus()  # a popup gives none by itself: what is typed would be lost
        self._fill("")

    @property
    def chosen(self) -> QAction | None:
        """The action to trigger once the palette is closed."""
        return self._chosen

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Let the arrow keys move in the list while the text has the focus."""
        if isinstance(event, QKeyEvent) and event.type() == QEvent.Type.KeyPress:
            step = {Qt.Key.Key_Down: 1, Qt.Key.Key_Up: -1}.get(Qt.Key(event.key()), 0)
            if step:
                beside = self.list.itemBelow if step > 0 else self.list.itemAbove
                here = self.list.currentItem()
                following = beside(here) if here is not None else None
                if following is not None:
                    self.list.setCurrentItem(following)
                return True
        return super().eventFilter(watched, event)

    def _fill(self, query: str) -> None:
        self.list.clear()
        for command in ranked(query):
            action = self._actions[command.id]
            if action.isEnabled() and command.id != "help.palette":
                keys = action.shortcut().toString(QKeySequence.SequenceFormat.NativeText)
                item = QTreeWidgetItem([command.title.rstrip("…"), keys])
                item.setIcon(0, action.icon())
                item.setToolTip(0, command.help)
                item.setData(0, Qt.ItemDataRole.UserRole, action)
                item.setTextAlignment(1, Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
                self.list.addTopLevelItem(item)
        first = self.list.topLevelItem(0)
        if first is not None:
            self.list.setCurrentItem(first)

    def _choose(self) -> None:
        item = self.list.currentItem()
        if item is not None:
            self._chosen = item.data(0, Qt.ItemDataRole.UserRole)
            self.accept()


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
