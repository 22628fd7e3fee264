"""The sample studies, made on the spot, and a tour of one minute."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QFrame, QHBoxLayout, QVBoxLayout

from homolog_app.window.explore.groups_page import GroupsPage
from homolog_app.window.rail import steps_of
from homolog_app.window.start_page import BEANS, HEARTS, Sample, Stop
from homolog_app.window.widgets import GRID, button, label

if TYPE_CHECKING:
    from homolog_app.window.main_window import MainWindow

__all__ = ["Tour"]


class Tour(QObject):
    """Cards over the views, one after the other."""

    def __init__(self, window: "MainWindow") -> None:
        super().__init__(window)
        self._window = window
        self._at = 0
        self._sample = HEARTS
        self.card = _Card()
        self.card.hide()
        self.card.back.clicked.connect(lambda: self.show_stop(self._at - 1))
        self.card.go_on.clicked.connect(lambda: self.show_stop(self._at + 1))
        self.card.end.clicked.connect(self.card.hide)
        self.card.offer.clicked.connect(self._accept_offer)
        window.workspace.work.changed.connect(self._refresh)
        window.step_changed.connect(self._follow)
        offers = {stop.offer for sample in (BEANS, HEARTS) for stop in sample.stops if stop.offer}
        for offer in sorted(offers):
            window.commands[offer].changed.connect(self._refresh)

    def handlers(self) -> dict[str, Callable[[], object]]:
        """Return what the commands of the tour do."""
        return {
            "help.tour": lambda: self.show_stop(0),
            "file.sample_hearts": partial(self.open_sample, HEARTS),
            "file.sample": partial(self.open_sample, BEANS),
        }

    def open_sample(self, sample: Sample) -> None:
        """Make a sample study, list its subjects and begin the tour."""
        window = self._window
        if window.projects.may_leave():
            window.projects.begin()
            folder = window.workspace.home / "samples" / sample.name
            window.workspace.work.make_sample(sample, folder, partial(self._accept_sample, sample))

    def _accept_sample(self, sample: Sample, folder: Path) -> None:
        window, self._sample = self._window, sample
        window.projects.open_paths([folder])
        settings = window.workspace.session.study.settings
        window.workspace.edit_settings("groom", "alignment", sample.groom_settings(settings.groom))
        window.workspace.edit_settings(
            "optimize", "particles", settings.optimize.model_copy(update=sample.optimize)
        )
        self.show_stop(0)

    def show_stop(self, index: int) -> None:
        """Show a card, and the step that it is about."""
        if index >= len(self._stops):
            self.card.hide()
            return
        self._at = max(0, index)
        self.card.show()
        stop = self._stops[self._at]
        self._window.show_step(stop.step)
        if stop.opens and self._window.commands[stop.opens].isEnabled():
            self._window.commands[stop.opens].trigger()
        if stop.alignment is not None:
            self._window.inspector.explore.page_of(GroupsPage).form.choose_alignment(stop.alignment)
        self._refresh()

    @property
    def _stops(self) -> tuple[Stop, ...]:
        return self._sample.stops

    def _accept_offer(self) -> None:
        self._window.commands[self._stops[self._at].offer].trigger()

    def _follow(self) -> None:
        """Go on to the card of the step that was opened in another way."""
        step = self._window.step
        if not self.card.isHidden() and self._stops[self._at].step != step:
            self._at = next(index for index, stop in enumerate(self._stops) if stop.step == step)
            self._refresh()

    def _refresh(self) -> None:
        if self.card.isHidden():
            return
        stop = self._stops[self._at]
        offer = self._window.commands[stop.offer] if stop.offer else None
        last, work = self._at + 1 == len(self._stops), self._window.workspace.work
        carried_out = steps_of(self._window.workspace.session, work)[stop.step].done and not work.is_busy
        done = last or offer is None or carried_out
        self.card.show_stop(stop, f"{self._at + 1} of {len(self._stops)}", self._at > 0, done, last)
        if offer is not None:
            self.card.offer.setText(offer.text())
            self.card.offer.setEnabled(offer.isEnabled())


class _Card(QFrame):
    """One stop's title and text, with its buttons."""

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("Banner")
        self.title, self._text = label("", "SectionTitle"), label("", wrap=True)
        self._number = label("", "Hint")
        self.offer, self.back = button(""), button("Back", "flat")
        self.go_on, self.end = button("Next"), button("End tour", "flat")
        head = QHBoxLayout()
        head.addWidget(self.title)
        head.addStretch()
        head.addWidget(self._number)
        row = QHBoxLayout()
        for widget in (self.end, self.back):
            row.addWidget(widget)
        row.addStretch()
        for widget in (self.offer, self.go_on):
            row.addWidget(widget)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(2 * GRID, GRID + 4, 2 * GRID, GRID + 4)
        layout.setSpacing(GRID)
        layout.addLayout(head)
        layout.addWidget(self._text)
        layout.addLayout(row)

    def show_stop(self, stop: Stop, number: str, has_back: bool, done: bool, last: bool) -> None:
        self.title.setText(stop.title)
        self._text.setText(stop.text)
        self._number.setText(number)
        self.offer.setVisible(bool(stop.offer))
        self.back.setVisible(has_back)
        self.go_on.setEnabled(done)
        self.go_on.setText("Done" if last else "Next")
