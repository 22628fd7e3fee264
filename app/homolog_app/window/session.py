"""The open study: the observable state of the window."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QObject, Signal
from PySide6.QtGui import QUndoCommand, QUndoStack

from homolog.cohort import Subject, column_of
from homolog.io.constraints import own_text
from homolog.settings import OWN, OwnGrooming, RunSettings
from homolog_app.scenes.loaded_result import LoadedResult
from homolog_app.scenes.model_shape import PreliminaryModel
from homolog_app.scenes.structures import ALL, POSES, SHAPES, aspect_of, part_of_aspect
from homolog_app.scenes.subjects import Groomed, readable_cuts
from homolog_app.window.jobs import Devices, RunJob
from homolog_app.window.runner import Status
from homolog_app.window.study import Extension, Member, Study, extension_of, with_cuts

if TYPE_CHECKING:
    from homolog_app.scenes.file_survey import FileSurvey

__all__ = ["BACKGROUND", "PAGE_OF_JOB", "Job", "Session"]

PAGE_OF_JOB = {
    "groups": "Groups",
    "seeds": "Groups",
    "plan": "Groups",
    "mend": "Check",
    "reference": "Patient",
    "patient": "Patient",
    "typical": "Patient",
    "follow-up": "Patient",
    "report": "Patient",
}
"""Pages of *Explore* that show the progress of a job, by its kind."""


BACKGROUND = ("read", "restore", "prepare")
"""Kinds of background jobs."""


@dataclass(frozen=True, slots=True)
class Job:
    """The current job.

    Attributes
    ----------
    kind : str
        Kind of the job, or of the one that is queued next; empty without a job.
    following : str
        The job that is queued next.
    status : Status or None
        Progress of the job that the user waits for.
    background : str
        Description of background work.
    run : RunJob or None
        The run in progress.
    kept : RunJob or None
        The last cancelled run, whose particles can still be saved as the result.
    """

    kind: str = ""
    following: str = ""
    status: Status | None = None
    background: str = ""
    run: RunJob | None = None
    kept: RunJob | None = None

    @property
    def is_busy(self) -> bool:
        """Whether the user is waiting for a job."""
        return self.kind not in ("", *BACKGROUND) or bool(self.following)

    @property
    def is_saving(self) -> bool:
        """Whether a result is being written, or a job that will write one is queued."""
        return "keep" in (self.kind, self.following)


class Session(QObject):
    """State of the open study, with a signal for each part. Used only in the GUI thread.

    `project_changed` is about the folder and whether everything is saved in it, `job_changed` about a job
    that begins, ends, pauses, or has a new preliminary model; `job_progressed` means only that
    its status has changed. `noticed` is a message for the status bar, `failed` an error with its kind.
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
        self.is_opening = False
        """Whether signals of an opened study follow, of which `selection_changed` is the last."""
        self.read_only = ""
        """Why the folder is read-only; empty if it is not."""
        self.surveys: dict[str, FileSurvey] = {}
        self.groomed: dict[str, Groomed] = {}
        self.result: LoadedResult | None = None
        self.aspect = ALL
        """What of a model of several structures *Explore* shows."""
        self._aspects: tuple[LoadedResult | None, dict[str, LoadedResult]] = None, {}
        self.written: LoadedResult | None = None
        """The result in the project's folder."""
        self.used_anyway: LoadedResult | None = None
        """The result that is analysed although it is not usable."""
        self.selection: tuple[str, ...] = ()
        self.step = "cohort"
        """The open step."""
        self.page = ""
        """Title of the open page of *Explore*."""
        self.pages: tuple[str, ...] = ()
        """Titles of all pages, in the order of their tabs."""
        self.job = Job()
        self.devices: Devices | None = None
        """Devices of this machine; None until they are known."""
        self.undo.cleanChanged.connect(self.project_changed)

    @property
    def shown(self) -> LoadedResult | None:
        """The result, or the aspect of it whose model *Explore* shows; the same object each time."""
        if self.result is None or self.aspect == ALL:
            return self.result
        if self._aspects[0] is not self.result:
            self._aspects = self.result, {}
        known = self._aspects[1]
        if self.aspect not in known:
            known[self.aspect] = aspect_of(self.result, self.aspect)
        return known[self.aspect]

    @property
    def part(self) -> LoadedResult | None:
        """The result whose subjects are shown: that of all structures, or of one."""
        return None if self.result is None else part_of_aspect(self.result, self.aspect)

    def show_aspect(self, aspect: str) -> None:
        """Choose what of a model of several structures *Explore* shows."""
        if aspect != self.aspect:
            self.aspect = aspect
            self.result_changed.emit()

    @property
    def is_open(self) -> bool:
        """Whether a study is open."""
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
        """Whether every included subject is groomed with the current settings."""
        return bool(self.study.included) and all(
            self.is_groomed_as_set(subject) for subject in self.study.included
        )

    def is_groomed_as_set(self, subject: Subject) -> bool:
        """Whether a subject is groomed with the current settings and what its table says."""
        groomed = self.groomed.get(subject.name)
        now = self.study.settings.groom, own_text(subject.columns)
        return groomed is not None and (groomed.settings, groomed.own) == now

    def own_grooming(self, name: str) -> OwnGrooming:
        """Return what differs for one subject; raises InputError if its table can't be read."""
        member = next(member for member in self.study.members if member.name == name)
        return OwnGrooming.read(column_of(member.subject.columns, OWN), name)

    def set_own_grooming(self, name: str, own: OwnGrooming) -> None:
        """Set what differs for one subject, in its column ``grooming``."""
        member = next(member for member in self.study.members if member.name == name)
        title = next((key for key in member.subject.columns if key.strip().casefold() == OWN), OWN)
        columns = {**member.subject.columns, title: own.text}
        changed = replace(member, subject=replace(member.subject, columns=columns))
        self.edit(f"Grooming of {name}", self.study.with_members({name: changed}))

    @property
    def cut_structures(self) -> dict[str, str]:
        """Of several structures, their names and what they are in the files; else one without a name."""
        several = self.study.settings.groom.of_structures
        return {name: own.structure for name, own in several.items()} or {"": ""}

    def has_cuts(self, subject: Subject) -> bool:
        """Whether anything is cut away of a subject."""
        return any(readable_cuts(subject, own) for own in self.cut_structures.values())

    def set_cuts(self, name: str, text: str, structure: str = "", key: str = "") -> None:
        """Set what is cut away of one subject; edits with the same key are one in the undo history."""
        self.edit(f"Cut {name}", with_cuts(self.study, {name: text}, structure), key)

    def uncut_selected(self) -> None:
        """Leave the selected subjects whole."""
        study = self.study
        for structure in ("", *self.cut_structures.values()):
            study = with_cuts(study, dict.fromkeys(self.selection, ""), structure)
        self.edit("Remove cuts", study)

    @property
    def extension_of(self) -> Extension | None:
        """Possible extension of the result by a run; None without a result."""
        return extension_of(self.study, self.result.record) if self.result is not None else None

    @property
    def missing(self) -> tuple[str, ...]:
        """Data of the open study that are not in the project's folder, as texts."""
        edits = self.folder is not None and not self.undo.isClean()
        cautions = {"Unsaved edits": edits, "Changed particles": not self.is_result_written}
        return tuple(text for text, given in cautions.items() if given)

    def show_step(self, step: str) -> None:
        """Open one of the four steps."""
        self.step = step
        if step != "explore":
            self.show_aspect(ALL)
        self.step_changed.emit()

    def show_page(self, page: str | int, step: str = "") -> None:
        """Open a page of *Explore*, by title or number, and a step if given."""
        title = self.pages[page] if isinstance(page, int) else page
        if title != self.page:
            self.page = title
            if title != "Modes" and self.aspect in (SHAPES, POSES):
                self.show_aspect(ALL)
            self.page_changed.emit()
        if step:
            self.show_step(step)

    @property
    def preliminary(self) -> PreliminaryModel | None:
        """The preliminary model of the current or cancelled run, while the study has no result."""
        run = self.job.run or self.job.kept
        return run.preliminary if run is not None and self.result is None else None

    def add_groomed(self, groomed: Mapping[str, Groomed]) -> None:
        """Add groomed subjects, replacing those with the same names."""
        self.groomed |= groomed
        self.groomed_changed.emit()

    def set_devices(self, devices: Devices) -> None:
        """Set the devices of this machine."""
        self.devices = devices
        self.devices_changed.emit()

    def edit(self, text: str, study: Study, key: str = "") -> None:
        """Apply an undoable edit; successive edits with the same key are merged."""
        if study != self.study:
            self.undo.push(_Edit(self, text, study, key))

    def edit_settings(self, text: str, settings: RunSettings, key: str = "") -> None:
        """Edit the settings of the next run."""
        self.edit(text, Study(self.study.members, settings), key)

    def open(self, study: Study, folder: Path | None, read_only: str = "") -> None:
        """Open another study; the previous one and its pending jobs are dropped."""
        self.generation += 1
        self.surveys, self.groomed, self.result, self.written, self.selection = {}, {}, None, None, ()
        self.aspect = ALL
        self.study, self.folder, self.read_only = study, folder, read_only
        self._remember()
        self.is_opening = True
        self.undo.clear()
        self.project_changed.emit()
        for changed in (self.study_changed, self.surveys_changed, self.groomed_changed, self.result_changed):
            changed.emit()
        self.is_opening = False
        self.selection_changed.emit()

    @property
    def is_result_written(self) -> bool:
        """Whether the open result is the one in the project's folder."""
        seen, written = self.result, self.written
        return seen is written or (
            seen is not None
            and written is not None
            and seen.record is written.record
            and np.array_equal(seen.result.local, written.result.local)
        )

    def set_result(self, loaded: LoadedResult, text: str) -> None:
        """Set the result that was written to the project; undo restores the previous one.

        Undo is not possible if shapes were groomed with other settings since.
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
        """Replace the result; undo restores the previous one."""
        self.undo.push(_Exchange(self, loaded, text))

    def show_result(self, loaded: LoadedResult | None) -> None:
        """Replace the result without an entry in the undo history."""
        self.result, self.aspect = loaded, ALL
        self.result_changed.emit()

    def select(self, names: Iterable[str]) -> None:
        """Select subjects in all parts of the window."""
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
        """Assign the selected subjects to a group."""
        self._edit_selected(
            "Set group", lambda member: replace(member, subject=replace(member.subject, group=group))
        )

    def toggle_included(self) -> None:
        """Include the selected subjects, or exclude them if all are included."""
        chosen = [member for member in self.study.members if member.name in self.selection]
        included = not all(member.included for member in chosen)
        self._edit_selected(
            "Include subjects" if included else "Exclude subjects",
            lambda member: replace(member, included=included),
        )

    def remove_selected(self) -> None:
        """Remove the selected subjects from the study."""
        self.edit("Remove subjects", self.study.without(self.selection))

    def _edit_selected(self, text: str, change: Callable[[Member], Member]) -> None:
        changed = {
            member.name: change(member) for member in self.study.members if member.name in self.selection
        }
        self.edit(text, self.study.with_members(changed))

    def put(self, study: Study) -> None:
        """Set the study without an entry in the undo history."""
        self.study = study
        self._remember()
        self.study_changed.emit()
        self.select(self.selection)

    def _remember(self) -> None:
        """Remember all subjects of the session, because the log may mention removed ones."""
        for member in self.study.members:
            subject = member.subject
            self.seen[subject.name, subject.path, subject.group, *subject.columns.values()] = subject


class _Exchange(QUndoCommand):
    """An undoable change of the result."""

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
    """An undoable change of the study."""

    def __init__(self, session: Session, text: str, after: Study, key: str) -> None:
        super().__init__(text)
        self._session = session
        self._before, self.after = session.study, after
        self.key = key

    def id(self) -> int:
        """Return which edits can be merged."""
        return hash(self.key) % (2**31 - 1) if self.key else -1

    def mergeWith(self, other: QUndoCommand) -> bool:
        """Merge a following edit of the same object."""
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
