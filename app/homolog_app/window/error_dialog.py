"""What went wrong, for people, and a report of it to send."""

import os
import platform
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import MappingProxyType

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QDialog, QHBoxLayout, QLabel, QPlainTextEdit, QVBoxLayout, QWidget

import homolog
import homolog_app
from homolog_app.window.log_pane import LogMemory
from homolog_app.window.session import Session
from homolog_app.window.theme import Theme, pixmap
from homolog_app.window.widgets import GRID, button, label

__all__ = ["ErrorDialog", "problem_report"]


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
_ID_LENGTH = 5  # digits that may be somebody's number rather than an age
_OWN = (
    *(Path(str(module.__file__)).parents[1] for module in (homolog, homolog_app)),
    sys.prefix,
    sys.base_prefix,
)
_PATH = re.compile(r"""(?<![\w.<>])(?:/|[A-Za-z]:[\\/])[^\n:"'<>|]*""")  # up to what ends a path in messages


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
        *[line for _, line in list(memory.lines)[-_LINES:]],
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
    """Yield everything that could tell who somebody is, with what to say instead."""
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
    """Shows an error; the details can be unfolded, a report saved, and remedies tried, each with a button."""

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
        self.setWindowTitle(title)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.setMinimumWidth(560)
        sign = QLabel()
        sign.setPixmap(pixmap("warning", theme.colours.warning, 40))
        sign.setAlignment(Qt.AlignmentFlag.AlignTop)
        text = label(message, wrap=True)
        text.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.details = QPlainTextEdit(details, readOnly=True)
        self.details.setAccessibleName("Details")
        self.details.setMinimumHeight(200)
        self.details.hide()
        words_column = QVBoxLayout()
        words_column.setSpacing(GRID)
        words_column.addWidget(label(title, "PanelTitle", wrap=True))
        words_column.addWidget(text)
        head = QHBoxLayout()
        head.setSpacing(2 * GRID)
        head.addWidget(sign)
        head.addLayout(words_column, 1)
        unfold = button("Details", "flat")
        unfold.setCheckable(True)
        unfold.setAutoDefault(False)  # Enter closes the dialog, whatever has the focus
        unfold.toggled.connect(self._unfold)
        report = button("Save report…")
        report.setAutoDefault(False)
        report.clicked.connect(lambda: save(details))
        close = button("Close", "primary")
        close.setDefault(True)
        close.clicked.connect(self.accept)
        row = QHBoxLayout()
        row.addWidget(unfold)
        row.addStretch()
        row.addWidget(report)
        row.addWidget(close)
        for words_of_one, remedy in remedies.items():
            single = button(words_of_one)
            single.setAutoDefault(False)
            single.clicked.connect(self.accept)
            single.clicked.connect(lambda _, remedy=remedy: remedy())
            row.insertWidget(row.count() - 2, single)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(3 * GRID, 3 * GRID, 3 * GRID, 2 * GRID)
        layout.setSpacing(2 * GRID)
        layout.addLayout(head)
        layout.addWidget(self.details)
        layout.addLayout(row)
        close.setFocus()

    def _unfold(self, shown: bool) -> None:
        self.details.setVisible(shown)
        self.adjustSize()
