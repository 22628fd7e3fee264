"""Menus and actions, made from the command table."""

from collections.abc import Callable, Mapping

from PySide6.QtCore import QEvent, QObject, QSize, QTimer, Slot
from PySide6.QtGui import QAction, QActionGroup, QCursor, QEnterEvent, QKeySequence
from PySide6.QtWidgets import QMainWindow, QMenu, QToolButton, QToolTip, QWidget

from homolog_app.window.commands import COMMANDS, MENUS, REASONS, Command, command
from homolog_app.window.theme import Theme, icon

__all__ = ["Actions", "shortcuts"]

Handler = Callable[[], object]

_TIP_MS = 400  # Qt's own tips come after 700


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
    """A button of a command without a text: its tooltip comes soon."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self._soon = QTimer(self, singleShot=True, interval=_TIP_MS)
        self._soon.timeout.connect(self._show_tip)

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

    def enable(self, available: Mapping[str, bool], read_only: str = "") -> None:
        """Enable exactly the commands whose requirements are met; tooltips of the others give the reason.

        Parameters
        ----------
        available : mapping of str to bool
            Whether each need is met.
        read_only : str
            Why nothing can be written into the project; empty if it can.
        """
        for entry in COMMANDS:
            against = read_only if entry.writes else ""
            action, possible = self._actions[entry.id], available[entry.needs] and not against
            reason = "" if possible else against or REASONS[entry.needs]
            if self._reasons.get(entry.id) != reason:
                self._reasons[entry.id] = reason
                action.setEnabled(possible)
                action.setToolTip(self._tip(entry, reason))

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
        menus: dict[str, QMenu] = {name: window.menuBar().addMenu(f"&{name}") for name in MENUS}
        for entry in COMMANDS:
            top, _, below = entry.menu.partition("/")
            if entry.menu not in menus:
                menus[entry.menu] = menus[top].addMenu(below)
            menus[entry.menu].addAction(self._actions[entry.id])
            if entry.ends_section:
                menus[entry.menu].addSeparator()

    def _draw_icons(self) -> None:
        colours = self._theme.colours
        for entry in COMMANDS:
            if entry.icon:
                picture = icon(entry.icon, colours.text, colours.faint, colours.accent)
                self._actions[entry.id].setIcon(picture)
