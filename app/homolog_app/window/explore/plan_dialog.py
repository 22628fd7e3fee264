"""The dialog *Plan a study*: power and needed numbers from the open project as a pilot."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import Qt, Slot
from PySide6.QtGui import QFontDatabase
from PySide6.QtWidgets import QDialog, QDialogButtonBox, QLineEdit, QVBoxLayout, QWidget

from homolog_app.rendering.text import parse_number
from homolog_app.window.form import named_rows
from homolog_app.window.widgets import GRID, button, label, set_primary

if TYPE_CHECKING:
    from homolog.comparison.plan import Plan

__all__ = ["PlanDialog"]


class PlanDialog(QDialog):
    """Asks for an effect, and shows the power of studies that look for it.

    Parameters
    ----------
    parent : QWidget
    compute : callable
        Receives the arguments of `homolog.comparison.plan.plan_project`; the answer comes by `show_plan`.
    save : callable
        Saves the plan that it receives.
    """

    def __init__(
        self,
        parent: QWidget,
        compute: Callable[[dict[str, Any]], object],
        save: Callable[["Plan"], object],
    ) -> None:
        super().__init__(parent)
        self.setWindowTitle("Plan a study")
        self.setMinimumWidth(640)
        self._compute, self._keep = compute, save
        self.plan: Plan | None = None
        self.effect, self.width_mm, self.particle = QLineEdit(), QLineEdit(), QLineEdit()
        self.numbers = QLineEdit("8 12 20 30 50 80")
        self.width_mm.setPlaceholderText("4 spacings of the particles")
        self.particle.setPlaceholderText("a place of median variation")
        rows = (
            ("Effect (mm)", self.effect),
            ("Width (mm)", self.width_mm),
            ("Particle", self.particle),
            ("Subjects per group", self.numbers),
        )
        for text, field in rows:
            field.setAccessibleName(text)
        self.problem = label("", "Problem", wrap=True)
        self.answer = label("")
        self.answer.setFont(QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont))
        self.answer.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.summary = label("", wrap=True)
        buttons = QDialogButtonBox(QDialogButtonBox.StandardButton.Close, parent=self)
        self.go, self.save = button("Plan"), button("Save…")
        self.go.setDefault(True)
        set_primary(self.go, primary=True)
        buttons.addButton(self.go, QDialogButtonBox.ButtonRole.ApplyRole)
        buttons.addButton(self.save, QDialogButtonBox.ButtonRole.ActionRole)
        buttons.rejected.connect(self.reject)
        self.go.clicked.connect(self._start)
        self.save.clicked.connect(self._save)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(3 * GRID, 3 * GRID, 3 * GRID, 2 * GRID)
        layout.setSpacing(2 * GRID)
        hint = "A smooth bump in one of two groups, inward if negative. This project is the pilot."
        layout.addWidget(label(hint, "Hint", wrap=True))
        layout.addLayout(named_rows(rows))
        for widget in (self.problem, self.summary, self.answer, buttons):
            layout.addWidget(widget)
        self.show_plan(None)

    def show_plan(self, plan: "Plan | None") -> None:
        """Show a plan, or nothing."""
        self.plan = plan
        lines: list[str] = []
        if plan is not None:
            from homolog_app.report.plan import plan_lines

            lines = plan_lines(plan)
        end = lines.index("") if "" in lines else 0
        self.summary.setText("\n".join(lines[:end]))
        self.answer.setText("\n".join(lines[end + 1 :]))
        self.answer.setMinimumWidth(self.answer.sizeHint().width())
        self.problem.hide()
        for widget in (self.summary, self.answer, self.save):
            widget.setVisible(plan is not None)
        self.adjustSize()

    @Slot()
    def _start(self) -> None:
        """Plan in the computing thread."""
        try:
            given = {
                "effect": parse_number(self.effect.text()),
                "width": parse_number(self.width_mm.text()) if self.width_mm.text().strip() else None,
                "particle": int(self.particle.text()) if self.particle.text().strip() else None,
                "per_group": tuple(map(int, self.numbers.text().replace(",", " ").split())),
            }
        except ValueError:
            self.problem.setText("Enter the effect and its width in mm, and whole numbers of subjects.")
            self.problem.show()
            return
        self.problem.hide()
        self._compute(given)

    @Slot()
    def _save(self) -> None:
        if self.plan is not None:
            self._keep(self.plan)
