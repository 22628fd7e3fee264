"""The widget that VTK draws into."""

import time
from typing import Any

from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QWidget
from pyvistaqt import QtInteractor

from homolog_app.rendering.opengl import SMOOTH

__all__ = ["Interactor"]


_CELLS = (4, 4)
_SOFTWARE = ("llvmpipe", "softpipe", "swiftshader", "swrast", "basic render")


class Interactor(QtInteractor):  # type: ignore[misc] # pyvistaqt is untyped
    """A QtInteractor that draws once for each paint event, and only then.

    VTK's interactor style renders at every mouse move, and the frame that comes of it asks for a paint that
    renders again. Here its wish to render only asks for a paint, which Qt merges with others, so that moves
    of the mouse never queue up behind drawings.
    """

    def __init__(self, parent: QWidget) -> None:
        self.draw_ms = self.last_ms = 0.0
        self._painting = False
        super().__init__(
            parent, shape=_CELLS, border=False, auto_update=False, multi_samples=0, lighting="none"
        )
        self.setAcceptDrops(False)
        self._vtk: Any = self.ren_win.GetInteractor()
        self._vtk.EnableRenderOff()
        self._observer = self._vtk.AddObserver("RenderEvent", self._wish)

    @property
    def smoothing(self) -> int:
        """Samples a pixel that this machine can afford: none where the processor does the drawing."""
        capabilities = str(self.ren_win.ReportCapabilities()).lower()
        return 0 if any(name in capabilities for name in _SOFTWARE) else SMOOTH

    def paintGL(self) -> None:
        """Draw, and remember how long that took."""
        began = time.perf_counter()
        self._painting = True
        self._vtk.EnableRenderOn()
        super().paintGL()
        self._vtk.EnableRenderOff()
        self._painting = False
        self.last_ms = 1000.0 * (time.perf_counter() - began)
        self.draw_ms = self.last_ms if not self.draw_ms else 0.8 * self.draw_ms + 0.2 * self.last_ms

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Leave the keys to the window's commands; VTK's own would turn surfaces to wires."""
        event.ignore()

    def keyReleaseEvent(self, event: QKeyEvent) -> None:
        """Leave the keys to the window's commands."""
        event.ignore()

    def close(self) -> None:
        """Let go of the graphics."""
        if getattr(self, "_vtk", None) is not None:
            self._vtk.RemoveObserver(self._observer)
            self._vtk = None
        super().close()

    def _wish(self, *_: object) -> None:
        if not self._painting:
            self.update()
