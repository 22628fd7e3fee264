"""Menus, actions, command palette and list of shortcuts: all made from the command table."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

from PySide6.QtCore import QEvent, QObject, QPoint, QSize, Qt, QTimer, Slot
from PySide6.QtGui import (
    QAction,
    QActionGroup,
    QCursor,
    QEnterEvent,
    QIcon,
    QKeyEvent,
    QKeySequence,
    QPixmap,
    QUndoStack,
)
from PySide6.QtWidgets import (
    QAbstractScrollArea,
    QDialog,
    QGridLayout,
    QHeaderView,
    QLineEdit,
    QMainWindow,
    QMenu,
    QToolButton,
    QToolTip,
    QTreeWidget,
    QTreeWidgetItem,
    QWidget,
)

from homolog_app.window.commands import COMMANDS, MENUS, Command, command
from homolog_app.window.theme import Theme, icon
from homolog_app.window.widgets import (
    DIALOG_EDGES,
    GRID,
    button,
    column,
    grid,
    having,
    keep_space,
    label,
    row,
)

__all__ = [
    "Actions",
    "CommandPalette",
    "ShortcutSheet",
    "matches",
    "ranked",
    "shortcuts",
]


Handler = Callable[[], object]

_ICON_PX = 32
_TIP_MS = 400  # Qt's default is 700


_STANDARD = {
    "file.open": QKeySequence.StandardKey.Open,
    "file.save": QKeySequence.StandardKey.Save,
    "file.save_as": QKeySequence.StandardKey.SaveAs,
    "file.close": QKeySequence.StandardKey.Close,
    "file.quit": QKeySequence.StandardKey.Quit,
    "edit.undo": QKeySequence.StandardKey.Undo,
    "edit.redo": QKeySequence.StandardKey.Redo,
    "edit.preferences": QKeySequence.StandardKey.Preferences,
    "help.shortcuts": QKeySequence.StandardKey.HelpContents,
}


def shortcuts(entry: Command) -> list[QKeySequence]:
    """Return a command's shortcuts: the platform's convention, or its own."""
    own = [QKeySequence(entry.shortcut)] if entry.shortcut else []
    standard = _STANDARD.get(entry.id)
    return (QKeySequence.keyBindings(standard) if standard is not None else []) or own


class _ToolButton(QToolButton):
    """A button of a command that shows no text: its tooltip appears early."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self._soon = QTimer(self, singleShot=True, interval=_TIP_MS)
        self._soon.timeout.connect(self._show_tip)

    def event(self, event: QEvent) -> bool:
        return keep_space(event) or super().event(event)

    def enterEvent(self, event: QEnterEvent) -> None:
        super().enterEvent(event)
        self._soon.start()

    def leaveEvent(self, event: QEvent) -> None:
        super().leaveEvent(event)
        self._soon.stop()

    @Slot()
    def _show_tip(self) -> None:
        if self.underMouse():
            QToolTip.showText(QCursor.pos(), self.toolTip(), self)


class Actions(QObject):
    """One QAction for each command, all owned by the window."""

    def __init__(self, window: QMainWindow, theme: Theme) -> None:
        super().__init__(window)
        self._theme = theme
        self._actions: dict[str, QAction] = {}
        self._reasons: dict[str, str] = {}
        groups: dict[str, QActionGroup] = {}
        for entry in COMMANDS:
            action = QAction(entry.title, window)
            action.setObjectName(entry.id)
            action.setCheckable(entry.checkable)
            action.setShortcuts(shortcuts(entry))
            action.setToolTip(self._tip(entry, ""))
            action.setStatusTip(entry.help)
            if entry.choice:
                group = groups.setdefault(entry.choice, QActionGroup(window))
                group.addAction(action)
            window.addAction(action)
            self._actions[entry.id] = action
        self._fill_menus(window)
        theme.changed.connect(self._draw_icons)
        self._draw_icons()

    def __getitem__(self, identifier: str) -> QAction:
        """Return the action of a command."""
        return self._actions[identifier]

    def connect_handlers(self, handlers: Mapping[str, Handler]) -> None:
        """Connect commands to their handlers."""
        for identifier, handler in handlers.items():
            self._actions[identifier].triggered.connect(lambda _, handler=handler: handler())

    def name_edits(self, undo: QUndoStack) -> None:
        """Let *Undo* and *Redo* name the edit, as in "Undo Set group"."""
        for identifier, signal in (("edit.undo", undo.undoTextChanged), ("edit.redo", undo.redoTextChanged)):
            action = self._actions[identifier]
            signal.connect(partial(_name_edit, action, action.text()))

    def enable(self, obstacles: Mapping[str, str], read_only: str = "") -> None:
        """Enable exactly the commands whose requirements are met; tooltips of the others give the reason.

        Parameters
        ----------
        obstacles : mapping of str to str
            Why each requirement is not met; empty if it is.
        read_only : str
            Why nothing can be written into the project; empty if it can.
        """
        for entry in COMMANDS:
            reason = (read_only if entry.writes else "") or obstacles[entry.needs]
            if self._reasons.get(entry.id) != reason:
                self._reasons[entry.id] = reason
                action = self._actions[entry.id]
                action.setEnabled(not reason)
                action.setToolTip(self._tip(entry, reason))

    def offer(self, widget: QWidget, *identifiers: str) -> None:
        """Offer commands in the context menu of a widget."""

        def pop_up(place: QPoint) -> None:
            menu = QMenu(widget)
            menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
            menu.addActions([self._actions[identifier] for identifier in identifiers])
            area = widget.viewport() if isinstance(widget, QAbstractScrollArea) else widget
            menu.popup(area.mapToGlobal(place))

        widget.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
        widget.customContextMenuRequested.connect(pop_up)

    def button(self, identifier: str, parent: QWidget, size: int = 20) -> QToolButton:
        """Return a tool button of a command."""
        result = _ToolButton(parent)
        result.setDefaultAction(self._actions[identifier])
        result.setIconSize(QSize(size, size))
        result.setAccessibleName(command(identifier).title)
        return result

    def _tip(self, entry: Command, reason: str) -> str:
        known = shortcuts(entry)
        keys = known[0].toString(QKeySequence.SequenceFormat.NativeText) if known else ""
        name = entry.title.rstrip("…")
        lines = [f"{name} ({keys})" if keys else name, entry.help, f"Not now: {reason}." if reason else ""]
        return "\n".join(filter(None, lines))

    def _fill_menus(self, window: QMainWindow) -> None:
        menus: dict[str, QMenu] = {name: window.menuBar().addMenu(name) for name in MENUS}
        for entry in COMMANDS:
            top, _, below = entry.menu.partition("/")
            if entry.menu not in menus:
                menus[entry.menu] = menus[top].addMenu(below)
            menus[entry.menu].addAction(self._actions[entry.id])
            if entry.ends_section:
                menus[entry.menu].addSeparator()
        for menu in (window.menuBar(), *menus.values()):
            _add_mnemonics(menu.actions())

    def _draw_icons(self) -> None:
        colours = self._theme.colours
        for entry in COMMANDS:
            if entry.icon:
                picture = icon(entry.icon, colours.text, colours.faint, colours.accent)
                self._actions[entry.id].setIcon(picture)


def _name_edit(action: QAction, title: str, edit: str) -> None:
    action.setText(f"{title} {edit}".rstrip())


def _add_mnemonics(entries: Sequence[QAction]) -> None:
    """Underline a letter of each entry that no other entry of the menu has, preferably its first."""
    taken: set[str] = set()
    for action in sorted(entries, key=lambda action: len(action.text())):  # short texts first
        text = action.text()
        starts = [at for at, _ in enumerate(text) if at == 0 or text[at - 1] == " "]
        for at in dict.fromkeys([*starts, *range(len(text))]):
            letter = text[at].casefold()
            if letter.isalnum() and letter not in taken:
                taken.add(letter)
                action.setText(f"{text[:at]}&{text[at:]}")
                break


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
        room = QPixmap(_ICON_PX, _ICON_PX)
        room.fill(Qt.GlobalColor.transparent)
        self._blank = QIcon(room)  # aligns the titles
        self.setAccessibleName("Command palette")
        self.resize(560, 420)
        self.query = QLineEdit(placeholderText="Find a command…")
        self.query.setAccessibleName("Find a command")
        self.list = QTreeWidget(columnCount=2)
        having(self.list, headerHidden=True, rootIsDecorated=False, accessibleName="Commands")
        self.list.header().setStretchLastSection(False)
        self.list.header().setSectionResizeMode(0, QHeaderView.ResizeMode.Stretch)
        self.list.header().setSectionResizeMode(1, QHeaderView.ResizeMode.ResizeToContents)
        column(self.query, self.list, on=self, edges=(GRID,))
        self.query.textChanged.connect(self._fill)
        self.query.returnPressed.connect(lambda: self._choose())
        self.list.itemActivated.connect(self._choose)
        self.list.itemClicked.connect(self._choose)
        self.query.installEventFilter(self)
        self.query.setFocus()  # a popup focuses no widget by itself, and typed text would be lost
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
                neighbour = self.list.itemBelow if step > 0 else self.list.itemAbove
                current = self.list.currentItem()
                following = neighbour(current) if current is not None else None
                if following is not None:
                    self.list.setCurrentItem(following)
                return True
        return super().eventFilter(watched, event)

    def _fill(self, query: str) -> None:
        self.list.clear()
        ranking = [entry for entry in ranked(query) if entry.id != "help.palette"]
        possible = {entry.id: self._actions[entry.id].isEnabled() for entry in ranking}
        for entry in sorted(ranking, key=lambda entry: not possible[entry.id]):
            if possible[entry.id] or query.strip():
                self.list.addTopLevelItem(self._item(entry))
        first = self.list.topLevelItem(0)
        if first is None:
            nothing = QTreeWidgetItem(["No matching command"])
            nothing.setDisabled(True)
            self.list.addTopLevelItem(nothing)
        elif not first.isDisabled():
            self.list.setCurrentItem(first)

    def _item(self, entry: Command) -> QTreeWidgetItem:
        """Return the row of a command; that of an unavailable command is disabled and gives the reason."""
        action = self._actions[entry.id]
        keys = action.shortcut().toString(QKeySequence.SequenceFormat.NativeText)
        item = QTreeWidgetItem([entry.title.rstrip("…"), keys])
        item.setIcon(0, self._blank if action.icon().isNull() else action.icon())
        item.setToolTip(0, entry.help if action.isEnabled() else action.toolTip())
        item.setData(0, Qt.ItemDataRole.UserRole, action)
        item.setTextAlignment(1, Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        item.setDisabled(not action.isEnabled())
        return item

    def _choose(self, item: QTreeWidgetItem | None = None) -> None:
        item = item or self.list.currentItem()
        if item is not None and not item.isDisabled():
            self._chosen = item.data(0, Qt.ItemDataRole.UserRole)
            self.accept()


_COLUMNS = (("File", "Edit", "Help"), ("View",), ("Run", "Explore"))


class ShortcutSheet(QDialog):
    """The command table as keys and titles, menu by menu."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setWindowTitle("Keyboard shortcuts")
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        parts = {
            menu: (label(menu, "SectionTitle"), _keys(menu), GRID) for menus in _COLUMNS for menu in menus
        }
        columns = [column(*(part for menu in menus for part in parts[menu]), ...) for menus in _COLUMNS]
        close = button("Close", "primary", self.accept)
        title, all_keys = label("Keyboard shortcuts", "PanelTitle"), row(*columns, gap=5 * GRID)
        column(title, all_keys, [..., close], on=self, edges=DIALOG_EDGES, gap=2 * GRID)


def _keys(menu: str) -> QGridLayout:
    cells = grid(across=3 * GRID, down=2)
    listed = [entry for entry in COMMANDS if entry.menu.split("/")[0] == menu and entry.shortcut]
    for line, entry in enumerate(listed):
        keys = shortcuts(entry)[0].toString(QKeySequence.SequenceFormat.NativeText)
        cells.addWidget(label(entry.title.rstrip("…")), line, 0)
        cells.addWidget(label(keys, "Hint"), line, 1, alignment=Qt.AlignmentFlag.AlignRight)
    cells.setColumnStretch(0, 1)
    return cells
