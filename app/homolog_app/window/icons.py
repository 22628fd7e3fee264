"""The application's own icons, drawn in any colour."""

from functools import lru_cache
from importlib.resources import files

from PySide6.QtCore import QByteArray, QSize, Qt
from PySide6.QtGui import QIcon, QPainter, QPixmap
from PySide6.QtSvg import QSvgRenderer

__all__ = ["application_icon", "icon", "pixmap"]


@lru_cache
def _source(name: str) -> str:
    return (files("homolog_resources") / "icons" / f"{name}.svg").read_text(encoding="utf-8")


def pixmap(name: str, colour: str, size: int = 24, ratio: float = 2.0) -> QPixmap:
    """Draw an icon of `size` logical pixels for screens of a device pixel ratio up to `ratio`."""
    image = QPixmap(QSize(size, size) * ratio)
    image.fill(Qt.GlobalColor.transparent)
    painter = QPainter(image)
    QSvgRenderer(QByteArray(_source(name).replace("currentColor", colour).encode())).render(painter)
    painter.end()
    image.setDevicePixelRatio(ratio)
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
