"""A study on disk: saved, interrupted, and recovered after a crash."""

import shutil
import uuid
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal

from filelock import FileLock, Timeout
from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError

from homolog.cohort import checked_path
from homolog.errors import InputError
from homolog.io.atomic import replace_folder, write_text
from homolog.io.project import ProjectFolder, subject_of
from homolog.io.project_table import update_table
from homolog.io.records import ProjectRecord, SubjectRecord
from homolog.settings import RunSettings
from homolog_app.rendering.camera import CameraState, Canvas, Layer
from homolog_app.window.study import Member, Study

__all__ = [
    "KEPT",
    "InterruptedSession",
    "Journal",
    "JournalRecord",
    "Opened",
    "StudyRecord",
    "ViewRecord",
    "copy_project",
    "find_lost",
    "interrupted_text",
    "open_project",
    "record_of",
    "save_project",
    "save_view",
    "study_of",
    "suggested_folder",
]


_FILE = "window.json"


KEPT = ("opacity", "letters", "scale_bar", "layers")
"""Fields of the views' display that a project keeps."""


class ViewRecord(BaseModel):
    """The state of the window's views.

    Attributes
    ----------
    step, page : str
        The open step, empty if unknown, and the open page of Explore by its title.
    selection : tuple of str
    layout : int
        Number of subjects per page of the views.
    camera : CameraState or None
        Camera of the views; None for the default.
    opacity : float
        Opacity of the surfaces.
    letters, scale_bar : bool
        Whether the anatomical directions and a scale bar are shown.
    layers : tuple of Layer
        Structures that are not shown as usual.
    """

    model_config = ConfigDict(frozen=True)

    step: str = ""
    page: str = ""
    selection: tuple[str, ...] = ()
    layout: Literal[1, 4, 9, 16] = 4
    camera: CameraState | None = None
    opacity: float = 1.0
    letters: bool = True
    scale_bar: bool = True
    layers: tuple[Layer, ...] = ()

    def of_canvas(self, canvas: Canvas) -> "ViewRecord":
        """Return a copy with the display state of a canvas."""
        same = {name: getattr(canvas, name) for name in ("layout", *KEPT)}
        return self.model_copy(update={**same, "camera": canvas.cameras[0]})


class StudyRecord(BaseModel):
    """All subjects in order, the names of excluded ones, and the settings."""

    model_config = ConfigDict(frozen=True)

    subjects: list[SubjectRecord] = []
    excluded: list[str] = []
    settings: RunSettings = RunSettings()
    view: ViewRecord = ViewRecord()


@dataclass(frozen=True, slots=True)
class Opened:
    """An opened project."""

    study: Study
    view: ViewRecord
    has_result: bool
    unfinished: bool


def record_of(study: Study, project: ProjectFolder, view: ViewRecord) -> StudyRecord:
    """Return a study for the disk, with paths relative to the project's folder."""
    return StudyRecord(
        subjects=project.describe(study.whole),
        excluded=[member.name for member in study.members if not member.included],
        settings=study.settings,
        view=view,
    )


def study_of(record: StudyRecord, folder: Path) -> Study:
    """Return the study of a record whose paths are relative to a folder."""
    excluded = set(record.excluded)
    members = tuple(
        Member(subject_of(subject, folder), subject.name not in excluded) for subject in record.subjects
    )
    return Study(members, record.settings)


def save_project(project: ProjectFolder, study: Study, view: ViewRecord) -> None:
    """Write a study into its project; its result is not changed.

    Raises
    ------
    InputError
        If the folder can't be written to.
    """
    before = project.read() if project.exists else ProjectRecord()
    project.write(
        before.model_copy(update={"subjects": project.describe(study.cohort), "settings": study.settings})
    )
    update_table(project, study.whole.subjects)
    save_view(project, study, view)


def save_view(project: ProjectFolder, study: Study, view: ViewRecord) -> None:
    """Write the view state of a saved study; raises InputError if that can't be written."""
    write_text(project.folder / _FILE, record_of(study, project, view).model_dump_json(indent=2) + "\n")


def open_project(project: ProjectFolder) -> Opened:
    """Read a project's study, including later changes by the command line.

    Raises
    ------
    InputError
        If the folder is not a project, or damaged.
    """
    project.recover()
    record = project.read()
    stored = _stored(project.folder / _FILE)
    left_out = [subject for subject in stored.subjects if subject.name in set(stored.excluded)]
    running = {subject.name: subject for subject in record.subjects}
    order = [subject.name for subject in stored.subjects] + list(running)
    known = {subject.name: subject for subject in left_out} | running
    subjects = [known[name] for name in dict.fromkeys(order) if name in known]
    whole = StudyRecord(
        subjects=subjects,
        excluded=[subject.name for subject in left_out if subject.name not in running],
        settings=record.settings,
    )
    study = study_of(whole, project.folder)
    return Opened(study, stored.view, record.result is not None, record.unfinished)


def _stored(path: Path) -> StudyRecord:
    if not path.is_file():
        return StudyRecord()
    try:
        return StudyRecord.model_validate_json(path.read_bytes())
    except (ValidationError, OSError) as error:
        raise InputError(f"{path}: is damaged: {error}; delete it to open the project without it") from error


_RECORD, _LOCK, _DRAFT = "journal.json", "lock", "draft"


class JournalRecord(BaseModel):
    """The open study: project folder (None if never saved), study, and whether a run was in progress."""

    model_config = ConfigDict(frozen=True)

    folder: Annotated[str, AfterValidator(checked_path)] | None
    study: StudyRecord
    running: bool


class Journal:
    """One window's folder: its lock, its journal, and the draft project of a study that was never saved."""

    def __init__(self, sessions: Path) -> None:
        self._folder = sessions / uuid.uuid4().hex
        self._folder.mkdir(parents=True)
        self._lock = FileLock(self._folder / _LOCK)
        self._lock.acquire(timeout=0)

    @property
    def draft(self) -> ProjectFolder:
        """The project of a study that was never saved."""
        return ProjectFolder(self._folder / _DRAFT)

    def write(self, record: JournalRecord) -> None:
        """Replace the journal."""
        write_text(self._folder / _RECORD, record.model_dump_json())

    def clear_record(self) -> None:
        """Delete the record of the open study after it was saved."""
        (self._folder / _RECORD).unlink(missing_ok=True)

    def clear(self) -> None:
        """Delete record and draft: the study was discarded, or saved elsewhere."""
        self.clear_record()
        shutil.rmtree(self.draft.folder, ignore_errors=True)

    def adopt(self, lost: "InterruptedSession") -> None:
        """Take over the draft of a terminated window."""
        draft = lost.folder / _DRAFT
        if draft.is_dir():
            shutil.rmtree(self.draft.folder, ignore_errors=True)
            draft.replace(self.draft.folder)
        lost.discard()

    def close(self) -> None:
        """Remove everything; the window was closed normally."""
        self._lock.release()
        shutil.rmtree(self._folder, ignore_errors=True)


@dataclass(frozen=True, slots=True)
class InterruptedSession:
    """The journal of a terminated window."""

    folder: Path
    record: JournalRecord

    @property
    def base(self) -> Path:
        """The folder to which the study's paths are relative."""
        return Path(self.record.folder) if self.record.folder else self.folder / _DRAFT

    def discard(self) -> None:
        """Delete the journal."""
        shutil.rmtree(self.folder, ignore_errors=True)


def find_lost(sessions: Path) -> list[InterruptedSession]:
    """Return the journals of terminated windows, newest first; folders without one are removed.

    Running windows hold a lock, which the system releases when the process ends for any reason.
    """
    journals: list[tuple[float, InterruptedSession]] = []
    for folder in sessions.iterdir() if sessions.is_dir() else ():
        lock = FileLock(folder / _LOCK)
        try:
            lock.acquire(timeout=0)
        except (Timeout, OSError):
            continue
        lock.release()
        path = folder / _RECORD
        try:
            lost = InterruptedSession(folder, JournalRecord.model_validate_json(path.read_bytes()))
            journals.append((path.stat().st_mtime, lost))
        except (OSError, ValidationError):
            shutil.rmtree(folder, ignore_errors=True)
    return [lost for _, lost in sorted(journals, key=lambda entry: -entry[0])]


def interrupted_text(checkpoint: Path, particles: int) -> str:
    """Describe the progress of an interrupted run.

    Parameters
    ----------
    checkpoint : Path
        The checkpoint file.
    particles : int
        Requested number of particles.
    """
    try:
        placed, iterations, fraction = _read(checkpoint, checkpoint.stat().st_mtime_ns)
    except (InputError, OSError, KeyError, IndexError):
        return "The last run was interrupted, and its checkpoint can't be read; start a new run."
    where = f"after {iterations} iterations" if fraction is None else f"at {100.0 * fraction:.0f} %"
    return f"Stopped {where}, with {placed} of {particles} particles. Resume continues from there."


@lru_cache(maxsize=1)
def _read(checkpoint: Path, _changed: int) -> tuple[int, int, float | None]:
    """Return particles, iterations and fraction done; read again only if the file has changed."""
    from homolog.io.arrays import read_arrays

    stored = read_arrays(checkpoint, names=("means", "iteration", "fraction"))
    fraction = float(stored["fraction"]) if "fraction" in stored else None  # versions before 0.3 lack it
    return len(stored["means"]), int(stored["iteration"]), fraction


def copy_project(old: Path, new: Path) -> None:
    """Copy a project's folder atomically; stop at the first error."""
    failed: list[OSError] = []

    def copy(source: str, target: str) -> None:
        if not failed:
            try:
                shutil.copy2(source, target)
            except OSError as error:
                failed.append(error)

    ignored = shutil.ignore_patterns(".lock", ".holder")
    with replace_folder(new) as part:
        shutil.copytree(old, part, dirs_exist_ok=True, ignore=ignored, copy_function=copy)
        if failed:
            raise failed[0]


def suggested_folder(study: Study, folder: Path | None, home: Path) -> Path:
    """Return a new folder for a project: next to the open one, or to the folder of the subjects' files.

    Sample studies, whose files are in `home`, are suggested by name only.
    """
    base = folder or next((member.subject.path.parent for member in study.members), home)
    return Path("Study") if base.is_relative_to(home) else base.with_name(f"{base.name}-study")
