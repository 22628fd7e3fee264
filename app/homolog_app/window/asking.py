"""Questions to the user, and errors of what the user ordered."""

import logging
from collections.abc import Callable
from functools import wraps
from typing import Concatenate, ParamSpec, Protocol, TypeVar

from PySide6.QtWidgets import QMessageBox, QWidget

from homolog.errors import HomologError

__all__ = ["ask", "reported"]

_log = logging.getLogger(__name__)
_Given = ParamSpec("_Given")


class _HasWindow(Protocol):
    _window: "_ShowsErrors"


class _ShowsErrors(Protocol):
    helping: "_Helping"


class _Helping(Protocol):
    def show_error(self, kind: str, error: BaseException) -> None: ...


_Owner = TypeVar("_Owner", bound=_HasWindow)


def ask(parent: QWidget, title: str, words: str, answers: tuple[str, ...]) -> str:
    """Ask a question; the first answer is the default, closing the box means the last one."""
    box = QMessageBox(QMessageBox.Icon.Question, title, title, parent=parent)
    box.setInformativeText(words)
    role = QMessageBox.ButtonRole
    buttons = {
        box.addButton(text, role.RejectRole if text == answers[-1] else role.AcceptRole): text
        for text in answers
    }
    box.setDefaultButton(next(iter(buttons)))
    box.setEscapeButton(list(buttons)[-1])
    box.exec()
    answer = buttons.get(box.clickedButton(), answers[-1])
    box.deleteLater()
    return answer


def reported(
    method: Callable[Concatenate[_Owner, _Given], None],
) -> Callable[Concatenate[_Owner, _Given], None]:
    """Show an error of a method in the error dialog of its owner's window."""

    @wraps(method)
    def wrapper(self: _Owner, *args: _Given.args, **kwargs: _Given.kwargs) -> None:
        try:
            method(self, *args, **kwargs)
        except HomologError as error:
            _log.warning("%s", error)
            self._window.helping.show_error(method.__name__, error)

    return wrapper
