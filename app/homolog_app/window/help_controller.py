"""Palette, shortcuts, preferences, errors, reports and About."""

import traceback
from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import Slot
from PySide6.QtWidgets import QDialog, QFileDialog, QMessageBox

from homolog import __version__
from homolog.errors import user_message
from homolog.files.atomic import write_text
from homolog_app.window.error_dialog import ErrorDialog, problem_report
from homolog_app.window.palette import CommandPalette, ShortcutSheet
from homolog_app.window.preferences import PreferencesDialog
from homolog_app.window.questions import Controller, reported
from homolog_app.window.theme import pixmap

__all__ = ["HelpController"]

_AGAIN = {"groom": "run.groom", "run": "run.start"}
_TITLES = {
    "groom": "Grooming stopped",
    "run": "The run stopped",
    "open": "The project can't be opened",
    "open_paths": "Nothing can be opened there",
    "save_to": "The project can't be saved",
    "import_table": "The table can't be imported",
    "import_model": "The model can't be imported",
    "import": "The model can't be imported",
    "export_table": "The table can't be written",
    "reference": "The reference can't be made",
    "open_reference": "The reference can't be read",
    "patient": "The patient can't be compared",
    "groups": "The groups can't be compared",
}
_REFUSED, _BUG = "This can't be done", "Unexpected error"


class HelpController(Controller):
    """Everything that explains."""

    def handlers(self) -> dict[str, Callable[[], object]]:
        """Return what the commands of help do."""
        return {
            "help.palette": self.show_palette,
            "help.shortcuts": self.show_shortcuts,
            "help.report": self.save_report,
            "help.about": self.show_about,
            "edit.preferences": self.show_preferences,
            "view.theme": self.change_scheme,
        }

    @Slot(str, object)
    def show_error(self, kind: str, error: BaseException) -> None:
        """Show what happened and what to do; a defect of the program asks for a report."""
        said = user_message(error)
        title = _TITLES.get(kind, _REFUSED if said else _BUG)
        text = said or "This is a bug in Homolog. Please save a problem report and attach it to an issue."
        details = "".join(traceback.format_exception(error))
        remedies = self._remedies(kind, text)
        ErrorDialog(
            self._window, self._workspace.theme, title, text, details, self.save_report, remedies
        ).open()

    def _remedies(self, kind: str, message: str) -> dict[str, Callable[[], object]]:
        """Return what can be done about the subject that an error of grooming or a run names."""
        session, commands = self._workspace.session, self._window.commands
        names = [
            subject.name for subject in session.study.included if message.startswith(f"{subject.name}: ")
        ]
        if kind not in _AGAIN or len(names) != 1:
            return {}
        (name,) = names

        def show() -> None:
            self._window.show_step("cohort")
            session.select([name])

        def leave_out() -> None:
            session.select([name])
            session.toggle_included()
            commands[_AGAIN[kind]].trigger()

        return {f"Show {name}": show, "Exclude it and continue": leave_out}

    def show_palette(self) -> None:
        """Let the user find a command by typing."""
        palette = CommandPalette(self._window, self._window.commands)
        place = self._window.rect().center()
        palette.move(self._window.mapToGlobal(place) - palette.rect().center() - palette.rect().topLeft() / 2)
        palette.exec()
        chosen = palette.chosen
        palette.deleteLater()
        if chosen is not None:
            chosen.trigger()

    def show_shortcuts(self) -> None:
        """List every shortcut."""
        ShortcutSheet(self._window).open()

    def show_preferences(self) -> None:
        """Let the user change preferences."""
        preferences = self._workspace.preferences
        dialog = PreferencesDialog(self._window, preferences)
        if dialog.exec() == QDialog.DialogCode.Accepted:
            dialog.store(preferences)
            self._workspace.theme.choose(preferences.scheme)
        dialog.deleteLater()

    def change_scheme(self) -> None:
        """Change between light and dark."""
        self._workspace.preferences.scheme = "light" if self._workspace.theme.is_dark else "dark"
        self._workspace.theme.choose(self._workspace.preferences.scheme)

    @reported
    def save_report(self, details: str = "") -> None:
        """Ask for a file and write the problem report."""
        path, _ = QFileDialog.getSaveFileName(
            self._window, "Save report", "homolog-report.txt", "Text files (*.txt)"
        )
        if path:
            write_text(
                Path(path), problem_report(self._workspace.session, self._workspace.memory, details or "")
            )

    def show_about(self) -> None:
        """Show version, device and licence."""
        box = QMessageBox(self._window)
        box.setWindowTitle("About Homolog")
        box.setIconPixmap(pixmap("homolog", "", 64))
        box.setText(f"Homolog {__version__}")
        box.setInformativeText(
            "Corresponding points on ensembles of anatomical shapes.\n"
            f"{self._window.status.device.text()}\n"
            "MIT licence. For research use, not for diagnosis."
        )
        box.exec()
        box.deleteLater()
