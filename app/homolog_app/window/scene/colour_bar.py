"""The colour scale below the views."""

from PySide6.QtCore import QSize, Qt, Signal
from PySide6.QtGui import QColor, QImage, QMouseEvent, QPainter, QPaintEvent
from PySide6.QtWidgets import QWidget

from homolog_app.rendering.colours import ColourScale
from homolog_app.rendering.scheme import LIGHT, Colours
from homolog_app.rendering.text import short
from homolog_app.window.scene.colour_scale_picture import HEIGHT, MOST, SIDE, scale_picture
from homolog_app.window.theme import text_scale

__all__ = ["ColourBar"]


class ColourBar(QWidget):
    """Shows what is put below saved pictures as well. A click asks for another range."""

    clicked = Signal()

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setFixedHeight(round(HEIGHT * text_scale()))
        self._scale: ColourScale | None = None
        self._colours = LIGHT
        self._drawn: tuple[object, QImage] | None = None
        self.setAccessibleName("Colour scale")
        self.setCursor(Qt.CursorShape.PointingHandCursor)
        self.hide()

    @property
    def scale(self) -> ColourScale | None:
        """What is shown; None hides the bar."""
        return self._scale

    def show_scale(self, scale: ColourScale | None) -> None:
        """Show a scale, or none."""
        if scale is self._scale:
            return
        self._scale = scale
        self.setVisible(scale is not None)
        if scale is not None:
            text = (f"{scale.title} in {scale.unit}, from {short(scale.low)} {scale.low_words} "
                     f"to {short(scale.high)} {scale.high_words}")  # fmt: skip
            self.setAccessibleDescription(text)
            text += f"; grey: {scale.grey_words}" if scale.grey_words else ""
            hollow = " On the inner wall of a hollow organ, out of the tissue makes the cavity smaller."
            self.setToolTip(text + ". Click to set the range." + hollow * ("tissue" in scale.high_words))
        self.update()

    def paint(self, colours: Colours) -> None:
        """Take the colours of the scheme."""
        self._colours = colours
        self.update()

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        """Ask for another range."""
        if event.button() == Qt.MouseButton.LeftButton and self.rect().contains(event.position().toPoint()):
            self.clicked.emit()

    def sizeHint(self) -> QSize:
        """Return the usual size."""
        return QSize(MOST + 2 * SIDE, self.height())

    def paintEvent(self, event: QPaintEvent) -> None:
        """Paint the bar."""
        painter = QPainter(self)
        painter.fillRect(self.rect(), QColor(self._colours.scene))
        if self._scale is not None:
            painter.drawImage(0, 0, self._picture(self._scale))
        painter.end()

    def _picture(self, scale: ColourScale) -> QImage:
        """Return the scale's picture, kept as long as nothing of it changes."""
        ratio, text = self.devicePixelRatioF(), text_scale()
        wanted = scale, self._colours, self.width(), ratio, text
        if self._drawn is None or self._drawn[0] != wanted:
            pixels = scale_picture(scale, self._colours, round(self.width() * ratio), ratio * text)
            height, width, _ = pixels.shape
            image = QImage(pixels.tobytes(), width, height, 4 * width, QImage.Format.Format_RGBA8888).copy()
            image.setDevicePixelRatio(ratio)
            self._drawn = wanted, image
        return self._drawn[1]
