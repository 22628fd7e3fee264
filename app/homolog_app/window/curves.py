"""Live curves of the three energies."""

from collections.abc import Sequence

import numpy as np
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QWidget

from homolog.arrays import FloatArray
from homolog_app.window.quantities import tick_words
from homolog_app.window.theme import Theme

__all__ = ["EnergyCurves"]

_NAMES = ("Sampling", "Ensemble", "Normals")
_MEANINGS = ("evenness on each surface", "agreement across shapes", "agreement of normals")
_MOST_POINTS = 400
_FIRST = 20  # one of so many iterations is among the first
_LEFT, _TOP, _BOTTOM, _RIGHT = 64, 44, 32, 16


class EnergyCurves(QWidget):
    """Three small charts side by side over the iterations, each with its own scale."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self._theme = theme
        self._rows: FloatArray = np.empty((0, 4))
        self.setObjectName("Curves")
        self.setMinimumHeight(152)
        self.setAccessibleName("Energies")
        theme.changed.connect(self.update)

    def show_rows(self, rows: FloatArray | Sequence[Sequence[float]]) -> None:
        """Show energies of shape (T, 4): iteration and the three parts."""
        table = np.asarray(rows, dtype=np.float64).reshape(-1, 4)
        every = max(1, len(table) // _MOST_POINTS)
        self._rows = np.concatenate([table[::every], table[-1:]]) if len(table) else table
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Paint the three charts, or what will be here."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        font = painter.font()
        font.setPixelSize(12)
        painter.setFont(font)
        painter.fillRect(self.rect(), QColor(self._theme.colours.surface))
        if len(np.unique(self._rows[:, 0])) < 2:
            painter.setPen(QColor(self._theme.colours.dim))
            text = "The three energies appear here while particles are being placed."
            painter.drawText(self.rect(), Qt.AlignmentFlag.AlignCenter, text)
        else:
            width = self.width() / 3
            for part in range(3):
                self._paint_chart(painter, QRectF(part * width, 0, width, self.height()), part)
        painter.end()

    def _paint_chart(self, painter: QPainter, box: QRectF, part: int) -> None:
        colours = self._theme.colours
        frame = box.adjusted(_LEFT, _TOP, -_RIGHT, -_BOTTOM)
        x, y = self._rows[:, 0], self._rows[:, 1 + part]
        known = np.isfinite(y)
        painter.setPen(QColor(colours.text))
        painter.drawText(QPointF(frame.left(), box.top() + 18), _NAMES[part])
        painter.setPen(QColor(colours.dim))
        painter.drawText(QPointF(frame.left(), box.top() + 34), _MEANINGS[part])
        painter.setPen(QPen(QColor(colours.line), 1))
        painter.drawLine(frame.bottomLeft(), frame.bottomRight())
        painter.drawLine(frame.bottomLeft(), frame.topLeft())
        if known.sum() < 2 or not np.any(y[known]):
            painter.setPen(QColor(colours.dim))
            painter.drawText(frame, Qt.AlignmentFlag.AlignCenter, "not part of this method")
            return
        low, high = _range(y[known])
        across = frame.left() + frame.width() * (x - x[0]) / max(x[-1] - x[0], 1.0)
        down = frame.bottom() - frame.height() * (y - low) / (high - low)
        line = QPolygonF([QPointF(a, b) for a, b in zip(across[known], down[known], strict=True)])
        painter.setPen(QPen(QColor(colours.accent), 2))
        painter.save()
        painter.setClipRect(frame.adjusted(-2, -2, 2, 2))
        painter.drawPolyline(line)
        painter.restore()
        painter.setPen(QColor(colours.dim))
        right = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        words = tick_words([_rounded(low, high - low), _rounded(high, high - low)])
        for text, height in zip(words, (frame.bottom(), frame.top()), strict=True):
            painter.drawText(QRectF(box.left(), height - 8, _LEFT - 8, 16), right, text)
        below = QRectF(frame.left(), frame.bottom() + 6, frame.width(), 18)
        painter.drawText(below, Qt.AlignmentFlag.AlignRight, f"iteration {x[-1]:.0f}")


def _rounded(value: float, span: float) -> float:
    """Round to a hundredth of what is shown."""
    return round(value, max(0, 1 - int(np.floor(np.log10(span)))))


def _range(values: FloatArray) -> tuple[float, float]:
    """Return the range to show: all but leaps of the first iterations, with room around a flat curve."""
    later = values[len(values) // _FIRST :]
    low, high = float(later.min()), float(later.max())
    room = 0.05 * (high - low) or abs(high) * 0.05 or 1.0
    return low - room, high + room
