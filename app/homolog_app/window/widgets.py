"""Common widgets: labels, buttons, rows, panels, numbers, progress."""

from collections.abc import Callable, Iterable, Mapping
from types import EllipsisType
from typing import Any, TypeVar

from PySide6.QtCore import (
    QCoreApplication,
    QEvent,
    QMargins,
    QObject,
    QPoint,
    QSignalBlocker,
    QSize,
    Qt,
    Signal,
    SignalInstance,
    Slot,
)
from PySide6.QtGui import QAction, QKeyEvent, QResizeEvent, QShowEvent
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractSpinBox,
    QBoxLayout,
    QCheckBox,
    QComboBox,
    QFrame,
    QGraphicsOpacityEffect,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QLayout,
    QLineEdit,
    QProgressBar,
    QPushButton,
    QScrollArea,
    QSizePolicy,
    QSlider,
    QSpinBox,
    QTableView,
    QVBoxLayout,
    QWidget,
)

from homolog_app.rendering.text import duration, parse_number, signed
from homolog_app.window.runner import Status
from homolog_app.window.theme import scaled

__all__ = [
    "GRID",
    "ActionButton",
    "NumberBox",
    "Panel",
    "Part",
    "PercentEdit",
    "Progress",
    "ProgressBar",
    "ValueEdit",
    "button",
    "choice",
    "clear_grid",
    "column",
    "dress_choice",
    "dress_table",
    "enable_all",
    "fill",
    "grid",
    "having",
    "held",
    "keep_space",
    "label",
    "link",
    "named_rows",
    "offer",
    "progress_text",
    "prose",
    "restyle",
    "row",
    "rule",
    "say",
    "scrolling",
    "set_dimmed",
    "set_primary",
    "show_all",
    "slider",
    "tick",
]


GRID = 8
DIALOG_EDGES = (3 * GRID, 3 * GRID, 3 * GRID, 2 * GRID)
_Widget = TypeVar("_Widget", bound=QWidget)
Part = QWidget | QLayout | EllipsisType | int | tuple[QWidget | QLayout, int] | list[Any]
"""What a layout holds: a widget or layout, also with its share of the free room; a row as a list; pixels of
space; or ``...`` for the room that is left."""


def column(
    *parts: Part, on: QWidget | None = None, edges: tuple[int, ...] = (0,), gap: int = GRID
) -> QVBoxLayout:
    """Return parts below each other.

    Parameters
    ----------
    parts : widget, layout, list, int or ...
    on : QWidget, optional
        The widget that is laid out.
    edges : tuple of int
        Margins [px]: all, or left, top, right and bottom.
    gap : int
        Space between the parts [px].
    """
    return fill(QVBoxLayout(on) if on else QVBoxLayout(), *parts, edges=edges, gap=gap)


def row(
    *parts: Part, on: QWidget | None = None, edges: tuple[int, ...] = (0,), gap: int = GRID
) -> QHBoxLayout:
    """Return parts beside each other; see `column`."""
    return fill(QHBoxLayout(on) if on else QHBoxLayout(), *parts, edges=edges, gap=gap)


_Box = TypeVar("_Box", bound=QBoxLayout)


def fill(layout: _Box, *parts: Part, edges: tuple[int, ...] = (), gap: int | None = None) -> _Box:
    """Add parts to a layout, and set its margins and spaces, if given; see `column`."""
    if edges:
        layout.setContentsMargins(QMargins(*(edges if len(edges) > 1 else 4 * edges)))
    if gap is not None:
        layout.setSpacing(gap)
    for each in parts:
        part, share = each if isinstance(each, tuple) else (each, 0)
        if isinstance(part, QWidget):
            layout.addWidget(part, share)
        elif isinstance(part, QLayout):
            layout.addLayout(part, share)
        elif isinstance(part, list):
            layout.addLayout(row(*part))
        elif isinstance(part, int):
            layout.addSpacing(part)
        else:
            layout.addStretch()
    return layout


def held(*parts: Part, gap: int = GRID) -> QWidget:
    """Return a widget with parts below each other, so that they can be shown and hidden together."""
    result = QWidget()
    column(*parts, on=result, gap=gap)
    return result


def named_rows(rows: Iterable[tuple[str, QWidget]], on: QWidget | None = None) -> QGridLayout:
    """Return rows of labels at the left and widgets at the right."""
    result = grid(on)
    result.setColumnStretch(1, 1)
    for line, (text, named) in enumerate(rows):
        name = label(text)
        name.setBuddy(named)
        result.addWidget(name, line, 0)
        result.addWidget(named, line, 1)
    return result


def grid(on: QWidget | None = None, across: int = GRID, down: int = GRID) -> QGridLayout:
    """Return an empty grid without margins, with spaces across and down [px]."""
    result = QGridLayout(on) if on else QGridLayout()
    result.setContentsMargins(0, 0, 0, 0)
    result.setHorizontalSpacing(across)
    result.setVerticalSpacing(down)
    return result


def clear_grid(filled: QGridLayout) -> None:
    """Take all widgets out of a grid, and delete them."""
    while (item := filled.takeAt(0)) is not None:
        if (widget := item.widget()) is not None:
            widget.hide()  # it would be painted until it is deleted
            widget.deleteLater()


def having(widget: _Widget, **properties: object) -> _Widget:
    """Set Qt properties of a widget, such as accessibleName or toolTip, and return it."""
    for name, value in properties.items():
        widget.setProperty(name, value)
    return widget


def link(slot: Callable[..., object] | SignalInstance, *signals: SignalInstance) -> None:
    """Call a function, or emit a signal, with each of several signals."""
    for signal in signals:
        signal.connect(slot)


def show_all(shown: bool, *widgets: QWidget) -> None:
    """Show or hide widgets."""
    for widget in widgets:
        widget.setVisible(shown)


def enable_all(enabled: bool, *widgets: QWidget) -> None:
    """Enable or disable widgets."""
    for widget in widgets:
        widget.setEnabled(enabled)


def say(target: QLabel, text: str) -> None:
    """Show a text in a label, which is hidden without one."""
    target.setText(text)
    target.setVisible(bool(text))


def label(text: str, name: str = "", *, wrap: bool = False) -> QLabel:
    """Return a label; `name` selects its style in the style sheet."""
    return having(QLabel(text), objectName=name, wordWrap=wrap, textFormat=Qt.TextFormat.PlainText)


def prose(name: str = "") -> QLabel:
    """Return an empty label for sentences, which can be selected and copied; `name` selects its style."""
    return having(
        label("", name, wrap=True), textInteractionFlags=Qt.TextInteractionFlag.TextSelectableByMouse
    )


def button(
    text: str, look: str = "", does: Callable[..., object] | None = None, **properties: object
) -> QPushButton:
    """Return a push button.

    Parameters
    ----------
    text : str
    look : str
        ``"primary"``, ``"flat"``, ``"pick"``, ``"card"`` or nothing.
    does : callable, optional
        Is called by a click.
    properties : object
        Qt properties, such as toolTip.
    """
    result = having(QPushButton(text), **({look: "true"} if look else {}), **properties)
    if does is not None:
        result.clicked.connect(does)
    return result


def tick(text: str, tip: str = "", *, checked: bool = False) -> QCheckBox:
    """Return a check box."""
    return having(QCheckBox(text), toolTip=tip, checked=checked)


def slider(name: str, low: int, high: int, **properties: object) -> QSlider:
    """Return a horizontal slider with its accessible name and Qt properties."""
    made = QSlider(Qt.Orientation.Horizontal)
    return having(made, accessibleName=name, minimum=low, maximum=high, **properties)


class ActionButton(QPushButton):
    """A button that triggers an action and has its enabled state and tooltip."""

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
        set_enabled(self, self._action.isEnabled())
        self.setToolTip(self._action.toolTip())


def set_enabled(target: QPushButton, enabled: bool) -> None:
    """Enable or disable a button of a panel.

    The panel holds the focus of a disabled button. Qt would pass it on to another part of the window.
    """
    panel = target.parentWidget()
    while panel is not None and not isinstance(panel, Panel):
        panel = panel.parentWidget()
    owner = target.window().focusWidget()
    if panel is not None and not enabled and owner is target:
        panel.lender = target
        panel.setFocus()
    target.setEnabled(enabled)
    if panel is not None and enabled and panel.lender is target:
        panel.lender = None
        if owner is panel:
            target.setFocus()


_DIMMED = 0.4


def set_dimmed(widget: QWidget, dimmed: bool) -> None:
    """Draw a widget dimmed, or normally."""
    effect = widget.graphicsEffect()
    if effect is None:
        effect = QGraphicsOpacityEffect(widget)
        effect.setOpacity(_DIMMED)
        widget.setGraphicsEffect(effect)
    effect.setEnabled(dimmed)


def set_primary(target: QPushButton, primary: bool) -> None:
    """Style a button as primary or ordinary."""
    restyle(target, "primary", "true" if primary else "false")


def restyle(target: QWidget, name: str, value: object) -> None:
    """Set a property on which the style sheet depends."""
    if target.property(name) != value:
        target.setProperty(name, value)
        target.style().unpolish(target)
        target.style().polish(target)


def choice(name: str, entries: Mapping[str, object] | None = None, tip: str = "") -> QComboBox:
    """Return a combo box with its accessible name; it can be as narrow as the panel.

    Parameters
    ----------
    name : str
    entries : mapping of str to object, optional
        The items, and their data.
    tip : str
        Tooltip.
    """
    box = dress_choice(QComboBox(), name, tip)
    offer(box, entries or {})
    return box


_Choice = TypeVar("_Choice", bound=QComboBox)


def dress_choice(box: _Choice, name: str, tip: str = "") -> _Choice:
    """Name a combo box, and let it be as narrow as the panel."""
    least = QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon
    return having(box, accessibleName=name, toolTip=tip, sizeAdjustPolicy=least, minimumContentsLength=4)


def offer(box: QComboBox, entries: Mapping[str, object]) -> None:
    """Offer other items, given with their data, and keep the one that is chosen, or choose the first."""
    kept, chosen = box.currentIndex() >= 0, box.currentData()
    with QSignalBlocker(box):
        if list(entries.items()) != [(box.itemText(at), box.itemData(at)) for at in range(box.count())]:
            box.clear()
            for text, data in entries.items():
                box.addItem(text, data)
        box.setCurrentIndex(max(box.findData(chosen) if kept else 0, 0) if entries else -1)


def dress_table(table: QTableView, name: str, least_height: int) -> None:
    """Configure a table: selection of rows, no lines or row numbers, an accessible name."""
    having(
        table,
        accessibleName=name,
        selectionBehavior=QTableView.SelectionBehavior.SelectRows,
        alternatingRowColors=True,
        showGrid=False,
        wordWrap=False,
        tabKeyNavigation=False,
        minimumHeight=least_height,
    )
    table.verticalHeader().hide()
    table.horizontalHeader().setHighlightSections(False)


def rule() -> QFrame:
    """Return a thin horizontal line."""
    return having(QFrame(), objectName="Rule")


def scrolling(inner: QWidget) -> QScrollArea:
    """Return a widget that scrolls up and down in the room that it gets."""
    result = QScrollArea(widgetResizable=True)
    result.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
    result.setWidget(inner)
    return result


def keep_space(event: QEvent) -> bool:
    """Leave the space bar, a shortcut, to the button that has the focus; return whether it was pressed."""
    is_over = event.type() == QEvent.Type.ShortcutOverride
    if is_space := is_over and isinstance(event, QKeyEvent) and event.key() == Qt.Key.Key_Space:
        event.accept()
    return is_space


class _Body(QWidget):
    """The scrolling body of a panel: at least as high as its texts need at the current width."""

    def __init__(self, body: QVBoxLayout) -> None:
        super().__init__()
        self._body = body
        self.setLayout(body)

    def minimumSizeHint(self) -> QSize:
        """Return the minimum size; the layout's own assumes texts wider than allowed."""
        least = super().minimumSizeHint()
        return QSize(least.width(), max(least.height(), self._body.minimumHeightForWidth(self.width())))

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Request another height when the width changes."""
        super().resizeEvent(event)
        if event.size().width() != event.oldSize().width():
            self.updateGeometry()


class Panel(QWidget):
    """One step's page in the inspector: title, one sentence, a body that scrolls, and the step's button.

    Attributes
    ----------
    lender : QPushButton or None
        The button whose focus the panel holds while it is disabled.
    """

    def __init__(self, title: str, hint: str) -> None:
        super().__init__()
        self.lender: QPushButton | None = None
        self.setAccessibleName(title)
        self.body = column(edges=(2 * GRID, 0, 2 * GRID, GRID))
        inner, self.base = _Body(self.body), having(QFrame(), objectName="PanelBase")
        self.footer = column(on=self.base, edges=(2 * GRID, GRID, 2 * GRID, 2 * GRID))
        self._scroll = scrolling(inner)
        self._scroll.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Expanding)
        for widget in (inner, self.base):  # long names do not make the panel wider
            widget.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        texts = (label(title, "PanelTitle"), label(hint, "Hint", wrap=True))
        head = column(*texts, edges=(2 * GRID, 2 * GRID, 2 * GRID, GRID), gap=GRID // 2)
        column(head, (self._scroll, 1), self.base, on=self, gap=0)

    def take_focus(self) -> None:
        """Let the arrow keys scroll, and Tab reach the first control."""
        self._scroll.setFocus()

    def reveal(self, widget: QWidget, *, at_top: bool = False) -> None:
        """Scroll the body until a widget in it is visible, or at the top."""
        QCoreApplication.sendPostedEvents(self._scroll.widget(), QEvent.Type.LayoutRequest.value)
        self._scroll.ensureWidgetVisible(widget, 0, GRID)
        if at_top:
            bar = self._scroll.verticalScrollBar()
            bar.setValue(bar.value() + widget.mapTo(self._scroll, QPoint()).y() - GRID)

    def showEvent(self, event: QShowEvent) -> None:
        """Watch the wheel over combo boxes and sliders."""
        super().showEvent(event)
        for widget in (w for kind in (QComboBox, QAbstractSpinBox, QSlider) for w in self.findChildren(kind)):
            widget.installEventFilter(self)
            widget.setFocusPolicy(widget.focusPolicy() & Qt.FocusPolicy.StrongFocus)  # not by the wheel
        for each in self.findChildren(QAbstractButton):
            each.installEventFilter(self)
            each.setFocusPolicy(each.focusPolicy() & Qt.FocusPolicy.TabFocus)  # not by a click: Space plays

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Let the wheel scroll the panel instead of changing the value under the pointer."""
        if event.type() == QEvent.Type.Wheel:
            event.ignore()
            return True
        return isinstance(watched, QAbstractButton) and keep_space(event)


class NumberBox(QSpinBox):
    """A whole number; the style sheet hides its buttons: without them Qt 6.12 reserves no space for it."""

    def __init__(self, low: int = 0, high: int = 99) -> None:
        super().__init__(minimum=low, maximum=high)
        self.lineEdit().setTextMargins(8, 0, 8, 0)


class ValueEdit(QLineEdit):
    """Shows a value; typed numbers are clamped to bounds, other input is reverted.

    Parameters
    ----------
    name : str
        Accessible name.
    low, high : float
        Bounds.
    step : float
        Step of the arrow keys.
    form : callable
        Formats a value.
    """

    entered = Signal(float)

    def __init__(
        self, name: str, low: float, high: float, step: float = 0.1, form: Callable[[float], str] = signed
    ) -> None:
        super().__init__()
        self._low, self._high, self._step, self._form = low, high, step, form
        self._value = 0.0
        tip = f"Type a number from {low:g} to {high:g}".replace("-", "−")
        having(self, accessibleName=name, toolTip=tip, alignment=Qt.AlignmentFlag.AlignRight)
        self.setFixedWidth(scaled(64))
        self.editingFinished.connect(self._receive)

    def show_value(self, value: float) -> None:
        """Show a value without emitting `entered`."""
        self._value = value
        self.setText(self._form(value))

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Increase or decrease by a step."""
        steps = {Qt.Key.Key_Up: 1, Qt.Key.Key_Down: -1}.get(Qt.Key(event.key()), 0)
        if steps:
            self._go_to(self._value + steps * self._step)
        else:
            super().keyPressEvent(event)

    @Slot()
    def _receive(self) -> None:
        if self.text() == self._form(self._value):
            return
        try:
            value = parse_number(self.text())
        except ValueError:
            value = self._value
        self._go_to(value if value == value else self._value)

    def _go_to(self, value: float) -> None:
        value = min(max(value, self._low), self._high)
        changed = value != self._value
        self.show_value(value)
        if changed:
            self.entered.emit(value)


class PercentEdit(ValueEdit):
    """A percentage next to a slider; each changes the other."""

    def __init__(self, name: str, slider: QSlider) -> None:
        lowest = 100.0 * slider.minimum() / slider.maximum()
        super().__init__(name, lowest, 100.0, 1.0, lambda value: f"{value:.0f}")
        self.setFixedWidth(scaled(48))
        self.entered.connect(lambda value: slider.setValue(round(value / 100.0 * slider.maximum())))
        slider.valueChanged.connect(lambda value: self.show_value(100.0 * value / slider.maximum()))
        self.show_value(100.0 * slider.value() / slider.maximum())


class ProgressBar(QProgressBar):
    """A bar from 0 to 1000 that is painted with the next frame; Qt's own repaints the whole window."""

    def __init__(self) -> None:
        super().__init__(maximum=1000)
        self.setTextVisible(False)
        self.setAccessibleName("Progress")

    def show_fraction(self, fraction: float) -> None:
        """Show a fraction in [0, 1]."""
        value = round(1000 * fraction)
        if value != self.value():
            self.setUpdatesEnabled(False)
            self.setValue(value)
            self.setUpdatesEnabled(True)


class Progress(QWidget):
    """A bar, the current step, the time left, and *Cancel*."""

    def __init__(self, cancel: QAction) -> None:
        super().__init__()
        self.bar = ProgressBar()
        self.message: QLabel = label("", "Hint", wrap=True)
        self.cancel = button("Cancel", does=cancel.trigger)
        self.buttons = row(self.cancel)
        column(self.bar, self.message, self.buttons, on=self)
        self.hide()

    def show_status(self, status: Status | None) -> None:
        """Show the progress of a job; hide without one."""
        self.setVisible(status is not None)
        if status is not None:
            self.bar.show_fraction(status.fraction)
            self.message.setText(progress_text(status))


def progress_text(status: Status) -> str:
    """Return a status as one line of text."""
    message = status.message[:1].upper() + status.message[1:]
    if status.paused:
        return f"Paused · {message}"
    left = f" · {duration(status.eta_s)} left" if status.eta_s is not None else ""
    return f"{message}{left}"
