"""The dialog *Plan a study*: power and needed numbers from the open project as a pilot."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import Slot
from PySide6.QtGui import QFontDatabase
from PySide6.QtWidgets import QDialog, QDialogButtonBox, QLineEdit, QWidget

from homolog_app.rendering.text import parse_number
from homolog_app.window.widgets import (
    DIALOG_EDGES,
    GRID,
    button,
    column,
    having,
    label,
    named_rows,
    prose,
    say,
    show_all,
)

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
        having(self, windowTitle="Plan a study", minimumWidth=640)
        self._compute, self._keep = compute, save
        self.plan: Plan | None = None
        self.effect = QLineEdit()
        self.width_mm = QLineEdit(placeholderText="4 spacings of the particles")
        self.particle = QLineEdit(placeholderText="a place of median variation")
        self.numbers = QLineEdit("8 12 20 30 50 80")
        fields = {"Effect (mm)": self.effect, "Width (mm)": self.width_mm, "Particle": self.particle}
        rows = {**fields, "Subjects per group": self.numbers}
        for text, field in rows.items():
            field.setAccessibleName(text)
        self.problem, self.summary = label("", "Problem", wrap=True), label("", wrap=True)
        self.answer = having(prose(), wordWrap=False)
        self.answer.setFont(QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont))
        buttons = QDialogButtonBox(QDialogButtonBox.StandardButton.Close, parent=self)
        self.go = button("Plan", "primary", self._start, default=True)
        self.save = button("Save…", does=self._save)
        buttons.addButton(self.go, QDialogButtonBox.ButtonRole.ApplyRole)
        buttons.addButton(self.save, QDialogButtonBox.ButtonRole.ActionRole)
        buttons.rejected.connect(self.reject)
        hint = "A smooth bump in one of two groups, inward if negative. This project is the pilot."
        parts = (label(hint, "Hint", wrap=True), named_rows(rows.items()), self.problem, self.summary)
        column(*parts, self.answer, buttons, on=self, edges=DIALOG_EDGES, gap=2 * GRID)
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
        show_all(plan is not None, self.summary, self.answer, self.save)
        self.adjustSize()

    @Slot()
    def _start(self) -> None:
        width, particle = self.width_mm.text().strip(), self.particle.text().strip()
        try:
            given = {
                "effect": parse_number(self.effect.text()),
                "width": parse_number(width) if width else None,
                "particle": int(particle) if particle else None,
                "per_group": tuple(map(int, self.numbers.text().replace(",", " ").split())),
            }
        except ValueError:
            say(self.problem, "Enter the effect and its width in mm, and whole numbers of subjects.")
            return
        self.problem.hide()
        self._compute(given)

    @Slot()
    def _save(self) -> None:
        if self.plan is not None:
            self._keep(self.plan)
