"""The base class of the pages of *Explore*, their shared shape models, and the page *Overview*."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, Signal, Slot
from PySide6.QtWidgets import QComboBox, QWidget

from homolog.comparison.stored import name_primary, stored_answers
from homolog.errors import InputError
from homolog.io.project import ProjectFolder
from homolog.progress import Tick
from homolog_app.rendering.content import SubjectContents, ViewContents
from homolog_app.scenes.loaded_result import LoadedResult
from homolog_app.scenes.model_shape import ModelShape, PreliminaryModel, fit_model_shape
from homolog_app.scenes.states import View
from homolog_app.window.actions import Actions
from homolog_app.window.explore.group_results import StoredAnswers
from homolog_app.window.widgets import (
    GRID,
    ActionButton,
    Panel,
    button,
    fill,
    label,
    link,
    prose,
    row,
    say,
    show_all,
)
from homolog_app.window.workspace import Workspace

if TYPE_CHECKING:
    from homolog_app.scenes.slices import SliceScene
    from homolog_app.window.explore.controls import Player
    from homolog_app.window.scene import Pick

__all__ = ["CompareBox", "ExplorePage", "ModelCache", "OverviewPage"]

_OF_MODEL = ("Modes", "Groups", "Measure")
"""Titles of the pages that show the model."""


class ModelCache(QObject):
    """Fits the model of the session's result in the computing thread when a page needs it.

    A cancelled fit restarts when another page is opened, or by `retry`.
    """

    changed = Signal()

    def __init__(self, workspace: Workspace, parent: QObject) -> None:
        super().__init__(parent)
        self._workspace = workspace
        self._wanted = False
        self._page = ""
        self._requested: LoadedResult | None = None
        self._of: LoadedResult | None = None
        self._shape: ModelShape | None = None
        self._other: ModelShape | None = None
        self._folder: Path | None = None
        self._early: PreliminaryModel | None = None
        self._early_of: tuple[int, LoadedResult | None] = (0, None)
        self.draw_ms = 0.0
        """Drawing time of the views [ms], which limits the speed of playback."""
        self.from_middle = False
        """Whether colours show displacements as positive away from the centre of the shape."""
        session = workspace.session
        link(self._look, session.result_changed, session.job_changed, session.page_changed)

    @property
    def shape(self) -> "ModelShape | None":
        """The model of the result that is open; None until it is fitted."""
        return self._shape if self._of is self._workspace.session.shown else None

    @property
    def preliminary(self) -> PreliminaryModel | None:
        """The model of a run that has not finished, until that of its result is fitted."""
        return self._early if self.shape is None else None

    @property
    def other(self) -> "ModelShape | None":
        """The model of another project that the open result is compared with."""
        return self._other if self.shape is not None else None

    @property
    def beside(self) -> Path | None:
        """The folder of that project."""
        return self._folder if self.other is not None else None

    @property
    def both(self) -> "tuple[ModelShape, ...]":
        """The models that are shown side by side: none, the open one, or both."""
        return tuple(shape for shape in (self.shape, self.other) if shape is not None)

    @property
    def is_cancelled(self) -> bool:
        """Whether the fit of the result that is open was cancelled."""
        session = self._workspace.session
        waits = self._requested is not None and self._requested is session.shown
        return waits and self.shape is None and not session.job.is_busy

    def retry(self) -> None:
        """Fit the model after a cancellation."""
        self._requested = None
        self._look()

    def compare_with(self, folder: Path) -> None:
        """Read another project's result and fit its model; `changed` follows.

        Raises
        ------
        InputError
            If the folder is not a project.
        """
        project, shape = ProjectFolder(folder), self.shape
        if not project.exists:
            raise InputError(f"{folder}: is not a project; choose the folder of a project with a result")

        def read(tick: Tick) -> "ModelShape":
            from homolog_app.scenes.model_shape import facing, read_model_shape

            other = read_model_shape(folder.name, project, tick)
            return other if shape is None else facing(other, shape)

        def take(other: "ModelShape") -> None:
            self._folder = folder
            self._set_other(other)

        self._workspace.work.compute("compare", read, f"reading {folder.name}", take)

    def compare_no_more(self) -> None:
        """Show the open result alone again."""
        self._set_other(None)

    def _set_other(self, shape: "ModelShape | None") -> None:
        self._other = shape
        self.changed.emit()

    @Slot()
    def _look(self) -> None:
        session, result = self._workspace.session, self._workspace.session.shown
        self._update_preliminary(result)
        self._wanted |= session.page in _OF_MODEL
        if session.page != self._page:
            self._page, self._requested = session.page, None
        if self._of is not None and self._of is not result:
            self._of = self._shape = self._other = None
            self.changed.emit()
        if not self._wanted or result is None or result in (self._of, self._requested) or session.job.is_busy:
            return
        self._requested = result
        fit = partial(fit_model_shape, session.title, result.method, result.result, rigid=result.is_rigid)

        def take(shape: "ModelShape") -> None:
            self._of, self._shape = result, shape
            self.changed.emit()

        self._workspace.work.compute("model", fit, "fitting the shape model", take)

    def _update_preliminary(self, result: LoadedResult | None) -> None:
        """Update the preliminary model; drop one of a closed study or previous run."""
        early, generation = self._workspace.session.preliminary, self._workspace.session.generation
        if early is not None:
            self._early_of = generation, None
        elif self._early is not None:
            of_generation, of_result = self._early_of
            if result is None or generation != of_generation or of_result not in (None, result):
                early = None
            else:
                self._early_of, early = (generation, result), self._early
        if early is not self._early:
            self._early = early
            self.changed.emit()


class CompareBox(QWidget):
    """Shows the model that is compared with the open result, and buttons to choose or remove it."""

    def __init__(self, actions: Actions, fitted: ModelCache) -> None:
        super().__init__()
        self._fitted = fitted
        self.choose = ActionButton("Compare with…", actions["explore.compare"])
        self.leave = button("Stop comparing", "flat", does=fitted.compare_no_more)
        self.hint = label("", "Hint", wrap=True)
        row(self.choose, (self.hint, 1), self.leave, on=self)
        fitted.changed.connect(self._show)
        self._show()

    def _show(self) -> None:
        other = self._fitted.other
        self.hint.setText(
            f"Compared with: {other.title}" if other else "Another run or method, for comparison."
        )
        self.leave.setVisible(other is not None)


class ExplorePage(Panel):
    """A page of the inspector that defines the contents of the views while it is open.

    To change what is shown, emit `shown_changed`: the views then call `shown`. To move the camera to a point,
    emit `place_wanted` with a subject's name, the point and the surface's normal there; to turn whole shapes
    so that they show it, `turn_wanted` with the same. A command that needs the page to be visible emits
    `page_wanted`. Long work goes through `workspace.work.compute`.

    Attributes
    ----------
    title : str
        Text of the page's tab.
    compares : bool
        Whether the page shows another project's model beside that of the result.
    player : Player or None
        What plays when the space bar is pressed.
    plots : QWidget or None
        Content of the dock below the views while the page is open.
    views : QComboBox or None
        Choice of contents, each with its number of views; None if the page shows subjects.
    colour_range : tuple of 2 float or None
        Ends of the colour scale, if set by hand.
    """

    title = ""
    hint = ""
    compares = False
    shown_changed = Signal()
    place_wanted = Signal(str, object, object)
    turn_wanted = Signal(str, object, object)
    page_wanted = Signal()

    def __init__(self, workspace: Workspace, actions: Actions, fitted: ModelCache) -> None:
        super().__init__(self.title, self.hint)
        self.workspace, self.fitted = workspace, fitted
        self.player: Player | None = None
        self.plots: QWidget | None = None
        self.views: QComboBox | None = None
        self.colour_range: tuple[float, float] | None = None
        workspace.session.job_changed.connect(self.show_state)
        workspace.session.job_progressed.connect(self._follow_progress)

    def show_state(self) -> None:
        """Update status and buttons; during a job only the visible page is updated."""

    def _follow_progress(self) -> None:
        if self.isVisible():
            self.show_state()

    @property
    def chosen(self) -> View | None:
        """The display state; None while the page shows the subjects as they are."""
        return None

    @property
    def layouts(self) -> tuple[int, ...] | None:
        """Numbers of views that can be chosen, the current one first; None if subjects are paged."""
        if self.chosen is None:
            return None
        if self.views is None:
            return (1,)
        counts = [self.views.itemData(index) for index in range(self.views.count())]
        return (self.views.currentData(), *counts)

    def choose_layout(self, count: int) -> None:
        """Show one of the numbers of views in `layouts`."""
        if self.views is not None:
            self.views.setCurrentIndex(self.views.findData(count))
            self.shown_changed.emit()

    def shown(self, subjects: SubjectContents) -> ViewContents:
        """Return the contents of the views.

        Parameters
        ----------
        subjects : SubjectContents
            The subjects as other steps show them; add colours, arrows and lines with `dataclasses.replace`.
        """
        return ViewContents(subjects)

    def set_colour_range(self, range_: tuple[float, float] | None) -> None:
        """Set the ends of the colour scale, or let them follow the values."""
        self.colour_range = range_
        self.shown_changed.emit()

    def enter(self) -> None:
        """React to the opening of the page."""

    def play_or_stop(self) -> bool:
        """Play or pause the page's animation; return whether it has one."""
        if self.player is not None and self.player.isEnabled():
            self.player.play_or_stop()
        return self.player is not None

    @property
    def can_be_drawn_again(self) -> bool:
        """Whether the views can be restored from the project and `chosen`."""
        return True

    def sliced(self) -> "SliceScene | None":
        """Return the page's slices; None for those of the selected subject."""
        return None

    def set_scan(self, name: str, path: Path) -> bool:
        """Set the scan of `sliced`; return whether the page accepts it."""
        return False

    def handle_pick(self, pick: "Pick") -> None:
        """Handle a click in a view."""

    def stop(self) -> None:
        """Stop playing because the page is closed or the window is minimized."""
        if self.player is not None:
            self.player.stop()


_NEXT = {
    "explore.modes": "What varies? Modes",
    "explore.groups": "What differs? Groups and numbers",
    "explore.check": "Can it be trusted? Check",
    "explore.measure": "How large? Measure",
    "explore.patient": "How unusual is one patient? Patient",
}


_PRIMARY = (
    "Reports begin with the selected study and call all others secondary; choose it before you see results"
)


class OverviewPage(ExplorePage):
    """An overview of the result, with links to the other pages."""

    title = "Overview"
    hint = "Equal colours mark corresponding places."

    def __init__(self, workspace: Workspace, actions: Actions, fitted: ModelCache) -> None:
        super().__init__(workspace, actions, fitted)
        session = self._session = workspace.session
        self._busy = False
        self.summary, self.verdict, self.files = prose(), prose(), prose("Hint")
        self.kept_title = label("Answers stored in the project", "SectionTitle")
        self.kept, self.outdated = StoredAnswers(), prose("Problem")
        self.kept_hint = label("Double-click an answer to see it.", "Hint")
        self.primary = button("Make primary", does=self._name_primary, toolTip=_PRIMARY)
        self.kept.currentItemChanged.connect(self._show_primary)
        self.playback = label("", "Hint", wrap=True)
        following = [ActionButton(title, actions[command]) for command, title in _NEXT.items()]
        answers = (self.kept_title, self.kept, self.kept_hint, self.primary, self.outdated)
        title = partial(label, name="SectionTitle")
        fill(self.body, title("Result"), self.summary, GRID, title("Verdict"), self.verdict, GRID)
        fill(self.body, title("What next"), *following, GRID, *answers, GRID)
        fill(self.body, title("Playback"), self.playback, GRID, title("Files"), self.files, ...)
        self.save = ActionButton("Save project…", actions["file.save"], "primary")
        self.footer.addWidget(self.save)
        link(self._show, session.result_changed, session.project_changed)
        session.job_changed.connect(self._follow_work)

    def enter(self) -> None:
        """Read the stored answers again."""
        self._show()

    def _follow_work(self) -> None:
        """Read the stored answers again after a new answer or new particles."""
        busy = self.workspace.session.job.is_busy
        if self._busy and not busy:
            self._show_kept()
        self._busy = busy

    def _show_kept(self) -> None:
        """List the answers in the project's folder; those of an earlier result separately."""
        kept, damaged = stored_answers(self.workspace.shown_project) if self._session.folder else ([], [])
        old = [stored.question.title for stored in kept if stored.is_outdated]
        note = ["Out of date: particles were placed again. Compare again, or write the report:"] * bool(old)
        text = "\n".join([*note, *old, *damaged])
        self.kept.show_answers([stored for stored in kept if not stored.is_outdated])
        show_all(not self.kept.isHidden(), self.kept_hint, self.primary)
        self._show_primary()
        say(self.outdated, text)
        self.kept_title.setVisible(bool(kept or text))

    def _show_primary(self) -> None:
        """Enable the button that names the selected answer's study the primary one."""
        chosen = self.kept.current_request is not None
        self.primary.setEnabled(chosen and not self._session.job.is_busy and not self._session.read_only)

    def _name_primary(self) -> None:
        project, request = self.workspace.shown_project, self.kept.current_request
        self.workspace.work.compute(
            "study",
            lambda _: name_primary(project, request),
            "storing the primary study",
            lambda _: self._show_kept(),
        )

    def _show(self) -> None:
        self._show_kept()
        loaded = self._session.part
        self.summary.setText(loaded.summary if loaded else "")
        self.verdict.setText(loaded.verdict.summary if loaded else "")
        self.playback.setText(
            "Space replays the run from its stored frames; the slider below the views seeks."
            if loaded and loaded.frames
            else "This run can't be replayed: only runs in the window record frames."
        )
        folder = self._session.folder
        self.base.setVisible(self._session.folder is None)
        self.files.setText(
            f"Particles, shape model and tables are in {folder}."
            if folder
            else "Save the project to keep particles, shape model and tables."
        )
