"""The jobs of the session: reading, grooming and running, one at a time."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any, TypeVar

from PySide6.QtCore import QObject, Slot

from homolog.cohort import Cohort, Subject, column_of
from homolog.io.constraints import cut_column, own_text
from homolog.io.project import ProjectFolder
from homolog.progress import Tick, part_of
from homolog.settings import GroomSettings
from homolog_app.scenes.loaded_result import LoadedResult, load_result
from homolog_app.scenes.subjects import Groomed, whole_surface
from homolog_app.window.jobs import (
    Devices,
    RunJob,
    prepare,
    read_files,
)
from homolog_app.window.runner import JobOutcome, Runner, Status, Task, TaskStatus
from homolog_app.window.session import BACKGROUND, Job, Session
from homolog_app.window.start_page import Sample
from homolog_app.window.study import with_cuts

if TYPE_CHECKING:
    from homolog.arrays import FloatArray
    from homolog.grooming import GroomedSubject
    from homolog_app.scenes.file_survey import FileSurvey

    GroomedCohort = tuple[list[GroomedSubject], FloatArray]

__all__ = ["Work"]

_log = logging.getLogger(__name__)
_T = TypeVar("_T")
_COMPUTED = ("groom", "run")
"""Jobs that wait until the kernels are compiled, which they would do themselves without a word."""
_Order = tuple[str, RunJob | Callable[[Tick], Any], str, Callable[[Any], object]]


def _forwards(status: Status, before: Status | None) -> Status:
    """Return a job's status with the fraction that it had before, if that was larger."""
    if before is None or status.fraction >= before.fraction:
        return status
    return TaskStatus(before.fraction, status.message, status.eta_s, status.paused)


class Work(QObject):
    """Passes jobs to the computing thread and stores their results in the session.

    Reading files and compiling kernels are background jobs, which yield to other jobs.
    `Session.job` describes the current job.
    """

    def __init__(self, session: Session, parent: QObject) -> None:
        super().__init__(parent)
        self.session = session
        self.runner = Runner(self)
        self.runner.progressed.connect(self._progressed)
        self.runner.ended.connect(self._ended)
        self._kind = ""
        self._status: Status | None = None
        self._then: Callable[[Any], object] | None = None
        self._generation = 0
        self._next: _Order | None = None
        self._arrived: SimpleQueue[FileSurvey] = SimpleQueue()
        self._prepared = False
        self._last_state: tuple[object, ...] = ()
        self.to_restore: ProjectFolder | None = None
        self._kept: RunJob | None = None
        self.awaits_result = False  # a result is being read; it needs no input files
        session.study_changed.connect(self.go_on)

    def _update_job(self, background: str = "") -> None:
        """Update the session's job; a job that waits for background work is shown, too."""
        run, kind, following, status = self.runner.job, self._kind, "", self._status
        if self._next is not None:
            kind = following = self._next[0]
            now = self.runner.job if self._kind == "prepare" else None
            status = TaskStatus(message=now.status.message if now else self._next[2] or "starting")
        self.session.job = Job(
            kind, following, status, background, run if isinstance(run, RunJob) else None, self._kept
        )

    def _publish(self) -> None:
        self._update_job()
        self.session.job_changed.emit()

    @Slot()
    def go_on(self) -> None:
        """Start waiting background jobs if no other job is running; reading goes before compiling."""
        groom, unread = self.session.study.settings.groom, self._unread()
        if self.runner.job is not None or self._next is not None:
            if unread and self._kind == "prepare":
                self.runner.cancel()
            return
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

    def _unread(self) -> list[Subject]:
        """Return the subjects without a preview of their file and structure."""
        groom = self.session.study.settings.groom
        return [
            member.subject
            for member in self.session.study.members
            if (seen := self.session.surveys.get(member.name)) is None
            or seen.subject.path != member.subject.path
            or seen.groom.source != groom.source
        ]

    def restore_groomed(self, project: ProjectFolder) -> None:
        """Restore a project's cached groomed shapes once its files are read, if they are up to date."""
        self.to_restore = project

    def _restore(self, project: ProjectFolder) -> None:
        cohort, settings = self.session.study.cohort, self.session.study.settings

        def look(tick: Tick) -> "GroomedCohort | None":
            from homolog.run.project_grooming import groomed_before

            return groomed_before(cohort, settings, project, tick)

        def take(groomed: "GroomedCohort | None") -> None:
            self.to_restore = None
            if groomed is not None:
                self._receive_groomed(groomed, cohort, settings.groom)
                _log.info("%d subjects are already groomed", len(cohort.subjects))

        self.compute("restore", look, "looking for groomed shapes", take)

    def groom(self, cohort: Cohort, project: ProjectFolder) -> None:
        """Groom the subjects of a cohort with the current settings."""
        settings = self.session.study.settings

        def work(tick: Tick) -> "GroomedCohort":
            from homolog.run.project_grooming import groom_project

            return groom_project(cohort, settings, project, tick)

        def take(groomed: "GroomedCohort") -> None:
            self._receive_groomed(groomed, cohort, settings.groom)
            _log.info("groomed %d subjects", len(cohort.subjects))

        self.compute("groom", work, "grooming", take)

    def _receive_groomed(self, groomed: "GroomedCohort", cohort: Cohort, settings: GroomSettings) -> None:
        """Take the surfaces of a cohort, as it was when its grooming began."""
        self.to_restore = None
        own = {item.name: own_text(item.columns) for item in cohort.subjects}
        self.session.add_groomed(
            {
                item.name: Groomed(item, alignment, settings, own.get(item.name, ""))
                for item, alignment in zip(*groomed, strict=True)
            }
        )

    def groom_one(self, name: str, project: ProjectFolder) -> None:
        """Groom one subject again; the others keep their surfaces."""
        study, before = self.session.study, self.session.groomed
        own = {item.name: own_text(item.columns) for item in study.included}
        shapes = {other: item.subject for other, item in before.items() if other in own}

        def work(tick: Tick) -> "dict[str, tuple[GroomedSubject, FloatArray]]":
            from homolog.run.project_grooming import groom_again

            return groom_again(study.cohort, name, shapes, study.settings, project, tick)

        def take(groomed: "dict[str, tuple[GroomedSubject, FloatArray]]") -> None:
            _log.info("groomed %s again", name)
            again = {
                other: replace(before[other], subject=subject, alignment=place)
                for other, (subject, place) in groomed.items()
                if other != name
            }
            self.session.add_groomed(again | {name: Groomed(*groomed[name], study.settings.groom, own[name])})

        self.compute("groom", work, f"grooming {name}", take)

    def carry_cuts(self, name: str) -> None:
        """Carry what is cut away of a subject to all other groomed ones, as one edit of the study."""
        study, session = self.session.study, self.session
        shapes = {
            item.name: (whole, session.groomed[item.name].alignment)
            for item in study.included
            if item.name in session.groomed
            and (whole := whole_surface(item.name, session.surveys, session.groomed)) is not None
        }
        subject = next(item for item in study.included if item.name == name)
        texts = {key: column_of(subject.columns, cut_column(key)) for key in session.cut_structures.values()}

        def work(tick: Tick) -> dict[str, dict[str, str]]:
            from homolog.run.planes import carry_cuts

            carried = {}
            for number, (structure, text) in enumerate(texts.items()):
                own = {
                    item: (mesh.parts[number], place)
                    for item, (mesh, place) in shapes.items()
                    if len(mesh.parts) == len(texts)
                }
                if text and name in own:
                    now = part_of(tick, number / len(texts), (number + 1) / len(texts))
                    carried[structure] = carry_cuts(name, text, own, now)
            return carried

        def take(carried: dict[str, dict[str, str]]) -> None:
            study = self.session.study
            for structure, cuts in carried.items():
                study = with_cuts(study, cuts, structure)
            self.session.edit("Carry cuts", study)

        self.compute("carry", work, "carrying the cuts", take)

    def run(self, project: ProjectFolder, *, resume: bool = False, from_result: bool = False) -> None:
        """Place the particles, or continue from a checkpoint or from the result."""
        study = self.session.study
        self._kept = None
        job = RunJob(
            project,
            study.cohort,
            study.settings,
            resume=resume,
            from_result=from_result,
            title=self.session.title,
        )
        self.compute("run", job, "", self._receive_result)

    def keep(self) -> None:
        """Save the particles of the last cancelled run as the result."""
        job = self._kept
        if job is not None:
            self.compute("keep", job.keep, "saving the particles", self._receive_result)

    def compute(
        self, kind: str, work: RunJob | Callable[[Tick], _T], message: str, take: Callable[[_T], object]
    ) -> None:
        """Call a function in the computing thread with progress and cancellation, then pass on its result.

        Waits for background jobs to end. Does nothing if the user is waiting for another job
        (`Session.job`). The result is dropped if another study has been opened meanwhile; errors and
        cancelling are reported as for any job.

        Parameters
        ----------
        kind : str
            Name of the work for `Job.kind` and the log.
        work : RunJob or callable
            A function takes a tick, does not use Qt, and imports heavy packages itself.
        message : str
            What is being done; a run reports this itself.
        take : callable
            Called in the GUI thread.
        """
        if self.runner.job is not None:
            if not self.session.job.is_busy:
                self._next = (kind, work, message, take)
                if not (self._kind == "prepare" and kind in _COMPUTED):
                    self.runner.cancel()
            self._publish()
        else:
            self._kind, self._then, self._generation = kind, take, self.session.generation
            if kind not in BACKGROUND:
                _log.info("%s: started", message or kind)
            self.runner.start(work if isinstance(work, RunJob) else Task(work, message))  # publishes it

    def open_result(self, project: ProjectFolder, then: Callable[[], None]) -> None:
        """Read the result of a project, then call a function."""

        def take(loaded: LoadedResult) -> None:
            self._receive_result(loaded)
            then()

        self.compute("open", lambda tick: load_result(project, tick), "reading the result", take)

    def import_model(
        self, source: Path, folder: Path, domain: str | None, take: Callable[[Sequence[str]], None]
    ) -> None:
        """Create a project from another program's model; `take` receives remarks on it."""

        def work(tick: Tick) -> list[str]:
            from homolog.run.import_model import import_model

            return import_model(source, ProjectFolder(folder), domain=domain, tick=tick)

        self.compute("import", work, "importing the model", take)

    def make_sample(self, sample: Sample, folder: Path, take: Callable[[Path], None]) -> None:
        """Generate a sample study."""
        self.compute("sample", lambda tick: sample.make(folder, tick), f"making {sample.name}", take)

    def cancel(self) -> None:
        """Cancel the job that the user waits for."""
        if self._next is not None:
            self._next = None
            self._publish()
        else:
            self.runner.cancel()

    def forget(self) -> None:
        """Cancel all jobs of the study before it is closed."""
        self._next = None
        self._kept = self.to_restore = None
        self.awaits_result = False
        self.runner.cancel()
        self._update_job()

    def toggle_pause(self) -> None:
        """Pause or resume the run."""
        run = self.session.job.run
        if run is not None:
            run.set_paused(not run.status.paused)

    @Slot(object)
    def _progressed(self, status: Status) -> None:
        self._drain()
        if self._kind not in BACKGROUND and self._next is None:
            self._status = _forwards(status, self._status)
        self._update_job(status.message if self._kind not in ("groom", "run") else "")
        state = (self.runner.job, self._status is None, status.paused, self.session.preliminary)
        (self.session.job_progressed if state == self._last_state else self.session.job_changed).emit()
        self._last_state = state

    @Slot(object)
    def _ended(self, ended: JobOutcome) -> None:
        self._drain()
        kind, self._kind, self._status = self._kind, "", None
        take, self._then = self._then, None
        if self._generation != self.session.generation and kind not in BACKGROUND:
            take = self._kept = None
            ended = JobOutcome(ended.job, cancelled=True)
        self._update_job()
        self._prepared |= kind == "prepare" and not ended.cancelled
        if ended.error is not None:
            _log.error("%s failed: %s", kind, ended.error, exc_info=ended.error)
            self.session.failed.emit(kind, ended.error)
        elif ended.cancelled:
            _log.info("%s cancelled", kind)
            if (
                isinstance(ended.job, RunJob)
                and ended.job.keeps
                and self._generation == self.session.generation
            ):
                self._kept = ended.job
        elif take is not None:
            take(ended.result)
        if self._next is not None and self.runner.job is None:  # unless `take` started a job
            following, self._next = self._next, None
            self.compute(*following)
        else:
            self.go_on()
        if self.runner.job is None:
            self._publish()

    def _drain(self) -> None:
        """Add previews to the session; subjects with unusable files are excluded until ticked again."""
        arrived: list[FileSurvey] = []
        while not self._arrived.empty():
            arrived.append(self._arrived.get())
        if not arrived:
            return
        members = {member.name: member for member in self.session.study.members}
        current = [
            survey
            for survey in arrived
            if survey.subject.name in members
            and members[survey.subject.name].subject.path == survey.subject.path
        ]
        before = self.session.surveys
        back = {  # excluded because its file lacked the structure chosen before
            survey.subject.name: replace(members[survey.subject.name], included=True)
            for survey in current
            if not survey.problem
            and not members[survey.subject.name].included
            and (last := before.get(survey.subject.name)) is not None
            and last.problem
            and not last.awaits_choice
        }
        result = self.session.result
        seen = result.result.names if result is not None else ()  # shown even without their files
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
        self.session.surveys |= {survey.subject.name: survey for survey in current}
        if bad or back:
            self.session.put(self.session.study.with_members(bad | back))
        self.session.surveys_changed.emit()

    def _read_ended(self, _: object) -> None:
        _log.info("read %d files", len(self.session.surveys))

    def _prepare_ended(self, devices: Devices) -> None:
        self.session.set_devices(devices)

    def _receive_result(self, loaded: LoadedResult | None) -> None:
        self._kept = None
        self.awaits_result = False
        if loaded is None:
            _log.warning("too few particles to keep")
            return
        _log.info("%s", loaded.summary)
        self.session.set_result(loaded, "Place particles")
