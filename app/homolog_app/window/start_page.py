"""The first page, and the sample studies that it offers."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QFrame, QGridLayout, QHBoxLayout, QLabel, QPushButton, QWidget

from homolog.progress import Tick
from homolog.settings import Alignment, GroomSettings
from homolog.statistics.procrustes import Alignment as ShapeAlignment
from homolog_app.window.actions import Actions
from homolog_app.window.commands import command
from homolog_app.window.runner import Status
from homolog_app.window.study import Study
from homolog_app.window.theme import Theme, pixmap, scaled
from homolog_app.window.widgets import (
    GRID,
    ActionButton,
    Progress,
    button,
    column,
    fill,
    grid,
    having,
    held,
    label,
    row,
    rule,
)

__all__ = ["BEANS", "HEARTS", "SAMPLES", "Sample", "StartPage", "Stop", "stops_for"]


_COMPLETE = ".complete"
_SEED = 5
_SUBJECTS = 20  # with twelve, permutation tests do not detect the infarct


@dataclass(frozen=True, slots=True)
class Stop:
    """A card of the tour.

    Attributes
    ----------
    step : str
        The step that it describes.
    title, text : str
        Heading and text.
    offer : str
        Identifier of its button's command.
    opens : str
        Identifier of the command triggered when it is shown, such as one that opens a page.
    alignment : ShapeAlignment, optional
        Alignment of the group comparison from then on.
    """

    step: str
    title: str
    text: str
    offer: str = ""
    opens: str = ""
    alignment: ShapeAlignment | None = None


@dataclass(frozen=True, slots=True)
class Sample:
    """A generated study.

    Attributes
    ----------
    name : str
        Name of its folder.
    write : function of folder and tick
        Writes its files.
    stops : tuple of Stop
        The tour.
    truth : str
        A file next to the subjects that identifies samples of this kind.
    groom, optimize : dict
        Settings other than the defaults.
    """

    name: str
    write: Callable[[Path, Tick], object]
    stops: tuple[Stop, ...]
    truth: str
    groom: dict[str, object] = field(default_factory=dict)
    optimize: dict[str, object] = field(default_factory=dict)

    def make(self, folder: Path, tick: Tick) -> Path:
        """Write the study unless it exists; return its folder."""
        if not (folder / _COMPLETE).is_file():
            self.write(folder, tick)
            (folder / _COMPLETE).touch()
        return folder

    def groom_settings(self, settings: GroomSettings) -> GroomSettings:
        """Return settings of grooming that suit the study."""
        return settings.model_copy(update=self.groom)


def _write_study(kind: str, folder: Path, tick: Tick) -> None:
    from homolog.samples import make_study, write_study

    write_study(folder, make_study(kind, _SUBJECTS, _SEED), _SEED, tick, scans=True)


def _write_beans(folder: Path, tick: Tick) -> None:
    from homolog.beans.files import write_beans
    from homolog.beans.generate import draw_beans

    write_beans(folder, draw_beans(), _SEED, tick)


_HEART_STOPS = (
    Stop(
        "cohort",
        "Left ventricles of the heart",
        "Half are healthy, half have an infarct: a region where the wall is thin. Group, age and sex are in "
        "the table. Press 5 to cut the hearts open and see their cavity.",
    ),
    Stop(
        "groom",
        "Smooth surfaces",
        "Grooming fills holes, smooths voxel steps and aligns the hearts. Press 1 and 2 to switch between "
        "input and groomed surface, 4 to see both in the scan.",
        "run.groom",
    ),
    Stop(
        "correspond",
        "Corresponding particles",
        "Particles spread over all hearts at once and stay at corresponding places. Distances are measured "
        "along the surface, which keeps the inside and outside of the wall apart.",
        "run.start",
    ),
    Stop(
        "explore",
        "What varies",
        "The modes of variation, the largest first. Move a slider, or press Space to play a mode.",
        opens="explore.modes",
    ),
    Stop(
        "explore",
        "What differs",
        "Compare healthy hearts with infarcts. Hearts differ in size for other reasons; Shape removes size. "
        "Colours show where the difference is significant: the wall is thinner in the infarct.",
        "explore.test",
        "explore.groups",
        ShapeAlignment.SHAPE,
    ),
)

_BEAN_STOPS = (
    Stop(
        "cohort",
        "Ten beans",
        "Each is an ellipsoid with a slot, whose position and width vary: two modes to find. Tick, sort and "
        "group subjects in the table.",
    ),
    Stop(
        "groom",
        "Smooth surfaces",
        "Grooming fills holes and smooths voxel steps. The beans are aligned already. Press 1 and 2 to "
        "switch between input and groomed surface, 4 to see slices.",
        "run.groom",
    ),
    Stop(
        "correspond",
        "Corresponding particles",
        "Particles spread over all beans at once and stay at corresponding places. Distances are measured "
        "along the surface, which keeps the two sides of a slot apart.",
        "run.start",
    ),
    Stop(
        "explore",
        "The result",
        "Equal colours mark corresponding places. Drag to rotate the beans. The page Modes shows what "
        "varies: the position of the slot, then its width. Press Space to play a mode.",
    ),
)

_STOPS = (
    Stop(
        "cohort",
        "Subjects",
        "The table lists the subjects with their volumes. Tick those to study, and assign groups: type in "
        "the column, or import a table.",
    ),
    Stop(
        "groom",
        "Smooth surfaces",
        "Grooming fills holes, smooths voxel steps and aligns the shapes. Press 1 and 2 to switch between "
        "input and groomed surface, 4 to see slices.",
        "run.groom",
    ),
    Stop(
        "correspond",
        "Corresponding particles",
        "Particles spread over all shapes at once and stay at corresponding places. Distances are measured "
        "along the surface, which keeps opposite sides of a thin wall apart.",
        "run.start",
    ),
    _HEART_STOPS[3],
    Stop(
        "explore",
        "What differs",
        "Compare groups, or test the effect of a number such as age. Colours show where the difference is "
        "significant.",
        "explore.test",
        "explore.groups",
    ),
)

_FRACTURE = (
    "Half are healthy, half have a wedge fracture: the front of the vertebral body is lower. Group, age and "
    "sex are in the table."
)
_CAM = (
    "Left and right, cut through the shaft. Half have a cam deformity: a bump in front of the neck, next to "
    "the head. Group, side, age and sex are in the table."
)


def _anatomy(kind: str, singular: str, stops: tuple[Stop, ...]) -> Sample:
    truth, write = f"truth/{singular}_01.ply", partial(_write_study, kind)
    return Sample(f"{kind}-{_SUBJECTS}", write, stops, truth, optimize={"particles": 256})


HEARTS = _anatomy("hearts", "heart", _HEART_STOPS)
_VERTEBRAE = _anatomy("vertebrae", "vertebra", (Stop("cohort", "Lumbar vertebrae", _FRACTURE), *_STOPS[1:]))
_FEMORA = _anatomy("femora", "femur", (Stop("cohort", "Upper ends of femora", _CAM), *_STOPS[1:]))

# A bean fits after half a turn, too: alignment would rotate some by 180°.
BEANS = Sample("coffee-beans", _write_beans, _BEAN_STOPS, "truth.csv", groom={"alignment": Alignment.NONE})

SAMPLES = {
    "file.sample_hearts": HEARTS,
    "file.sample_vertebrae": _VERTEBRAE,
    "file.sample_femora": _FEMORA,
    "file.sample": BEANS,
}
"""Sample studies by the command that opens them."""


def stops_for(study: Study) -> tuple[Stop, ...]:
    """Return the tour of a study: its own if it is a sample, else that of any study."""
    folders = {member.subject.path.parent for member in study.members}
    for sample in SAMPLES.values():
        if len(folders) == 1 and (next(iter(folders)) / sample.truth).is_file():
            return sample.stops
    return _STOPS


_CARDS = {
    "file.new": "Segmentations (NRRD, NIfTI, MetaImage) or surfaces (VTP, PLY, STL, GIFTI).",
    "file.open": "Open a saved study.",
    "file.sample_hearts": "Twenty generated left ventricles, healthy or after infarct; a short tour.",
}
_FURTHER = {
    "file.sample_vertebrae": "Vertebrae",
    "file.sample_femora": "Femora",
    "file.sample": "Coffee beans",
}
_RECENT = 6
_TEXT_PX = 240


class StartPage(QFrame):
    """Cards to start a study, and the recent projects."""

    opened = Signal(str)
    located = Signal(str)
    forgotten = Signal()

    def __init__(self, theme: Theme, actions: Actions) -> None:
        super().__init__()
        self.setObjectName("StartPage")
        self._theme, self._actions = theme, actions
        self._cards: list[tuple[QPushButton, QLabel, str]] = []
        self._recent = column(gap=0)
        self.hint = label("Or drop a folder, files or a project anywhere on this window.", "Hint")
        self.progress = Progress(actions["run.cancel"])
        self.progress.buttons.addStretch()
        more = [ActionButton(title, actions[identifier], "flat") for identifier, title in _FURTHER.items()]
        samples = row(..., label("More sample studies:", "Hint"), *more, ...)
        parts = (self._head(), self._card_row(), samples, [..., self.hint, ...], self.progress, GRID)
        centre = having(QWidget(), maximumWidth=scaled(768))  # side margins on wide windows only
        column(*parts, self._recent, on=centre, gap=2 * GRID)
        middle = row((centre, 100), gap=0)
        middle.insertStretch(0, 1)
        middle.addStretch(1)
        self.notice = label("", "Hint")
        outer = column(middle, on=self, edges=(GRID,))
        outer.insertStretch(0, 2)
        outer.addStretch(3)
        fill(outer, [..., self.notice, ...])
        theme.changed.connect(self._draw_icons)
        self._draw_icons()

    def show_busy(self, status: Status | None) -> None:
        """Show the progress of a job that was started here, or hide it."""
        self.progress.show_status(status)
        self.hint.setVisible(status is None)

    def show_recent(self, folders: list[Path]) -> None:
        """List the recent projects; missing ones can be located."""
        while item := self._recent.takeAt(0):
            if widget := item.widget():
                widget.deleteLater()
        if folders:
            forget = button("Clear list", "flat", self.forgotten.emit)
            head = held([label("Recent projects", "SectionTitle"), ..., forget], GRID // 2, gap=0)
            fill(self._recent, head, rule(), *map(self._recent_row, folders[:_RECENT]))

    def _head(self) -> QHBoxLayout:
        mark = QLabel()
        mark.setPixmap(pixmap("homolog", "", 64))
        about = "From segmentations to corresponding points and shape statistics"
        texts = column(label("Homolog", "Wordmark"), label(about, "Tagline", wrap=True), gap=0)
        return row(mark, (texts, 1), gap=2 * GRID)

    def _card_row(self) -> QGridLayout:
        cells = grid(across=2 * GRID, down=2 * GRID)
        for place, (identifier, text) in enumerate(_CARDS.items()):
            card = ActionButton("", self._actions[identifier], "card")
            title = command(identifier).title
            having(card, accessibleName=title, accessibleDescription=text)
            icon = QLabel()
            texts = (label(title.rstrip("…"), "SectionTitle"), label(text, "Hint", wrap=True))
            column(*_unclickable(icon, *texts), ..., on=card, edges=(2 * GRID,))
            self._cards.append((card, icon, command(identifier).icon))
            cells.addWidget(card, 0, place)
        return cells

    def _recent_row(self, folder: Path) -> QWidget:
        present = folder.is_dir()
        name = f"Open {folder.name}" if present else f"Locate {folder.name}"
        signal = self.opened if present else self.located
        texts = (folder.name, str(folder.parent) if present else "not found — locate…")
        first, second = (
            self.fontMetrics().elidedText(text, Qt.TextElideMode.ElideMiddle, _TEXT_PX) for text in texts
        )
        result = button("", "row", lambda: signal.emit(str(folder)), accessibleName=name, toolTip=str(folder))
        title, where = _unclickable(label(first), label(second, "Hint"))
        row(title, ..., where, on=result, edges=(GRID, 0, GRID, 0))
        return result

    def _draw_icons(self) -> None:
        for _, icon, name in self._cards:
            icon.setPixmap(pixmap(name, self._theme.colours.accent, 32))


def _unclickable(*widgets: QLabel) -> tuple[QLabel, ...]:
    """Let clicks reach the button below."""
    for widget in widgets:
        widget.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
    return widgets
