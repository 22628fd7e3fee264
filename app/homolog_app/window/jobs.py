"""The long jobs of the window. Their functions run in the computing thread, without Qt.

They import slow modules of the core themselves.
"""

import logging
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from homolog.cohort import Cohort, Subject
from homolog.errors import Cancelled, NumericalError
from homolog.io.project import ProjectFolder
from homolog.progress import Tick
from homolog.settings import GroomSettings, Method, RunSettings
from homolog_app.scenes.loaded_result import LoadedResult, Recorder, load_result
from homolog_app.scenes.model_shape import PreliminaryModel, facing, fit_model_shape

if TYPE_CHECKING:
    from homolog.correspondence import Frame
    from homolog.run import Run, RunStatus
    from homolog_app.scenes.file_survey import FileSurvey

__all__ = [
    "Devices",
    "RunJob",
    "prepare",
    "read_files",
]

_log = logging.getLogger(__name__)
_COMPILING = "compiling, once on this machine"


@dataclass(frozen=True, slots=True)
class Devices:
    """The machine's devices: alias and name, and the one that *automatic* selects."""

    names: dict[str, str]
    automatic: str


def prepare(tick: Tick) -> Devices:
    """Import heavy modules and compile the kernels, so that the first run starts without delay."""
    tick(0.0, "loading compute kernels")
    import matplotlib.font_manager  # noqa: F401 - lists the system's fonts, for names of other scripts
    import warp

    import homolog.run  # noqa: F401 - brings all that a run computes with
    import homolog_app.plots  # noqa: F401 - the first plot appears at once
    from homolog.device import choose_device, describe_device

    automatic = choose_device("auto")
    aliases = ["cpu", *(device.alias for device in warp.get_cuda_devices())]
    names = {"auto": f"Automatic: {describe_device(automatic)}"}
    names |= {alias: describe_device(alias) for alias in aliases}
    if len(aliases) > 2:
        names[",".join(aliases[1:])] = f"All {len(aliases) - 1} GPUs"
    ours = [module for name, module in sys.modules.items() if name.startswith("homolog.")]
    kernels = [item for module in ours for item in vars(module).values() if isinstance(item, warp.Kernel)]
    modules = sorted({kernel.module.name for kernel in kernels})
    for number, module in enumerate(modules):
        tick(
            number / len(modules), _COMPILING if _is_missing(module, automatic) else "loading compute kernels"
        )
        warp.load_module(module, device=automatic)
    return Devices(names, automatic)


def _is_missing(module: str, device: str) -> bool:
    """Return whether kernels of a module have not been compiled on this machine for a device."""
    import warp

    block = 1 if device == "cpu" else None  # Warp's number of threads in a block of a CPU
    name = warp.get_module(module).get_module_identifier(block)
    return not (Path(warp.config.kernel_cache_dir) / name).exists()


def read_files(
    subjects: Sequence[Subject], groom: GroomSettings, arrived: "Callable[[FileSurvey], None]", tick: Tick
) -> None:
    """Preview files and hand over the results one by one."""
    from homolog_app.scenes.file_survey import surveys

    for survey in surveys(subjects, groom, tick):
        arrived(survey)


class RunJob:
    """A run of the pipeline, with its frames recorded and its result read back."""

    def __init__(
        self,
        project: ProjectFolder,
        cohort: Cohort,
        settings: RunSettings,
        *,
        resume: bool,
        from_result: bool = False,
        title: str = "",
    ) -> None:
        from homolog.run import Run

        self._run = Run(project, cohort, settings, resume=resume, from_result=from_result)
        self._from_result = from_result
        self._last: Frame | None = None
        self._cluster = ""
        self.recorder = Recorder()
        self.names = [subject.name for subject in cohort.subjects]
        self._status: RunStatus = self._run.status
        self._latest: tuple[RunStatus, PreliminaryModel | None] = (self._status, None)
        optimize = settings.optimize
        self._fits = PreliminaryFits(self._run, title, optimize.method, optimize.particles)

    @property
    def keeps(self) -> bool:
        """Whether particles can be saved when the run is cancelled; an initial result remains."""
        return self._run.can_be_kept

    @property
    def preliminary(self) -> PreliminaryModel | None:
        """The shape model of the particles placed so far; None before the first."""
        return self._fits.newest

    @property
    def status(self) -> "RunStatus":
        """Status of the run; a new object also for each new preliminary model."""
        latest = (self._run.status, self._fits.newest)
        if any(now is not before for now, before in zip(latest, self._latest, strict=True)):
            self._latest, self._status = latest, replace(latest[0])
        return self._status

    @property
    def frame(self) -> "Frame | None":
        """The newest particles."""
        return self._run.frame

    def cancel(self) -> None:
        """Stop as soon as possible; a checkpoint remains."""
        self._run.cancel()

    def set_paused(self, paused: bool) -> None:
        """Pause or resume."""
        self._run.set_paused(paused)

    def keep(self, tick: Tick) -> LoadedResult | None:
        """Save the particles of a cancelled run as the result and read it; None if there are too few."""
        tick(0.0, "saving the particles")
        return self._finished() if self._run.keep() else None

    def execute(self) -> LoadedResult:
        """Execute the run and read its result; raises Cancelled if it was cancelled."""
        from homolog.run import FinishReason

        try:
            reason = self._run.execute(self._watch)
        finally:
            self._fits.close()
        if reason is FinishReason.CANCELLED:
            raise Cancelled("cancelled")
        return self._finished()

    def _finished(self) -> LoadedResult:
        self.recorder.write(self._run.project)
        return load_result(self._run.project)

    def _watch(self, status: "RunStatus") -> None:
        if status.cluster not in ("", self._cluster):
            self._cluster = status.cluster
            _log.info("%s", status.cluster)
        frame = self._run.frame
        if frame is not None and frame is not self._last:
            self._last = frame
            if frame.iteration > 0:  # before the first iteration there are no energies
                self.recorder.take(frame.iteration, frame.world, frame.energies, frame.alignments)
        if not self._from_result:
            self._fits.look()


class PreliminaryFits:
    """Fits a model at each completed stage of a run, in a parallel thread.

    Parameters
    ----------
    run : Run
    name : str
        Name of the project, for captions.
    method : Method
    wanted : int
        Final number of particles of the run.

    Attributes
    ----------
    newest : PreliminaryModel or None
        The newest model; any thread may read it.
    """

    def __init__(self, run: "Run", name: str, method: Method, wanted: int) -> None:
        self._run, self._name, self._method, self._wanted = run, name, method, wanted
        self.newest: PreliminaryModel | None = None
        self._seen: Frame | None = None
        self._thread: threading.Thread | None = None
        self._closed = threading.Event()

    def look(self) -> None:
        """Start a fit if the run has completed a stage and none is in progress."""
        frame = self._run.preliminary
        if frame is None or frame is self._seen or (self._thread is not None and self._thread.is_alive()):
            return
        self._seen = frame
        self._thread = threading.Thread(
            target=self._fit, args=[frame], name="homolog-preliminary", daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """Stop the fit in progress; `newest` remains."""
        self._closed.set()
        if self._thread is not None:
            self._thread.join()

    def _fit(self, frame: "Frame") -> None:

        try:
            result = self._run.preliminary_result(frame, self._tick)
            shape = fit_model_shape(self._name, self._method, result, self._tick)
        except Cancelled:
            return
        except NumericalError as error:
            _log.warning("no preliminary model at iteration %d: %s", frame.iteration, error)
            return
        if self.newest is not None:
            shape = facing(shape, self.newest.shape)
        self.newest = PreliminaryModel(shape, frame.world.shape[1], self._wanted, frame.iteration)
        _log.info("preliminary model of %d particles", frame.world.shape[1])

    def _tick(self, fraction: float, message: str) -> None:
        if self._closed.is_set():
            raise Cancelled("the run has ended")
