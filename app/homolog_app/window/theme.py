"""Light and dark: one set of colours each, one style sheet for both."""

from dataclasses import asdict, dataclass
from importlib.resources import files
from pathlib import Path
from string import Template

from PySide6.QtCore import QObject, Qt, Signal, Slot
from PySide6.QtGui import QColor, QGuiApplication, QPalette
from PySide6.QtWidgets import QApplication

__all__ = ["DARK", "LIGHT", "Colours", "Theme", "rgb"]


@dataclass(frozen=True, slots=True)
class Colours:
    """What each surface and text of the window is painted with, as ``#rrggbb``."""

    window: str
    surface: str
    raised: str
    sunken: str
    field: str
    zebra: str
    hover: str
    selected: str
    notice: str
    line: str
    text: str
    dim: str
    faint: str
    accent: str
    accent_hover: str
    on_accent: str
    danger: str
    warning: str
    scene: str
    bone: str
    raw: str
    mark: str


LIGHT = Colours(
    window="#f3f4f6", surface="#fbfbfc", raised="#ffffff", sunken="#e9ebee", field="#ffffff", zebra="#f7f8f9",
    hover="#e6ecec", selected="#d3e9e7", notice="#fdf4dc", line="#d3d7dc", text="#1b1f24", dim="#59636e",
    faint="#9aa2ab", accent="#0a6f6a", accent_hover="#085a56", on_accent="#ffffff", danger="#b3261e",
    warning="#8a5a00", scene="#eef0f2", bone="#d9d4c8", raw="#d2b48c",
    mark="#1b1f24",
)  # fmt: skip

DARK = Colours(
    window="#1c1f24", surface="#22262b", raised="#2b3036", sunken="#15171b", field="#1a1d21", zebra="#1e2126",
    hover="#333a41", selected="#194240", notice="#3a3322", line="#3b4149", text="#e7eaed", dim="#a3acb6",
    faint="#6b747e", accent="#35b8b0", accent_hover="#50cac2", on_accent="#06201f", danger="#ff8a80",
    warning="#f2b84b", scene="#121417", bone="#cdc6b6", raw="#bf9f74",
    mark="#d81b60",
)  # fmt: skip


def rgb(colour: str) -> tuple[float, float, float]:
    """Return the parts of a ``#rrggbb`` in [0, 1]."""
    red, green, blue = (int(colour[at : at + 2], 16) / 255.0 for at in (1, 3, 5))
    return red, green, blue


class Theme(QObject):
    """The colour scheme in force: the system's, unless the user chose one."""

    changed = Signal()

    def __init__(self, app: QApplication, choice: str = "system") -> None:
        super().__init__(app)
        self._app = app
        self._choice = choice
        self.colours = LIGHT
        app.setStyle("Fusion")
        QGuiApplication.styleHints().colorSchemeChanged.connect(self._follow)
        self._apply()

    @property
    def choice(self) -> str:
        """``"system"``, ``"light"`` or ``"dark"``."""
        return self._choice

    @property
    def is_dark(self) -> bool:
        """Whether the dark colours are shown."""
        return self.colours is DARK

    def choose(self, choice: str) -> None:
        """Follow the system or keep to one scheme."""
        self._choice = choice
        self._apply()

    @Slot()
    def _follow(self) -> None:
        if self._choice == "system":
            self._apply()

    def _apply(self) -> None:
        system_is_dark = QGuiApplication.styleHints().colorScheme() == Qt.ColorScheme.Dark
        dark = system_is_dark if self._choice == "system" else self._choice == "dark"
        self.colours = DARK if dark else LIGHT
        self._app.setPalette(_palette(self.colours))
        sheet = (files("homolog_resources") / "style.qss").read_text(encoding="utf-8")
        tick = "tick_dark" if dark else "tick_light"
        names = asdict(self.colours) | {"icons": _icon_folder(), "tick": tick}
        self._app.setStyleSheet(Template(sheet).substitute(names))
        self.changed.emit()


def _icon_folder() -> str:
    return Path(str(files("homolog_resources"))).joinpath("icons").as_posix()


def _palette(colours: Colours) -> QPalette:
    role = QPalette.ColorRole
    palette = QPalette()
    for which, value in (
        (role.Window, colours.window), (role.Base, colours.field), (role.AlternateBase, colours.zebra),
        (role.Button, colours.raised), (role.ToolTipBase, colours.raised), (role.Mid, colours.line),
        (role.Highlight, colours.accent), (role.HighlightedText, colours.on_accent),
        (role.Link, colours.accent),
        (role.Text, colours.text), (role.WindowText, colours.text), (role.ButtonText, colours.text),
        (role.ToolTipText, colours.text), (role.PlaceholderText, colours.faint),
        (role.Accent, colours.accent),
    ):  # fmt: skip
        palette.setColor(which, QColor(value))
    for which in (role.Text, role.WindowText, role.ButtonText):
        palette.setColor(QPalette.ColorGroup.Disabled, which, QColor(colours.faint))
    return palette
