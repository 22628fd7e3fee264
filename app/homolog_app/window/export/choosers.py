"""What can be exported, and the controls that choose modes and groups."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel
from PySide6.QtCore import Signal
from PySide6.QtWidgets import QCheckBox, QComboBox, QGridLayout, QLabel, QLineEdit, QVBoxLayout, QWidget

from homolog.io.project import ProjectFolder
from homolog.io.report_details import read_details
from homolog.statistics.design import reference_first
from homolog_app.exports.settings import (
    SIGHTS,
    CutAway,
    CutSettings,
    FilmSettings,
    MeshSettings,
    ParticleSettings,
    PlotSettings,
    ReportSettings,
    ScreenshotSettings,
    StillSettings,
    TableSettings,
)
from homolog_app.rendering.camera import Clip, ClipPlane
from homolog_app.window.theme import scaled
from homolog_app.window.widgets import GRID, choice, label

__all__ = [
    "KINDS",
    "NAMES_PX",
    "SCREENSHOT",
    "ExportKind",
    "GroupChooser",
    "MotionChooser",
    "content_problem",
    "first_settings",
    "group_columns",
    "place_problem",
]


@dataclass(frozen=True, slots=True)
class ExportKind:
    """One export.

    Attributes
    ----------
    name : str
        Name on the command line.
    title : str
        Title of the dialog.
    hint : str
        A sentence on its output.
    settings : model or None
        Its options.
    main : tuple of str
        The options that are always visible.
    suffixes : tuple of str
        Suffixes of the file. A folder is created if there are none, or if the chosen one is empty.
    content : str
        Further choices: ``"motion"``, ``"groups"`` or nothing.
    place : bool
        Whether the user chooses the location.
    """

    name: str
    title: str
    hint: str
    settings: type[BaseModel] | None = None
    main: tuple[str, ...] = ()
    suffixes: tuple[str, ...] = ()
    content: str = ""
    place: bool = True


SCREENSHOT = ExportKind(
    "screenshot",
    "Screenshot",
    "The views as they are now, with the colour scale.",
    ScreenshotSettings,
    suffixes=(".png",),
)
"""The picture of the views, which the window draws itself."""

KINDS = {
    kind.name: kind
    for kind in (
        ExportKind(
            "film",
            "Film",
            "The shape moves along modes or from group to group, or turns.",
            FilmSettings,
            ("width", "height", "fps", "seconds", "deviations", "loop", "turntable"),
            (".mp4", ".gif", ""),
            "motion",
        ),
        ExportKind(
            "still",
            "Picture",
            "One picture of any size for a paper, a slide or a poster.",
            StillSettings,
            ("width", "height", "at", "transparent", "background"),
            (".png",),
            "motion",
        ),
        ExportKind(
            "plot",
            "Plot",
            "Vector graphics: eigenvalues, scores, model quality, groups.",
            PlotSettings,
            ("kind", "background"),
            (".svg", ".pdf", ".png"),
            "groups",
        ),
        ExportKind(
            "meshes",
            "Meshes",
            "Mean, modes, groups and subjects with displacement, p and q at the vertices.",
            MeshSettings,
            ("format", "modes", "deviations", "subjects"),
            (),
            "groups",
        ),
        ExportKind(
            "table",
            "Tables",
            "Scores, modes, measures of the subjects and group results as CSV.",
            TableSettings,
            (),
            (),
            "groups",
        ),
        ExportKind(
            "particles",
            "Particles",
            "A .particles file for each subject.",
            ParticleSettings,
        ),
        ExportKind("shapeworks", "ShapeWorks project", "A project that ShapeWorks Studio opens."),
        ExportKind(
            "markups",
            "Slicer markups",
            "A point list for each subject, for 3D Slicer.",
            ParticleSettings,
        ),
        ExportKind(
            "morphometrics",
            "Morphometrics files",
            "All subjects' points as TPS, NTS and Morphologika, for R, MorphoJ and PAST.",
            ParticleSettings,
        ),
        ExportKind(
            "report",
            "Report",
            "The model and its studies on a page of HTML and as PDF, in the project's folder.",
            ReportSettings,
            place=False,
        ),
    )
}


_NOTHING = "No comparison"
NAMES_PX = 112
"""Width of the labels of an export's fields, so that the fields are aligned."""


def group_columns(columns: Mapping[str, Sequence[str]]) -> dict[str, list[str]]:
    """Return the columns that hold groups, with their values, controls first.

    Columns qualify with at least two values, and at most half as many as there are subjects.
    """
    groups_of = {}
    for name, values in columns.items():
        groups = reference_first(values)
        if 2 <= len(groups) <= max(2, len(values) // 2):
            groups_of[name] = groups
    return groups_of


class GroupChooser(QWidget):
    """A column and two of its groups."""

    changed = Signal()

    def __init__(self, columns: Mapping[str, Sequence[str]], *, optional: bool) -> None:
        super().__init__()
        self._columns = group_columns(columns)
        self._of_groups: list[QWidget] = []
        self.column, self.first, self.second = choice("Column"), choice("From"), choice("To")
        if optional:
            self.column.addItem(_NOTHING, "")
        for column in self._columns:
            self.column.addItem(column, column)
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setSpacing(GRID)
        rows = (("Column", self.column), ("From the mean of", self.first), ("To the mean of", self.second))
        for row, (text, box) in enumerate(rows):
            box.setAccessibleName(text)
            name = QLabel(text)
            name.setBuddy(box)
            grid.addWidget(name, row, 0)
            grid.addWidget(box, row, 1)
            if box is not self.column:
                self._of_groups += name, box
        grid.setColumnStretch(1, 1)
        grid.setColumnMinimumWidth(0, scaled(NAMES_PX))
        self.column.currentIndexChanged.connect(self._fill)
        for box in (self.first, self.second):
            box.currentIndexChanged.connect(self.changed)
        self._fill()

    @property
    def is_possible(self) -> bool:
        """Whether there are groups."""
        return bool(self._columns)

    @property
    def problem(self) -> str:
        """Fault of the choice, or an empty text."""
        same = self.column.currentData() and self.first.currentText() == self.second.currentText()
        return "Choose two different groups." if same else ""

    def arguments(self) -> list[str]:
        """Return the choice as options of the command line."""
        column = self.column.currentData()
        return ["--group", column, self.first.currentText(), self.second.currentText()] if column else []

    def _fill(self) -> None:
        groups = self._columns.get(self.column.currentData() or "", [])
        for index, box in enumerate((self.first, self.second)):
            box.blockSignals(True)
            box.clear()
            box.addItems(groups)
            box.setCurrentIndex(min(index, len(groups) - 1))
            box.blockSignals(False)
        for widget in self._of_groups:
            widget.setVisible(bool(groups))
        self.changed.emit()


class MotionChooser(QWidget):
    """Modes, two groups or the mean shape, and the view directions."""

    changed = Signal()

    def __init__(self, modes: int, mode: int, columns: Mapping[str, Sequence[str]], camera: str = "") -> None:
        super().__init__()
        self._most = modes
        self.what, self.modes = QComboBox(), QLineEdit(str(mode))
        self.groups = GroupChooser(columns, optional=False)
        self.what.addItem("Modes of variation", "mode")
        if self.groups.is_possible:
            self.what.addItem("From one group to another", "group")
        self.what.addItem("The mean shape", "mean")
        self.what.setAccessibleName("What is shown")
        self.modes.setAccessibleName("Modes")
        self.modes.setToolTip(f"Numbers from 1 to {modes}; several make a grid")
        self._mode_page = self._make_mode_page(modes)
        self.groups.hide()
        self.views = {name: QCheckBox(name.capitalize()) for name in SIGHTS}
        if camera:
            self.views = {camera: QCheckBox("As in the window"), **self.views}
        next(iter(self.views.values())).setChecked(True)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(GRID)
        layout.addWidget(self.what)
        layout.addWidget(self._mode_page)
        layout.addWidget(self.groups)
        layout.addWidget(label("Seen from", "SectionTitle"))
        grid = QGridLayout()
        grid.setSpacing(GRID // 2)
        for index, tick in enumerate(self.views.values()):
            tick.setAccessibleName(f"Seen from: {tick.text()}")
            grid.addWidget(tick, index // 2, index % 2)
            tick.toggled.connect(self.changed)
        layout.addLayout(grid)
        self.what.currentIndexChanged.connect(self._turn)
        self.modes.textChanged.connect(self.changed)
        self.groups.changed.connect(self.changed)

    @property
    def kind(self) -> str:
        """``"mode"``, ``"group"`` or ``"mean"``."""
        return str(self.what.currentData())

    @property
    def problem(self) -> str:
        """Fault of the choice, or an empty text."""
        if not self._views():
            return "Choose a direction to look from."
        if self.kind == "group":
            return self.groups.problem
        numbers = self._numbers()
        if self.kind == "mode" and (not numbers or len(set(numbers)) < len(numbers)):
            return f"Name each mode once: numbers from 1 to {self._most}."
        return ""

    def arguments(self) -> list[str]:
        """Return the choice as options of the command line."""
        parts: list[str] = []
        if self.kind == "mode":
            parts = ["--mode", *map(str, self._numbers())]
        elif self.kind == "group":
            parts = self.groups.arguments()
        views = self._views()
        return parts if views == ["oblique"] else [*parts, "--view", *views]

    def _make_mode_page(self, modes: int) -> QWidget:
        page = QWidget()
        grid = QGridLayout(page)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setHorizontalSpacing(GRID)
        grid.setVerticalSpacing(GRID // 2)
        grid.setColumnMinimumWidth(0, scaled(NAMES_PX))
        name = QLabel("Modes")
        name.setBuddy(self.modes)
        grid.addWidget(name, 0, 0)
        grid.addWidget(self.modes, 0, 1)
        grid.addWidget(label(f"1 to {modes}, such as 1 or 1 2 3 for a grid", "FieldHelp", wrap=True), 1, 1)
        return page

    def _numbers(self) -> list[int]:
        parts = self.modes.text().replace(",", " ").split()
        numbers = [int(word) for word in parts if word.isdecimal()]
        fit = len(numbers) == len(parts) and all(1 <= number <= self._most for number in numbers)
        return numbers if fit else []

    def _views(self) -> list[str]:
        return [name for name, tick in self.views.items() if tick.isChecked()]

    def _turn(self) -> None:
        self._mode_page.setVisible(self.kind == "mode")
        self.groups.setVisible(self.kind == "group")
        self.changed.emit()


def content_problem(chooser: MotionChooser | GroupChooser, settings: BaseModel | None) -> str:
    """Return the problem of the chosen content, or an empty text."""
    at_rest = isinstance(chooser, MotionChooser) and chooser.kind == "mean"
    if isinstance(settings, FilmSettings) and at_rest and not settings.turntable:
        return "The mean shape does not move: enable the turntable."
    if isinstance(settings, PlotSettings):
        named = bool(chooser.arguments())
        if named != settings.kind.needs_groups:
            return "This plot compares no groups." if named else "Choose two groups to compare."
    return chooser.problem


def place_problem(out: Path | None, suffixes: tuple[str, ...]) -> str:
    """Return the problem of the path of a file with one of the suffixes, or of a folder, or an empty text."""
    if out is None:
        return "Choose where to save."
    if suffixes and out.suffix.lower() not in suffixes:
        kinds = ", ".join(suffix or "no suffix for a folder of pictures" for suffix in suffixes)
        return f"The name must end in {kinds}."
    is_folder = not suffixes or not out.suffix
    if is_folder and out.exists() and (not out.is_dir() or any(out.iterdir())):
        return "That folder already exists; choose a new name."
    return ""


def first_settings(kind: ExportKind, project: Path, clip: Clip | None) -> BaseModel | None:
    """Return the initial settings; they cut the shapes open where the window's views do.

    Those of a report are the ones stored in the project.
    """
    if kind.settings is None:
        return None
    settings = kind.settings()
    if isinstance(settings, ReportSettings):
        settings = settings.model_copy(update=dict(read_details(ProjectFolder(project))))
    if clip is not None and clip.plane is not ClipPlane.FREE and isinstance(settings, CutSettings):
        cut = {"clip": CutAway(clip.plane), "clip_at": clip.position, "clip_flip": clip.flipped}
        settings = settings.model_copy(update=cut)
    return settings
