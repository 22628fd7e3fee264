"""The panel *Explore*: its tabs, and the handlers of its commands."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QStackedWidget, QTabBar, QWidget

from homolog.arrays import Array
from homolog.comparison.question import Question
from homolog.comparison.stored import stored_answers
from homolog.errors import InputError
from homolog.progress import Tick
from homolog_app.scenes.loaded_result import LoadedResult
from homolog_app.scenes.structures import POSES, SHAPES, aspects_of
from homolog_app.window.actions import Actions
from homolog_app.window.explore.check_page import CheckPage
from homolog_app.window.explore.groups_page import GroupsPage
from homolog_app.window.explore.measure_page import MeasurePage
from homolog_app.window.explore.modes_page import ModesPage
from homolog_app.window.explore.page import ExplorePage, ModelCache, OverviewPage
from homolog_app.window.explore.patient_page import PatientPage
from homolog_app.window.explore.plan_dialog import PlanDialog
from homolog_app.window.explore.plot import plots_of
from homolog_app.window.explore.printing import drawn_report, print_pages
from homolog_app.window.explore.verdict_bar import VerdictBar
from homolog_app.window.study import FILES, outdated_text
from homolog_app.window.widgets import (
    GRID,
    button,
    choice,
    column,
    having,
    label,
    link,
    row,
    say,
    set_dimmed,
)
from homolog_app.window.workspace import Controller, Workspace, reported

if TYPE_CHECKING:
    from homolog.comparison.plan import Plan

__all__ = ["PAGES", "PAGE_COMMANDS", "ExploreController", "ExplorePanel"]


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
    """The pages, of which one is open."""

    def __init__(self, workspace: Workspace, actions: Actions) -> None:
        super().__init__()
        self.setAccessibleName("Explore")
        self.fitted = ModelCache(workspace, self)
        self.tabs = having(QTabBar(), expanding=False, drawBase=False, accessibleName="Pages of Explore")
        self._stack = QStackedWidget()
        self.pages = [kind(workspace, actions, self.fitted) for kind in PAGES]
        for page in self.pages:
            self.tabs.addTab(page.title)
            self._stack.addWidget(page)
            for plot in (each for part in (page, page.plots) if part is not None for each in plots_of(part)):
                plot.files = workspace.files
        session = self._session = workspace.session
        session.pages = tuple(page.title for page in PAGES)
        session.page = PAGES[0].title
        self.aspects = choice("Structures of the model")
        self.aspects.activated.connect(lambda _: session.show_aspect(self.aspects.currentData()))
        self._aspects = QWidget()
        edges = (2 * GRID, GRID, 2 * GRID, 0)
        row(label("Model of"), (self.aspects, 1), on=self._aspects, edges=edges)
        self.verdict, self.outdated = VerdictBar(session), label("", "Problem", wrap=True)
        self.outdated.setContentsMargins(2 * GRID, GRID, 2 * GRID, 0)
        self.fit = button("Fit shape model", does=self.fitted.retry)
        missing = label("The shape model is not fitted.", "Problem", wrap=True)
        self.unfitted = QWidget()
        row((missing, 1), self.fit, on=self.unfitted, edges=(2 * GRID, GRID, 2 * GRID, 0))
        parts = (self.tabs, self._aspects, self.verdict, self.outdated, self.unfitted)
        column(*parts, (self._stack, 1), on=self, edges=(0, GRID // 2, 0, 0), gap=0)
        self.tabs.currentChanged.connect(session.show_page)
        session.page_changed.connect(self._turn)
        link(self._update_outdated, session.study_changed, session.result_changed)
        self._page_before: ExplorePage | None = None
        link(self._offer_pages, session.result_changed, self.fitted.changed)
        offered = (session.job_changed, self.fitted.changed)
        link(lambda: self.unfitted.setVisible(self.fitted.is_cancelled), *offered)
        self.unfitted.hide()
        link(self._show_aspects, session.result_changed, session.page_changed)
        self._show_aspects()
        self._update_outdated()

    @property
    def page(self) -> ExplorePage:
        """The open page."""
        return next(page for page in self.pages if page.title == self._session.page)

    def page_of(self, kind: type[_Kind]) -> _Kind:
        """Return the page of a kind."""
        return next(page for page in self.pages if isinstance(page, kind))

    def open_page(self, page: ExplorePage) -> None:
        """Open a page."""
        self._session.show_page(page.title)

    def _show_aspects(self) -> None:
        """List what of several structures can be shown; pose and shape apart on the page of modes only."""
        result = self._session.result
        aspects = aspects_of(result) if result is not None else {}
        self._aspects.setVisible(bool(aspects))
        self.aspects.clear()
        for title, aspect in aspects.items():
            if aspect not in (SHAPES, POSES) or isinstance(self.page, ModesPage):
                self.aspects.addItem(title, aspect)
        self.aspects.setCurrentIndex(self.aspects.findData(self._session.aspect))

    def _update_outdated(self) -> None:
        """Show whether the result belongs to a previous cohort."""
        study, result = self._session.study, self._session.result
        text = outdated_text(study, result.record, settings=False) if result is not None else ""
        say(self.outdated, text)
        for page in self.pages:
            if isinstance(page, ModesPage | MeasurePage | CheckPage):  # *Groups* compares with its question
                for widget in filter(None, (page, page.plots)):
                    set_dimmed(widget, bool(text))

    def _offer_pages(self) -> None:
        """Enable only the page of modes while the model is preliminary."""
        only_modes = self._session.result is None and self.fitted.preliminary is not None
        if only_modes and self._page_before is None:
            self._page_before = self.page  # before its tab is disabled, which opens another page
        for index, page in enumerate(self.pages):
            self.tabs.setTabEnabled(index, not only_modes or isinstance(page, ModesPage))
        if only_modes:
            self.open_page(self.page_of(ModesPage))
        elif self._page_before is not None:
            if not self.isVisible():  # the preliminary modes have not been seen
                self.open_page(self._page_before)
            self._page_before = None

    def _turn(self) -> None:
        before, page = self._stack.currentWidget(), self.page
        if before is page:
            return
        if isinstance(before, ExplorePage):
            before.stop()
        self._stack.setCurrentWidget(page)
        self.tabs.setCurrentIndex(self.pages.index(page))
        page.enter()


PAGE_COMMANDS = {
    "explore.modes": ModesPage.title,
    "explore.groups": GroupsPage.title,
    "explore.measure": MeasurePage.title,
    "explore.check": CheckPage.title,
    "explore.patient": PatientPage.title,
}
"""Titles of the pages that commands open."""
_REFERENCES, _LISTS = "References (*.npz)", "CSV (*.csv);;JSON (*.json)"


class ExploreController(Controller):
    """Opens pages and handles their commands."""

    def __init__(self, window: QWidget, workspace: Workspace, panel: ExplorePanel) -> None:
        super().__init__(window, workspace)
        self._panel = panel
        self._groups, self._check = panel.page_of(GroupsPage), panel.page_of(CheckPage)
        self._patient = panel.page_of(PatientPage)
        for page in self._panel.pages:
            page.page_wanted.connect(partial(workspace.session.show_page, page.title, "explore"))
        self._plan: PlanDialog | None = None
        self._wanted: tuple[Question, str] | None = None
        self._panel.page_of(OverviewPage).kept.chosen.connect(self.open_stored)
        self._groups.answered.connect(lambda: QTimer.singleShot(0, self, self._show_wanted))
        self._panel.fitted.changed.connect(self._ask_wanted)  # a project that was just opened has no model
        session = workspace.session
        self._asked_of: LoadedResult | None = None
        stages = (session.page_changed, session.step_changed, session.job_changed, panel.fitted.changed)
        link(self._show_stored, *stages)

    def handlers(self) -> dict[str, Callable[[], object]]:
        """Return the handlers of the commands of *Explore*."""
        show_page, noticed = self._workspace.session.show_page, self._workspace.session.noticed
        files, measure, patient = self._workspace.files, self._panel.page_of(MeasurePage), self._patient
        later = partial(patient.further.add_time, repeats=False)
        repeat = partial(patient.further.add_time, repeats=True)
        again = "Another segmentation of the first time"
        groups = "References of further groups"
        return {
            **{name: partial(show_page, title, "explore") for name, title in PAGE_COMMANDS.items()},
            "check.look": self._check.checked.want,
            "check.next": self._next_suspect,
            "check.mend": self._check.repair_chosen,
            "check.mend_all": self._check.repair_all,
            "check.keep": self._check.checked.write,
            "check.export": self.asking(
                files.new, "Export suspects", "suspects.csv", _LISTS, does=self._check.checked.export
            ),
            "explore.mean": self._panel.page_of(ModesPage).sliders.reset.click,
            "explore.test": self._groups.test,
            "explore.keep": self._groups.store,
            "explore.compare": self.asking(
                files.folder, "Compare with the result of a project", does=self._panel.fitted.compare_with
            ),
            "explore.plan": self.plan,
            "explore.table": self.asking(
                files.new, "Export measures", "measures.csv", "CSV (*.csv)", does=measure.write
            ),
            "explore.distances": self.asking(
                *(files.new, "Export distances", "distances.vtp", "Surfaces (*.vtp *.ply)"),
                does=lambda path: noticed.emit(measure.write_distances(path)),
            ),
            "patient.reference": patient.make_reference,
            "patient.open_reference": self.asking(
                files.file, "Open reference", _REFERENCES, does=patient.open_reference
            ),
            "patient.keep_reference": self.asking(
                files.new, "Save reference", "reference.npz", _REFERENCES, does=patient.save_reference
            ),
            "patient.open": self.open_patient,
            "patient.groups": self.asking(
                files.files, groups, _REFERENCES, does=patient.further.compare_groups
            ),
            "patient.later": self.asking(files.file, "The patient at a later time", FILES, does=later),
            "patient.repeat": self.asking(files.file, again, FILES, does=repeat),
            "patient.save": self.asking(
                files.new, "Save report as (creates a folder)", "Patient", does=patient.write
            ),
            "file.print": self.print_patient,
        }

    @reported
    def open_stored(self, request: Question, comparison: str) -> None:
        """Answer a stored question again, and show one of its comparisons.

        Raises
        ------
        InputError
            If the cohort's table no longer allows it.
        """
        self._workspace.session.show_page(GroupsPage.title, "explore")
        if not self._groups.form.ask(request):
            raise InputError(f"{request.title}: the cohort's table no longer has these groups or numbers")
        self._wanted = request, comparison
        if self._groups.answers and self._groups.is_current:
            self._show_wanted()
        else:
            self._ask_wanted()

    def _show_stored(self) -> None:
        """Show the first stored answer when *Groups* is opened with a result for the first time."""
        session, groups = self._workspace.session, self._groups
        is_open = session.step == "explore" and session.page == groups.title
        if not is_open or session.job.is_busy or self._panel.fitted.shape is None:
            return
        if self._asked_of is session.part:
            return
        self._asked_of = session.part
        if (
            groups.answers
            or self._wanted is not None
            or session.folder is None
            or not session.is_result_written
            or session.part is None
            or not session.part.verdict.is_usable
        ):
            return
        with suppress(InputError):  # *Overview* shows the reason
            kept = [item for item in stored_answers(self._workspace.shown_project)[0] if not item.is_outdated]
            if kept and groups.form.ask(kept[0].question):
                groups.test(turns=False)

    def _ask_wanted(self) -> None:
        """Answer the chosen question if the form still contains it."""
        if self._wanted is None:
            return
        wanted, form = self._wanted[0].identity, self._groups.form
        if wanted in [request.identity for request in form.requests]:
            self._groups.test(turns=False)

    def _show_wanted(self) -> None:
        (request, comparison), answers = self._wanted or (None, ""), self._groups.all
        self._wanted = None
        for number, study in enumerate(answers.own if answers is not None else ()):
            titles = [pair.title for pair in study.pairwise or (study.overall,)]
            if request is not None and study.question.identity == request.identity and comparison in titles:
                self._groups.choose_pair(number, titles.index(comparison))

    def plan(self) -> None:
        """Ask for the effect that a study should find, and show its power."""
        if self._plan is None:
            self._plan = PlanDialog(self._window, self._compute_plan, self._save_plan)
        self._plan.show_plan(None)
        self._plan.show()
        self._plan.raise_()

    @reported
    def _compute_plan(self, given: dict[str, Any]) -> None:
        project, dialog = self._workspace.shown_project, self._plan
        assert dialog is not None, "it asks"

        def work(tick: Tick) -> "Plan":
            from homolog.comparison.plan import plan_project

            return plan_project(project, tick=tick, **given)

        self._workspace.work.compute("plan", work, "planning", dialog.show_plan)

    def _save_plan(self, plan: "Plan") -> None:
        from homolog_app.report.plan import plan_page
        from homolog_app.report.sheets import write_page

        def save(path: Path) -> None:
            write_page(path, plan_page(plan))
            self._workspace.session.noticed.emit(f"Plan written to {path}")

        kinds = "PDF (*.pdf);;HTML (*.html)"
        self.asking(self._workspace.files.new, "Save plan", "plan.pdf", kinds, does=save)()

    def open_patient(self) -> None:
        """Ask for a patient's file and compare it."""
        self._workspace.session.show_page(PatientPage.title, "explore")
        what, files = "Patient's segmentation or surface", self._workspace.files
        self.asking(files.file, what, FILES, does=self._patient.compare)()

    @reported
    def print_patient(self) -> None:
        """Draw the pages of the patient's report, and print them."""
        page = self._patient
        if page.comparison is None or page.reference is None:
            raise InputError("there is no patient yet; choose a patient's file first")
        draw = partial(drawn_report, page.comparison, page.reference, page.further.groups, page.further.times)
        take = partial(self._print_later, f"Shape of {page.comparison.name}")
        self._workspace.work.compute("report", draw, "drawing the pages", take)

    def _print_later(self, title: str, pages: Sequence[Array]) -> None:
        """Ask for the printer once the job has ended."""
        QTimer.singleShot(0, self._window, lambda: self._print(title, pages))

    @reported
    def _print(self, title: str, pages: Sequence[Array]) -> None:
        if print_pages(self._window, title, pages):
            self._workspace.session.noticed.emit(f"{title}: sent to the printer")

    def _next_suspect(self) -> None:
        self._workspace.session.show_page(CheckPage.title, "explore")
        self._check.go_to_next()
