"""Studies on disk: new, add, open, save, import, export, close, recover."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtWidgets import QInputDialog, QWidget

from homolog.cohort import Cohort, is_series, tables_beside, tables_in
from homolog.errors import InputError, InUseError
from homolog.io.atomic import replace_folder
from homolog.io.particles import PARTICLE_SUFFIXES
from homolog.io.project import ProjectFolder
from homolog_app.scenes.loaded_result import write_from_memory
from homolog_app.window.actions import Actions
from homolog_app.window.dialogs import ask, wait_until, waited
from homolog_app.window.explore.panel import ExplorePanel
from homolog_app.window.start_page import StartPage
from homolog_app.window.study import FILES, Reading, Study, read_subjects, readings_of, with_table
from homolog_app.window.study_files import (
    InterruptedSession,
    ViewRecord,
    copy_project,
    find_lost,
    interrupted_text,
    open_project,
    save_project,
    study_of,
    suggested_folder,
)
from homolog_app.window.workspace import Controller, Workspace, reported

if TYPE_CHECKING:
    from homolog_app.window.views import Views

__all__ = ["ProjectController"]

_TABLES, _READ = "Tables (*.csv)", "Tables (*.csv *.tsv *.txt *.xlsx)"
_NOT_HELD = (
    "Subjects, settings, particles, surfaces and the shape model were saved. Groomed volumes, stored "
    "answers, figures and reports existed only in that folder and could not be saved."
)
_ANSWERS = ("Open read-only", "Cancel")
_IN_USE = "the project is open in another Homolog, and read-only here"
_UNWRITABLE = "the project's folder can't be written to"
_MODELS = "ShapeWorks projects, particles (*.swproj *.xlsx *.particles *.pts *.lpts *.wpts)"


_TOGETHER = "All together"


class ProjectController(Controller):
    """Opens and saves projects; asks before data are lost.

    Attributes
    ----------
    views : Views or None
        Their state is saved with a project.
    """

    def __init__(
        self, window: QWidget, workspace: Workspace, commands: Actions, page: StartPage, explore: ExplorePanel
    ) -> None:
        super().__init__(window, workspace)
        self._commands, self._start, self._explore = commands, page, explore
        self.views: Views | None = None
        page.opened.connect(lambda path: self.open_paths([Path(path)]))
        page.located.connect(lambda path: self.locate(Path(path)))
        page.forgotten.connect(self._forget)
        self.show_recent()

    def handlers(self) -> dict[str, Callable[[], object]]:
        """Return the handlers of the file commands."""
        files = self._workspace.files
        return {
            "run.start": self.start_run,
            "file.new": self._begin_with,
            "file.add": self.asking(files.files, "Add files", FILES, does=self.open_paths),
            "file.open": self._open,
            "file.save": self.save,
            "file.save_as": self.save_as,
            "file.import": self._import,
            "file.import_model": self._import_model,
            "file.export": self.asking(
                files.new, "Export table", "cohort.csv", _TABLES, does=self.export_table
            ),
            "file.close": self.leave,
            "edit.group": self._group,
        }

    def start_run(self) -> None:
        """Place the particles; ask first if new subjects could be fitted to the result instead."""
        session = self._workspace.session
        possible = session.extension_of if session.is_result_written else None
        answer = ""
        if possible is not None and possible.subjects:
            answer = ask(
                self._window,
                "Fit the new subjects to the result, or place all particles from the start?",
                f"{possible.message} A run from the start replaces the result.",
                ("Fit new subjects", "From the start", "Cancel"),
            )
        if answer != "Cancel":
            self._workspace.run(from_result=answer == "Fit new subjects")

    def show_recent(self) -> None:
        """List the projects opened last on the start page."""
        self._start.show_recent(self._workspace.preferences.recent)

    @reported
    def open_paths(self, paths: Sequence[Path]) -> None:
        """Open a project, or add files to the study."""
        if len(paths) == 1 and ProjectFolder(paths[0]).exists:
            if self.may_leave():
                self.open(paths[0])
            return
        if len(paths) == 1 and paths[0].is_dir() and not is_series(paths[0]):
            self._open_folder(paths[0])
        else:
            self._take(read_subjects(paths))

    def _open_folder(self, folder: Path) -> None:
        """Add the subjects of a folder; what it means is chosen where its layout does not tell."""
        is_new = not self._workspace.session.is_open

        def read() -> tuple[list[Reading], list[Path]]:
            readings = readings_of(folder)
            is_whole = is_new and readings[0].is_sure
            return readings, tables_beside(readings[0].cohort) if is_whole else []

        readings, tables = waited(self._window, f"Reading {folder.name}…", read)
        if readings[0].is_sure:
            self._take(readings[0].cohort)
            if tables:
                self.import_table(tables[0])
            return

        from homolog_app.window.folder_page import FolderPage  # its imports take a second

        def save() -> Path | None:
            return self._workspace.files.new(self._window, "Save table", str(folder / "cohort.csv"), _TABLES)

        page = FolderPage(self._window, self._workspace.theme, folder, readings, save)
        page.chosen.connect(self._take)
        page.open()

    @reported
    def _take(self, added: Cohort) -> None:
        session = self._workspace.session
        study = session.study.adding(added.subjects)
        if session.is_open:
            new = [member.name for member in study.members[len(session.study.members) :]]
            if not new:
                session.noticed.emit("Already in the cohort; nothing was added")
                return
            session.edit("Add subjects", study)
            session.show_step("cohort")
            session.select(new)
        else:
            session.open(study, None)  # opening is not an edit: it can't be undone
        if added.notes:
            session.noticed.emit("; ".join(added.notes))
        if not session.selection and study.members:
            session.select([study.members[0].name])

    @reported
    def open(self, folder: Path) -> None:
        """Open a project and read its result."""
        project = ProjectFolder(folder)
        opened = open_project(project)
        read_only = "" if os.access(folder, os.W_OK) else _UNWRITABLE
        try:
            self._workspace.lock_project(folder)
        except InUseError as error:
            details = f"{error}.\n\nRead-only projects can be seen and exported, but not saved."
            if ask(self._window, f"Open {folder.name} read-only?", details, _ANSWERS, 1) == _ANSWERS[1]:
                return
            self._workspace.lock_project(None)
            read_only = _IN_USE
        elsewhere = self._ask_location(opened.study)
        self._workspace.work.forget()
        self._workspace.work.awaits_result = opened.has_result
        self._workspace.journal.clear()
        study = opened.study if elsewhere is None else opened.study.relocated(elsewhere)
        self._workspace.work.restore_groomed(project)
        self._workspace.session.open(study, folder, read_only)
        if elsewhere is not None:
            self._workspace.session.undo.resetClean()
        self._workspace.session.select(opened.view.selection or [each.name for each in study.members[:1]])
        self._workspace.preferences.remember(folder)
        self.show_recent()
        self._commands[f"view.grid{opened.view.layout}"].trigger()
        resumable = opened.unfinished and project.checkpoint.is_file()
        stopped = resumable and not opened.has_result
        self._workspace.session.show_step("correspond" if stopped else opened.view.step or "cohort")
        if opened.has_result:
            self._workspace.work.open_result(project, lambda: self._show_as(opened.view))
        if resumable:
            particles = opened.study.settings.optimize.particles
            self._workspace.session.noticed.emit(interrupted_text(project.checkpoint, particles))

    def save(self) -> None:
        """Save to the project's folder, or ask for one."""
        folder = self._workspace.session.folder
        if folder is None:
            self.save_as()
        else:
            self.save_to(folder)

    def save_as(self) -> None:
        """Ask for a folder and save there."""
        session = self._workspace.session
        near = suggested_folder(session.study, session.folder, self._workspace.home)
        path = self._workspace.files.new(self._window, "Save project as (creates a folder)", str(near))
        if path:
            self.save_to(path)

    @reported
    def save_to(self, folder: Path) -> None:
        """Save the study and its results to a folder."""
        session, before = self._workspace.session, self._workspace.project
        if folder != session.folder and folder.exists() and any(folder.iterdir()):
            raise InputError(f"{folder}: is not empty; choose a new name for the project")
        is_missing = session.result is not None and not (before.exists and before.read().result)
        in_use = session.result is not None and session.read_only == _IN_USE
        if is_missing and folder == session.folder:
            raise InputError(
                f"{before.folder}: was moved or deleted with its result; restore it, or save "
                "what is still in memory with Save as"
            )
        if is_missing or in_use:  # a folder in use by another program may be half written
            self._write_from_memory(folder)
        elif folder != session.folder and before.folder.is_dir():
            waited(self._window, f"Saving to {folder.name}…", lambda: copy_project(before.folder, folder))
        save_project(ProjectFolder(folder), session.study, self._view())
        moved = folder != session.folder
        self._workspace.lock_project(folder)
        session.folder, session.read_only = folder, ""
        session.undo.setClean()
        if moved:
            self._workspace.journal.clear()
        self._workspace.journal.clear_record()
        self._workspace.preferences.remember(folder)
        self.show_recent()
        session.project_changed.emit()
        session.noticed.emit(f"Saved to {folder}")
        if is_missing or in_use:
            why = "is gone" if is_missing else "is in use"
            ask(self._window, "Saved from memory", f"{before.folder} {why}. {_NOT_HELD}", ("Close",))

    def _write_from_memory(self, folder: Path) -> None:
        """Write the data in memory of a result whose folder is missing, atomically."""
        loaded, cohort = self._workspace.session.result, self._workspace.session.study.whole
        assert loaded is not None, "without a result, no folder is missing"

        def write() -> None:
            with replace_folder(folder) as part:
                write_from_memory(ProjectFolder(part), loaded, cohort)

        waited(self._window, f"Saving to {folder.name}…", write)

    def may_leave(self) -> bool:
        """Ask about a run in progress and unsaved edits; return whether to continue."""
        if not self._is_agreed():
            return False
        self._workspace.keep_view(self._view())
        return True

    def _is_agreed(self) -> bool:
        workspace = self._workspace
        if not workspace.preferences.ask_on_close:
            return True
        if workspace.session.job.is_busy:
            run = "The run can be resumed from its checkpoint." if workspace.session.job.run else ""
            answer = ask(
                self._window,
                "Stop the computation?",
                f"It has not finished. {run}".strip(),
                ("Stop", "Keep working"),
                1,
                lambda: not workspace.session.job.is_busy,
            )
            if answer == "Keep working":
                return False
            if answer == "Stop":
                workspace.work.cancel()
        if not workspace.is_changed:
            return True
        title, saved = workspace.session.title, workspace.session.folder is not None
        lost = "Otherwise, changes since it was last saved are lost." if saved else "Otherwise it is lost."
        question = f"Save {title if saved else 'the study'}?"
        answer = ask(self._window, question, lost, ("Save", "Don't save", "Cancel"))
        if answer == "Save":
            session, message = workspace.session, f"Saving {title}…"
            wait_until(self._window, message, lambda: not session.job.is_busy)  # a stopped job must end first
            self.save()
            wait_until(self._window, message, lambda: not session.job.is_saving)
            return not workspace.is_changed
        return answer == "Don't save"

    def leave(self) -> None:
        """Close the project and go back to the start page."""
        if self.may_leave():
            self.begin()

    def begin(self) -> None:
        """Discard the open study and start an empty one."""
        self._workspace.work.forget()
        self._workspace.journal.clear()
        self._workspace.lock_project(None)
        self._workspace.session.open(Study(), None)
        self._workspace.session.show_step("cohort")

    @reported
    def locate(self, missing: Path) -> None:
        """Ask for the new location of a project."""
        path = self._workspace.files.folder(self._window, f"Where is {missing.name}?")
        if path:
            self._workspace.preferences.relocate(missing, path)
            self.open(path)

    @reported
    def offer_recovery(self) -> None:
        """Offer to recover the studies of terminated windows, the newest first."""
        for lost in find_lost(self._workspace.sessions):
            name = Path(lost.record.folder).name if lost.record.folder else "a study that was never saved"
            what = "a run was in progress" if lost.record.running else "unsaved edits"
            count = len(lost.record.study.subjects)
            text = f"The program ended without closing it: {count} subjects, {what}."
            answer = ask(self._window, f"Recover {name}?", text, ("Recover", "Discard", "Later"))
            if answer == "Discard":
                lost.discard()
            elif answer == "Recover":
                self._recover(lost)
                return

    def _recover(self, lost: InterruptedSession) -> None:
        workspace, session = self._workspace, self._workspace.session
        study = study_of(lost.record.study, lost.base)
        folder = Path(lost.record.folder) if lost.record.folder else None
        workspace.lock_project(folder)
        saved = open_project(ProjectFolder(folder)).study if folder is not None else Study()
        workspace.journal.adopt(lost)
        workspace.work.restore_groomed(workspace.project)
        session.open(saved, folder)
        session.edit("Recovered edits", study)
        if workspace.project.exists and workspace.project.read().result is not None:
            workspace.work.open_result(workspace.project, lambda: session.show_step("explore"))
        workspace.write_journal()
        resumable = lost.record.running and workspace.project.checkpoint.is_file()
        session.show_step("correspond" if resumable else "cohort")
        if resumable:
            session.noticed.emit("Resume continues from the checkpoint of the run.")

    def _begin_with(self) -> None:
        path = self._workspace.files.folder(self._window, "Folder of segmentations or surfaces")
        if path and self.may_leave():
            self.begin()
            self.open_paths([path])

    def _open(self) -> None:
        path = self._workspace.files.folder(self._window, "Open project folder")
        if path and self.may_leave():
            self.open(path)

    @reported
    def _import(self) -> None:
        members = self._workspace.session.study.members
        near = members[0].subject.path.parent if members else None
        if near is not None and not tables_in(near):
            near = near.parent if tables_in(near.parent) else None
        path = self._workspace.files.file(self._window, "Import groups and covariates", _READ, near)
        if path:
            self.import_table(path)

    @reported
    def import_table(self, path: Path) -> None:
        """Read groups and covariates after the user has confirmed the changes."""
        study, changes = with_table(self._workspace.session.study, path)
        answers = ("Close",) if changes.is_empty else ("Import", "Cancel")
        if ask(self._window, f"Import {path.name}?", "\n".join(changes.lines), answers) != "Import":
            return
        self._workspace.session.edit("Import table", study)
        message = f"Rows for {len(changes.matched)} subjects read from {path.name}"
        self._workspace.session.noticed.emit(message)

    @reported
    def _import_model(self) -> None:
        files = self._workspace.files
        path = files.file(self._window, "Import model (choose any particle file of a folder)", _MODELS)
        if path:
            self.import_from(path)

    def import_from(self, path: Path) -> None:
        """Ask for the project's folder, and import a model, or that of the folder of a particle file."""
        if not self.may_leave():
            return
        source = path.parent if path.suffix.lower() in PARTICLE_SUFFIXES else path
        folder = self._workspace.files.new(self._window, "Save project as (creates a folder)", source.stem)
        if folder:
            self.import_model(source, folder)

    @reported
    def import_model(self, source: Path, folder: Path) -> None:
        """Create a project from another program's model and open it."""
        from homolog.run.import_model import domains_of

        domains = domains_of(source)
        domain: str | None = domains[0]
        if len(domains) > 1:
            text, offered = "Which anatomy of the project?", [_TOGETHER, *domains]
            answer, chosen = QInputDialog.getItem(self._window, "Import model", text, offered, editable=False)
            if not chosen:
                return
            domain = None if answer == _TOGETHER else answer

        def take(notes: Sequence[str]) -> None:
            self.open(folder)
            self._workspace.session.noticed.emit(" · ".join(notes) or f"Imported from {source.name}")

        self._workspace.work.import_model(source, folder, domain, take)

    @reported
    def export_table(self, path: Path) -> None:
        """Write names, files, groups and covariates; the file can be read as a cohort again."""
        from homolog_app.exports.tables import write_cohort

        write_cohort(path, self._workspace.session.study.whole)
        self._workspace.session.noticed.emit(f"Table written to {path}")

    def _group(self) -> None:
        session = self._workspace.session
        count = len(session.selection)
        text = f"Group of {session.selection[0] if count == 1 else f'the {count} selected subjects'}:"
        groups = session.study.groups or [""]
        own = {member.subject.group for member in session.study.members if member.name in session.selection}
        present = next((at for at, group in enumerate(groups) if own == {group}), 0)
        name, chosen = QInputDialog.getItem(self._window, "Set group", text, groups, present)
        if chosen:
            session.set_group(name.strip() or None)

    def _ask_location(self, study: Study) -> Path | None:
        """Ask for the folder of moved input files; None if no file has moved, or the dialog is cancelled."""
        missing = [member.name for member in study.members if not member.subject.is_there]
        if not missing:
            return None
        text = f"{len(missing)} input files have moved, such as that of {missing[0]}."
        answers = ("Locate folder…", "Continue without")
        if ask(self._window, "Files have moved", text, answers) != answers[0]:
            return None
        return self._workspace.files.folder(self._window, "Folder that contains the files now")

    def _show_as(self, view: ViewRecord) -> None:
        """Restore the saved state of the views."""
        explore, views = self._explore, self.views
        self._workspace.session.show_step(view.step or "explore")
        for page in (page for page in explore.pages if page.title == view.page):
            explore.open_page(page)
        if views is not None:
            views.restore_view(view)

    def _view(self) -> ViewRecord:
        session = self._workspace.session
        view = ViewRecord(step=session.step, page=self._explore.page.title, selection=session.selection)
        return view if self.views is None else self.views.noted(view)

    def _forget(self) -> None:
        self._workspace.preferences.forget()
        self.show_recent()
