"""The sample: ten beans made on the spot, and a tour of one minute."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QFrame, QHBoxLayout, QVBoxLayout

from homolog.settings import Alignment
from homolog_app.window.widgets import GRID, button, label

if TYPE_CHECKING:
    from homolog_app.window.main_window import MainWindow

__all__ = ["STOPS", "Stop", "Tour"]


@dataclass(frozen=True, slots=True)
class Stop:
    """One card of the tour: the step that it belongs to, what it says, and the command that it offers."""

    step: str
    title: str
    words: str
    offer: str = ""


STOPS = (
    Stop("cohort", "Ten beans", "Each is an ellipsoid with a slot. Where the slot sits and how wide it is "
         "differ: two things to find out. Tick, sort and group subjects in the table."),
    Stop("groom", "Smooth surfaces", "Grooming fills holes and smooths voxel steps. The beans lie alike: no "
         "alignment is needed. Switch between input and groomed surface with 1 and 2, see slices with 4.",
         "run.groom"),
    Stop("correspond", "Corresponding particles", "Particles spread over every bean at once and keep to the "
         "same places. Distances run along the surface: the two sides of a slot stay apart.", "run.start"),
    Stop("explore", "The result", "Equal colours mark equal places. Turn the beans with the mouse. The tab "
         "Modes shows what varies: where the slot sits, then how wide it is. Space plays it."),
)  # fmt: skip


class Tour(QObject):
    """Cards over the views, one after the other."""

    def __init__(self, window: "MainWindow") -> None:
        super().__init__(window)
        self._window = window
        self._at = 0
        self.card = _Card()
        self.card.hide()
        self.card.back.clicked.connect(lambda: self.show_stop(self._at - 1))
        self.card.go_on.clicked.connect(lambda: self.show_stop(self._at + 1))
        self.card.end.clicked.connect(self.card.hide)
        self.card.offer.clicked.connect(self._take_offer)
        window.desk.work.changed.connect(self._refresh)

    def handlers(self) -> dict[str, Callable[[], object]]:
        """Return what the commands of the tour do."""
        return {"help.tour": lambda: self.show_stop(0), "file.sample": self.open_sample}

    def open_sample(self) -> None:
        """Make the beans, list them and begin the tour."""
        window = self._window
        if window.library.may_leave():
            window.library.begin()
            window.desk.work.make_sample(window.desk.home / "samples" / "coffee-beans", self._take_sample)

    def _take_sample(self, folder: Path) -> None:
        self._window.library.take([folder])
        groom = self._window.desk.session.study.settings.groom
        lying = groom.model_copy(update={"alignment": Alignment.NONE})  # half turned a bean fits, too
        self._window.desk.edit_settings("groom", "alignment", lying)
        self.show_stop(0)

    def show_stop(self, index: int) -> None:
        """Show a card, and the step that it is about."""
        if index >= len(STOPS):
            self.card.hide()
            return
        self._at = max(0, index)
        self.card.show()
        self._window.show_step(STOPS[self._at].step)
        self._refresh()

    def _take_offer(self) -> None:
        self._window.commands[STOPS[self._at].offer].trigger()

    def _refresh(self) -> None:
        if self.card.isHidden():
            return
        stop = STOPS[self._at]
        offer = self._window.commands[stop.offer] if stop.offer else None
        following = STOPS[self._at + 1].step if self._at + 1 < len(STOPS) else ""
        reachable = not following or self._window.commands[f"view.{following}"].isEnabled()
        done = offer is None or (reachable and not self._window.desk.work.is_busy)
        self.card.show_stop(stop, f"{self._at + 1} of {len(STOPS)}", self._at > 0, done)
        if offer is not None:
            self.card.offer.setText(offer.text())
            self.card.offer.setEnabled(offer.isEnabled())


class _Card(QFrame):
    """One stop's title and words, with its buttons."""

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("Banner")
        self._title, self._words = label("", "SectionTitle"), label("", wrap=True)
        self._number = label("", "Hint")
        self.offer, self.back = button(""), button("Back", "flat")
        self.go_on, self.end = button("Next", "primary"), button("End tour", "flat")
        head = QHBoxLayout()
        head.addWidget(self._title)
        head.addStretch()
        head.addWidget(self._number)
        row = QHBoxLayout()
        for one in (self.end, self.back):
            row.addWidget(one)
        row.addStretch()
        for one in (self.offer, self.go_on):
            row.addWidget(one)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(2 * GRID, GRID + 4, 2 * GRID, GRID + 4)
        layout.setSpacing(GRID)
        layout.addLayout(head)
        layout.addWidget(self._words)
        layout.addLayout(row)

    def show_stop(self, stop: Stop, number: str, has_back: bool, done: bool) -> None:
        self._title.setText(stop.title)
        self._words.setText(stop.words)
        self._number.setText(number)
        self.offer.setVisible(bool(stop.offer))
        self.back.setVisible(has_back)
        self.go_on.setEnabled(done)
        self.go_on.setText("Done" if stop is STOPS[-1] else "Next")
