"""The result at a glance, and the run played again."""

from typing import TypeVar

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QStackedWidget, QTabBar, QVBoxLayout, QWidget

from homolog.errors import InputError
from homolog_app.report.request import kept_studies
from homolog_app.studies.study import outdated_text
from homolog_app.window.actions import Actions
from homolog_app.window.explore.check_page import CheckPage
from homolog_app.window.explore.groups_page import GroupsPage
from homolog_app.window.explore.measure_page import MeasurePage
from homolog_app.window.explore.modes_page import ModesPage
from homolog_app.window.explore.page import ExplorePage, ModelCache
from homolog_app.window.explore.patient_page import PatientPage
from homolog_app.window.widgets import GRID, ActionButton, label
from homolog_app.window.workspace import Workspace

__all__ = ["PAGES", "ExplorePanel", "OverviewPage"]


_NEXT = {
    "explore.modes": "What varies? Modes",
    "explore.groups": "What differs? Groups and numbers",
    "explore.check": "Can it be trusted? Check",
    "explore.measure": "How large? Measure",
}


class OverviewPage(ExplorePage):
    """What the run came to, and how to look at it."""

    title = "Overview"
    hint = "Equal colours mark corresponding places."

    def __init__(self, workspace: Workspace, actions: Actions, fitted: ModelCache) -> None:
        super().__init__(workspace, actions, fitted)
        session = self._session = workspace.session
        self._busy = False
        self.summary = label("", wrap=True)
        self.summary.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.files = label("", "Hint", wrap=True)
        self.files.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.body.addWidget(label("Result", "SectionTitle"))
        self.body.addWidget(self.summary)
        self.body.addSpacing(GRID)
        self.body.addWidget(label("What next", "SectionTitle"))
        for command, title in _NEXT.items():
            self.body.addWidget(ActionButton(title, actions[command]))
        self.body.addSpacing(GRID)
        self.kept_title = label("Answers kept in the project", "SectionTitle")
        self.kept = label("", wrap=True)
        self.outdated = label("", "Problem", wrap=True)
        for listed in (self.kept, self.outdated):
            listed.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        for text in (self.kept_title, self.kept, self.outdated):
            self.body.addWidget(text)
        self.body.addSpacing(GRID)
        self.body.addWidget(label("Playback", "SectionTitle"))
        self.playback = label("", "Hint", wrap=True)
        self.body.addWidget(self.playback)
        self.body.addSpacing(GRID)
        self.body.addWidget(label("Files", "SectionTitle"))
        self.body.addWidget(self.files)
        self.body.addStretch()
        self.save = ActionButton("Save project…", actions["file.save"], "primary")
        self.footer.addWidget(self.save)
        session.facts_changed.connect(self._show)
        workspace.work.changed.connect(self._follow_work)
        session.project_changed.connect(self._show)

    def enter(self) -> None:
        """Read anew what is kept."""
        self._show()

    def _follow_work(self) -> None:
        """Look again once an answer was kept or particles were placed."""
        busy = self.workspace.work.is_busy
        if self._busy and not busy:
            self._show_kept()
        self._busy = busy

    def _show_kept(self) -> None:
        """List the answers in the project's folder, those of an earlier result apart."""
        try:
            kept = kept_studies(self.workspace.project) if self._session.folder else []
        except InputError as error:
            kept, text = [], str(error)
        else:
            old = [study.title for study, outdated in kept if outdated]
            text = "\n".join(
                ["Out of date, since particles were placed again: compare again, or write the report:", *old]
            ) if old else ""  # fmt: skip
        self.kept.setText("\n".join(study.title for study, outdated in kept if not outdated))
        self.outdated.setText(text)
        self.kept.setVisible(bool(self.kept.text()))
        self.outdated.setVisible(bool(text))
        self.kept_title.setVisible(bool(kept or text))

    def _show(self) -> None:
        self._show_kept()
        loaded = self._session.result
        self.summary.setText(loaded.summary if loaded else "")
        self.playback.setText(
            "Space replays the run from its stored frames; the slider below the views seeks."
            if loaded and loaded.frames
            else "This run can't be played: only the window keeps frames of its runs."
        )
        folder = self._session.folder
        self.base.setVisible(self._session.folder is None)
        self.files.setText(
            f"Particles, shape model and tables are in {folder}."
            if folder
            else "Save the project to keep particles, shape model and tables."
        )


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
