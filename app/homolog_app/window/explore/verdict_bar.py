"""The verdict on the model, above the pages of *Explore*."""

from typing import TYPE_CHECKING

from PySide6.QtWidgets import QWidget

from homolog_app.window.dialogs import ask
from homolog_app.window.session import Session
from homolog_app.window.widgets import GRID, column, prose

if TYPE_CHECKING:
    from homolog.inspection.verdict import Verdict

__all__ = ["VerdictBar", "may_use"]

_ANSWERS = "Use it anyway", "Cancel"


class VerdictBar(QWidget):
    """Why a model is doubtful or not usable, and what to do; hidden if it is sound."""

    def __init__(self, session: Session) -> None:
        super().__init__()
        self._session = session
        self.text = prose("Problem")
        column(self.text, on=self, edges=(2 * GRID, GRID, 2 * GRID, 0))
        session.result_changed.connect(self._show)
        self._show()

    def _show(self) -> None:
        verdict = _verdict(self._session)
        self.setVisible(verdict is not None and not verdict.is_sound)
        if verdict is not None:
            self.text.setText(f"This model is {verdict.word}. {verdict.cause} {verdict.remedy}")


def may_use(window: QWidget, session: Session) -> bool:
    """Return whether the result may be analysed: it is usable, or the user says so now or has said so."""
    loaded, verdict = session.part, _verdict(session)
    if verdict is None or verdict.is_usable or session.used_anyway is loaded:
        return True
    details = f"{verdict.cause} {verdict.remedy}\n\n{verdict.numbers}"
    if ask(window, "This model is not usable.", details, _ANSWERS, 1) != _ANSWERS[0]:
        return False
    session.used_anyway = loaded
    return True


def _verdict(session: Session) -> "Verdict | None":
    return session.part.verdict if session.part is not None else None
