"""The shape model of particles that a run has placed so far, fitted while the run goes on."""

import logging
import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING

from homolog.errors import Cancelled, NumericalError
from homolog.settings import Method

if TYPE_CHECKING:
    from homolog.correspondence import Frame
    from homolog.run import Run
    from homolog_app.window.explore.model_shape import ModelShape

__all__ = ["PreliminaryFits", "PreliminaryModel"]

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class PreliminaryModel:
    """A shape model of a run that has not finished.

    Attributes
    ----------
    shape : ModelShape
    particles, wanted : int
        Particles on each shape, and how many the run places in the end.
    iteration : int
    """

    shape: "ModelShape"
    particles: int
    wanted: int
    iteration: int

    @property
    def description(self) -> str:
        """How far the run was."""
        return f"preliminary: {self.particles} of {self.wanted} particles, iteration {self.iteration}"


class PreliminaryFits:
    """Fits a model at each stage that a run completes, in a thread beside the run.

    Parameters
    ----------
    run : Run
    name : str
        The project's, for captions.
    method : Method
    wanted : int
        Particles that the run places in the end.

    Attributes
    ----------
    newest : PreliminaryModel or None
        A mailbox that any thread may look into.
    """

    def __init__(self, run: "Run", name: str, method: Method, wanted: int) -> None:
        self._run, self._name, self._method, self._wanted = run, name, method, wanted
        self.newest: PreliminaryModel | None = None
        self._seen: Frame | None = None
        self._thread: threading.Thread | None = None
        self._closed = threading.Event()

    def look(self) -> None:
        """Begin a fit if the run has completed a stage and none is in progress."""
        frame = self._run.preliminary
        if frame is None or frame is self._seen or (self._thread is not None and self._thread.is_alive()):
            return
        self._seen = frame
        self._thread = threading.Thread(
            target=self._fit, args=[frame], name="homolog-preliminary", daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """End the fit in progress; `newest` stays."""
        self._closed.set()
        if self._thread is not None:
            self._thread.join()

    def _fit(self, frame: "Frame") -> None:
        from homolog_app.window.explore.model_shape import facing, fit_model_shape

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
