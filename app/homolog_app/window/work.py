"""The work of the session: reading, grooming and running, one job at a time."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any, TypeVar

from PySide6.QtCore import QObject, Signal, Slot

from homolog.cohort import Cohort
from homolog.files.project import ProjectFolder
from homolog.progress import Tick
from homolog.settings import GroomSettings
from homolog_app.studies.jobs import (
    Devices,
    RunJob,
    groom,
    groom_again,
    groomed_before,
    import_model,
    prepare,
    read_files,
)
from homolog_app.studies.loaded_result import LoadedResult, load_result
from homolog_app.studies.model_shape import PreliminaryModel
from homolog_app.views.contents import Groomed
from homolog_app.window.runner import JobOutcome, Runner, Status, Task
from homolog_app.window.session import Session
from homolog_app.window.start_page import Sample

if TYPE_CHECKING:
    from homolog.arrays import FloatArray
    from homolog.grooming import GroomedSubject
    from homolog_app.studies.file_survey import FileSurvey

    GroomedCohort = tuple[list[GroomedSubject], FloatArray]

__all__ = ["Work"]

_log = logging.getLogger(__name__)
_BACKGROUND = ("read", "restore", "prepare")
_T = TypeVar("_T")
_Order = tuple[str, RunJob | Callable[[Tick], Any], str, Callable[[Any], object]]


class Work(QObject):
    """Gives jobs to the computing thread and puts what they found into the session.

    Reading files and preparing kernels go on in the background: they give way to what the user orders.
    `changed` says that a job begins, ends, pauses, or has a first or another preliminary model; `progressed`
    only that the status of the same job is newer.
    """

    changed = Signal()
    progressed = Signal()
    background = Signal(str)
    devices_known = Signal(object)
    failed = Signal(str, object)

    def __init__(self, session: Session, parent: QObject) -> None:
        super().__init__(parent)
        self._session = session
        self.runner = Runner(self)
        self.runner.progressed.connect(self._progressed)
        self.runner.ended.connect(self._ended)
        self.status: Status | None = None
        self.kind = ""
        self._then: Callable[[Any], object] | None = None
        self._generation = 0
        self._next: _Order | None = None
        self._arrived: SimpleQueue[FileSurvey] = SimpleQueue()
        self._prepared = False
        self._told: tuple[object, ...] = ()
        self.to_restore: ProjectFolder | None = None
        self.cancelled_run: RunJob | None = None
        self.awaits_result = False  # the study being opened has one, which shows subjects without their files
        session.study_changed.connect(self.go_on)

    @property
    def is_busy(self) -> bool:
        """Whether the user waits for a job."""
        return self.kind not in ("", *_BACKGROUND) or self._next is not None

    @property
    def is_saving(self) -> bool:
        """Whether a result is being written, or is about to be."""
        return self.kind == "keep" or (self._next is not None and self._next[0] == "keep")

    @property
    def run_job(self) -> RunJob | None:
        """The run that is going on."""
        return self.runner.job if isinstance(self.runner.job, RunJob) else None

    @property
    def preliminary(self) -> PreliminaryModel | None:
        """The model so far of the run that goes on or was cancelled, while the study has no result."""
        job = self.run_job or self.cancelled_run
        return job.preliminary if job is not None and self._session.result is None else None

    @Slot()
    def go_on(self) -> None:
        """Do what waits in the background, if nothing else is done."""
        if self.runner.job is not None or self._next is not None:
            return
        groom = self._session.study.settings.groom
        unread = [
            member.subject
            for member in self._session.study.members
            if (seen := self._session.surveys.get(member.name)) is None
            or seen.subject.path != member.subject.path
            or (seen.label, seen.segment) != (groom.label, groom.segment)
        ]
        if unread:
            self.compute(
                "read",
                lambda tick: read_files(unread, groom, self._arrived.put, tick),
                "reading files",
                self._read_ended,
            )
        elif self.to_restore is not None:
            self._restore(self.to_restore)
        elif not self._prepared:
            self.compute("prepare", prepare, "preparing compute kernels", self._prepare_ended)

    def restore_groomed(self, project: ProjectFolder) -> None:
        """Show what a project keeps of its grooming once its files are read, if it is still good for them."""
        self.to_restore = project

    def _restore(self, project: ProjectFolder) -> None:
        cohort, settings = self._session.study.cohort, self._session.study.settings

        def look(tick: Tick) -> "GroomedCohort | None":
            return groomed_before(cohort, settings, project, tick)

        def take(groomed: "GroomedCohort | None") -> None:
            self.to_restore = None
            if groomed is not None:
                self._receive_groomed(groomed, settings.groom)
                _log.info("%d subjects are already groomed", len(cohort.subjects))

        self.compute("restore", look, "looking for groomed shapes", take)

    def groom(self, cohort: Cohort, project: ProjectFolder) -> None:
        """Groom the subjects of a cohort with the settings in force."""
        settings = self._session.study.settings

        def take(groomed: "GroomedCohort") -> None:
            self._receive_groomed(groomed, settings.groom)
            _log.info("groomed %d subjects", len(cohort.subjects))

        self.compute("groom", lambda tick: groom(cohort, settings, project, tick), "grooming", take)

    def _receive_groomed(self, groomed: "GroomedCohort", settings: GroomSettings) -> None:
        self._session.groomed |= {
            item.name: Groomed(item, alignment, settings) for item, alignment in zip(*groomed, strict=True)
        }
        self.to_restore = None
        self._session.facts_changed.emit()

    def groom_one(self, name: str, project: ProjectFolder) -> None:
        """Groom one subject again; its place among the others stays."""
        study, others = self._session.study, self._session.groomed
        shapes = {other: item.subject for other, item in others.items()}

        def work(tick: Tick) -> "GroomedSubject":
            return groom_again(study.cohort, name, shapes, study.settings, project, tick)

        def take(groomed: "GroomedSubject") -> None:
            before = self._session.groomed[name]
            self._session.groomed[name] = Groomed(groomed, before.alignment, study.settings.groom)
            _log.info("groomed %s again", name)
            self._session.facts_changed.emit()

        self.compute("groom", work, "grooming", take)

    def run(self, project: ProjectFolder, *, resume: bool = False, from_result: bool = False) -> None:
        """Place the particles, or go on from a checkpoint or from the result."""
        study = self._session.study
        self.cancelled_run = None
        job = RunJob(
            project,
            study.cohort,
            study.settings,
            resume=resume,
            from_result=from_result,
            title=self._session.title,
        )
        self.compute("run", job, "", self._receive_result)

    def keep(self) -> None:
        """Make the particles of the run that was cancelled last the result."""
        job = self.cancelled_run
        if job is not None:
            self.compute("keep", job.keep, "keeping the particles", self._receive_result)

    def compute(
        self, kind: str, work: RunJob | Callable[[Tick], _T], message: str, take: Callable[[_T], object]
    ) -> None:
        """Call a function in the computing thread with progress and cancel, then hand over what it returns.

        Waits until work in the background has ended. Does nothing if the user waits for something else
        already (`is_busy`). The result is dropped if another study has been opened meanwhile; errors and
        cancelling are told as with any job.

        Parameters
        ----------
        kind : str
            Names the work: `kind` and the log say it.
        work : RunJob or callable
            A function takes a tick, knows no Qt, and imports what is heavy by itself.
        message : str
            What is being done; a run says it by itself.
        take : callable
            Is called in the window's thread.
        """
        if self.runner.job is not None:
            if not self.is_busy:
                self._next = (kind, work, message, take)
                self.runner.cancel()
        else:
            self.kind, self._then, self._generation = kind, take, self._session.generation
            if kind not in _BACKGROUND:
                _log.info("%s begins", kind)
            self.runner.start(work if isinstance(work, RunJob) else Task(work, message))
        self.changed.emit()

    def open_result(self, project: ProjectFolder, then: Callable[[], None]) -> None:
        """Read the result of a project, then do something."""

        def take(loaded: LoadedResult) -> None:
            self._receive_result(loaded)
            then()

        self.compute("open", lambda tick: load_result(project), "reading the result", take)

    def import_model(
        self, source: Path, folder: Path, domain: str, take: Callable[[Sequence[str]], None]
    ) -> None:
        """Make a project of another program's model; `take` gets what is to be said of it."""
        self.compute(
            "import", lambda tick: import_model(source, folder, domain, tick), "importing the model", take
        )

    def make_sample(self, sample: Sample, folder: Path, take: Callable[[Path], None]) -> None:
        """Make a sample study."""
        self.compute("sample", lambda tick: sample.make(folder, tick), f"making {sample.name}", take)

    def cancel(self) -> None:
        """End what the user waits for."""
        if self._next is not None:
            self._next = None
            self.changed.emit()
        else:
            self.runner.cancel()

    def forget(self) -> None:
        """End what is done for the study, which is about to be closed."""
        self._next = None
        self.cancelled_run = self.to_restore = None
        self.awaits_result = False
        self.runner.cancel()

    def toggle_pause(self) -> None:
        """Hold the run, or let it go on."""
        if self.run_job is not None:
            self.run_job.set_paused(not self.run_job.status.paused)

    @Slot(object)
    def _progressed(self, status: Status) -> None:
        self._drain()
        if self.is_busy:
            self.status = status
        if self.kind not in ("groom", "run"):
            self.background.emit(status.message)
        state = (self.runner.job, self.status is None, status.paused, self.preliminary)
        (self.progressed if state == self._told else self.changed).emit()
        self._told = state

    @Slot(object)
    def _ended(self, ended: JobOutcome) -> None:
        self._drain()
        kind, self.kind, self.status = self.kind, "", None
        take, self._then = self._then, None
        if self._generation != self._session.generation and kind not in _BACKGROUND:
            take = self.cancelled_run = None
            ended = JobOutcome(ended.job, cancelled=True)
        self.background.emit("")
        self._prepared |= kind == "prepare" and not ended.cancelled
        if ended.error is not None:
            _log.error("%s failed: %s", kind, ended.error, exc_info=ended.error)
            self.failed.emit(kind, ended.error)
        elif ended.cancelled:
            _log.info("%s cancelled", kind)
            if (
                isinstance(ended.job, RunJob)
                and ended.job.keeps
                and self._generation == self._session.generation
            ):
                self.cancelled_run = ended.job
        elif take is not None:
            take(ended.result)
        if self._next is not None and self.runner.job is None:  # unless `take` began something
            following, self._next = self._next, None
            self.compute(*following)
        else:
            self.go_on()
        self.changed.emit()

    def _drain(self) -> None:
        """Put what was read into the session; bad files are left out until the user ticks them again."""
        arrived: list[FileSurvey] = []
        while not self._arrived.empty():
            arrived.append(self._arrived.get())
        if not arrived:
            return
        members = {member.name: member for member in self._session.study.members}
        current = [
            survey
            for survey in arrived
            if survey.subject.name in members
            and members[survey.subject.name].subject.path == survey.subject.path
        ]
        before = self._session.surveys
        back = {  # left out for the lack of a structure, and another one was chosen
            survey.subject.name: replace(members[survey.subject.name], included=True)
            for survey in current
            if not survey.problem
            and not members[survey.subject.name].included
            and (last := before.get(survey.subject.name)) is not None
            and last.problem
            and not last.awaits_choice
        }
        self._session.surveys |= {survey.subject.name: survey for survey in current}
        result = self._session.result
        seen = result.result.names if result is not None else ()  # a result is shown also without its files
        bad = {
            survey.subject.name: replace(members[survey.subject.name], included=False)
            for survey in current
            if survey.problem
            and not (survey.awaits_choice or self.awaits_result)
            and members[survey.subject.name].included
            and survey.subject.name not in seen
        }
        for survey in current:
            if survey.problem:
                _log.warning("%s: %s", survey.subject.name, survey.problem)
        if bad or back:
            self._session.put(self._session.study.with_members(bad | back))
        self._session.facts_changed.emit()

    def _read_ended(self, _: object) -> None:
        _log.info("read %d files", len(self._session.surveys))

    def _prepare_ended(self, devices: Devices) -> None:
        self.devices_known.emit(devices)

    def _receive_result(self, loaded: LoadedResult | None) -> None:
        self.cancelled_run = None
        self.awaits_result = False
        if loaded is None:
            _log.warning("too few particles to keep")
            return
        _log.info("%s", loaded.summary)
        self._session.set_result(loaded, "Place particles")
