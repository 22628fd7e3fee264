"""What can be exported, and the controls that choose modes and groups."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel
from PySide6.QtCore import QSignalBlocker, Signal
from PySide6.QtWidgets import QCheckBox, QComboBox, QLabel, QLineEdit, QWidget

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
from homolog_app.rendering.camera import Clip
from homolog_app.window.theme import scaled
from homolog_app.window.widgets import (
    GRID,
    choice,
    column,
    grid,
    having,
    label,
    link,
    named_rows,
    offer,
    show_all,
)

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
        nothing: dict[str, object] = {_NOTHING: ""} if optional else {}
        self.column = choice("Column", nothing | {name: name for name in self._columns})
        self.first, self.second = choice("From the mean of"), choice("To the mean of")
        self._of_groups = (QLabel("From the mean of"), self.first, QLabel("To the mean of"), self.second)
        cells = grid(self)
        for line, parts in enumerate(
            ((QLabel("Column"), self.column), self._of_groups[:2], self._of_groups[2:])
        ):
            for place, part in enumerate(parts):
                cells.addWidget(part, line, place)
            parts[0].setBuddy(parts[1])
        cells.setColumnStretch(1, 1)
        cells.setColumnMinimumWidth(0, scaled(NAMES_PX))
        self.column.currentIndexChanged.connect(self._fill)
        link(self.changed, self.first.currentIndexChanged, self.second.currentIndexChanged)
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
            offer(box, dict.fromkeys(groups))
            with QSignalBlocker(box):
                box.setCurrentIndex(min(index, len(groups) - 1))
        show_all(bool(groups), *self._of_groups)
        self.changed.emit()


class MotionChooser(QWidget):
    """Modes, two groups or the mean shape, and the view directions."""

    changed = Signal()

    def __init__(self, modes: int, mode: int, columns: Mapping[str, Sequence[str]], camera: str = "") -> None:
        super().__init__()
        self._most = modes
        self.groups = GroupChooser(columns, optional=False)
        kinds = {"Modes of variation": "mode", "From one group to another": "group", "The mean shape": "mean"}
        possible = {text: kind for text, kind in kinds.items() if kind != "group" or self.groups.is_possible}
        self.what = having(QComboBox(), accessibleName="What is shown")
        offer(self.what, possible)
        tip = f"Numbers from 1 to {modes}; several make a grid"
        self.modes = having(QLineEdit(str(mode)), accessibleName="Modes", toolTip=tip)
        how = label(f"1 to {modes}, such as 1 or 1 2 3 for a grid", "FieldHelp", wrap=True)
        self._mode_page = QWidget()
        rows = named_rows((("Modes", self.modes), ("", how)), self._mode_page)
        rows.setColumnMinimumWidth(0, scaled(NAMES_PX))
        rows.setVerticalSpacing(GRID // 2)
        self.groups.hide()
        own = {camera: QCheckBox("As in the window")} if camera else {}
        self.views = own | {name: QCheckBox(name.capitalize()) for name in SIGHTS}
        next(iter(self.views.values())).setChecked(True)
        sights = grid(across=GRID // 2, down=GRID // 2)
        for index, each in enumerate(self.views.values()):
            each.setAccessibleName(f"Seen from: {each.text()}")
            sights.addWidget(each, index // 2, index % 2)
            each.toggled.connect(self.changed)
        seen = label("Seen from", "SectionTitle")
        column(self.what, self._mode_page, self.groups, seen, sights, on=self)
        self.what.currentIndexChanged.connect(self._turn)
        link(self.changed, self.modes.textChanged, self.groups.changed)

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
    if clip is not None and isinstance(settings, CutSettings):
        cut = {
            "clip": CutAway(clip.plane),
            "clip_at": clip.position,
            "clip_normal": " ".join(f"{part:.6g}" for part in clip.normal),
            "clip_flip": clip.flipped,
        }
        settings = settings.model_copy(update=cut)
    return settings
