"""A number that is typed beside a slider."""

from PySide6.QtCore import Qt, Signal, Slot
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QLineEdit

from homolog_app.rendering.text import parse_number, signed

__all__ = ["ValueEdit"]


class ValueEdit(QLineEdit):
    """Shows a value with its sign; a number that is typed is kept within bounds, anything else is undone.

    Parameters
    ----------
    name : str
        Accessible name.
    low, high : float
        Bounds.
    step : float
        How far the arrow keys go.
    """

    entered = Signal(float)

    def __init__(self, name: str, low: float, high: float, step: float = 0.1) -> None:
        super().__init__()
        self._low, self._high, self._step = low, high, step
        self._value = 0.0
        self.setAccessibleName(name)
        self.setToolTip(f"Type a number from {signed(low, 0)} to {signed(high, 0)}")
        self.setAlignment(Qt.AlignmentFlag.AlignRight)
        self.setFixedWidth(64)
        self.editingFinished.connect(self._receive)

    def show_value(self, value: float) -> None:
        """Show a value; `entered` does not follow."""
        self._value = value
        self.setText(signed(value))

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Go a step up or down."""
        steps = {Qt.Key.Key_Up: 1, Qt.Key.Key_Down: -1}.get(Qt.Key(event.key()), 0)
        if steps:
            self._go_to(self._value + steps * self._step)
        else:
            super().keyPressEvent(event)

    @Slot()
    def _receive(self) -> None:
        if self.text() == signed(self._value):
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
