"""Errors, problem reports, palette, preferences, and the tour."""

import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path

from PySide6.QtCore import QObject, Signal, Slot
from PySide6.QtWidgets import QDialog, QFrame, QMainWindow, QMessageBox

from homolog import __version__
from homolog.errors import user_message
from homolog.io.atomic import write_text
from homolog_app.window.actions import Actions, CommandPalette, ShortcutSheet
from homolog_app.window.commands import command
from homolog_app.window.dialogs import ErrorDialog, problem_report
from homolog_app.window.explore.groups_page import GroupsPage
from homolog_app.window.project_controller import ProjectController
from homolog_app.window.rail import steps_of
from homolog_app.window.start_page import HEARTS, SAMPLES, Sample, Stop, stops_for
from homolog_app.window.theme import pixmap
from homolog_app.window.widgets import GRID, button, column, label, row
from homolog_app.window.workspace import Controller, PreferencesDialog, Workspace, reported

__all__ = ["HelpController", "Tour"]


_AGAIN = {"groom": "run.groom", "run": "run.start"}
_TITLES = {
    "groom": "Grooming stopped",
    "run": "The run stopped",
    "open": "The project can't be opened",
    "open_paths": "These files can't be opened",
    "save_to": "The project can't be saved",
    "import_table": "The table can't be imported",
    "import_model": "The model can't be imported",
    "import": "The model can't be imported",
    "export_table": "The table can't be written",
    "reference": "The reference can't be made",
    "open_reference": "The reference can't be read",
    "patient": "The patient can't be compared",
    "typical": "The patient can't be compared with the groups",
    "follow-up": "The times can't be compared",
    "groups": "The groups can't be compared",
}
_REFUSED, _BUG = "This can't be done", "Unexpected error"


class HelpController(Controller):
    """Handlers of the help commands."""

    def __init__(self, window: QMainWindow, workspace: Workspace, commands: Actions) -> None:
        super().__init__(window, workspace)
        self._commands = commands

    def handlers(self) -> dict[str, Callable[[], object]]:
        """Return the handlers of the help commands."""
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
        """Show an error with its remedy; for a defect of the program, ask for a report."""
        message = user_message(error)
        title = _TITLES.get(kind, _REFUSED if message else _BUG)
        text = message or "This is a bug in Homolog. Please save a problem report and attach it to an issue."
        details = "".join(traceback.format_exception(error))
        remedies = self._remedies(kind, text)
        ErrorDialog(
            self._window, self._workspace.theme, title, text, details, self.save_report, remedies
        ).open()

    def _remedies(self, kind: str, message: str) -> dict[str, Callable[[], object]]:
        """Return remedies for the subject that an error of grooming or a run names, by itself or its file."""
        session, commands = self._workspace.session, self._commands
        names = [
            subject.name
            for subject in session.study.included
            if message.startswith((f"{subject.name}: ", f"{subject.path}: "))
        ]
        if kind not in _AGAIN or not names:
            return {}

        def show() -> None:
            session.show_step("cohort")
            session.select(names)

        def leave_out() -> None:
            session.select(names)
            session.toggle_included()
            commands[_AGAIN[kind]].trigger()

        return {f"Show {names[0]}": show, "Exclude it and continue": leave_out}

    def show_palette(self) -> None:
        """Open the command palette."""
        palette = CommandPalette(self._window, self._commands)
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
        """Open the preferences."""
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
        kinds = "Text files (*.txt)"
        path = self._workspace.files.new(self._window, "Save problem report", "homolog-problem.txt", kinds)
        if path:
            write_text(path, problem_report(self._workspace.session, self._workspace.memory, details or ""))

    def show_about(self) -> None:
        """Show version, device and licence."""
        box = QMessageBox(self._window)
        box.setWindowTitle("About Homolog")
        box.setIconPixmap(pixmap("homolog", "", 64))
        box.setText(f"Homolog {__version__}")
        devices = self._workspace.session.devices
        device = f"Device: {devices.names[devices.automatic]}\n" if devices is not None else ""
        box.setInformativeText(
            "Corresponding points on ensembles of anatomical shapes.\n"
            f"{device}"
            "MIT licence. For research use, not for diagnosis."
        )
        box.exec()
        box.deleteLater()


class Tour(QObject):
    """A sequence of cards over the views."""

    def __init__(
        self, workspace: Workspace, commands: Actions, projects: ProjectController, groups: GroupsPage
    ) -> None:
        super().__init__(workspace)
        self._workspace, self._commands, self._projects, self._groups = workspace, commands, projects, groups
        self._at = 0
        self._stops = HEARTS.stops
        self.card = _Card()
        self.card.hide()
        self.card.back.clicked.connect(lambda: self.show_stop(self._at - 1))
        self.card.go_on.clicked.connect(lambda: self.show_stop(self._at + 1))
        self.card.end.clicked.connect(self.card.hide)
        self.card.offer.clicked.connect(self._accept_offer)
        workspace.session.job_changed.connect(self._refresh)
        workspace.session.step_changed.connect(self._follow)
        workspace.session.page_changed.connect(self._follow_page)
        offers = {stop.offer for sample in SAMPLES.values() for stop in sample.stops if stop.offer}
        for offer in sorted(offers):
            commands[offer].changed.connect(self._refresh)

    def handlers(self) -> dict[str, Callable[[], object]]:
        """Return the handlers of the tour's commands."""
        return {
            "help.tour": self.begin,
            **{name: partial(self.open_sample, sample) for name, sample in SAMPLES.items()},
        }

    def open_sample(self, sample: Sample) -> None:
        """Generate a sample study, list its subjects and start the tour."""
        if self._projects.may_leave():
            self._projects.begin()
            folder = self._workspace.home / "samples" / sample.name
            self._workspace.work.make_sample(sample, folder, partial(self._accept_sample, sample))

    def _accept_sample(self, sample: Sample, folder: Path) -> None:
        workspace, self._stops = self._workspace, sample.stops
        self._projects.open_paths([folder])
        settings = workspace.session.study.settings
        workspace.edit_settings("groom", "alignment", sample.groom_settings(settings.groom))
        workspace.edit_settings("optimize", "particles", settings.optimize.model_copy(update=sample.optimize))
        self.show_stop(0)

    def begin(self) -> None:
        """Show the first card of the tour for the open study."""
        self._stops = stops_for(self._workspace.session.study)
        self.show_stop(0)

    def show_stop(self, index: int) -> None:
        """Show a card and its step."""
        if index >= len(self._stops):
            self.card.hide()
            return
        self._at = max(0, index)
        self.card.show()
        stop = self._stops[self._at]
        self._workspace.session.show_step(stop.step)
        if stop.opens and self._commands[stop.opens].isEnabled():
            self._commands[stop.opens].trigger()
        if stop.alignment is not None:
            self._groups.form.choose_alignment(stop.alignment)
        self._refresh()

    def _accept_offer(self) -> None:
        self._commands[self._stops[self._at].offer].trigger()

    def _follow(self) -> None:
        """Go to the card of a step that was opened by other means."""
        step = self._workspace.session.step
        if not self.card.isHidden() and self._stops[self._at].step != step:
            self.show_stop(next(index for index, stop in enumerate(self._stops) if stop.step == step))

    def _follow_page(self) -> None:
        """Go to the card of a page of *Explore* that was opened by other means."""
        page, step = self._workspace.session.page, self._workspace.session.step
        for index, stop in enumerate(self._stops):
            if stop.opens and command(stop.opens).title == page and step == stop.step:
                self._at = index
                self._refresh()

    def _refresh(self) -> None:
        if self.card.isHidden():
            return
        stop = self._stops[self._at]
        offer = self._commands[stop.offer] if stop.offer else None
        last, session = self._at + 1 == len(self._stops), self._workspace.session
        carried_out = steps_of(session)[stop.step].done and not session.job.is_busy
        done = last or offer is None or carried_out
        self.card.show_stop(stop, f"{self._at + 1} of {len(self._stops)}", self._at > 0, done, last)
        if offer is not None:
            self.card.offer.setText(offer.text().replace("&", ""))
            self.card.offer.setEnabled(offer.isEnabled())


class _Card(QFrame):
    """Title and text of one stop, with buttons; as low as possible to leave space for the views above it."""

    toggled = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("Banner")
        self.title, self._text = label("", "SectionTitle"), label("", wrap=True)
        self._number = label("", "Hint")
        self.offer, self.back = button(""), button("Back", "flat")
        self.go_on, self.end = button("Next"), button("End tour", "flat")
        head = row(self.title, self._number, ..., self.end, self.back, self.offer, self.go_on)
        column(head, self._text, on=self, edges=(2 * GRID, GRID, 2 * GRID, GRID), gap=GRID // 2)

    def setVisible(self, visible: bool) -> None:
        """Show or hide the card; the window distributes its space again."""
        is_new = visible == self.isHidden()
        super().setVisible(visible)
        if is_new:
            self.toggled.emit()

    def show_stop(self, stop: Stop, number: str, has_back: bool, done: bool, last: bool) -> None:
        self.title.setText(stop.title)
        self._text.setText(stop.text)
        self._number.setText(number)
        self.offer.setVisible(bool(stop.offer))
        self.back.setVisible(has_back)
        self.go_on.setEnabled(done)
        self.go_on.setText("Done" if last else "Next")
