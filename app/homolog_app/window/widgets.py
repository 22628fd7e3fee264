"""Common widgets: labels, buttons, rows, panels, numbers, progress."""

from collections.abc import Callable, Mapping

from PySide6.QtCore import QCoreApplication, QEvent, QObject, QPoint, QSize, Qt, Signal, Slot
from PySide6.QtGui import QAction, QKeyEvent, QResizeEvent, QShowEvent
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractSpinBox,
    QComboBox,
    QFrame,
    QGraphicsOpacityEffect,
    QHBoxLayout,
    QLabel,
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
    "PercentEdit",
    "Progress",
    "ProgressBar",
    "ValueEdit",
    "button",
    "choice",
    "dress_table",
    "keep_space",
    "label",
    "progress_text",
    "rule",
    "set_dimmed",
    "set_primary",
]


GRID = 8


def label(text: str, name: str = "", *, wrap: bool = False) -> QLabel:
    """Return a label; `name` selects its style in the style sheet."""
    result = QLabel(text)
    result.setObjectName(name)
    result.setWordWrap(wrap)
    result.setTextFormat(Qt.TextFormat.PlainText)
    return result


def button(text: str, look: str = "") -> QPushButton:
    """Return a push button; its style is ``"primary"``, ``"flat"``, ``"pick"``, ``"card"`` or nothing."""
    result = QPushButton(text)
    if look:
        result.setProperty(look, "true")
    return result


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
    value = "true" if primary else "false"
    if target.property("primary") != value:
        target.setProperty("primary", value)
        target.style().unpolish(target)
        target.style().polish(target)


def choice(name: str, entries: Mapping[str, object] | None = None) -> QComboBox:
    """Return a combo box with its accessible name; it can be as narrow as the panel.

    Parameters
    ----------
    name : str
    entries : mapping of str to object, optional
        The items, and their data.
    """
    box = QComboBox()
    box.setAccessibleName(name)
    box.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
    box.setMinimumContentsLength(4)
    for text, data in (entries or {}).items():
        box.addItem(text, data)
    return box


def dress_table(table: QTableView, name: str, least_height: int) -> None:
    """Configure a table: selection of rows, no lines or row numbers, an accessible name."""
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
        inner = _Body(self.body)
        scroll = self._scroll = QScrollArea(widgetResizable=True)
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
        for widget in (inner, self.base):  # long names do not make the panel wider
            widget.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        outer.addWidget(self.base)

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
        self.setAccessibleName(name)
        self.setToolTip(f"Type a number from {low:g} to {high:g}".replace("-", "−"))
        self.setAlignment(Qt.AlignmentFlag.AlignRight)
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
        self.cancel = button("Cancel")
        self.cancel.clicked.connect(cancel.trigger)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(GRID)
        self.buttons = QHBoxLayout()
        self.buttons.setSpacing(GRID)
        self.buttons.addWidget(self.cancel)
        layout.addWidget(self.bar)
        layout.addWidget(self.message)
        layout.addLayout(self.buttons)
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
