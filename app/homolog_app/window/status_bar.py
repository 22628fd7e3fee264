"""The bottom line: what goes on in the background, the device and the memory."""

from typing import TYPE_CHECKING

import psutil
from PySide6.QtCore import QObject, QTimer, Slot
from PySide6.QtWidgets import QProgressBar, QSizePolicy

from homolog_app.studies.jobs import Devices
from homolog_app.window.widgets import ActionButton, label

if TYPE_CHECKING:
    from homolog_app.window.main_window import MainWindow

__all__ = ["StatusBar"]

_MEMORY_MS = 2000
_BAR_PX = 160, 8
_ON_PAGE = ("groom", "run", "groups", "seeds", "mend")  # their pages show how far they are


class StatusBar(QObject):
    """Fills the window's status bar."""

    def __init__(self, window: "MainWindow") -> None:
        super().__init__(window)
        self._bar, self._workspace = window.statusBar(), window.workspace
        self._bar.setSizeGripEnabled(False)
        self.work = label("")
        self.bar = QProgressBar(maximum=1000)
        self.bar.setTextVisible(False)
        self.bar.setFixedSize(*_BAR_PX)
        self.bar.setAccessibleName("Progress")
        self.cancel = ActionButton("Cancel", window.commands["run.cancel"], "flat")
        self.device = label("Device: …")
        self.memory = label("")
        self.work.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)  # names may be long
        self._bar.addWidget(self.work, 1)
        for widget in (self.bar, self.cancel):
            self._bar.addPermanentWidget(widget)
            widget.hide()
        self._bar.addPermanentWidget(self.device)
        self._bar.addPermanentWidget(self.memory)
        window.workspace.work.background.connect(self._show_work)
        for signal in (window.workspace.work.changed, window.workspace.work.progressed):
            signal.connect(self._show_busy)
        window.workspace.work.devices_known.connect(self._show_devices)
        self._process = psutil.Process()
        self._timer = QTimer(self, interval=_MEMORY_MS)
        self._timer.timeout.connect(self._show_memory)
        self._timer.start()
        self._show_memory()

    def say(self, text: str) -> None:
        """Show a word for some seconds."""
        self._bar.showMessage(text, 6000)

    @Slot()
    def _show_busy(self) -> None:
        """Show how far what the user waits for is, if no page shows it."""
        work = self._workspace.work
        shown = work.is_busy and work.kind not in _ON_PAGE and self._workspace.session.is_open
        for widget in (self.bar, self.cancel):
            widget.setVisible(shown)
        if work.status is not None:
            self.bar.setValue(round(1000 * work.status.fraction))

    def _show_work(self, text: str) -> None:
        self.work.setText(f"{text[:1].upper()}{text[1:]}…" if text else "")

    def _show_devices(self, devices: Devices) -> None:
        self.device.setText(f"Device: {devices.names[devices.automatic]}")

    def _show_memory(self) -> None:
        self.memory.setText(f"Memory: {self._process.memory_info().rss / 2**20:.0f} MB")
