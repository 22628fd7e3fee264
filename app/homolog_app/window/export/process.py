"""The command line in a child process: an export with its progress, and the preview of one."""

import json
import math
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import QObject, QProcess, QTemporaryDir, QTimer, Signal, Slot
from PySide6.QtGui import QPixmap, Qt
from PySide6.QtWidgets import QLabel, QWidget

from homolog_app.cli.options import options_of
from homolog_app.exports.settings import PictureSettings, StillSettings
from homolog_app.window.widgets import having

__all__ = ["ExportProcess", "Preview"]


_PATIENCE_MS = 3000
_CANCELLED = 130


class ExportProcess(QObject):
    """One export. `ended` emits ``"done"``, ``"cancelled"`` or ``"failed"`` and the last message."""

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
        """Whether the export is running."""
        return self._process.state() != QProcess.ProcessState.NotRunning

    def start(self, arguments: Sequence[str], out: Path | None) -> None:
        """Start ``homolog`` with these arguments; `out` is the output file or folder."""
        self._out, self._cancelled = out, False
        self._process.start(sys.executable, ["-m", "homolog_app", *arguments, "--progress", "json"])
        self._number = self._process.processId()

    def cancel(self) -> None:
        """Terminate the process so that it can clean up, then kill it. `ended` follows."""
        if self.is_running:
            self._cancelled = True
            self._impatience.start()
            if sys.platform == "win32":  # programs without a window can't be asked to end
                self._process.kill()
            else:
                self._process.terminate()

    def stop(self) -> None:
        """Stop the process and wait for its end."""
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
                continue  # not a line of progress

    @Slot(int, QProcess.ExitStatus)
    def _finish(self, code: int, _status: object) -> None:
        self._impatience.stop()
        self._read()
        message = bytes(self._process.readAllStandardError().data()).decode(errors="replace").strip()
        lines = [line.removeprefix("homolog: ") for line in message.splitlines()]
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
        """Remove the partial files of a killed process."""
        if self._out is None or not self._out.parent.is_dir():
            return
        for part in self._out.parent.glob(f".part-{self._number}-*"):
            if part.is_dir():
                shutil.rmtree(part, ignore_errors=True)
            else:
                part.unlink(missing_ok=True)


_SIZE = 576
_PAUSE_MS = 400
_LEAST = 480, 320


class Preview(QLabel):
    """Shows the first frame; updates it shortly after the last change."""

    def __init__(self, project: Path, parent: QWidget | None = None) -> None:
        super().__init__("Drawing the first frame…", parent)
        having(self, objectName="Preview", accessibleName="Preview of the first frame", wordWrap=True)
        self.setFixedSize(_SIZE, _SIZE * 9 // 16)
        self.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.setFrameShape(QLabel.Shape.StyledPanel)
        self._project = project
        self._folder = QTemporaryDir()
        self._wanted: tuple[list[str], PictureSettings] | None = None
        self._child = ExportProcess(self)
        self._child.ended.connect(self._show)
        self._pause = QTimer(self, interval=_PAUSE_MS, singleShot=True)
        self._pause.timeout.connect(self._draw)

    def want(self, content: list[str], settings: PictureSettings) -> None:
        """Request an update soon."""
        self._wanted = content, settings
        self._pause.start()

    def stop(self) -> None:
        """Stop drawing."""
        self._wanted = None
        self._pause.stop()
        self._child.stop()

    @Slot()
    def _draw(self) -> None:
        if self._child.is_running:
            self._child.cancel()  # its end starts the next drawing
            return
        if self._wanted is None:
            return
        (content, settings), self._wanted = self._wanted, None
        still = _small(settings, first_frame_of(content, settings))
        self._child.start(
            ["export", "still", str(self._project), *content, *options_of(still), f"--out={self._picture}"],
            self._picture,
        )

    @property
    def _picture(self) -> Path:
        return Path(self._folder.path()) / "preview.png"

    @Slot(str, str)
    def _show(self, how: str, message: str) -> None:
        if self._wanted is not None:
            self._pause.start()
        elif how == "done":
            picture = QPixmap(str(self._picture))
            self.setPixmap(
                picture.scaled(
                    self.size(),
                    Qt.AspectRatioMode.KeepAspectRatio,
                    Qt.TransformationMode.SmoothTransformation,
                )
            )
        elif how == "failed":
            self.setText(message)


def first_frame_of(content: list[str], settings: PictureSettings) -> float | None:
    """Return the position of the picture: that of a still, the start of a film."""
    if isinstance(settings, StillSettings):
        return settings.at
    return {"--mode": -settings.deviations, "--group": 0.0}.get(content[0] if content else "")


def _small(settings: PictureSettings, at: float | None) -> StillSettings:
    """Return the settings of a small picture that looks the same."""
    scale = max(
        _SIZE / max(settings.width, settings.height),
        *(least / side for least, side in zip(_LEAST, (settings.width, settings.height), strict=True)),
    )
    shared = {name: getattr(settings, name) for name in PictureSettings.model_fields}
    shared |= {name: 2 * math.ceil(scale * shared[name] / 2.0) for name in ("width", "height")}
    clear = isinstance(settings, StillSettings) and settings.transparent
    return StillSettings(**shared, at=at, transparent=clear)
