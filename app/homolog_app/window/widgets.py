"""The small parts that panels are made of; distances are multiples of 8 pixels."""

from collections.abc import Iterable, Mapping

from PySide6.QtCore import Qt, Slot
from PySide6.QtGui import QAction
from PySide6.QtWidgets import (
    QComboBox,
    QFrame,
    QGraphicsOpacityEffect,
    QGridLayout,
    QLabel,
    QPushButton,
    QScrollArea,
    QSizePolicy,
    QSpinBox,
    QTableView,
    QVBoxLayout,
    QWidget,
)

__all__ = [
    "GRID",
    "ActionButton",
    "NumberBox",
    "Panel",
    "button",
    "choice",
    "dress_table",
    "label",
    "named_rows",
    "rule",
    "set_dimmed",
    "set_primary",
]

GRID = 8


def label(text: str, name: str = "", *, wrap: bool = False) -> QLabel:
    """Return a text; `name` picks its look from the style sheet."""
    result = QLabel(text)
    result.setObjectName(name)
    result.setWordWrap(wrap)
    result.setTextFormat(Qt.TextFormat.PlainText)
    return result


def button(text: str, look: str = "") -> QPushButton:
    """Return a push button; look is ``"primary"``, ``"flat"``, ``"pick"``, ``"card"`` or nothing."""
    result = QPushButton(text)
    if look:
        result.setProperty(look, "true")
    return result


class ActionButton(QPushButton):
    """Triggers an action, can be pressed when it can, and says as it does what is missing."""

    def __init__(self, text: str, action: QAction, look: str = "") -> None:
        super().__init__(text)
        if look:
            self.setProperty(look, "true")
        self._action = action
        self.clicked.connect(action.trigger)
        action.changed.connect(self._follow)
        self._follow()

    @Slot()
    def _follow(self) -> None:
        self.setEnabled(self._action.isEnabled())
        self.setToolTip(self._action.toolTip())


_DIMMED = 0.4


def set_dimmed(widget: QWidget, dimmed: bool) -> None:
    """Draw a widget pale, or as usual."""
    effect = widget.graphicsEffect()
    if effect is None:
        effect = QGraphicsOpacityEffect(widget)
        effect.setOpacity(_DIMMED)
        widget.setGraphicsEffect(effect)
    effect.setEnabled(dimmed)


def set_primary(target: QPushButton, primary: bool) -> None:
    """Make a button the one to press next, or an ordinary one."""
    wanted = "true" if primary else "false"
    if target.property("primary") != wanted:
        target.setProperty("primary", wanted)
        target.style().unpolish(target)
        target.style().polish(target)


def choice(name: str, entries: Mapping[str, object] | None = None) -> QComboBox:
    """Return a box to choose from, with its accessible name; it gets as narrow as the panel is.

    Parameters
    ----------
    name : str
    words : mapping of str to object, optional
        What is offered, and the data behind it.
    """
    box = QComboBox()
    box.setAccessibleName(name)
    box.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
    box.setMinimumContentsLength(4)
    for text, data in (entries or {}).items():
        box.addItem(text, data)
    return box


def named_rows(rows: Iterable[tuple[str, QWidget]]) -> QGridLayout:
    """Return names at the left and what they name at the right, below each other."""
    grid = QGridLayout()
    grid.setHorizontalSpacing(GRID)
    grid.setColumnStretch(1, 1)
    for line, (text, named) in enumerate(rows):
        name = label(text)
        name.setBuddy(named)
        grid.addWidget(name, line, 0)
        grid.addWidget(named, line, 1)
    return grid


def dress_table(table: QTableView, name: str, least_height: int) -> None:
    """Let a table choose whole rows, without lines and row numbers, with an accessible name."""
    table.setAccessibleName(name)
    table.setSelectionBehavior(QTableView.SelectionBehavior.SelectRows)
    table.setAlternatingRowColors(True)
    table.setShowGrid(False)
    table.setWordWrap(False)
    table.setTabKeyNavigation(False)
    table.setMinimumHeight(least_height)
    table.verticalHeader().hide()
    table.horizontalHeader().setHighlightSections(False)


def rule() -> QFrame:
    """Return a thin horizontal line."""
    result = QFrame()
    result.setObjectName("Rule")
    return result


class Panel(QWidget):
    """One step's page in the inspector: title, one sentence, a body that scrolls, and the step's button."""

    def __init__(self, title: str, hint: str) -> None:
        super().__init__()
        self.setAccessibleName(title)
        self.body = QVBoxLayout()
        self.body.setContentsMargins(2 * GRID, 0, 2 * GRID, GRID)
        self.body.setSpacing(GRID)
        self.footer = QVBoxLayout()
        self.footer.setContentsMargins(2 * GRID, GRID, 2 * GRID, 2 * GRID)
        self.footer.setSpacing(GRID)
        head = QVBoxLayout()
        head.setContentsMargins(2 * GRID, 2 * GRID, 2 * GRID, GRID)
        head.setSpacing(GRID // 2)
        head.addWidget(label(title, "PanelTitle"))
        head.addWidget(label(hint, "Hint", wrap=True))
        inner = QWidget()
        inner.setLayout(self.body)
        scroll = QScrollArea()
        scroll.setWidgetResizable(True)
        scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        scroll.setWidget(inner)
        scroll.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Expanding)
        outer = QVBoxLayout(self)
        outer.setContentsMargins(0, 0, 0, 0)
        outer.setSpacing(0)
        outer.addLayout(head)
        outer.addWidget(scroll, 1)
        self.base = QFrame()
        self.base.setObjectName("PanelBase")
        self.base.setLayout(self.footer)
        for widget in (inner, self.base):  # names, however long, never make the panel wider
            widget.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        outer.addWidget(self.base)


class NumberBox(QSpinBox):
    """A whole number; its buttons are hidden by the style sheet.

    Without buttons (`NoButtons`) Qt 6.11.3 and 6.12.0 leave a styled box's number no room. Its margins are
    set here, since versions differ in whether they add the style sheet's.
    """

    def __init__(self, low: int = 0, high: int = 99) -> None:
        super().__init__(minimum=low, maximum=high)
        self.lineEdit().setTextMargins(8, 0, 8, 0)
