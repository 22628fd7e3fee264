"""The dock below the views: energies and log."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, Qt
from PySide6.QtWidgets import QDockWidget

from homolog_app.window.curves import EnergyCurves
from homolog_app.window.log_pane import LogPane

if TYPE_CHECKING:
    from homolog_app.window.main_window import MainWindow

__all__ = ["Docks"]


class Docks(QObject):
    """Two docks in one place; the energies come up with a run, the log when it is asked for."""

    def __init__(self, window: "MainWindow") -> None:
        super().__init__(window)
        self._window = window
        self.curves = EnergyCurves(window.desk.theme)
        self.log = LogPane(window.desk.memory)
        self._curves_dock = self._dock("Energies", self.curves)
        self._log_dock = self._dock("Log", self.log)
        self._log_dock.visibilityChanged.connect(lambda shown: window.commands["view.log"].setChecked(shown))
        window.desk.session.facts_changed.connect(self._show_result)

    def handlers(self) -> dict[str, Callable[[], object]]:
        """Return what the commands of the docks do."""
        return {"view.log": lambda: self._log_dock.setVisible(self._log_dock.isHidden())}

    def show_for(self, open_: bool) -> None:
        """Show the energies while there are some, in the steps that they belong to."""
        work, session = self._window.desk.work, self._window.desk.session
        wanted = open_ and self._window.step in ("correspond", "explore")
        self._curves_dock.setVisible(wanted and (work.run_job is not None or session.result is not None))

    def _show_result(self) -> None:
        result = self._window.desk.session.result
        self.curves.show_rows(result.energies if result is not None else [])

    def _dock(self, title: str, widget: EnergyCurves | LogPane) -> QDockWidget:
        dock = QDockWidget(title, self._window)
        dock.setObjectName(title)
        dock.setWidget(widget)
        dock.setFeatures(QDockWidget.DockWidgetFeature.NoDockWidgetFeatures)
        self._window.addDockWidget(Qt.DockWidgetArea.BottomDockWidgetArea, dock)
        dock.hide()
        return dock
