"""What every page of Explore is."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QComboBox, QWidget

from homolog_app.views.content import Content, ViewContents
from homolog_app.views.view_states import View
from homolog_app.window.actions import Actions
from homolog_app.window.explore.model_cache import ModelCache
from homolog_app.window.widgets import Panel
from homolog_app.window.workspace import Workspace

if TYPE_CHECKING:
    from homolog_app.views.slices import SliceScene
    from homolog_app.window.interactor import Pick

__all__ = ["ExplorePage"]


class ExplorePage(Panel):
    """A page of the inspector that also says what the views show while it is open.

    To change what is shown, emit `shown_changed`: the views then ask `shown`. To have them look at a place,
    emit `place_wanted` with a subject's name, the place and the surface's normal there. A command that
    needs the page to be seen emits `page_wanted`. Long work goes through `workspace.work.compute`.

    Attributes
    ----------
    title : str
        On the page's tab.
    plays : bool
        Whether the page plays something, so that the space bar does.
    plots : QWidget or None
        What the dock below the views shows while the page is open.
    views : QComboBox or None
        What the views show of the model, each with its number of views; None if the page shows subjects.
    colour_range : tuple of 2 float or None
        Ends of the colour scale that were set by hand.
    from_middle : bool
        Whether colours show displacements as positive away from the middle of the shape.
    """

    title = ""
    hint = ""
    plays = False
    shown_changed = Signal()
    place_wanted = Signal(str, object, object)
    page_wanted = Signal()

    def __init__(self, workspace: Workspace, actions: Actions, fitted: ModelCache) -> None:
        super().__init__(self.title, self.hint)
        self.workspace, self.actions_, self.fitted = workspace, actions, fitted
        self.plots: QWidget | None = None
        self.views: QComboBox | None = None
        self.colour_range: tuple[float, float] | None = None
        self.from_middle = False

    @property
    def chosen(self) -> View | None:
        """What is chosen to be seen; None while the page shows the subjects as they are."""
        return None

    @property
    def layouts(self) -> tuple[int, ...] | None:
        """Numbers of views that can be chosen, the present one first; None if subjects are paged through."""
        if self.chosen is None:
            return None
        if self.views is None:
            return (1,)
        counts = [self.views.itemData(index) for index in range(self.views.count())]
        return (self.views.currentData(), *counts)

    def choose_layout(self, count: int) -> None:
        """Show so many views, which `layouts` names."""
        if self.views is not None:
            self.views.setCurrentIndex(self.views.findData(count))
            self.shown_changed.emit()

    def shown(self, subjects: Sequence[Content]) -> ViewContents:
        """Return what the views show.

        Parameters
        ----------
        subjects : sequence of Content
            The subjects as they are shown anyway; `dataclasses.replace` gives them colours, arrows, lines.
        """
        return ViewContents(subjects)

    def set_colour_range(self, range_: tuple[float, float] | None) -> None:
        """Set the ends of the colour scale by hand, or let them be chosen by the values."""
        self.colour_range = range_
        self.shown_changed.emit()

    def enter(self) -> None:
        """Do what is to be done when the page is opened."""

    def play_or_stop(self) -> bool:
        """Play what the page can play, or hold; return whether it can."""
        return False

    @property
    def can_be_drawn_again(self) -> bool:
        """Whether what is shown follows from the project and `chosen`."""
        return True

    def sliced(self) -> "SliceScene | None":
        """Return what slices show while the page is open; None for the selected subject's."""
        return None

    def set_scan(self, name: str, path: Path) -> bool:
        """Take a scan of what `sliced` names; return whether it does."""
        return False

    def drop_files(self, paths: Sequence[Path]) -> bool:
        """Do something with files that were dropped while the page is open; return whether it did."""
        return False

    def handle_pick(self, pick: "Pick") -> None:
        """Do what is to be done when something was clicked in a view."""

    def stop(self) -> None:
        """Stop playing: the page is left or the window rests."""
