"""The state of a window without widgets: theme, preferences, session, jobs, journal; base of controllers."""

import logging
import os
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial, wraps
from pathlib import Path
from typing import Concatenate, ParamSpec, TypeVar, cast

from PySide6.QtCore import QByteArray, QObject, QSettings, QTimer, Slot
from PySide6.QtWidgets import (
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QFileDialog,
    QWidget,
)

from homolog.errors import HomologError, InputError
from homolog.io.project import ProjectFolder
from homolog.settings import RunSettings
from homolog_app.scenes.structures import project_of_aspect
from homolog_app.window.dialogs import LogMemory
from homolog_app.window.session import Session
from homolog_app.window.study_files import Journal, JournalRecord, ViewRecord, record_of, save_view
from homolog_app.window.theme import Theme
from homolog_app.window.widgets import (
    DIALOG_EDGES,
    GRID,
    column,
    having,
    label,
    named_rows,
    offer,
    set_primary,
    tick,
)
from homolog_app.window.work import Work

__all__ = ["Controller", "FileDialogs", "Preferences", "PreferencesDialog", "Workspace", "reported"]


_log = logging.getLogger(__name__)
_MOST_RECENT = 10
_JOURNAL_MS = 1000
SCHEMES = {"system": "Follow the system", "light": "Light", "dark": "Dark"}


class Preferences:
    """A small file in the user's configuration folder."""

    def __init__(self, path: Path) -> None:
        self._store = QSettings(str(path), QSettings.Format.IniFormat)

    def _put(self, name: str, value: object) -> None:
        """Store a value immediately; failures are logged only."""
        self._store.setValue(name, value)
        self._store.sync()
        if self._store.status() != QSettings.Status.NoError:
            _log.warning(
                "%s: can't be written; make room on its disk or make its folder writable",
                self._store.fileName(),
            )

    @property
    def scheme(self) -> str:
        """``"system"``, ``"light"`` or ``"dark"``."""
        value = str(self._store.value("scheme", "system"))
        return value if value in SCHEMES else "system"

    @scheme.setter
    def scheme(self, value: str) -> None:
        self._put("scheme", value)

    @property
    def ask_on_close(self) -> bool:
        """Whether to ask before discarding unsaved edits or stopping a run."""
        return str(self._store.value("ask_on_close", "true")) == "true"

    @ask_on_close.setter
    def ask_on_close(self, value: bool) -> None:
        self._put("ask_on_close", "true" if value else "false")

    @property
    def recent(self) -> list[Path]:
        """Projects opened last, newest first."""
        stored = self._store.value("recent", [])
        listed = [stored] if isinstance(stored, str) else stored if isinstance(stored, list) else []
        return [Path(path) for path in listed if path]

    def remember(self, folder: Path) -> None:
        """Put a project at the top of the list; file dialogs begin next to it."""
        others = [other for other in self.recent if other != folder]
        self._put("recent", [str(path) for path in [folder, *others]][:_MOST_RECENT])
        self.place = folder.parent

    @property
    def place(self) -> Path:
        """Folder where file dialogs begin: that of the last file or project; else the user's."""
        value = Path(str(self._store.value("place", "")))
        return value if value.is_absolute() and value.is_dir() else Path.home()

    @place.setter
    def place(self, value: Path) -> None:
        self._put("place", str(value))

    def relocate(self, before: Path, after: Path) -> None:
        """Replace a missing project by its new location."""
        listed = [after if path == before else path for path in self.recent]
        self._put("recent", [str(path) for path in dict.fromkeys(listed)])

    def forget(self) -> None:
        """Forget all folders: their names may identify patients."""
        self._put("recent", [])
        self._put("place", "")

    def keep_geometry(self, geometry: QByteArray, state: QByteArray) -> None:
        """Store the window's position."""
        self._put("geometry", geometry)
        self._put("state", state)

    @property
    def geometry(self) -> tuple[QByteArray, QByteArray] | None:
        """Stored position of the window, if known."""
        geometry, state = self._store.value("geometry"), self._store.value("state")
        known = isinstance(geometry, QByteArray) and isinstance(state, QByteArray)
        return (geometry, state) if known else None


class FileDialogs:
    """Asks for files and folders. Each dialog begins where the last file was chosen."""

    def __init__(self, preferences: Preferences) -> None:
        self._preferences = preferences

    def folder(self, parent: QWidget, title: str) -> Path | None:
        """Ask for a folder."""
        chosen = QFileDialog.getExistingDirectory(parent, title, str(self._preferences.place))
        if chosen:
            self._preferences.place = Path(chosen)
        return Path(chosen) if chosen else None

    def file(self, parent: QWidget, title: str, kinds: str, near: Path | None = None) -> Path | None:
        """Ask for a file, in a folder if one is given."""
        chosen, _ = QFileDialog.getOpenFileName(parent, title, str(near or self._preferences.place), kinds)
        return self._remembered([chosen])

    def files(self, parent: QWidget, title: str, kinds: str) -> list[Path]:
        """Ask for files."""
        chosen, _ = QFileDialog.getOpenFileNames(parent, title, str(self._preferences.place), kinds)
        self._remembered(chosen)
        return [Path(path) for path in chosen]

    def new(self, parent: QWidget, title: str, name: str, kinds: str = "") -> Path | None:
        """Ask for a file or folder to write; a name that includes a folder is suggested unchanged."""
        near = str(self._preferences.place / name)
        chosen, _ = QFileDialog.getSaveFileName(parent, title, near, kinds)
        return self._remembered([chosen])

    def _remembered(self, paths: Sequence[str]) -> Path | None:
        if not any(paths):
            return None
        self._preferences.place = Path(paths[0]).parent
        return Path(paths[0])


class PreferencesDialog(QDialog):
    """Colour scheme and confirmations."""

    def __init__(self, parent: QWidget, preferences: Preferences) -> None:
        super().__init__(parent)
        having(self, windowTitle="Preferences", minimumWidth=440)
        self.scheme = QComboBox()
        offer(self.scheme, {text: value for value, text in SCHEMES.items()})
        self.scheme.setCurrentIndex(self.scheme.findData(preferences.scheme))
        asks = "Ask before discarding unsaved edits or stopping a run"
        self.ask = tick(asks, checked=preferences.ask_on_close)
        form = named_rows((("Colours", self.scheme), ("Closing", self.ask)))
        form.setVerticalSpacing(2 * GRID)
        standard = QDialogButtonBox.StandardButton
        buttons = QDialogButtonBox(standard.Ok | standard.Cancel, parent=self)
        set_primary(buttons.button(standard.Ok), primary=True)
        buttons.accepted.connect(self.accept)
        buttons.rejected.connect(self.reject)
        title, of_study = "Preferences", "Device, method and particles belong to the study: see Correspond."
        parts = (label(title, "PanelTitle"), form, label(of_study, "Hint", wrap=True), buttons)
        column(*parts, on=self, edges=DIALOG_EDGES, gap=2 * GRID)

    def store(self, preferences: Preferences) -> None:
        """Store the choices."""
        preferences.scheme = self.scheme.currentData()
        preferences.ask_on_close = self.ask.isChecked()


class Workspace(QObject):
    """Theme, preferences, session, jobs and journal of one window."""

    def __init__(self, home: Path, theme: Theme, memory: LogMemory) -> None:
        super().__init__()
        self.theme, self.memory = theme, memory
        self.home = home
        self.preferences = Preferences(home / "preferences.ini")
        self.files = FileDialogs(self.preferences)
        self.sessions = home / "sessions"
        self.journal = Journal(self.sessions)
        self.session = Session(self)
        self.work = Work(self.session, self)
        self.closed = False
        self._held = ExitStack()
        self._autosave = QTimer(self, interval=_JOURNAL_MS, singleShot=True)
        self._autosave.timeout.connect(self.write_journal)
        self.session.study_changed.connect(self._autosave.start)
        self.session.project_changed.connect(self._autosave.start)
        self.session.result_changed.connect(self._autosave.start)

    @property
    def project(self) -> ProjectFolder:
        """The folder of grooming and runs: the open project, or a draft until it is saved."""
        return ProjectFolder(self.session.folder) if self.session.folder else self.journal.draft

    @property
    def shown_project(self) -> ProjectFolder:
        """The project of what *Explore* shows: the open one, or that of one of its structures."""
        return project_of_aspect(self.project, self.session.aspect)

    @property
    def is_changed(self) -> bool:
        """Whether there are unsaved data."""
        session = self.session
        if session.read_only:
            return False
        unsaved = session.folder is None and bool(session.study.members)
        return unsaved or self.session.job.is_saving or not session.undo.isClean()

    def lock_project(self, folder: Path | None) -> None:
        """Lock the open project against other programs, and release the previous one.

        A project that can't be written to needs no lock.

        Raises
        ------
        InUseError
            If another program has it open; the previous project then stays locked.
        """
        held = ExitStack()
        if folder is not None and os.access(folder, os.W_OK):
            held.enter_context(ProjectFolder(folder).locked())
        self._held.close()
        self._held = held

    def handlers(self) -> dict[str, Callable[[], object]]:
        """Return the handlers of the commands that need no window."""
        session = self.session
        return {
            "edit.undo": session.undo.undo,
            "edit.redo": session.undo.redo,
            "edit.include": session.toggle_included,
            "edit.remove": session.remove_selected,
            "run.groom": self.groom,
            "run.regroom": self.groom_selected,
            "edit.uncut": session.uncut_selected,
            "edit.carry": lambda: self.work.carry_cuts(session.selection[0]),
            "run.resume": lambda: self.run(resume=True),
            "run.more": lambda: self.run(from_result=True),
            "run.fit": lambda: self.run(from_result=True),
            "run.pause": self.work.toggle_pause,
            "run.cancel": self.work.cancel,
            "run.keep": self.work.keep,
        }

    def groom(self) -> None:
        """Groom every included subject."""
        self.work.groom(self.session.study.cohort, self.project)

    def groom_selected(self) -> None:
        """Groom the selected subject with the current settings; others are unchanged."""
        self.work.groom_one(self.session.selection[0], self.project)

    def run(self, *, resume: bool = False, from_result: bool = False) -> None:
        """Place the particles where they can be watched, and record in the journal that a run goes on."""
        self.session.show_step("correspond")
        self.work.run(self.project, resume=resume, from_result=from_result)
        self.write_journal()

    def edit_settings(self, part: str, name: str, value: object) -> None:
        """Apply an edited part of the settings."""
        settings = self.session.study.settings
        changed: RunSettings = settings.model_copy(update={part: value})
        self.session.edit_settings(f"{name.replace('_', ' ').capitalize()}", changed, f"{part}.{name}")

    @Slot()
    def write_journal(self) -> None:
        """Record the open study, so that it can be recovered after a crash."""
        running = "run" in (self.session.job.kind, self.session.job.following)
        if not self.is_changed and not running:
            self.journal.clear_record()
            return
        folder = self.session.folder
        record = JournalRecord(
            folder=str(folder) if folder else None,
            study=record_of(self.session.study, self.project, ViewRecord()),
            running=running,
        )
        try:
            self.journal.write(record)
        except InputError as error:
            _log.warning("crash recovery is not possible: %s", error)

    def keep_view(self, view: ViewRecord) -> None:
        """Store the view state in the study's project, if everything is saved there."""
        session = self.session
        if session.folder is None or session.read_only or self.is_changed or not self.project.exists:
            return
        try:
            save_view(self.project, session.study, view)
        except InputError as error:
            _log.warning("the state of the views can't be stored: %s", error)

    def close(self) -> None:
        """Stop the thread and remove temporary files."""
        self.closed = True
        self._autosave.stop()
        if not self.work.runner.close():
            _log.warning("the computing thread ends later; what it computes is dropped")
        self._held.close()
        self.journal.close()


_Asked = TypeVar("_Asked")


class Controller(QObject):
    """Base of the controllers, which handle a group of the window's commands and show dialogs over it."""

    def __init__(self, window: QWidget, workspace: Workspace) -> None:
        super().__init__(window)
        self._window, self._workspace = window, workspace

    def show_error(self, kind: str, error: BaseException) -> None:
        """Show an error."""
        self._workspace.session.failed.emit(kind, error)

    def attempt(self, kind: str, work: Callable[[], object]) -> None:
        """Do something, and show its error instead of raising it."""
        try:
            work()
        except (HomologError, OSError) as error:
            _log.warning("%s", error)
            self.show_error(kind, error)

    def asking(
        self, ask: Callable[..., "_Asked | None"], *what: str, does: Callable[["_Asked"], object]
    ) -> Callable[[], None]:
        """Return a handler that asks for a file or folder, and does something with it if one is chosen.

        Parameters
        ----------
        ask : callable
            A method of `FileDialogs`.
        what : str
            What it is called with after the window: title, suggested name, kinds of files.
        does : callable
            Takes what was chosen; its errors are shown.
        """

        def handle() -> None:
            if chosen := ask(self._window, *what):
                self.attempt(getattr(does, "__name__", ""), partial(does, chosen))

        return handle


_Given = ParamSpec("_Given")
_AnyController = TypeVar("_AnyController", bound=Controller)
_Method = Callable[Concatenate[_AnyController, _Given], None]


def reported(method: "_Method[_AnyController, _Given]") -> "_Method[_AnyController, _Given]":
    """Decorate a method: show its errors in the error dialog instead of raising them."""

    @wraps(method)
    def wrapper(self: _AnyController, *args: _Given.args, **kwargs: _Given.kwargs) -> None:
        self.attempt(method.__name__, lambda: method(self, *args, **kwargs))

    return cast("_Method[_AnyController, _Given]", wrapper)
