"""The strip above the views: what is shown, from where, and how many."""

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QFrame, QHBoxLayout, QSlider

from homolog_app.window.actions import Actions
from homolog_app.window.widgets import GRID, label

__all__ = ["ViewBar", "ViewFooter"]

_SHOWN = ("view.raw", "view.groomed", "view.particles", "view.slice", "view.clip")
_GRIDS = ("view.grid1", "view.grid4", "view.grid9", "view.grid16")


class ViewBar(QFrame):
    """Buttons of the views' commands and the opacity of surfaces."""

    opacity_changed = Signal(float)

    def __init__(self, actions: Actions) -> None:
        super().__init__()
        self.setObjectName("ViewBar")
        row = QHBoxLayout(self)
        row.setContentsMargins(GRID, GRID // 2, GRID, GRID // 2)
        row.setSpacing(2)
        for identifier in _SHOWN:
            row.addWidget(actions.button(identifier, self))
        row.addSpacing(GRID)
        row.addWidget(label("Opacity", "Hint"))
        self.opacity = QSlider(Qt.Orientation.Horizontal)
        self.opacity.setRange(10, 100)
        self.opacity.setValue(100)
        self.opacity.setFixedWidth(56)
        self.opacity.setToolTip("Opacity of the surfaces")
        self.opacity.setAccessibleName("Opacity of surfaces")
        self.opacity.valueChanged.connect(lambda value: self.opacity_changed.emit(value / 100.0))
        row.addWidget(self.opacity)
        row.addStretch()
        for identifier in _GRIDS:
            row.addWidget(actions.button(identifier, self))
        row.addSpacing(GRID)
        for identifier in ("view.link", "view.reset", "view.screenshot"):
            row.addWidget(actions.button(identifier, self))


class ViewFooter(QFrame):
    """The strip below: pages, and the playback of a run."""

    frame_chosen = Signal(int)

    def __init__(self, actions: Actions) -> None:
        super().__init__()
        self.setObjectName("ViewFooter")
        row = QHBoxLayout(self)
        row.setContentsMargins(GRID, GRID // 2, GRID, GRID // 2)
        row.setSpacing(GRID)
        self.play = actions.button("run.play", self)
        self.time = QSlider(Qt.Orientation.Horizontal)
        self.time.setAccessibleName("Position in the run")
        self.time.valueChanged.connect(self.frame_chosen)
        self.moment = label("", "Hint")
        self.moment.setMinimumWidth(120)
        self.page = label("", "Hint")
        row.addWidget(self.play)
        row.addWidget(self.time, 1)
        row.addWidget(self.moment)
        row.addStretch()
        row.addWidget(actions.button("view.previous", self))
        row.addWidget(self.page)
        row.addWidget(actions.button("view.next", self))
        self.show_frames(0)

    def show_frames(self, count: int) -> None:
        """Offer the frames of a run, or none; the last one is shown."""
        self.time.blockSignals(True)
        self.time.setRange(0, max(0, count - 1))
        self.time.setValue(max(0, count - 1))
        self.time.blockSignals(False)
        for widget in (self.play, self.time, self.moment):
            widget.setVisible(count > 1)

    def show_page(self, first: int, last: int, total: int) -> None:
        """Say which subjects are shown."""
        text = f"{first}–{last} of {total}" if last > first else f"{first} of {total}"
        self.page.setText(text if total else "")
