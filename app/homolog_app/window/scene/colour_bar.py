"""The colour scale below the views: title, unit, ticks and what its ends mean."""

import numpy as np
from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QFont, QImage, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QWidget

from homolog_app.window.quantities import short
from homolog_app.window.scene.colour_scale import ColourScale
from homolog_app.window.theme import LIGHT, Colours

__all__ = ["ColourBar"]

_HEIGHT, _BAR, _MOST = 64, 12, 520
_SIDE = 120
_TICKS = 5


class ColourBar(QWidget):
    """Painted in the window and, the same way, into saved pictures."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setFixedHeight(_HEIGHT)
        self._scale: ColourScale | None = None
        self._colours = LIGHT
        self.setAccessibleName("Colour scale")
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
            words = (f"{scale.title} in {scale.unit}, from {short(scale.low)} {scale.low_words} "
                     f"to {short(scale.high)} {scale.high_words}")  # fmt: skip
            self.setAccessibleDescription(words)
            self.setToolTip(words)
        self.update()

    def paint(self, colours: Colours) -> None:
        """Take the colours of the scheme."""
        self._colours = colours
        self.update()

    def sizeHint(self) -> QSize:
        """Return the usual size."""
        return QSize(_MOST + 2 * _SIDE, _HEIGHT)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Paint the bar."""
        painter = QPainter(self)
        painter.fillRect(self.rect(), QColor(self._colours.scene))
        self._paint(painter, self.width())
        painter.end()

    def below(self, picture: QImage, scale: float) -> QImage:
        """Return a picture with the bar below it, so many times as large; unchanged without a scale."""
        if self._scale is None:
            return picture
        height = round(_HEIGHT * scale)
        joined = QImage(picture.width(), picture.height() + height, picture.format())
        transparent = picture.hasAlphaChannel()
        joined.fill(Qt.GlobalColor.transparent if transparent else QColor(self._colours.scene))
        painter = QPainter(joined)
        painter.drawImage(0, 0, picture)
        painter.translate(0, picture.height())
        painter.scale(scale, scale)
        self._paint(painter, picture.width() / scale)
        painter.end()
        return joined

    def _paint(self, painter: QPainter, width: float) -> None:
        scale, colours = self._scale, self._colours
        if scale is None:
            return
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        font = QFont(self.font())
        font.setPixelSize(12)
        painter.setFont(font)
        bar = QRectF(0, 24, min(_MOST, width - 2 * _SIDE), _BAR)
        bar.moveCenter(QPointF(width / 2, bar.center().y()))
        line = f"{scale.title} ({scale.unit})" if scale.unit else scale.title
        painter.setPen(QColor(colours.text))
        painter.drawText(
            QRectF(0, 4, width, 16),
            Qt.AlignmentFlag.AlignCenter,
            f"{line} · {scale.note}" if scale.note else line,
        )
        strip = QImage(
            scale.table.tobytes(), len(scale.table), 1, 3 * len(scale.table), QImage.Format.Format_RGB888
        )
        painter.drawImage(bar, strip)
        painter.setPen(QPen(QColor(colours.dim), 1))
        painter.setBrush(Qt.BrushStyle.NoBrush)
        painter.drawRect(bar)
        painter.setPen(QColor(colours.text))
        right, left = Qt.AlignmentFlag.AlignRight, Qt.AlignmentFlag.AlignLeft
        middle = Qt.AlignmentFlag.AlignVCenter
        painter.drawText(
            QRectF(bar.left() - _SIDE, bar.top() - 3, _SIDE - 8, 18), right | middle, scale.low_words
        )
        painter.drawText(
            QRectF(bar.right() + 8, bar.top() - 3, _SIDE - 8, 18), left | middle, scale.high_words
        )
        for value in np.linspace(scale.low, scale.high, _TICKS):
            x = bar.left() + bar.width() * (value - scale.low) / (scale.high - scale.low)
            painter.drawLine(QPointF(x, bar.bottom()), QPointF(x, bar.bottom() + 4))
            painter.drawText(
                QRectF(x - 40, bar.bottom() + 5, 80, 16), Qt.AlignmentFlag.AlignCenter, short(float(value))
            )
