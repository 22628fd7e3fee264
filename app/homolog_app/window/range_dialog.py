"""The range of the colour scale, set by hand."""

from collections.abc import Callable

from PySide6.QtCore import Qt, Slot
from PySide6.QtWidgets import (
    QCheckBox,
    QDialog,
    QDialogButtonBox,
    QFormLayout,
    QLineEdit,
    QVBoxLayout,
    QWidget,
)

from homolog_app.rendering.colours import ColourScale
from homolog_app.rendering.text import parse_number, short
from homolog_app.window.widgets import GRID, button, label

__all__ = ["RangeDialog"]


class RangeDialog(QDialog):
    """Lowest and highest value of the colours; what is chosen is seen at once.

    Parameters
    ----------
    parent : QWidget
    scale : ColourScale
        The present range.
    choose : callable
        Takes the range that is chosen, or None for an automatic one.
    present : callable
        Returns the range that is then in force, None if colours are no longer shown.
    """

    def __init__(
        self,
        parent: QWidget,
        scale: ColourScale,
        choose: Callable[[tuple[float, float] | None], object],
        present: Callable[[], ColourScale | None],
    ) -> None:
        super().__init__(parent)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self._choose, self._present = choose, present
        self.setWindowTitle("Colour range")
        self.setMinimumWidth(360)
        self.low, self.high = QLineEdit(short(scale.low)), QLineEdit(short(scale.high))
        unit = f" ({scale.unit})" if scale.unit else ""
        self.symmetric = QCheckBox("Symmetric about 0")
        form = QFormLayout()
        form.setVerticalSpacing(GRID)
        for text, box in ((f"Lowest{unit}", self.low), (f"Highest{unit}", self.high)):
            box.setAccessibleName(text)
            form.addRow(text, box)
        form.addRow("", self.symmetric)
        self.problem = label("", "Problem", wrap=True)
        self.automatic = button("Automatic")
        self.automatic.setToolTip("Choose the range by the values that are shown")
        buttons = QDialogButtonBox(
            QDialogButtonBox.StandardButton.Apply | QDialogButtonBox.StandardButton.Close
        )
        buttons.addButton(self.automatic, QDialogButtonBox.ButtonRole.ResetRole)
        self.apply = buttons.button(QDialogButtonBox.StandardButton.Apply)
        self.apply.setDefault(True)
        self.apply.clicked.connect(self._apply)
        self.automatic.clicked.connect(lambda: self._receive(None))
        buttons.rejected.connect(self.reject)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(3 * GRID, 3 * GRID, 3 * GRID, 2 * GRID)
        layout.setSpacing(2 * GRID)
        layout.addWidget(label(scale.title, "SectionTitle", wrap=True))
        layout.addLayout(form)
        layout.addWidget(self.problem)
        layout.addWidget(buttons)
        self.symmetric.toggled.connect(self._follow)
        self.symmetric.setChecked(scale.low == -scale.high)
        self.high.textEdited.connect(self._follow)
        self.problem.hide()
        self.high.selectAll()
        self.high.setFocus()

    def _receive(self, chosen: tuple[float, float] | None) -> None:
        """Choose a range, and show the one in force."""
        self._choose(chosen)
        if (scale := self._present()) is not None:
            self.low.setText(short(scale.low))
            self.high.setText(short(scale.high))

    @Slot()
    def _follow(self) -> None:
        """Keep the lower end opposite to the upper one."""
        self.low.setEnabled(not self.symmetric.isChecked())
        if self.symmetric.isChecked():
            text = self.high.text().strip()
            self.low.setText(text[1:] if text[:1] in ("-", "−") else f"−{text}")

    @Slot()
    def _apply(self) -> None:
        try:
            low, high = parse_number(self.low.text()), parse_number(self.high.text())
        except ValueError:
            low = high = 0.0
        valid = low < high and abs(low) + abs(high) < float("inf")
        self.problem.setText("Enter two numbers; the lowest value must be less than the highest.")
        self.problem.setVisible(not valid)
        if valid:
            self._receive((low, high))
