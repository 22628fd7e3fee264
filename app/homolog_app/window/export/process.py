"""``homolog export`` as a child process: progress, cancelling, and nothing left of what was cancelled."""

import json
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import QObject, QProcess, QTimer, Signal, Slot

__all__ = ["ExportProcess"]

_PATIENCE_MS = 3000
_CANCELLED = 130


class ExportProcess(QObject):
    """One export. `ended` tells ``"done"``, ``"cancelled"`` or ``"failed"`` and what was said last."""

    progressed = Signal(float, str)
    ended = Signal(str, str)

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self._process = QProcess(self)
        self._process.readyReadStandardOutput.connect(self._read)
        self._process.finished.connect(self._finish)
        self._process.errorOccurred.connect(self._fail)
        self._impatience = QTimer(self, interval=_PATIENCE_MS, singleShot=True)
        self._impatience.timeout.connect(self._process.kill)
        self._out: Path | None = None
        self._number = 0
        self._cancelled = False

    @property
    def is_running(self) -> bool:
        """Whether the export goes on."""
        return self._process.state() != QProcess.ProcessState.NotRunning

    def start(self, arguments: Sequence[str], out: Path | None) -> None:
        """Start ``homolog`` with these arguments; `out` is the file or folder that it makes."""
        self._out, self._cancelled = out, False
        self._process.start(sys.executable, ["-m", "homolog_app", *arguments, "--progress", "json"])
        self._number = self._process.processId()

    def cancel(self) -> None:
        """End the process: asked first, so that it tidies up, then for certain. `ended` follows."""
        if self.is_running:
            self._cancelled = True
            self._impatience.start()
            if sys.platform == "win32":  # where programs without a window can't be asked
                self._process.kill()
            else:
                self._process.terminate()

    def stop(self) -> None:
        """End the process and wait for that."""
        self.cancel()
        if not self._process.waitForFinished(_PATIENCE_MS):
            self._process.kill()
            self._process.waitForFinished(_PATIENCE_MS)

    @Slot()
    def _read(self) -> None:
        while self._process.canReadLine():
            try:
                message = json.loads(bytes(self._process.readLine().data()))
                self.progressed.emit(float(message["fraction"]), str(message["message"]))
            except (ValueError, KeyError, TypeError):
                continue  # a line for people

    @Slot(int, QProcess.ExitStatus)
    def _finish(self, code: int, _status: object) -> None:
        self._impatience.stop()
        self._read()
        said = bytes(self._process.readAllStandardError().data()).decode(errors="replace").strip()
        lines = [line.removeprefix("homolog: ") for line in said.splitlines()]
        if code == 0 and not self._cancelled:
            self.ended.emit("done", lines[-1] if lines else "")
            return
        self._remove_parts()
        if self._cancelled or code == _CANCELLED:
            self.ended.emit("cancelled", "")
        else:
            self.ended.emit("failed", "\n".join(lines[-6:]) or "The export ended without a message.")

    @Slot(QProcess.ProcessError)
    def _fail(self, error: QProcess.ProcessError) -> None:
        if error == QProcess.ProcessError.FailedToStart:
            self.ended.emit("failed", self._process.errorString())

    def _remove_parts(self) -> None:
        """Remove what a killed process had begun to write."""
        if self._out is None or not self._out.parent.is_dir():
            return
        for part in self._out.parent.glob(f".part-{self._number}-*"):
            if part.is_dir():
                shutil.rmtree(part, ignore_errors=True)
            else:
                part.unlink(missing_ok=True)
