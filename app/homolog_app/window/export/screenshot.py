"""The picture of the views: drawn here from what they show, or by the command line that is shown."""

from pathlib import Path

from PySide6.QtCore import Slot
from PySide6.QtWidgets import QWidget

from homolog.errors import InputError
from homolog_app.exports.settings import ScreenshotSettings
from homolog_app.films.encode import write_still
from homolog_app.window.explore.view_states import Snapshot
from homolog_app.window.export.dialog import ExportDialog, Exported
from homolog_app.window.export.kinds import SCREENSHOT
from homolog_app.window.scene.canvas import Canvas
from homolog_app.window.scene.content import ViewContents
from homolog_app.window.scene.contents_file import KEPT, write_shown
from homolog_app.window.scene.offscreen import drawn

__all__ = ["ScreenshotDialog"]


class ScreenshotDialog(ExportDialog):
    """Size, background and place of the picture; the views may go on meanwhile.

    Parameters
    ----------
    parent : QWidget
    what : Exported
    shown : Shown
    canvas : Canvas
    snapshot : Snapshot or None
        What the views show, for the command line. What no project holds, such as the particles of a run that
        goes on, is written beside the picture instead.
    """

    def __init__(
        self, parent: QWidget, what: Exported, shown: ViewContents, canvas: Canvas, snapshot: Snapshot | None
    ) -> None:
        self._shown, self._canvas, self._snapshot = shown, canvas, snapshot
        super().__init__(parent, SCREENSHOT, what)

    @property
    def kept(self) -> Path | None:
        """The file beside the picture that holds what is shown; None if the project does."""
        return self.out.with_suffix(KEPT) if self.out is not None and self._snapshot is None else None

    def content(self) -> list[str]:
        """Return what is shown as options of the command line."""
        return ["--view", self._snapshot.as_json if self._snapshot else str(self.kept)]

    def _warning(self) -> str:
        beside = self.kept
        sentences = [super()._warning()]
        if beside is not None:
            sentences.append(
                "The project does not contain what is shown, so it is written with the picture, for the "
                f"command line: {beside.name}."
            )
        return " ".join(sentence for sentence in sentences if sentence)

    @Slot()
    def _start(self) -> None:
        settings, out = self.settings, self.out
        assert isinstance(settings, ScreenshotSettings), "the kind says so"
        assert out is not None, "nothing is started without a place"
        try:
            pixels = drawn(self._shown, self._canvas, settings.scale, transparent=settings.transparent)
            write_still(out, pixels)
            if self.kept is not None:
                write_shown(self.kept, self._shown, self._canvas)
        except InputError as error:
            self._end("failed", str(error))
        else:
            self._end("done", f"{out}: {pixels.shape[1]} x {pixels.shape[0]} pixels")
