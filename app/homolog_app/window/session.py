"""The open study: the one object that the panels talk to."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QObject, Signal
from PySide6.QtGui import QUndoCommand, QUndoStack

from homolog.cohort import Subject
from homolog.settings import RunSettings
from homolog_app.studies.jobs import Devices, RunJob
from homolog_app.studies.loaded_result import LoadedResult
from homolog_app.studies.model_shape import PreliminaryModel
from homolog_app.studies.study import Extension, Member, Study, extension_of
from homolog_app.views.contents import Groomed
from homolog_app.window.runner import Status

if TYPE_CHECKING:
    from homolog_app.studies.file_survey import FileSurvey

__all__ = ["BACKGROUND", "Job", "Session"]


BACKGROUND = ("read", "restore", "prepare")
"""Kinds of jobs that nobody waits for."""


@dataclass(frozen=True, slots=True)
class Job:
    """What is computed now.

    Attributes
    ----------
    kind : str
        Names it; empty if nothing is computed.
    following : str
        What begins after it, because the user waits for it.
    status : Status or None
        How far what the user waits for is.
    background : str
        What is done in the background, or beside grooming and runs, in words.
    run : RunJob or None
        The run that goes on.
    kept : RunJob or None
        The run that was cancelled last, whose particles can still become the result.
    """

    kind: str = ""
    following: str = ""
    status: Status | None = None
    background: str = ""
    run: RunJob | None = None
    kept: RunJob | None = None

    @property
    def is_busy(self) -> bool:
        """Whether the user waits for something."""
        return self.kind not in ("", *BACKGROUND) or bool(self.following)

    @property
    def is_saving(self) -> bool:
        """Whether a result is being written, or is about to be."""
        return "keep" in (self.kind, self.following)


class Session(QObject):
    """What is open, computed, selected and seen: a signal for each. Only the GUI thread touches it.

    `project_changed` is about the folder and whether everything is saved in it, `job_changed` about a job
    that begins, ends, pauses, or has a first or another preliminary model; `job_progressed` says only that
    its status is newer. `noticed` is a word for the status bar, `failed` an error with its kind.
    """

    study_changed = Signal()
    project_changed = Signal()
    surveys_changed = Signal()
    groomed_changed = Signal()
    result_changed = Signal()
    selection_changed = Signal()
    step_changed = Signal()
    page_changed = Signal()
    job_changed = Signal()
    job_progressed = Signal()
    devices_changed = Signal()
    noticed = Signal(str)
    failed = Signal(str, object)

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self.undo = QUndoStack(self)
        self.study = Study()
        self.seen: dict[tuple[object, ...], Subject] = {}
        self.generation = 0
        self.folder: Path | None = None
        self.read_only = ""
        """Why nothing can be written to the folder; empty if it can."""
        self.surveys: dict[str, FileSurvey] = {}
        self.groomed: dict[str, Groomed] = {}
        self.result: LoadedResult | None = None
        self.written: LoadedResult | None = None
        """The result in the project's folder."""
        self.selection: tuple[str, ...] = ()
        self.step = "cohort"
        """The step of the study that is seen."""
        self.page = ""
        """Title of the page of *Explore* that is open."""
        self.pages: tuple[str, ...] = ()
        """Titles of all of these pages, in the order of their tabs."""
        self.job = Job()
        self.devices: Devices | None = None
        """Those of this machine; None until they are known."""
        self.undo.cleanChanged.connect(self.project_changed)

    @property
    def is_open(self) -> bool:
        """Whether there is a study."""
        return bool(self.study.members) or self.folder is not None

    @property
    def title(self) -> str:
        """The project's name for the title bar."""
        return self.folder.name if self.folder else "Unsaved study"

    @property
    def groomed_names(self) -> list[str]:
        """The included subjects that have a groomed surface, in order."""
        return [subject.name for subject in self.study.included if subject.name in self.groomed]

    @property
    def is_groomed(self) -> bool:
        """Whether every included subject is groomed with the settings in force."""
        return bool(self.study.included) and all(
            subject.name in self.groomed and self.groomed[subject.name].settings == self.study.settings.groom
            for subject in self.study.included
        )

    @property
    def extension_of(self) -> Extension | None:
        """What a run can add to the result; None without one."""
        return extension_of(self.study, self.result.record) if self.result is not None else None

    @property
    def missing(self) -> tuple[str, ...]:
        """What of the open study is not in the project's folder, in words."""
        edits = self.folder is not None and not self.undo.isClean()
        cautions = {"Unsaved edits": edits, "Changed particles": not self.is_result_written}
        return tuple(text for text, given in cautions.items() if given)

    def show_step(self, step: str) -> None:
        """Turn to one of the four steps."""
        self.step = step
        self.step_changed.emit()

    def show_page(self, page: str | int, step: str = "") -> None:
        """Turn to a page of *Explore*, by title or number, and to a step if one is named."""
        title = self.pages[page] if isinstance(page, int) else page
        if title != self.page:
            self.page = title
            self.page_changed.emit()
        if step:
            self.show_step(step)

    @property
    def preliminary(self) -> PreliminaryModel | None:
        """The model so far of the run that goes on or was cancelled, while the study has no result."""
        run = self.job.run or self.job.kept
        return run.preliminary if run is not None and self.result is None else None

    def add_surveys(self, surveys: "Mapping[str, FileSurvey]") -> None:
        """Have what was read of subjects' files."""
        self.surveys |= surveys
        self.surveys_changed.emit()

    def add_groomed(self, groomed: Mapping[str, Groomed]) -> None:
        """Have groomed subjects, in place of those of the same names."""
        self.groomed |= groomed
        self.groomed_changed.emit()

    def set_devices(self, devices: Devices) -> None:
        """Know the devices of this machine."""
        self.devices = devices
        self.devices_changed.emit()

    def edit(self, text: str, study: Study, key: str = "") -> None:
        """Make an edit that can be undone; successive edits with the same key become one."""
        if study != self.study:
            self.undo.push(_Edit(self, text, study, key))

    def edit_settings(self, text: str, settings: RunSettings, key: str = "") -> None:
        """Edit the settings of the next run."""
        self.edit(text, Study(self.study.members, settings), key)

    def open(self, study: Study, folder: Path | None, read_only: str = "") -> None:
        """Open another study; nothing of the one before is kept, nor what is still computed for it."""
        self.generation += 1
        self.surveys, self.groomed, self.result, self.written, self.selection = {}, {}, None, None, ()
        self.study, self.folder, self.read_only = study, folder, read_only
        self._remember()
        self.undo.clear()
        self.project_changed.emit()
        for changed in (
            self.study_changed, self.surveys_changed, self.groomed_changed, self.result_changed,
            self.selection_changed,
        ):  # fmt: skip
            changed.emit()

    @property
    def is_result_written(self) -> bool:
        """Whether the result that is seen is the one in the project's folder."""
        seen, written = self.result, self.written
        return seen is written or (
            seen is not None
            and written is not None
            and seen.record is written.record
            and np.array_equal(seen.result.local, written.result.local)
        )

    def set_result(self, loaded: LoadedResult, text: str) -> None:
        """Have the result that was written to the project; undo shows the one before.

        Not so if shapes were groomed with other settings since: they have taken the place of those before.
        """
        before, self.written = self.result, loaded
        if before is None or before.record.settings.groom != loaded.record.settings.groom:
            self.show_result(loaded)
            return
        clean = self.undo.isClean()
        self.exchange_result(loaded, text)
        if clean:
            self.undo.setClean()

    def exchange_result(self, loaded: LoadedResult, text: str) -> None:
        """Show another result; undo shows the present one again."""
        self.undo.push(_Exchange(self, loaded, text))

    def show_result(self, loaded: LoadedResult | None) -> None:
        """Show another result without a trace in the history."""
        self.result = loaded
        self.result_changed.emit()

    def select(self, names: Iterable[str]) -> None:
        """Select subjects, everywhere."""
        known = {member.name for member in self.study.members}
        chosen = tuple(name for name in names if name in known)
        if chosen != self.selection:
            self.selection = chosen
            self.selection_changed.emit()

    def toggle_selected(self, name: str) -> None:
        """Add a subject to the selection, or remove it."""
        others = [selected for selected in self.selection if selected != name]
        self.select(others if len(others) < len(self.selection) else [*others, name])

    def set_group(self, group: str | None) -> None:
        """Give the selected subjects a group."""
        self._edit_selected(
            "Set group", lambda member: replace(member, subject=replace(member.subject, group=group))
        )

    def toggle_included(self) -> None:
        """Take the selected subjects in, or leave them out if all of them are in."""
        chosen = [member for member in self.study.members if member.name in self.selection]
        included = not all(member.included for member in chosen)
        self._edit_selected(
            "Include subjects" if included else "Exclude subjects",
            lambda member: replace(member, included=included),
        )

    def remove_selected(self) -> None:
        """Take the selected subjects out of the study."""
        self.edit("Remove subjects", self.study.without(self.selection))

    def _edit_selected(self, text: str, change: Callable[[Member], Member]) -> None:
        changed = {
            member.name: change(member) for member in self.study.members if member.name in self.selection
        }
        self.edit(text, self.study.with_members(changed))

    def put(self, study: Study) -> None:
        """Set the study without a trace in the history; for the history itself."""
        self.study = study
        self._remember()
        self.study_changed.emit()
        self.select(self.selection)

    def _remember(self) -> None:
        """Keep in mind who was ever in a study: the log may speak of them when they are gone."""
        for member in self.study.members:
            subject = member.subject
            self.seen[subject.name, subject.path, subject.group, *subject.columns.values()] = subject


class _Exchange(QUndoCommand):
    """From one result to the next."""

    def __init__(self, session: Session, after: LoadedResult, text: str) -> None:
        super().__init__(text)
        self._session = session
        self._before, self._after = session.result, after

    def redo(self) -> None:
        """Show the later result."""
        self._session.show_result(self._after)

    def undo(self) -> None:
        """Show the earlier result."""
        self._session.show_result(self._before)


class _Edit(QUndoCommand):
    """From one study to the next."""

    def __init__(self, session: Session, text: str, after: Study, key: str) -> None:
        super().__init__(text)
        self._session = session
        self._before, self.after = session.study, after
        self.key = key

    def id(self) -> int:
        """Say which edits may become one."""
        return hash(self.key) % (2**31 - 1) if self.key else -1

    def mergeWith(self, other: QUndoCommand) -> bool:
        """Take a following edit of the same thing in."""
        if not isinstance(other, _Edit) or other.key != self.key:
            return False
        self.after = other.after
        return True

    def redo(self) -> None:
        """Show the later study."""
        self._session.put(self.after)

    def undo(self) -> None:
        """Show the earlier study."""
        self._session.put(self._before)
