"""The right side of the window: the page of the step at hand."""

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QFrame, QStackedWidget, QVBoxLayout

from homolog_app.studies.jobs import Devices
from homolog_app.window.actions import Actions
from homolog_app.window.cohort_panel import CohortPanel
from homolog_app.window.explore.panel import ExplorePanel
from homolog_app.window.groom_panel import GroomPanel
from homolog_app.window.rail import STEPS
from homolog_app.window.run_panel import RunPanel
from homolog_app.window.work import Work
from homolog_app.window.workspace import Workspace

__all__ = ["Inspector"]


class Inspector(QFrame):
    """Four panels, one shown."""

    settings_edited = Signal(str, str, object)

    def __init__(self, workspace: Workspace, actions: Actions) -> None:
        super().__init__()
        self.setObjectName("Inspector")
        self.setMinimumWidth(376)
        self.cohort = CohortPanel(workspace.session, workspace.theme, actions)
        self.groom = GroomPanel(workspace.session, actions)
        self.correspond = RunPanel(workspace.session, actions)
        self.explore = ExplorePanel(workspace, actions)
        self._pages = QStackedWidget()
        for panel in (self.cohort, self.groom, self.correspond, self.explore):
            self._pages.addWidget(panel)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self._pages)
        for part, panel in (("groom", self.groom), ("optimize", self.correspond)):
            panel.settings_edited.connect(
                lambda name, value, part=part: self.settings_edited.emit(part, name, value)
            )
        self.correspond.device_chosen.connect(
            lambda alias: self.settings_edited.emit("device", "device", alias)
        )
        workspace.work.devices_known.connect(self._show_devices)

    def show_step(self, step: str) -> None:
        """Turn to the page of a step."""
        self._pages.setCurrentIndex(STEPS.index(step))

    def show_work(self, work: Work) -> None:
        """Show how far the work is on the page that ordered it."""
        self.groom.show_busy(work.status if work.kind == "groom" else None)
        self.correspond.show_busy(work.status if work.kind == "run" else None)

    def _show_devices(self, devices: Devices) -> None:
        self.correspond.show_devices(devices.names)
