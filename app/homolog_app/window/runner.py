"""The computing thread, and garbage collection in the GUI thread."""

import gc
import os
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from queue import SimpleQueue
from typing import Any, Protocol

from PySide6.QtCore import QObject, QTimer, Signal, Slot

from homolog.cancellation import CancelToken
from homolog.errors import Cancelled
from homolog.progress import Tick

__all__ = ["GarbageCollector", "Job", "JobOutcome", "Runner", "Status", "Task", "TaskStatus"]


POLL_MS = 33
_NICENESS = 10


class Status(Protocol):
    """Status of a job: the common part of `homolog.run.RunStatus`."""

    @property
    def fraction(self) -> float:
        """Fraction done, in [0, 1]."""

    @property
    def message(self) -> str:
        """Description of the current step."""

    @property
    def eta_s(self) -> float | None:
        """Estimated seconds left; None while unknown."""

    @property
    def paused(self) -> bool:
        """Whether the job is paused."""


@dataclass(frozen=True, slots=True)
class TaskStatus:
    """The status of a `Task`."""

    fraction: float = 0.0
    message: str = ""
    eta_s: float | None = None
    paused: bool = False


class Job(Protocol):
    """A long computation: executed in the computing thread, controlled from the GUI thread. `Run` is one."""

    def execute(self) -> Any:  # noqa: ANN401 - each job has its own result
        """Execute the job in the calling thread."""

    @property
    def status(self) -> Status:
        """Newest status; safe from any thread."""

    def cancel(self) -> None:
        """Request cancellation; safe from any thread."""

    def set_paused(self, paused: bool) -> None:
        """Pause or resume; safe from any thread."""


class _TaskControl:
    """Status and cancel token of a `Task`."""

    def __init__(self, message: str) -> None:
        self.status: Status = TaskStatus(message=message)
        self.token = CancelToken()

    def tick(self, fraction: float, message: str) -> None:
        self.status = TaskStatus(fraction=fraction, message=message)
        self.token.wait_while_paused(lambda: self._report_waiting(fraction, message))

    def _report_waiting(self, fraction: float, message: str) -> None:
        self.status = TaskStatus(fraction=fraction, message=message, paused=True)


class Task:
    """Wraps a function that takes a tick as a job.

    Attributes
    ----------
    execute : callable
        Executes the function.
    """

    def __init__(self, work: Callable[[Tick], Any], message: str) -> None:
        self._control = _TaskControl(message)
        self.execute = partial(work, self._control.tick)

    @property
    def status(self) -> Status:
        """Newest status."""
        return self._control.status

    def cancel(self) -> None:
        """Cancel at the next tick."""
        self._control.token.cancel()

    def set_paused(self, paused: bool) -> None:
        """Pause at the next tick, or resume."""
        self._control.token.set_paused(paused)


@dataclass(frozen=True, slots=True, eq=False)
class JobOutcome:
    """Outcome of a job: a result, a cancellation or an error."""

    job: Job
    result: Any = None
    error: BaseException | None = None
    cancelled: bool = False


_OUTLIVED: "list[SimpleQueue[JobOutcome]]" = []
"""Results of computing threads that outlive their window: kept until the process ends."""


class Runner(QObject):
    """Owns the computing thread. Its signals are emitted in the GUI thread.

    A timer polls the thread's results: no signal crosses threads, and a slow window drops frames instead
    of queueing them. Results of an abandoned job are dropped.

    A job refers to objects of Qt, which may be freed in the GUI thread only. The thread therefore knows two
    queues and nothing else of the window, and passes each job back with its outcome.
    """

    progressed = Signal(object)
    ended = Signal(object)

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self._orders: SimpleQueue[Job | None] = SimpleQueue()
        self._results: SimpleQueue[JobOutcome] = SimpleQueue()
        self._job: Job | None = None
        self._shown: Status | None = None
        self._thread = threading.Thread(
            target=_work, args=[self._orders, self._results], name="homolog-compute", daemon=True
        )
        self._thread.start()
        self._timer = QTimer(self, interval=POLL_MS)
        self._timer.timeout.connect(self._look)

    @property
    def job(self) -> Job | None:
        """The current job, or None."""
        return self._job

    @property
    def is_alive(self) -> bool:
        """Whether the thread has not ended."""
        return self._thread.is_alive()

    def start(self, job: Job) -> None:
        """Start a job; none may be running."""
        if self._job is not None:
            raise RuntimeError("a job is in progress")
        self._job, self._shown = job, None
        self._orders.put(job)
        self._timer.start()
        self._look()

    def cancel(self) -> None:
        """Cancel the current job; `ended` follows."""
        if self._job is not None:
            self._job.cancel()

    def close(self, seconds: float = 3.0) -> bool:
        """Stop the thread; return whether it ended in time. No more signals are emitted.

        A thread that is in native code, such as a compiler, ends later; what it computes is dropped.
        """
        self._timer.stop()
        self.cancel()
        self._orders.put(None)
        self._thread.join(seconds)
        if self.is_alive:
            _OUTLIVED.append(self._results)
        return not self.is_alive

    def _look(self) -> None:
        job = self._job
        if job is not None and job.status is not self._shown:
            self._shown = job.status
            self.progressed.emit(self._shown)
        while not self._results.empty():
            ended = self._results.get()
            if ended.job is self._job:
                self._job = None
                self._timer.stop()
                self.ended.emit(ended)


def _work(orders: "SimpleQueue[Job | None]", results: "SimpleQueue[JobOutcome]") -> None:
    """Execute jobs until None is ordered."""
    _step_back()
    while (job := orders.get()) is not None:
        outcome = [_executed(job)]
        del job
        results.put(outcome.pop())  # no variable of this thread refers to the job any more


def _executed(job: Job) -> JobOutcome:
    try:
        return JobOutcome(job, result=job.execute())
    except Cancelled:
        return JobOutcome(job, cancelled=True)
    except BaseException as error:  # noqa: BLE001 - a job's every error is shown, the thread goes on
        return JobOutcome(job, error=error)


def _step_back() -> None:
    """Lower the thread's priority where the system supports it."""
    if hasattr(os, "setpriority"):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICENESS)


_EVERY_MS = 500
REST = 100.0
"""Pause after a full collection, relative to its duration."""


class GarbageCollector(QObject):
    """Collects garbage in the GUI thread, in place of Python, as long as the application lives.

    Python collects in whichever thread allocates. Qt deletes widgets without Python's lock, so that their
    wrappers, or anything of VTK, freed by another thread at the same time end the process; this also holds
    when a window is being closed and between two windows.
    """

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self._next_whole = 0.0
        gc.disable()
        self._timer = QTimer(self, interval=_EVERY_MS)
        self._timer.timeout.connect(self.sweep)
        self._timer.start()

    def settle(self) -> None:
        """Exclude existing objects from further collections to keep these short."""
        gc.freeze()

    @Slot()
    def sweep(self) -> None:
        """Collect the generations that are due."""
        young, middle, old = (
            count > most for count, most in zip(gc.get_count(), gc.get_threshold(), strict=True)
        )
        began = time.monotonic()
        if old and began > self._next_whole:
            gc.collect()
            now = time.monotonic()
            self._next_whole = now + REST * (now - began)
        elif middle:
            gc.collect(1)
        elif young:
            gc.collect(0)
