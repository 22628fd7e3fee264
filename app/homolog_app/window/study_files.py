"""A study on disk: every subject, also those left out, and the settings of the next run."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from homolog.cohort import Subject
from homolog.errors import InputError
from homolog.files.atomic import write_text
from homolog.files.project import ProjectFolder
from homolog.files.project_table import update_table
from homolog.files.records import ProjectRecord, SubjectRecord
from homolog.settings import RunSettings
from homolog_app.rendering.camera import CameraState, Canvas
from homolog_app.window.study import Member, Study

__all__ = ["Opened", "StudyRecord", "ViewRecord", "open_project", "record_of", "save_project", "study_of"]

_FILE = "window.json"


class ViewRecord(BaseModel):
    """How the window looked.

    Attributes
    ----------
    step, page : str
        The open step, and the open page of Explore by its title.
    selection : tuple of str
    layout : int
        Subjects a page of the views.
    camera : CameraState or None
        From where the views looked; None for the usual side.
    opacity : float
        Of the surfaces.
    letters, scale_bar : bool
        Whether the anatomical directions and a scale bar are shown.
    """

    model_config = ConfigDict(frozen=True)

    step: str = "cohort"
    page: str = ""
    selection: tuple[str, ...] = ()
    layout: Literal[1, 4, 9, 16] = 4
    camera: CameraState | None = None
    opacity: float = 1.0
    letters: bool = True
    scale_bar: bool = True

    def of_canvas(self, canvas: Canvas) -> "ViewRecord":
        """Return a copy with how a canvas is looked at."""
        same = {name: getattr(canvas, name) for name in ("layout", "opacity", "letters", "scale_bar")}
        return self.model_copy(update={**same, "camera": canvas.cameras[0]})


class StudyRecord(BaseModel):
    """All subjects in order, the names of those left out, and the settings."""

    model_config = ConfigDict(frozen=True)

    subjects: list[SubjectRecord] = []
    excluded: list[str] = []
    settings: RunSettings = RunSettings()
    view: ViewRecord = ViewRecord()


@dataclass(frozen=True, slots=True)
class Opened:
    """A project as it was found."""

    study: Study
    view: ViewRecord
    has_result: bool
    unfinished: bool


def record_of(study: Study, project: ProjectFolder, view: ViewRecord) -> StudyRecord:
    """Return a study for the disk, with paths that start at the project's folder."""
    return StudyRecord(
        subjects=project.describe(study.whole),
        excluded=[member.name for member in study.members if not member.included],
        settings=study.settings,
        view=view,
    )


def study_of(record: StudyRecord, folder: Path) -> Study:
    """Return the study of a record whose paths start at a folder."""
    excluded = set(record.excluded)
    members = tuple(
        Member(
            Subject(
                subject.name,
                (folder / subject.path).resolve(),
                subject.group,
                subject.columns,
                (folder / subject.landmarks).resolve() if subject.landmarks else None,
                (folder / subject.image).resolve() if subject.image else None,
            ),
            subject.name not in excluded,
        )
        for subject in record.subjects
    )
    return Study(members, record.settings)


def save_project(project: ProjectFolder, study: Study, view: ViewRecord) -> None:
    """Write a study into its project; the result there stays.

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
    write_text(project.folder / _FILE, record_of(study, project, view).model_dump_json(indent=2) + "\n")


def open_project(project: ProjectFolder) -> Opened:
    """Read a project's study. What the command line changed since the window saved it counts.

    Raises
    ------
    InputError
        If the folder is no project or damaged.
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
