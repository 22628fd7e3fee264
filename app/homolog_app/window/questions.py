"""Questions to the user, and error reports of commands."""

import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import wraps
from typing import TYPE_CHECKING, Concatenate, ParamSpec, TypeVar, cast

from PySide6.QtCore import QEventLoop, QObject, Qt, QTimer
from PySide6.QtWidgets import QMessageBox, QProgressDialog, QWidget

from homolog.errors import HomologError

if TYPE_CHECKING:
    from homolog_app.window.main_window import MainWindow

__all__ = ["Controller", "ask", "reported", "waited"]

_log = logging.getLogger(__name__)
_LOOK_MS = 100
_SETTLED = 1000
_Given = ParamSpec("_Given")
_Result = TypeVar("_Result")


class Controller(QObject):
    """Base of the controllers: each handles a group of the window's commands."""

    def __init__(self, window: "MainWindow") -> None:
        super().__init__(window)
        self._window, self._workspace = window, window.workspace

    def show_error(self, kind: str, error: BaseException) -> None:
        """Show what went wrong."""
        self._window.help.show_error(kind, error)


_AnyController = TypeVar("_AnyController", bound=Controller)
_Method = Callable[Concatenate[_AnyController, _Given], None]


def ask(
    parent: QWidget,
    title: str,
    details: str,
    answers: tuple[str, ...],
    default: int = 0,
    settled: Callable[[], bool] | None = None,
) -> str:
    """Ask a question.

    Parameters
    ----------
    parent : QWidget
    title, details : str
        What is asked, and what to know for it.
    answers : tuple of str
        On the buttons; closing the box means the last one.
    default : int
        Which answer Enter gives.
    settled : callable, optional
        Whether the question no longer matters: the box is then closed.

    Returns
    -------
    str
        The answer; nothing if the question was settled.
    """
    box = QMessageBox(QMessageBox.Icon.Question, title, title, parent=parent)
    box.setInformativeText(details)
    role = QMessageBox.ButtonRole
    buttons = [
        box.addButton(text, role.RejectRole if text == answers[-1] else role.AcceptRole) for text in answers
    ]
    box.setDefaultButton(buttons[default])
    box.setEscapeButton(buttons[-1])
    timer = QTimer(box, interval=_LOOK_MS)
    if settled is not None:
        timer.timeout.connect(lambda: box.done(_SETTLED) if settled() else None)
        timer.start()
    over = box.exec() == _SETTLED
    timer.stop()
    clicked = box.clickedButton()
    chosen = [text for text, button in zip(answers, buttons, strict=True) if button is clicked]
    box.deleteLater()
    if over and not chosen:
        return ""
    return chosen[0] if chosen else answers[-1]


def waited(parent: QWidget, text: str, work: Callable[[], _Result]) -> _Result:
    """Do something that takes a while in another thread; until it is done only the waiting is shown.

    Returns what `work` returns, raises what it raises.
    """
    dialog = QProgressDialog(text, "", 0, 0, parent)
    dialog.setCancelButton(None)
    dialog.setWindowModality(Qt.WindowModality.WindowModal)
    dialog.setMinimumDuration(300)
    loop, timer = QEventLoop(), QTimer(dialog, interval=20)
    with ThreadPoolExecutor(1, thread_name_prefix="homolog-files") as pool:
        future = pool.submit(work)
        timer.timeout.connect(lambda: loop.quit() if future.done() else dialog.setValue(0))
        timer.start()
        loop.exec(QEventLoop.ProcessEventsFlag.AllEvents)
    timer.stop()
    dialog.close()
    dialog.deleteLater()
    return future.result()


def reported(method: "_Method[_AnyController, _Given]") -> "_Method[_AnyController, _Given]":
    """Show an error of a part's method in the error dialog instead of raising it."""

    @wraps(method)
    def wrapper(self: _AnyController, *args: _Given.args, **kwargs: _Given.kwargs) -> None:
        try:
            method(self, *args, **kwargs)
        except (HomologError, OSError) as error:
            _log.warning("%s", error)
            self.show_error(method.__name__, error)

    return cast("_Method[_AnyController, _Given]", wrapper)
