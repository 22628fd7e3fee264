"""The picture of the views: drawn here from what they show, or by the command line that is shown."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import Slot
from PySide6.QtWidgets import QWidget

from homolog.errors import InputError
from homolog_app.exports.settings import ScreenshotSettings
from homolog_app.films.encode import write_still
from homolog_app.window.export.dialog import ExportDialog, Exported
from homolog_app.window.export.kinds import SCREENSHOT

__all__ = ["ScreenshotDialog"]


class ScreenshotDialog(ExportDialog):
    """Size, background and place of the picture.

    Parameters
    ----------
    parent : QWidget
    what : Exported
    view : str
        What the views show, for the command line; empty if no command can show it again.
    draw : callable
        Takes scale and whether there is no background, returns the pixels.
    """

    def __init__(
        self, parent: QWidget, what: Exported, view: str, draw: Callable[[int, bool], NDArray[np.uint8]]
    ) -> None:
        self._view, self._draw = view, draw
        super().__init__(parent, SCREENSHOT, what)

    def content(self) -> list[str]:
        """Return what is shown as options of the command line."""
        return ["--view", self._view]

    @Slot()
    def _tell(self) -> None:
        super()._tell()
        if not self._view:
            self.line.clear()
            self.line.setPlaceholderText("No command draws this picture again: the run goes on.")
        self.copy.setEnabled(bool(self._view))

    @Slot()
    def _start(self) -> None:
        settings, out = self.settings, self.out
        assert isinstance(settings, ScreenshotSettings), "the kind says so"
        assert out is not None, "nothing is started without a place"
        try:
            pixels = self._draw(settings.scale, settings.transparent)
            write_still(out, pixels)
        except InputError as error:
            self._end("failed", str(error))
        else:
            self._end("done", f"{out}: {pixels.shape[1]} x {pixels.shape[0]} pixels")
