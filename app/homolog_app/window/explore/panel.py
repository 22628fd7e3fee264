"""The fourth step: a strip of tabs, and a page below it."""

from typing import TypeVar

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QStackedWidget, QTabBar, QVBoxLayout, QWidget

from homolog_app.studies.study import outdated_text
from homolog_app.window.actions import Actions
from homolog_app.window.explore.check_page import CheckPage
from homolog_app.window.explore.groups_page import GroupsPage
from homolog_app.window.explore.measure_page import MeasurePage
from homolog_app.window.explore.model_cache import ModelCache
from homolog_app.window.explore.modes_page import ModesPage
from homolog_app.window.explore.overview_page import OverviewPage
from homolog_app.window.explore.page import ExplorePage
from homolog_app.window.explore.patient_page import PatientPage
from homolog_app.window.widgets import GRID, label
from homolog_app.window.workspace import Workspace

__all__ = ["PAGES", "ExplorePanel"]

PAGES: tuple[type[ExplorePage], ...] = (
    OverviewPage,
    ModesPage,
    GroupsPage,
    MeasurePage,
    CheckPage,
    PatientPage,
)
"""The pages in the order of their tabs."""


_Kind = TypeVar("_Kind", bound=ExplorePage)


class ExplorePanel(QWidget):
    """Turns pages. `page_changed` and `shown_changed` tell the views and the dock to ask the open page."""

    page_changed = Signal()
    shown_changed = Signal()

    def __init__(self, workspace: Workspace, actions: Actions) -> None:
        super().__init__()
        self.setAccessibleName("Explore")
        self.fitted = ModelCache(workspace, self)
        self.tabs = QTabBar()
        self.tabs.setExpanding(False)
        self.tabs.setDrawBase(False)
        self.tabs.setAccessibleName("Pages of Explore")
        self._stack = QStackedWidget()
        self.pages = [kind(workspace, actions, self.fitted) for kind in PAGES]
        for page in self.pages:
            self.tabs.addTab(page.title)
            self._stack.addWidget(page)
            page.shown_changed.connect(lambda page=page: self._update(page))
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, GRID // 2, 0, 0)
        layout.setSpacing(0)
        layout.addWidget(self.tabs)
        self.outdated = label("", "Problem", wrap=True)
        self.outdated.setContentsMargins(2 * GRID, GRID, 2 * GRID, 0)
        layout.addWidget(self.outdated)
        layout.addWidget(self._stack, 1)
        self.tabs.currentChanged.connect(self._turn)
        self._session = workspace.session
        for signal in (workspace.session.study_changed, workspace.session.facts_changed):
            signal.connect(self._update_outdated)
        self._page_before: ExplorePage | None = None
        for signal in (workspace.session.facts_changed, self.fitted.changed):
            signal.connect(self._offer_pages)
        self._update_outdated()

    @property
    def page(self) -> ExplorePage:
        """The open page."""
        return self.pages[self.tabs.currentIndex()]

    def page_of(self, kind: type[_Kind]) -> _Kind:
        """Return the page of a kind."""
        return next(page for page in self.pages if isinstance(page, kind))

    def open_page(self, page: ExplorePage) -> None:
        """Turn to a page."""
        self.tabs.setCurrentIndex(self.pages.index(page))

    def _update_outdated(self) -> None:
        """Say whether what the pages show is of another cohort or other settings than those in force."""
        result = self._session.result
        text = outdated_text(self._session.study, result.record) if result is not None else ""
        self.outdated.setText(text)
        self.outdated.setVisible(bool(text))

    def _offer_pages(self) -> None:
        """Offer the modes alone as long as there is a preliminary model only."""
        only_modes = self._session.result is None and self.fitted.preliminary is not None
        if only_modes and self._page_before is None:
            self._page_before = self.page  # before its tab is disabled, which turns to another
        for index, page in enumerate(self.pages):
            self.tabs.setTabEnabled(index, not only_modes or isinstance(page, ModesPage))
        if only_modes:
            self.open_page(self.page_of(ModesPage))
        elif self._page_before is not None:
            if not self.isVisible():  # nobody has looked at the preliminary modes
                self.open_page(self._page_before)
            self._page_before = None

    def _turn(self, index: int) -> None:
        before = self._stack.currentWidget()
        if isinstance(before, ExplorePage):
            before.stop()
        self._stack.setCurrentIndex(index)
        self.page.enter()
        self.page_changed.emit()

    def _update(self, page: ExplorePage) -> None:
        if page is self.page:
            self.shown_changed.emit()
