"""Choosing another project to show beside the open one."""

from PySide6.QtWidgets import QHBoxLayout, QWidget

from homolog_app.window.actions import Actions
from homolog_app.window.explore.model_cache import ModelCache
from homolog_app.window.widgets import GRID, ActionButton, button, label

__all__ = ["CompareBox"]


class CompareBox(QWidget):
    """Says what is beside the open result, and offers to choose or leave it."""

    def __init__(self, actions: Actions, fitted: ModelCache) -> None:
        super().__init__()
        self._fitted = fitted
        self.choose = ActionButton("Compare with…", actions["explore.compare"])
        self.leave = button("Stop comparing", "flat")
        self.leave.clicked.connect(fitted.compare_no_more)
        self.hint = label("", "Hint", wrap=True)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(GRID)
        row.addWidget(self.choose)
        row.addWidget(self.hint, 1)
        row.addWidget(self.leave)
        fitted.changed.connect(self._show)
        self._show()

    def _show(self) -> None:
        other = self._fitted.other
        self.hint.setText(
            f"Compared with: {other.title}" if other else "Another run or method, for comparison."
        )
        self.leave.setVisible(other is not None)
