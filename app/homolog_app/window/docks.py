"""What is docked below the views: curves of the energies, plots of the pages, and the log."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QObject, Qt
from PySide6.QtWidgets import QDockWidget, QStackedWidget, QTabBar, QWidget

from homolog.arrays import FloatArray
from homolog_app.window.error_dialog import LogPane
from homolog_app.window.explore.panel import OverviewPage
from homolog_app.window.explore.plot import Plot
from homolog_app.window.theme import Theme

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

    from homolog_app.window.main_window import MainWindow

__all__ = ["Docks", "EnergyCurves"]


_MOST_POINTS = 400
_AHEAD = 0.25  # share of further iterations of a run for which there is room


class EnergyCurves(Plot):
    """The parts of the objective over the iterations."""

    def __init__(self, theme: Theme) -> None:
        super().__init__(
            theme, "Energies", "The three energies appear here while particles are being placed."
        )
        self._rows: FloatArray = np.empty((0, 4))
        self._ahead = 0.0

    @property
    def is_empty(self) -> bool:
        """Whether there are no two iterations."""
        return len(np.unique(self._rows[:, 0])) < 2

    def show_rows(self, rows: FloatArray | Sequence[Sequence[float]], *, is_live: bool = False) -> None:
        """Show energies (T, 4): iteration and the three parts. Further ones follow if they are live."""
        table = np.asarray(rows, dtype=np.float64).reshape(-1, 4)
        every = max(1, len(table) // _MOST_POINTS)
        self._rows = np.concatenate([table[::every], table[-1:]]) if len(table) else table
        if is_live and self._ahead and self._fits():
            self.follow()
        else:
            self._ahead = _AHEAD if is_live else 0.0
            self.redraw()

    def draw(self, figure: "Figure") -> None:
        """Draw the frames."""
        from homolog_app.plots import draw_energy_frames

        draw_energy_frames(figure.subplots(1, 3), self._rows, self.theme.colours, self._ahead)

    def draw_moving(self, figure: "Figure") -> "Sequence[Artist]":
        """Draw the curves."""
        from homolog_app.plots import draw_energy_curves

        return draw_energy_curves(figure.axes, self._rows, self.theme.colours)

    def _fits(self) -> bool:
        """Whether the newest values are within the frames that were drawn."""
        axes = self.canvas.figure.axes if self.canvas is not None else []
        iteration, *values = self._rows[-1].tolist()
        return bool(axes) and all(
            frame.viewLim.x0 <= self._rows[0, 0] and frame.viewLim.contains(iteration, value)
            for frame, value in zip(axes, values, strict=True)
            if np.isfinite(value) and value
        )


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
