"""What is docked around the views: rail, inspector, energies and log."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, Qt
from PySide6.QtWidgets import QDockWidget, QStackedWidget, QTabBar, QWidget

from homolog_app.window.curves import EnergyCurves
from homolog_app.window.explore.overview_page import OverviewPage
from homolog_app.window.log_pane import LogPane

if TYPE_CHECKING:
    from homolog_app.window.main_window import MainWindow

__all__ = ["Docks"]

_INSPECTOR = 452


class Docks(QObject):
    """Rail left, inspector right, both full height; below energies or plots, and the log if wanted."""

    def __init__(self, window: "MainWindow") -> None:
        super().__init__(window)
        self._window = window
        self.curves = EnergyCurves(window.workspace.theme)
        self.log = LogPane(window.workspace.memory)
        bottom = Qt.DockWidgetArea.BottomDockWidgetArea
        window.setCorner(Qt.Corner.BottomLeftCorner, Qt.DockWidgetArea.LeftDockWidgetArea)
        window.setCorner(Qt.Corner.BottomRightCorner, Qt.DockWidgetArea.RightDockWidgetArea)
        self._rail_dock = self._dock("Steps", window.rail, Qt.DockWidgetArea.LeftDockWidgetArea)
        self._inspector_dock = self._dock(
            "Inspector", window.inspector, Qt.DockWidgetArea.RightDockWidgetArea
        )
        self._curves_dock = self._dock("Energies", self.curves, bottom)
        self._plots = QStackedWidget()
        self._plots_dock = self._dock("Plots", self._plots, bottom)
        self._log_dock = self._dock("Log", self.log, bottom)
        for page in window.inspector.explore.pages:
            if page.plots is not None:
                self._plots.addWidget(page.plots)
        window.tabifyDockWidget(self._curves_dock, self._plots_dock)
        window.tabifyDockWidget(self._curves_dock, self._log_dock)
        window.resizeDocks([self._inspector_dock], [_INSPECTOR], Qt.Orientation.Horizontal)
        self._log_dock.visibilityChanged.connect(lambda shown: window.commands["view.log"].setChecked(shown))
        window.workspace.session.facts_changed.connect(self._show_result)

    def handlers(self) -> dict[str, Callable[[], object]]:
        """Return what the commands of the docks do."""
        return {"view.log": self.show_or_hide_log}

    def show_or_hide_log(self) -> None:
        """Bring the log up, or put it away."""
        self._log_dock.setVisible(self._log_dock.isHidden())
        self._log_dock.raise_()

    def show_for(self, open_: bool) -> None:
        """Show the plots of the open page of Explore, or energies in the steps that they belong to."""
        for bar in self._window.findChildren(QTabBar, options=Qt.FindChildOption.FindDirectChildrenOnly):
            bar.setAccessibleName("Below the views")  # Qt makes it when it needs it
        work, session, step = self._window.workspace.work, self._window.workspace.session, self._window.step
        self._rail_dock.setVisible(self._window.workspace.session.is_open)
        self._inspector_dock.setVisible(open_)
        plots = self._window.inspector.explore.page.plots if step == "explore" else None
        if plots is not None:
            self._plots.setCurrentWidget(plots)
        self._plots_dock.setVisible(open_ and plots is not None)
        page = self._window.inspector.explore.page
        of_run = step == "correspond" or (step == "explore" and isinstance(page, OverviewPage))
        wanted = open_ and plots is None and of_run
        self._curves_dock.setVisible(wanted and (work.run_job is not None or session.result is not None))

    def _show_result(self) -> None:
        result = self._window.workspace.session.result
        self.curves.show_rows(result.energies if result is not None else [])

    def _dock(self, title: str, widget: QWidget, area: Qt.DockWidgetArea) -> QDockWidget:
        dock = QDockWidget(title, self._window)
        dock.setObjectName(title)
        dock.setWidget(widget)
        dock.setFeatures(QDockWidget.DockWidgetFeature.NoDockWidgetFeatures)
        dock.setTitleBarWidget(QWidget())
        self._window.addDockWidget(area, dock)
        dock.hide()
        return dock
