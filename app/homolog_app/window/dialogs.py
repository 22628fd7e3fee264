"""Questions, errors and the log."""

import logging
import os
import platform
import re
import sys
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import MappingProxyType
from typing import TypeVar

from PySide6.QtCore import QEventLoop, Qt, QTimer
from PySide6.QtWidgets import (
    QApplication,
    QComboBox,
    QDialog,
    QHBoxLayout,
    QLabel,
    QMessageBox,
    QPlainTextEdit,
    QProgressDialog,
    QWidget,
)

import homolog
import homolog_app
from homolog_app.window.session import Session
from homolog_app.window.theme import Theme, pixmap
from homolog_app.window.widgets import (
    DIALOG_EDGES,
    GRID,
    button,
    column,
    having,
    label,
    offer,
    prose,
    row,
    set_primary,
)

__all__ = [
    "STATUS",
    "ErrorDialog",
    "LogMemory",
    "LogPane",
    "ask",
    "problem_report",
    "wait_until",
    "waited",
]


_log = logging.getLogger(__name__)
STATUS = logging.INFO + 1
"""Level of status messages in the log. They may name any file, and stay out of problem reports."""
logging.addLevelName(STATUS, "STATUS")
_LOOK_MS = 100
_SETTLED = 1000
_Result = TypeVar("_Result")


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
        The question, and further information.
    answers : tuple of str
        Labels of the buttons; closing the box means the last one.
    default : int
        Index of the answer for Enter.
    settled : callable, optional
        Whether the question has become obsolete: the box is then closed.

    Returns
    -------
    str
        The answer; nothing if the question was settled.
    """
    icon = QMessageBox.Icon.Question if len(answers) > 1 else QMessageBox.Icon.Information
    box = QMessageBox(icon, QApplication.applicationDisplayName(), title, parent=parent)  # no second title
    box.setInformativeText(details)
    role = QMessageBox.ButtonRole
    buttons = [
        box.addButton(text, role.RejectRole if text == answers[-1] else role.AcceptRole) for text in answers
    ]
    box.setDefaultButton(buttons[default])
    set_primary(buttons[default], True)
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
    """Run a slow function in another thread and show a busy dialog meanwhile.

    Returns or raises as `work` does.
    """
    with ThreadPoolExecutor(1, thread_name_prefix="homolog-files") as pool:
        future = pool.submit(work)
        wait_until(parent, text, future.done)
    return future.result()


def wait_until(parent: QWidget, text: str, holds: Callable[[], bool]) -> None:
    """Show a busy dialog until a condition holds."""
    if holds():
        return
    dialog = QProgressDialog(text, "", 0, 0, parent)
    dialog.setCancelButton(None)
    dialog.setWindowModality(Qt.WindowModality.WindowModal)
    dialog.setMinimumDuration(300)
    loop, timer = QEventLoop(), QTimer(dialog, interval=20)
    timer.timeout.connect(lambda: loop.quit() if holds() else dialog.setValue(0))
    timer.start()
    loop.exec(QEventLoop.ProcessEventsFlag.AllEvents)
    timer.stop()
    dialog.close()
    dialog.deleteLater()


_KEPT = 2000
_LEVELS = {
    "Everything": logging.DEBUG,
    "Information": logging.INFO,
    "Warnings": logging.WARNING,
    "Errors": logging.ERROR,
}


class LogMemory(logging.Handler):
    """Keeps the last log records of all threads for the window."""

    def __init__(self) -> None:
        super().__init__()
        self.setFormatter(logging.Formatter("%(asctime)s  %(levelname)-7s  %(message)s", "%H:%M:%S"))
        self.lines: deque[tuple[int, str]] = deque(maxlen=_KEPT)
        self.count = 0

    def emit(self, record: logging.LogRecord) -> None:
        """Add a record."""
        self.lines.append((record.levelno, self.format(record)))
        self.count += 1


class LogPane(QWidget):
    """The lines of a `LogMemory` from a minimum level."""

    def __init__(self, memory: LogMemory) -> None:
        super().__init__()
        self.setObjectName("LogPane")
        self.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        self._memory = memory
        self._shown = -1
        self.text = having(QPlainTextEdit(readOnly=True), accessibleName="Log")
        self.level = having(QComboBox(), accessibleName="Lowest level shown")
        offer(self.level, _LEVELS)
        self.level.setCurrentText("Information")
        self.level.currentTextChanged.connect(self._fill)
        copy = button("Copy", does=lambda: QApplication.clipboard().setText(self.text.toPlainText()))
        column([self.level, ..., copy], self.text, on=self, edges=(2 * GRID, GRID, 2 * GRID, GRID))
        self._timer = QTimer(self, interval=250)
        self._timer.timeout.connect(self._look)

    def showEvent(self, event: object) -> None:
        """Poll for new lines while visible."""
        self._look()
        self._timer.start()

    def hideEvent(self, event: object) -> None:
        """Stop polling while hidden."""
        self._timer.stop()

    def _look(self) -> None:
        if self._memory.count != self._shown:
            self._fill()

    def _fill(self) -> None:
        self._shown = self._memory.count
        least = _LEVELS[self.level.currentText()]
        self.text.setPlainText("\n".join(line for level, line in list(self._memory.lines) if level >= least))
        bar = self.text.verticalScrollBar()
        bar.setValue(bar.maximum())


_PACKAGES = (
    "homolog",
    "numpy",
    "scipy",
    "warp-lang",
    "PySide6-Essentials",
    "pyvista",
    "pyvistaqt",
    "vtk",
    "SimpleITK",
)
_LINES = 200
_ID_LENGTH = 5  # digits that may identify a person, unlike an age
_OWN = (
    *(Path(str(module.__file__)).parents[1] for module in (homolog, homolog_app)),
    sys.prefix,
    sys.base_prefix,
)
_PATH = re.compile(r"""(?<![\w.<>])(?:/|[A-Za-z]:[\\/])[^\n:"'<>|]*""")  # up to the end of a path


def problem_report(session: Session, memory: LogMemory, details: str = "") -> str:
    """Return the report's text; names of subjects seen in the session, files and groups are replaced."""
    versions = [f"{name} {_version(name)}" for name in _PACKAGES]
    parts = [
        "Homolog problem report",
        f"{platform.platform()}, Python {sys.version.split()[0]}",
        ", ".join(versions),
        f"{len(session.study.members)} subjects, {len(session.study.included)} included, "
        f"{len(session.groomed)} groomed, result: {'yes' if session.result else 'no'}",
        session.study.settings.model_dump_json(),
        details,
        *[line for level, line in memory.lines if level != STATUS][-_LINES:],
    ]
    return _without_names("\n".join(parts), session)


def _without_names(text: str, session: Session) -> str:
    for home in _OWN:
        text = text.replace(f"{home}{os.sep}", "")
    secrets = {secret: word for secret, word in _secrets(session) if len(secret) > 1}
    for secret in sorted(secrets, key=len, reverse=True):
        text = text.replace(secret, secrets[secret])
    return _PATH.sub("PATH", text)


def _secrets(session: Session) -> Iterator[tuple[str, str]]:
    """Yield all texts that could identify a person, with their placeholders."""
    yield str(Path.home()), "HOME"
    if session.folder:
        yield str(session.folder), "PROJECT"
    numbers: dict[Path, int] = {}
    for subject in session.seen.values():
        number = numbers.setdefault(subject.path, len(numbers) + 1)
        yield str(subject.path), f"FILE-{number}"
        yield str(subject.path.parent), "FOLDER"
        yield subject.path.name, f"FILE-{number}"
        yield subject.name, f"SUBJECT-{number}"
        for value in (subject.group, *subject.columns.values()):
            if value and (len(value) >= _ID_LENGTH or not value.replace(".", "").isdigit()):
                yield value, "VALUE"


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "from a source checkout"


class ErrorDialog(QDialog):
    """Shows an error, with buttons that unfold the details, save a report and apply remedies."""

    def __init__(
        self,
        parent: QWidget,
        theme: Theme,
        title: str,
        message: str,
        details: str,
        save: Callable[[str], None],
        remedies: Mapping[str, Callable[[], object]] = MappingProxyType({}),
    ) -> None:
        super().__init__(parent)
        having(self, windowTitle=title, minimumWidth=560)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.details = QPlainTextEdit(details, readOnly=True)
        having(self.details, accessibleName="Details", minimumHeight=200)
        self.details.hide()
        close = button("Close", "primary", self.accept, default=True)
        unfold = button("Details", "flat", checkable=True, autoDefault=False)
        unfold.toggled.connect(self._unfold)
        report = button("Save problem report…", does=lambda: save(details), autoDefault=False)
        cures = [button(text, does=self.accept, autoDefault=False) for text in remedies]
        for cure, remedy in zip(cures, remedies.values(), strict=True):
            cure.clicked.connect(lambda _, remedy=remedy: remedy())
        buttons = row(unfold, ..., *cures, report, close)
        column(_head(theme, title, message), self.details, buttons, on=self, edges=DIALOG_EDGES, gap=2 * GRID)
        close.setFocus()

    def _unfold(self, shown: bool) -> None:
        self.details.setVisible(shown)
        self.adjustSize()


def _head(theme: Theme, title: str, message: str) -> QHBoxLayout:
    """Return the warning sign beside title and message."""
    sign = QLabel()
    sign.setPixmap(pixmap("warning", theme.colours.warning, 40))
    sign.setAlignment(Qt.AlignmentFlag.AlignTop)
    text = having(prose(), text=message)
    return row(sign, (column(label(title, "PanelTitle", wrap=True), text), 1), gap=2 * GRID)
