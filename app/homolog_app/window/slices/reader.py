"""Reads the scan of the subject that is shown, in a thread of its own, so that a run does not hold it up."""

import logging
from functools import partial
from pathlib import Path

from PySide6.QtCore import QObject, Signal, Slot

from homolog.arrays import FloatArray
from homolog.errors import InputError
from homolog.grooming.scans import Scan, check_frame, read_scan
from homolog.progress import Tick
from homolog_app.window.runner import JobOutcome, Runner, Task
from homolog_app.window.slices.planes import SliceScene
from homolog_app.window.slices.windowing import first_preset

__all__ = ["ReadScan", "ScanReader"]

_log = logging.getLogger(__name__)


class ReadScan:
    """A scan with what is shown of it at first: window and notes."""

    def __init__(self, scan: Scan, inside: float) -> None:
        self.scan = scan
        self.automatic = scan.automatic_window()
        self.preset = first_preset(scan)
        outside = round(100.0 * (1.0 - inside))
        beyond = (f"{outside} % of the structure lies outside of the scan",) if outside else ()
        self.notes = (*scan.notes, *beyond)


class ScanReader(QObject):
    """Holds one scan: that of the newest wish. The one before is let go first."""

    changed = Signal()

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self.read: ReadScan | None = None
        self.problem = ""
        self._wanted: tuple[str, Path] | None = None
        self._next: Task | None = None
        self._runner: Runner | None = None

    @property
    def is_busy(self) -> bool:
        """Whether the scan is being read."""
        return self._runner is not None and self._runner.job is not None

    def want(self, sliced: SliceScene) -> None:
        """Read a subject's scan unless it is there already, or being read."""
        wanted = None if sliced.image is None else (sliced.name, sliced.image)
        if wanted == self._wanted:
            return
        self._wanted, self.read, self.problem, self._next = wanted, None, "", None
        if self._runner is not None:
            self._runner.cancel()
        if wanted is None:
            return
        task = Task(partial(_read, wanted[1], sliced.name, sliced.points), "reading the scan")
        if self._runner is None:
            self._runner = Runner(self)
            self._runner.ended.connect(self._ended)
        if self._runner.job is None:
            self._runner.start(task)
        else:
            self._next = task

    def close(self) -> None:
        """End the thread."""
        if self._runner is not None:
            self._runner.close()

    @Slot(object)
    def _ended(self, ended: JobOutcome) -> None:
        assert self._runner is not None
        if self._next is not None:
            task, self._next = self._next, None
            self._runner.start(task)
            return
        if ended.error is not None:
            known = isinstance(ended.error, InputError)
            self.problem = str(ended.error) if known else f"The scan can't be read: {ended.error!r}"
            _log.warning("%s", self.problem, exc_info=None if known else ended.error)
        elif not ended.cancelled and self._wanted is not None:
            self.read = ended.result
        self.changed.emit()


def _read(path: Path, name: str, points: FloatArray, tick: Tick) -> ReadScan:
    scan = read_scan(path, tick)
    return ReadScan(scan, check_frame(scan, points, name) if len(points) else 1.0)
