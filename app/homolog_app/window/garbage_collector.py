"""Python's garbage is collected in the window's thread only.

The collector runs in whichever thread happens to allocate. In the computing thread it may destroy what Qt
and VTK own in the window's, where alone these may be touched: a closed dialog that refers to itself, say.
"""

import gc
import time

from PySide6.QtCore import QObject, QTimer, Slot

__all__ = ["GarbageCollector"]

_EVERY_MS = 500
_REST = 100.0
"""After a collection of everything there is none for so many times as long as it took."""


class GarbageCollector(QObject):
    """Collects garbage in place of Python's own collector, which is off until `close`."""

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self._next_whole = 0.0
        gc.disable()
        self._timer = QTimer(self, interval=_EVERY_MS)
        self._timer.timeout.connect(self.sweep)
        self._timer.start()

    def settle(self) -> None:
        """Leave what there is by now out of all further collections, which are short then."""
        gc.freeze()

    def close(self) -> None:
        """Hand over to Python's own collector."""
        self._timer.stop()
        gc.enable()

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
            self._next_whole = now + _REST * (now - began)
        elif middle:
            gc.collect(1)
        elif young:
            gc.collect(0)
