"""The main window: its parts, docks, and handlers of commands."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QEvent, QMimeData, QObject, QSize, Qt, Signal, Slot
from PySide6.QtGui import QCloseEvent, QDragEnterEvent, QDropEvent, QHelpEvent, QKeyEvent, QResizeEvent
from PySide6.QtOpenGLWidgets import QOpenGLWidget
from PySide6.QtWidgets import (
    QAbstractButton,
    QComboBox,
    QDockWidget,
    QFrame,
    QMainWindow,
    QScrollArea,
    QStackedWidget,
    QTabBar,
    QToolTip,
    QWidget,
)

from homolog_app.window.actions import Actions
from homolog_app.window.cohort_panel import CohortPanel
from homolog_app.window.commands import WindowState, obstacles
from homolog_app.window.dialogs import LogPane
from homolog_app.window.drops import Drops
from homolog_app.window.explore.groups_page import GroupsPage
from homolog_app.window.explore.page import OverviewPage
from homolog_app.window.explore.panel import PAGE_COMMANDS, ExploreController, ExplorePanel
from homolog_app.window.explore.patient_page import PatientPage
from homolog_app.window.export.controller import ExportController
from homolog_app.window.glossary import explanation, text_of
from homolog_app.window.groom_panel import GroomPanel
from homolog_app.window.help import HelpController, Tour
from homolog_app.window.project_controller import ProjectController
from homolog_app.window.rail import STEPS, DockSizes, Rail, StatusBar, least_inspector, steps_of
from homolog_app.window.run_panel import RunPanel
from homolog_app.window.run_particles import EnergyCurves
from homolog_app.window.start_page import StartPage
from homolog_app.window.theme import scaled, screen_room
from homolog_app.window.widgets import column
from homolog_app.window.workspace import Workspace

if TYPE_CHECKING:
    from homolog_app.window.views import Views

__all__ = ["Docks", "Inspector", "MainWindow"]

_INSPECTOR, _FLATTEST, _LOW = 452, 192, 900  # pixels
_INSPECTOR_SHARE = 0.29  # of the width: with plots folded the shapes have half of 1280 x 800 pixels
_WIDTH_SHARE, _HEIGHT_SHARE, _WIDEST = 0.25, 0.22, 540
"""Smallest fractions of a large window for inspector and plots; largest minimum width of the inspector."""
_SIZE, _FRAME = QSize(1440, 900), QSize(8, 40)  # initial size, and size of the system's frame [pixels]


class Inspector(QFrame):
    """Contains the panels of the four steps and shows one of them."""

    settings_edited = Signal(str, str, object)

    def __init__(self, workspace: Workspace, actions: Actions) -> None:
        super().__init__()
        self.setObjectName("Inspector")
        self.setMinimumWidth(least_inspector())
        self.cohort = CohortPanel(workspace.session, workspace.theme, actions)
        self.groom = GroomPanel(workspace.session, actions)
        self.correspond = RunPanel(workspace.session, actions)
        self.explore = ExplorePanel(workspace, actions)
        self._pages = QStackedWidget()
        for panel in (self.cohort, self.groom, self.correspond, self.explore):
            self._pages.addWidget(panel)
        column(self._pages, on=self)
        for part, panel in (("groom", self.groom), ("optimize", self.correspond)):
            panel.settings_edited.connect(
                lambda name, value, part=part: self.settings_edited.emit(part, name, value)
            )
            panel.resource_edited.connect(lambda name, value: self.settings_edited.emit(name, name, value))
        self._session = workspace.session
        workspace.session.devices_changed.connect(self._show_devices)

    def show_step(self, step: str) -> None:
        """Show the page of a step."""
        self._pages.setCurrentIndex(STEPS.index(step))

    def take_focus(self) -> None:
        """Move the keyboard focus to the shown panel."""
        panels = (self.cohort, self.groom, self.correspond, self.explore.page)
        panels[STEPS.index(self._session.step)].take_focus()

    def show_job(self, *, is_further: bool = False) -> None:
        """Show the progress of the job on the page that started it."""
        job = self._session.job
        for kind, panel in (("groom", self.groom), ("run", self.correspond)):
            if job.kind == kind or not is_further:
                panel.show_busy(job.status if job.kind == kind else None)

    @Slot()
    def _show_devices(self) -> None:
        devices = self._session.devices
        if devices is not None:
            self.correspond.show_devices(devices.names)


class Docks(QObject):
    """Rail left, inspector right, both full height; energies, plots and log below."""

    def __init__(
        self, window: QMainWindow, workspace: Workspace, commands: Actions, rail: Rail, inspector: Inspector
    ) -> None:
        super().__init__(window)
        self._window, self._workspace, self._explore = window, workspace, inspector.explore
        self._commands, self._folded = commands, False
        commands["view.plots"].setChecked(True)
        self._sizes = DockSizes(window)
        self.curves = EnergyCurves(workspace.theme)
        self.curves.files = workspace.files
        self.log = LogPane(workspace.memory)
        bottom = Qt.DockWidgetArea.BottomDockWidgetArea
        window.setCorner(Qt.Corner.BottomLeftCorner, Qt.DockWidgetArea.LeftDockWidgetArea)
        window.setCorner(Qt.Corner.BottomRightCorner, Qt.DockWidgetArea.RightDockWidgetArea)
        self._rail_dock = self._dock("Steps", rail, Qt.DockWidgetArea.LeftDockWidgetArea)
        self._inspector_dock = self._dock("Inspector", inspector, Qt.DockWidgetArea.RightDockWidgetArea)
        self._curves_dock = self._dock("Energies", self.curves, bottom)
        self._plots = QStackedWidget()
        self._plots_dock = self._dock("Plots", self._plots, bottom)
        self._log_dock = self._dock("Log", self.log, bottom)
        for page in inspector.explore.pages:
            if page.plots is not None:
                self._plots.addWidget(page.plots)
        window.tabifyDockWidget(self._curves_dock, self._plots_dock)
        window.tabifyDockWidget(self._curves_dock, self._log_dock)
        self._given = 0
        self._widen(window.width())
        self._log_dock.visibilityChanged.connect(lambda shown: commands["view.log"].setChecked(shown))
        workspace.session.result_changed.connect(self._show_result)

    def handlers(self) -> dict[str, Callable[[], object]]:
        """Return the handlers of the docks' commands."""
        return {"view.log": self.show_or_hide_log, "view.plots": self.fold}

    def fold(self) -> None:
        """Fold the plots and curves below the views away, or show them again."""
        self._folded = not self._commands["view.plots"].isChecked()
        self.show_for(self._workspace.session.is_open, tour=False)

    def show_or_hide_log(self) -> None:
        """Show or hide the log."""
        self._log_dock.setVisible(self._log_dock.isHidden())
        self._log_dock.raise_()

    def show_for(self, open_: bool, *, tour: bool) -> None:
        """Show the plots of the open page, or the energies of a run (not during a tour in a low window)."""
        for bar in self._window.findChildren(QTabBar, options=Qt.FindChildOption.FindDirectChildrenOnly):
            bar.setAccessibleName("Below the views")  # Qt creates it on demand
        session = self._workspace.session
        self._rail_dock.setVisible(session.is_open)
        self._inspector_dock.setVisible(open_)
        plots = self._explore.page.plots if session.step == "explore" else None
        if plots is not None:
            self._plots.setCurrentWidget(plots)
        self._plots_dock.setVisible(open_ and plots is not None and not self._folded)
        page = self._explore.page
        of_run = session.step == "correspond" or (
            session.step == "explore" and isinstance(page, OverviewPage)
        )
        is_shown = open_ and plots is None and of_run and not (tour and self._window.height() < _LOW)
        has_curves = session.job.run is not None or not self.curves.is_empty
        self._curves_dock.setVisible(is_shown and has_curves and not self._folded)

    def follow_size(self, size: QSize) -> None:
        """Resize inspector and plots with a large window, and give the space back when it shrinks."""
        across, up = Qt.Orientation.Horizontal, Qt.Orientation.Vertical
        inspector = self._inspector_dock
        if self._given and (inspector.isHidden() or inspector.width() == self._given):
            self._widen(size.width())  # unless a person has chosen another width
        width = min(max(least_inspector(), round(_WIDTH_SHARE * size.width())), scaled(_WIDEST))
        height = max(_FLATTEST, round(_HEIGHT_SHARE * size.height()))
        for dock, orientation, least in (
            (self._inspector_dock, across, width),
            (self._plots_dock, up, height),
            (self._curves_dock, up, height),
        ):
            self._sizes.set_least(dock, orientation, least)

    def keep_sizes(self) -> None:
        """Keep the inspector's width when the window is resized."""
        self._given = 0

    def _widen(self, window: int) -> None:
        """Give the inspector its share of a window's width [pixels]."""
        share = min(scaled(_INSPECTOR), round(_INSPECTOR_SHARE * window))
        self._given = max(least_inspector(), share)
        self._window.resizeDocks([self._inspector_dock], [self._given], Qt.Orientation.Horizontal)

    def _show_result(self) -> None:
        result = self._workspace.session.result
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


def _dropped_paths(data: QMimeData) -> list[Path]:
    """Return the dragged files and folders."""
    return [Path(url.toLocalFile()) for url in data.urls() if url.isLocalFile()]


class MainWindow(QMainWindow):
    """Assembles the parts and connects commands to handlers."""

    views_ready = Signal()

    def __init__(self, workspace: Workspace) -> None:
        super().__init__()
        self.workspace = workspace
        workspace.setParent(self)
        self.setAcceptDrops(True)
        self.resize(_SIZE.boundedTo(screen_room().size() - _FRAME))
        self._take_colours()
        workspace.theme.changed.connect(self._take_colours)
        self.commands = Actions(self, workspace.theme)
        self.views: Views | None = None
        self.start_page = StartPage(workspace.theme, self.commands)
        self.inspector = Inspector(workspace, self.commands)
        self.rail = Rail(workspace.theme)
        self._lay_out()
        explore = self.inspector.explore
        self.docks = Docks(self, workspace, self.commands, self.rail, self.inspector)
        self.status = StatusBar(self.statusBar(), workspace.session, self.commands)
        self.projects = ProjectController(self, workspace, self.commands, self.start_page, explore)
        self.drops = Drops(self, workspace, self.projects, explore)
        self.exporting = ExportController(self, workspace, explore)
        self.help = HelpController(self, workspace, self.commands)
        self.tour = Tour(workspace, self.commands, self.projects, explore.page_of(GroupsPage))
        self.exploring = ExploreController(self, workspace, explore)
        self._connect()
        self._restore_geometry()
        self.refresh()

    @Slot()
    def load_views(self) -> None:
        """Create the 3-D views; their import is slow."""
        from homolog_app.window.cutting import CutTool
        from homolog_app.window.stage import Stage
        from homolog_app.window.views import Views

        if self.views is not None or self.workspace.closed:
            return
        stage = Stage(self.workspace.theme, self.commands)
        explore, table = self.inspector.explore, self.inspector.cohort
        views = Views(self, self.workspace, self.commands, stage, explore, table, self.docks.curves)
        self.views = self.projects.views = self.exporting.views = views
        CutTool(self.workspace.session, self.inspector.groom.cuts, stage.scene)
        views.layout_changed.connect(self.refresh)
        views.slices_wanted.connect(self.exporting.save_slices)
        views.picture_wanted.connect(self.exporting.open_screenshot)
        self.drops.scans = views.scans
        self._middle.addWidget(stage)
        stage.place_card(self.tour.card)
        self._first_gl.deleteLater()
        self.commands.connect_handlers(self.views.handlers())
        self.refresh()
        self.workspace.work.go_on()
        self.views_ready.emit()

    @Slot()
    def _take_colours(self) -> None:
        self.setStyleSheet(self.workspace.theme.sheet)

    @Slot()
    def _turn(self) -> None:
        self.inspector.show_step(self.workspace.session.step)

    @Slot()
    def refresh(self) -> None:
        """Update enabled states."""
        workspace, session = self.workspace, self.workspace.session
        if session.is_opening:
            return
        self.commands.enable(obstacles(session, workspace.project, self._state()), session.read_only)
        steps, is_open = steps_of(session), session.is_open
        if is_open and session.step != "cohort" and not steps[session.step].enabled:
            session.show_step("cohort")
            return
        self.rail.show_steps(steps, session.step if is_open else "")
        self.inspector.show_job()
        self.start_page.show_busy(session.job.status if session.job.is_busy else None)
        opened = is_open and self.views is not None
        if not opened:
            self._middle.setCurrentIndex(0)
        self.docks.show_for(opened, tour=not self.tour.card.isHidden())
        if opened:  # last, since views are redrawn each time that a dock changes their size
            self._middle.setCurrentIndex(1)
        self._name_window()

    def _state(self) -> WindowState:
        views, job, explore = self.views, self.workspace.session.job, self.inspector.explore
        page, pages = views.pages if views else (0, 1)
        patient = explore.page_of(PatientPage)
        return WindowState(
            busy=job.is_busy,
            running=job.run is not None,
            kept=job.kept is not None,
            page=page,
            pages=pages,
            ready=views is not None,
            plays=self.workspace.session.step == "explore" and explore.page.player is not None,
            answered=bool(explore.page_of(GroupsPage).answers),
            reference=patient.reference is not None,
            patient=patient.comparison is not None,
            layouts=views.layouts if views else (),
            model=views is not None and views.shows_model,
            slices=views is not None and views.hides_views,
            coloured=views is not None and views.is_coloured,
            preliminary=explore.fitted.preliminary is not None,
        )

    @Slot()
    def _show_progress(self) -> None:
        """Show the progress of the job; enabled states do not change."""
        workspace = self.workspace
        if not workspace.session.is_open:
            self.start_page.show_busy(workspace.session.job.status if workspace.session.job.is_busy else None)
        elif workspace.session.job.kind in ("groom", "run"):
            self.rail.show_steps(steps_of(workspace.session), workspace.session.step)
            self.inspector.show_job(is_further=True)

    def closeEvent(self, event: QCloseEvent) -> None:
        """Ask, stop jobs, release the graphics, then close."""
        if not (self.exporting.may_close() and self.projects.may_leave()):
            event.ignore()
            return
        self.setEnabled(False)
        self.status.say("Stopping…")
        self.exporting.close()
        if self.isVisible():
            self.workspace.preferences.keep_geometry(self.saveGeometry(), self.saveState())
        if self.views is not None:
            self.views.close()
        self.workspace.close()
        event.accept()

    def dragEnterEvent(self, event: QDragEnterEvent) -> None:
        """Accept everything; `dropEvent` says what can't be used."""
        event.acceptProposedAction()

    def dropEvent(self, event: QDropEvent) -> None:
        """Open or add what was dropped, or say why not."""
        event.acceptProposedAction()
        session, paths = self.workspace.session, _dropped_paths(event.mimeData())
        if not paths or session.job.is_busy or self.views is None:
            busy = "Something is being computed; wait for it or cancel it, then drop this again"
            session.noticed.emit(busy if paths else "Drop files or folders of this machine")
            return
        self.drops.take(paths, event.position().toPoint())

    def event(self, event: QEvent) -> bool:
        """Explain technical words of a text under the pointer that has no help of its own."""
        if isinstance(event, QHelpEvent) and event.type() == QEvent.Type.ToolTip:
            text = explanation(text_of(self.childAt(event.pos()), event.globalPos()))
            QToolTip.showText(event.globalPos(), text, self) if text else QToolTip.hideText()
            return True
        return super().event(event)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Let Enter press the button or open the box that has the focus, as the space bar does."""
        focus, is_enter = self.focusWidget(), event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter)
        if is_enter and isinstance(focus, QAbstractButton):
            focus.click()
        elif is_enter and isinstance(focus, QComboBox) and not focus.isEditable():
            focus.showPopup()
        else:
            super().keyPressEvent(event)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Distribute the space."""
        super().resizeEvent(event)
        self.docks.follow_size(event.size())

    def changeEvent(self, event: QEvent) -> None:
        """Stop drawing while minimized."""
        super().changeEvent(event)
        if event.type() == QEvent.Type.WindowStateChange and self.views is not None:
            self.views.rest(self.isMinimized())

    def _restore_geometry(self) -> None:
        """Restore size, position and panel widths."""
        known = self.workspace.preferences.geometry
        if known is not None:
            geometry, state = known
            self.restoreGeometry(geometry)
            self.restoreState(state)
            self.docks.keep_sizes()

    def _lay_out(self) -> None:
        self._middle = QStackedWidget()
        self._first_gl = QOpenGLWidget(self)  # an OpenGL window from the start does not flash later
        self._first_gl.setFixedSize(1, 1)
        first = QScrollArea(widgetResizable=True)  # many recent projects scroll
        first.setFrameShape(QFrame.Shape.NoFrame)
        first.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        first.setWidget(self.start_page)
        self._middle.addWidget(first)
        self.setCentralWidget(self._middle)

    def _connect(self) -> None:
        workspace, session = self.workspace, self.workspace.session
        self.commands.connect_handlers(self._handlers())
        self.commands.name_edits(session.undo)
        for name, button in self.rail.buttons.items():
            button.clicked.connect(self.commands[f"view.{name}"].trigger)
        for name in (*(f"view.{step}" for step in STEPS), *PAGE_COMMANDS):
            self.commands[name].triggered.connect(self.inspector.take_focus)
        session.step_changed.connect(self._turn)
        for signal in (
            session.study_changed,
            session.surveys_changed,
            session.groomed_changed,
            session.result_changed,
            session.selection_changed,
            session.project_changed,
            session.step_changed,
            session.page_changed,
            session.undo.indexChanged,
            session.job_changed,
            self.tour.card.toggled,
        ):
            signal.connect(self.refresh)
        session.job_progressed.connect(self._show_progress)
        session.failed.connect(self.help.show_error)
        self.inspector.settings_edited.connect(workspace.edit_settings)

    def _handlers(self) -> dict[str, Callable[[], object]]:
        steps = {f"view.{name}": partial(self.workspace.session.show_step, name) for name in STEPS}
        own = {"file.quit": self.close}
        return {
            **steps,
            **own,
            **self.docks.handlers(),
            **self.projects.handlers(),
            **self.help.handlers(),
            **self.exporting.handlers(),
            **self.workspace.handlers(),
            **self.tour.handlers(),
            **self.exploring.handlers(),
        }

    def _name_window(self) -> None:
        session = self.workspace.session
        changed = session.is_open and (session.folder is None or self.workspace.is_changed)
        aside = " (read-only)" if session.read_only else ""
        self.setWindowTitle(f"{session.title}{aside}[*] — Homolog" if session.is_open else "Homolog")
        if changed != self.isWindowModified():
            self.setWindowModified(changed)
