"""Colours, fonts and icons of the window."""

from dataclasses import asdict
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from string import Template

from PySide6.QtCore import QByteArray, QObject, QRect, QSize, Qt, Signal, Slot
from PySide6.QtGui import QColor, QFontInfo, QGuiApplication, QIcon, QPainter, QPalette, QPixmap, QPixmapCache
from PySide6.QtSvg import QSvgRenderer
from PySide6.QtWidgets import QApplication, QWidget

from homolog_app.rendering.colours import DARK_SCHEME, LIGHT_SCHEME, Colours

__all__ = ["Theme", "application_icon", "icon", "pixmap", "scaled", "screen_room", "text_scale"]


_SIZES, _USUAL, _CARD = (12, 15, 17, 32), 12, 144


class Theme(QObject):
    """The current colour scheme: the system's, unless the user chose one.

    The window uses `sheet` as its own style sheet. An application-wide sheet would style each widget again
    whenever its parent changes, and takes several times as long to change.

    Attributes
    ----------
    colours : Colours
    sheet : str
        Style sheet with these colours.
    """

    changed = Signal()

    def __init__(self, app: QApplication, choice: str = "system") -> None:
        super().__init__(app)
        self._app = app
        self._choice = choice
        self.colours = LIGHT_SCHEME
        self.sheet = ""
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
        return self.colours is DARK_SCHEME

    def choose(self, choice: str) -> None:
        """Follow the system, or use one scheme."""
        self._choice = choice
        self._apply()

    @Slot()
    def _follow(self) -> None:
        if self._choice == "system":
            self._apply()

    def _apply(self) -> None:
        system_is_dark = QGuiApplication.styleHints().colorScheme() == Qt.ColorScheme.Dark
        dark = system_is_dark if self._choice == "system" else self._choice == "dark"
        colours = DARK_SCHEME if dark else LIGHT_SCHEME
        template = (files("homolog_resources") / "style.qss").read_text(encoding="utf-8")
        tick = "tick_dark" if dark else "tick_light"
        sizes = {f"font{size}": f"{scaled(size)}px" for size in _SIZES}
        names = (
            asdict(colours) | sizes | {"icons": _icon_folder(), "tick": tick, "card": f"{scaled(_CARD)}px"}
        )
        sheet = Template(template).substitute(names)
        if sheet == self.sheet:
            return  # setting it would style every widget again
        self.colours, self.sheet = colours, sheet
        self._app.setPalette(_palette(colours))
        self.changed.emit()


def scaled(size: int) -> int:
    """Return a font size [pixels], given for a system font of 12 pixels, scaled to the current one."""
    return round(size * text_scale())


def text_scale() -> float:
    """Return the size of the system's font relative to one of 12 pixels."""
    return QFontInfo(QGuiApplication.font()).pixelSize() / _USUAL


def screen_room(beside: QWidget | None = None) -> QRect:
    """Return the usable part of the screen that a widget is on, or of the first one.

    Widgets are not asked for their screen: PySide would make it their child, and delete Qt's only screen
    when it collects the garbage of such a widget.
    """
    screen = QGuiApplication.screenAt(beside.frameGeometry().center()) if beside is not None else None
    return (screen or QGuiApplication.primaryScreen()).availableGeometry()


def _icon_folder() -> str:
    return Path(str(files("homolog_resources"))).joinpath("icons").as_posix()


def _palette(colours: Colours) -> QPalette:
    role = QPalette.ColorRole
    palette = QPalette()
    for which, value in (
        (role.Window, colours.window),
        (role.Base, colours.field),
        (role.AlternateBase, colours.zebra),
        (role.Button, colours.raised),
        (role.ToolTipBase, colours.raised),
        (role.Mid, colours.line),
        (role.Highlight, colours.accent),
        (role.HighlightedText, colours.on_accent),
        (role.Link, colours.accent),
        (role.Text, colours.text),
        (role.WindowText, colours.text),
        (role.ButtonText, colours.text),
        (role.ToolTipText, colours.text),
        (role.PlaceholderText, colours.dim),
        (role.Accent, colours.accent),
    ):
        palette.setColor(which, QColor(value))
    for which in (role.Text, role.WindowText, role.ButtonText):
        palette.setColor(QPalette.ColorGroup.Disabled, which, QColor(colours.faint))
    return palette


@lru_cache
def _source(name: str) -> str:
    return (files("homolog_resources") / "icons" / f"{name}.svg").read_text(encoding="utf-8")


def pixmap(name: str, colour: str, size: int = 24, ratio: float = 2.0) -> QPixmap:
    """Return an icon of `size` logical pixels for screens of a device pixel ratio up to `ratio`."""
    key = f"{name} {colour} {size} {ratio}"
    image = QPixmap()
    if QPixmapCache.find(key, image):
        return image
    image = QPixmap(QSize(size, size) * ratio)
    image.fill(Qt.GlobalColor.transparent)
    painter = QPainter(image)
    QSvgRenderer(QByteArray(_source(name).replace("currentColor", colour).encode())).render(painter)
    painter.end()
    image.setDevicePixelRatio(ratio)
    QPixmapCache.insert(key, image)
    return image


def icon(name: str, colour: str, faint: str, on: str | None = None) -> QIcon:
    """Return an icon in a colour, greyed to `faint` where disabled and in `on` where checked."""
    result = QIcon(pixmap(name, colour))
    result.addPixmap(pixmap(name, faint), QIcon.Mode.Disabled)
    if on is not None:
        result.addPixmap(pixmap(name, on), QIcon.Mode.Normal, QIcon.State.On)
    return result


def application_icon() -> QIcon:
    """Return the program's own icon."""
    return QIcon(pixmap("homolog", "", 64))
