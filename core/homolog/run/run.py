"""The pipeline from files to a shape model, as a state machine with progress, pause and cancel."""

import shutil
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor

import numpy as np

from homolog.cluster import retried_on_workers
from homolog.cohort import Cohort
from homolog.correspondence import Checkpoint, Frame
from homolog.device import choose_device, device_faults
from homolog.errors import Cancelled, InputError
from homolog.grooming import GroomedSubject, Problem, Reading, check_cohort, groom_cohort
from homolog.grooming.cohort import landmarks_in
from homolog.io.atomic import report_os_errors
from homolog.io.mapped import mapped_within
from homolog.io.markups import Markups
from homolog.io.project import ProjectFolder
from homolog.io.records import ProjectRecord
from homolog.io.results import Result
from homolog.memory import Store, in_memory, large_arrays_apart
from homolog.progress import Tick, no_tick, part_of, run_in_background
from homolog.registration import check_sides
from homolog.run.another_seed import agreement_of_seeds, cost_of_seeds
from homolog.run.checkpoints import read_checkpoint, write_checkpoint
from homolog.run.choose_core import outline
from homolog.run.control import Control
from homolog.run.core_set import read_core, write_core
from homolog.run.events import FinishReason, Observer, Phase, RunStatus, ignore
from homolog.run.grow import grow
from homolog.run.preliminary import outcome_of_frame, preliminary_result
from homolog.run.prior_result import PriorResult, read_prior_result
from homolog.run.result import OptimizationInput, OptimizationOutcome, model_of, write_result
from homolog.run.steps import prepare_inputs, run_optimization
from homolog.run.structures import in_other_frames, prepare_joint_inputs
from homolog.run.table_cache import TableCache
from homolog.settings import RunSettings
from homolog.threads import cores
from homolog.workers import worker_processes

__all__ = ["Run"]

_FEWEST = 8
"""Least number of particles that define a surface."""
_MANY_ALIKE = 4
"""Least number of subjects refused for the same reason that share a line."""


class Run:
    """One run of the pipeline in a project folder.

    ::

        reading -> grooming -> aligning -> geodesics -> splitting -> optimizing -> modeling -> writing
                                    with a core set: optimizing -> fitting -> modeling
              any of them <-> paused          any of them -> completed | cancelled | failed

    `execute` works in the thread that calls it. Everything else may be called from any thread.

    Parameters
    ----------
    project : ProjectFolder
        Output folder, created if necessary. Its last result remains until the new one is complete.
    cohort : Cohort
        The cohort.
    settings : RunSettings
        Settings of the run.
    resume : bool
        Whether to continue from the checkpoint of a cancelled or killed run.
    from_result : bool
        Whether to start from the particles of the project's result, to add particles or to fit new subjects.
        A resumed run keeps its own start.
    skip_bad : bool
        Whether to exclude subjects with unusable files, with a note, instead of stopping.
    """

    def __init__(
        self,
        project: ProjectFolder,
        cohort: Cohort,
        settings: RunSettings,
        *,
        resume: bool = False,
        from_result: bool = False,
        skip_bad: bool = False,
    ) -> None:
        self.project = project
        self._cohort = cohort
        self._settings = settings
        self._resume = resume
        self._from_result = from_result
        self._skip_bad = skip_bad
        self._control = Control()
        self._frame: Frame | None = None
        self._preliminary: Frame | None = None
        self._study: OptimizationInput | None = None
        self._energies = np.empty((0, 4))
        self._excluded: dict[str, str] = {}
        self._lacking: dict[str, set[str]] = {}
        self._grooms = settings.groom.of_structures or {"": settings.groom}
        self._readings: dict[str, dict[str, Reading]] = {name: {} for name in self._grooms}
        self._landmarks: Mapping[str, Markups] = {}
        self._store: Store = in_memory

    @property
    def status(self) -> RunStatus:
        """The current status."""
        return self._control.status

    @property
    def frame(self) -> Frame | None:
        """The newest particles; None before the first frame. It may be polled at any rate."""
        return self._frame

    @property
    def preliminary(self) -> Frame | None:
        """The particles at the end of the latest stage that compares shapes; None before the first."""
        return self._preliminary

    def preliminary_result(self, frame: Frame, tick: Tick = no_tick) -> Result:
        """Return `preliminary` particles as a result in memory; may be called from any thread.

        Raises
        ------
        NumericalError
            If particles coincide, so that they define no warp of the surface.
        """
        assert self._study is not None, "particles exist only after the alignment"
        return preliminary_result(self._study, frame, tick)

    @property
    def notes(self) -> tuple[str, ...]:
        """A line for each excluded subject, including those of a continued run."""
        return tuple(self._excluded.values())

    @property
    def refusal(self) -> str:
        """Why files can't be used, a line for each or for several alike."""
        return "\n".join(_refusals(self._excluded))

    def cancel(self) -> None:
        """Stop the run as soon as possible; its checkpoint remains for `resume`."""
        self._control.cancel_token.cancel()

    def set_paused(self, paused: bool) -> None:
        """Pause or resume the run."""
        self._control.cancel_token.set_paused(paused)

    def execute(self, observer: Observer = ignore) -> FinishReason:
        """Execute the run; return whether it was completed or cancelled.

        Raises
        ------
        InputError
            If files are unusable (a line for each) or the project can't be written to.
        NumericalError
            If a computation fails.

        Notes
        -----
        The observer is notified of the end of the run in any case.
        """
        self._control.observer = observer
        try:
            with large_arrays_apart():
                self._work()
        except Cancelled:
            self._control.finish(FinishReason.CANCELLED, "cancelled")
            return FinishReason.CANCELLED
        except BaseException as error:
            self._control.finish(FinishReason.FAILED, str(error))
            raise
        self._control.finish(FinishReason.COMPLETED, "completed")
        return FinishReason.COMPLETED

    @property
    def can_be_kept(self) -> bool:
        """Whether there are particles that `keep` can save as the result."""
        frame = None if self._study is None or self._from_result else self._frame
        return frame is not None and min(part.world.shape[1] for part in frame.parts or [frame]) >= _FEWEST

    def keep(self) -> bool:
        """Save the newest particles of a cancelled run as the project's result; it can still be resumed.

        Returns
        -------
        bool
            False if there are no particles yet, or too few to define a surface, or if the run started from a
            result, which is then kept (`can_be_kept`).

        Raises
        ------
        InputError
            If the project can't be written to.
        """
        inputs, frame = self._study, self._frame
        if not self.can_be_kept or inputs is None or frame is None:
            return False
        outcome = outcome_of_frame(inputs, frame, self._energies, self._control.seconds)
        with self.project.locked():
            write_result(self.project, outcome, *model_of(outcome, no_tick), no_tick, self._excluded)
        return True

    def _work(self) -> None:
        device = choose_device(self._settings.device)
        cohort = self._checked()
        with (
            self.project.locked(),
            device_faults("cpu"),
            mapped_within(self.project.folder, self._settings.memory) as self._store,
        ):
            prior = self._base(cohort)
            self._write_run_record(cohort)
            size, complete = self._settings.optimize.core_set, cohort.without(set(self._excluded))
            grows = size is not None and size < len(complete.subjects) and prior is None
            if grows:
                self._control.expect_fits()
            elif "" in self._grooms and prior is None:
                cost = cost_of_seeds(self._settings.placing, len(cohort.subjects), cores())
                self._control.expect_another_seed(cost)
            cohort, groomed = self._groomed(
                cohort, outline if grows else lambda item: item.stored(self._store)
            )
            self._control.enter(Phase.ALIGNING, "aligning")
            if grows:
                outcome = self._grown(cohort, groomed, device)
            elif "" not in groomed:
                self._study = prepare_joint_inputs(
                    cohort,
                    groomed,
                    self._settings,
                    device,
                    self._control.tick,
                    project=self.project,
                    prior=prior,
                    landmarks=self._landmarks,
                )
                outcome = self._optimized(self._study, prior)
            else:
                self._study = prepare_inputs(
                    cohort,
                    groomed[""],
                    self._settings,
                    device,
                    self._control.tick,
                    prior=prior,
                    registrations=self.project.registrations,
                    landmarks=self._landmarks,
                )
                outcome = self._optimized(self._study, prior)
            self._control.enter(Phase.MODELING, "another seed")
            is_plain = "" in groomed and not grows  # several structures are judged one by one
            again = agreement_of_seeds(outcome, device, self._control.tick) if is_plain else None
            model, surface = run_in_background(
                lambda tick: model_of(outcome, tick), self._control.tick, "principal components"
            )
            self._control.enter(Phase.WRITING, "writing")
            given = self._control.tick, self._excluded, again
            write_result(self.project, outcome, model, surface, *given)
            self.project.checkpoint.unlink(missing_ok=True)
            shutil.rmtree(self.project.geodesics, ignore_errors=True)
            for name in self._grooms:
                folder = self.project.structure(name) if name else self.project
                shutil.rmtree(folder.fits, ignore_errors=True)
            shutil.rmtree(self.project.fits, ignore_errors=True)

    def _checked(self) -> Cohort:
        self._control.enter(Phase.READING, "reading")
        self._excluded, self._lacking = {}, {}
        if unknown := self._settings.unknown_structures:
            listed = ", ".join(filter(None, self._grooms)) or "there is only one structure"
            raise InputError(f"{', '.join(unknown)}: is none of the structures: {listed}")
        before = self.project.read() if self.project.exists else ProjectRecord()
        goes_on = self._resume or self._from_result
        accepted = before.excluded.keys() & {item.name for item in before.subjects} if goes_on else set()
        self._exclude(self._problems())
        if self._excluded.keys() - accepted and not self._skip_bad:
            raise InputError("\n".join([self.refusal, *self._rare()]))
        cohort = self._usable()
        check_sides(cohort, self._settings.groom)  # refuses invalid sides before any work
        return cohort

    def _exclude(self, problems: Mapping[str, Sequence[Problem]]) -> None:
        """Leave subjects out of the structures that they can't be used for, and of the model of all."""
        for name, those in problems.items():
            self._lacking.setdefault(name, set()).update(item.subject for item in those)
            for item in those:
                self._excluded.setdefault(item.subject, item.message)

    def _usable(self) -> Cohort:
        """Return the subjects that have a structure at least, if enough have all."""
        lacking = [self._lacking.get(name, set()) for name in self._grooms]
        self._check_number(self._cohort.without(set().union(*lacking)))
        return self._cohort.without(set.intersection(*lacking))

    def _rare(self) -> list[str]:
        """Return a line if a structure that subjects lack costs more of them than the others do."""
        names = list(self._grooms)
        gains = {
            name: len(self._excluded)
            - len(set().union(*(self._lacking.get(other, set()) for other in names if other != name)))
            for name in names
        }
        worst = max(gains, key=gains.__getitem__)
        if len(names) < 3 or not gains[worst]:  # of two, the other one would be left
            return []
        return [f"without the structure {worst}, {gains[worst]} more subjects could be modelled"]

    def _problems(self) -> dict[str, list[Problem]]:
        """Return the subjects that each structure can't be used of; what was read of the others is kept."""
        problems: dict[str, list[Problem]] = {}
        share = 1.0 / len(self._grooms)
        with worker_processes(self._settings.workers or cores()) as executor:
            for number, (name, groom) in enumerate(self._grooms.items()):
                self._readings[name] = {}
                problems[name] = check_cohort(
                    self._cohort,
                    groom,
                    part_of(self._control.tick, number * share, (number + 1) * share),
                    executor=executor,
                    readings=self._readings[name],
                )
        return problems

    def _check_number(self, cohort: Cohort) -> None:
        if len(cohort.subjects) < 2:
            count = "only one" if cohort.subjects else "no"
            message = f"{cohort.folder}: has {count} usable subject; a shape model needs two or more"
            raise InputError("\n".join([*self.notes, message]))

    def _base(self, cohort: Cohort) -> PriorResult | None:
        if self._resume and self.project.exists:
            self._from_result = self.project.read().from_result
        if not self._from_result:
            return None
        prior = read_prior_result(self.project)
        prior.check([subject.name for subject in cohort.subjects], self._settings)
        return prior

    def _write_run_record(self, cohort: Cohort) -> None:
        """Record the run in the project, so that a killed run can be resumed from the folder alone."""
        before = self.project.read() if self.project.exists else ProjectRecord()
        self._recall(before, {subject.name for subject in cohort.subjects})
        with report_os_errors(self.project.groomed):
            for name in self._grooms:
                folder = self.project.structure(name) if name else self.project
                folder.groomed.mkdir(parents=True, exist_ok=True)
            self.project.groomed.mkdir(exist_ok=True)
        if not self._resume:
            self.project.checkpoint.unlink(missing_ok=True)
        self.project.write(
            before.model_copy(
                update={
                    "subjects": self.project.describe(cohort),
                    "settings": self._settings,
                    "unfinished": True,
                    "from_result": self._from_result,
                    "excluded": self._excluded,
                }
            )
        )

    def _recall(self, before: ProjectRecord, here: set[str]) -> None:
        """Restore the reasons of earlier exclusions, if the project's cohort is continued."""
        if {subject.name for subject in before.subjects} <= here:
            absent = {name: why for name, why in before.excluded.items() if name not in here}
            self._excluded = absent | self._excluded

    def _groomed(
        self, cohort: Cohort, reduced: Callable[[GroomedSubject], GroomedSubject]
    ) -> tuple[Cohort, dict[str, list[GroomedSubject]]]:
        """Return the subjects that could be groomed, and their surfaces by structure; "" for a single one."""
        self._control.enter(Phase.GROOMING, "grooming")
        left_out: dict[str, list[Problem]] = {}
        tick, share = self._control.tick, 1.0 / len(self._grooms)

        def work(executor: Executor) -> dict[str, list[GroomedSubject]]:
            left_out.update({name: [] for name in self._grooms})
            return {
                name: groom_cohort(
                    cohort.without(self._lacking.get(name, set())),
                    groom,
                    executor=executor,
                    cache=(self.project.structure(name) if name else self.project).groomed,
                    tick=part_of(tick, number * share, (number + 1) * share),
                    left_out=left_out[name] if self._skip_bad else None,
                    readings=self._readings[name],
                    reduced=reduced,
                )
                for number, (name, groom) in enumerate(self._grooms.items())
            }

        workers, announce = self._settings.workers or cores(), self._control.work_on
        groomed = retried_on_workers(work, "grooming", workers, self._settings.cluster, announce)
        self._landmarks = landmarks_in(self._readings.values())
        self._readings = {name: {} for name in self._grooms}
        misplaced = in_other_frames(groomed)
        if misplaced and not self._skip_bad:
            raise InputError("\n".join(problem.message for problem in misplaced))
        if misplaced or any(left_out.values()):
            self._exclude(left_out)
            self._exclude(dict.fromkeys(groomed, misplaced))
            cohort, lost = self._usable(), {problem.subject for problem in misplaced}
            groomed = {
                name: [item for item in items if item.name not in lost] for name, items in groomed.items()
            }
            self._write_run_record(cohort)
        return cohort, groomed

    def _grown(
        self, cohort: Cohort, outlines: Mapping[str, Sequence[GroomedSubject]], device: str
    ) -> OptimizationOutcome:
        """Optimize a core set, and fit the others to it."""
        path = self.project.fits / "core.npz"

        def optimized(inputs: OptimizationInput) -> OptimizationOutcome:
            self._study = inputs
            outcome = read_core(path, inputs) if self._resume else None
            if outcome is None:
                outcome = self._optimized(inputs, None)
                write_core(path, outcome)
            return outcome

        return grow(
            cohort,
            outlines,
            self._settings,
            self.project,
            device,
            self._control,
            optimized,
            store=self._store,
        )

    def _optimized(self, inputs: OptimizationInput, prior: PriorResult | None) -> OptimizationOutcome:
        path = self.project.checkpoint

        def observe(frame: Frame) -> None:
            self._frame = frame
            if frame.ends_stage:
                self._preliminary = frame

        def save(checkpoint: Checkpoint) -> None:
            self._energies = checkpoint.energies
            write_checkpoint(path, checkpoint, inputs.fingerprint, self.status.fraction)

        return run_optimization(
            inputs,
            self._control,
            observe=observe,
            checkpoint=save,
            prior=prior,
            resume=read_checkpoint(path, inputs.fingerprint) if self._resume else None,
            solve=TableCache(self.project.geodesics, self._store).solve,
            store=self._store,
        )


def _refusals(messages: Mapping[str, str]) -> list[str]:
    """Return a line for each refused subject, or one for several if only the file's name differs."""
    kinds: dict[str, list[str]] = {}
    for name, message in messages.items():
        kinds.setdefault(message.partition(": ")[2] or message, []).append(name)
    lines = []
    for names in kinds.values():
        if len(names) < _MANY_ALIKE:
            lines += [messages[name] for name in names]
        else:
            more = f"{len(names) - 1} more subjects ({names[1]}, {names[2]}, …)"
            lines.append(f"{messages[names[0]]}; the same applies to {more}")
    return lines
