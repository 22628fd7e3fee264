"""Playing: a value that swings from one side of zero to the other."""

import math
import time
from collections.abc import Callable, Mapping

from PySide6.QtCore import QTimer, Signal
from PySide6.QtWidgets import QCheckBox, QHBoxLayout, QWidget

from homolog_app.window.actions import Actions
from homolog_app.window.widgets import GRID, ActionButton, choice

__all__ = ["Player"]

_PERIOD_S = 4.0
_LEAST_MS = 33
_DRAWING_SHARE = 1.5
_SPEEDS = {"½ ×": 0.5, "1 ×": 1.0, "2 ×": 2.0}


class Player(QWidget):
    """A button, speed, range and loop. Between two values it rests longer than drawing takes.

    Parameters
    ----------
    actions : Actions
    draw_ms : callable
        How long a drawing takes now [ms].
    ranges : mapping of str to float
        How far it swings, by words; nothing is offered where there is one only.
    """

    swung = Signal(float)

    def __init__(self, actions: Actions, draw_ms: Callable[[], float], ranges: Mapping[str, float]) -> None:
        super().__init__()
        self._draw_ms = draw_ms
        self._timer = QTimer(self, interval=_LEAST_MS)
        self._timer.timeout.connect(self._step)
        self._phase = self._seen = 0.0
        self.go = ActionButton("Play", actions["run.play"])
        self.speed, self.reach = choice("Speed", _SPEEDS), choice("Range", ranges)
        for box in (self.speed, self.reach):
            box.setMinimumContentsLength(6 if box is self.reach else 3)
            box.setToolTip(box.accessibleName())
            box.setCurrentIndex(min(1, box.count() - 1))
        self.reach.setVisible(len(ranges) > 1)
        self.loop = QCheckBox("Loop")
        self.loop.setChecked(True)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(GRID)
        for widget in (self.go, self.reach, self.speed, self.loop):
            row.addWidget(widget)
        row.addStretch()

    @property
    def is_playing(self) -> bool:
        """Whether it swings."""
        return self._timer.isActive()

    def play_or_stop(self) -> None:
        """Go on from where it was paused, or pause."""
        if self.is_playing:
            self.stop()
        else:
            self._seen = time.perf_counter()
            self._timer.start()
            self.go.setText("Pause")

    def stop(self) -> None:
        """Hold."""
        self._timer.stop()
        self.go.setText("Play")

    def _step(self) -> None:
        now = time.perf_counter()
        self._phase += (now - self._seen) * float(self.speed.currentData()) / _PERIOD_S
        self._seen = now
        if self._phase >= 1.0 and not self.loop.isChecked():
            self.stop()
            self._phase = 0.0
            self.swung.emit(0.0)
            return
        self.swung.emit(float(self.reach.currentData()) * math.sin(2.0 * math.pi * self._phase))
        self._timer.setInterval(max(_LEAST_MS, round(_DRAWING_SHARE * self._draw_ms())))
