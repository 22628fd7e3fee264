"""What a film or picture will look like, drawn small by the same command."""

import math
from pathlib import Path

from PySide6.QtCore import QTemporaryDir, QTimer, Slot
from PySide6.QtGui import QPixmap, Qt
from PySide6.QtWidgets import QLabel, QWidget

from homolog_app.cli.options import options_of
from homolog_app.films.settings import PictureSettings, StillSettings
from homolog_app.window.export.process import ExportProcess

__all__ = ["Preview"]

_SIZE = 448
_PAUSE_MS = 400
_LEAST = 480, 320


class Preview(QLabel):
    """Shows the first frame; asks for another one shortly after the last change."""

    def __init__(self, project: Path, parent: QWidget | None = None) -> None:
        super().__init__("Drawing the first frame…", parent)
        self.setObjectName("Preview")
        self.setAccessibleName("Preview of the first frame")
        self.setFixedSize(_SIZE, _SIZE * 9 // 16)
        self.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.setWordWrap(True)
        self.setFrameShape(QLabel.Shape.StyledPanel)
        self._project = project
        self._folder = QTemporaryDir()
        self._wanted: tuple[list[str], PictureSettings] | None = None
        self._child = ExportProcess(self)
        self._child.ended.connect(self._show)
        self._pause = QTimer(self, interval=_PAUSE_MS, singleShot=True)
        self._pause.timeout.connect(self._draw)

    def want(self, content: list[str], settings: PictureSettings) -> None:
        """Show this before long."""
        self._wanted = content, settings
        self._pause.start()

    def stop(self) -> None:
        """Draw no more."""
        self._wanted = None
        self._pause.stop()
        self._child.stop()

    @Slot()
    def _draw(self) -> None:
        if self._child.is_running:
            self._child.cancel()  # what follows its end draws anew
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
    def _show(self, how: str, said: str) -> None:
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
            self.setText(said)


def first_frame_of(content: list[str], settings: PictureSettings) -> float | None:
    """Return where the picture is taken: of a still where it says, of a film where it begins."""
    if isinstance(settings, StillSettings):
        return settings.at
    return {"--mode": -settings.deviations, "--group": 0.0}.get(content[0] if content else "")


def _small(settings: PictureSettings, at: float | None) -> StillSettings:
    """Return the settings of a small picture of the same look."""
    scale = max(_SIZE / max(settings.width, settings.height), *(
        least / side for least, side in zip(_LEAST, (settings.width, settings.height), strict=True)
    ))  # fmt: skip
    shared = {name: getattr(settings, name) for name in PictureSettings.model_fields}
    shared |= {name: 2 * math.ceil(scale * shared[name] / 2.0) for name in ("width", "height")}
    clear = isinstance(settings, StillSettings) and settings.transparent
    return StillSettings(**shared, at=at, transparent=clear)
