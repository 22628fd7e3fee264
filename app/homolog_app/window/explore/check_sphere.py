"""A particle's normals on all subjects, as points of a sphere around their mean."""

from collections.abc import Sequence

import numpy as np
from PySide6.QtCore import QEvent, QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QColor, QFont, QHelpEvent, QMouseEvent, QPainter, QPaintEvent, QPen, QRadialGradient
from PySide6.QtWidgets import QToolTip, QWidget

from homolog.arrays import FloatArray
from homolog_app.window.theme import Theme, scaled

__all__ = ["NormalSphere"]

_RINGS = (30.0, 60.0)
_MARGIN, _DOT = 12.0, 5.0
_LISTED = 5


class NormalSphere(QWidget):
    """Looks onto the sphere from the Fréchet mean; hollow is what is behind. A click selects a subject."""

    subject_chosen = Signal(str)

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self._theme = theme
        self._particle: int | None = None
        self._names: Sequence[str] = ()
        self.points: FloatArray = np.empty((0, 3))
        self._angles: FloatArray = np.empty(0)
        self._selected: Sequence[str] = ()
        self.setMinimumSize(360, 180)
        self.setAccessibleName("Normals of the particle")
        theme.changed.connect(self.update)

    def show_normals(
        self, particle: int, names: Sequence[str], normals: FloatArray, mean: FloatArray
    ) -> None:
        """Show the unit normals (M, 3) of a particle and their Fréchet mean (3,)."""
        self._particle, self._names = particle, names
        self._angles = np.degrees(np.arccos(np.clip(normals @ mean, -1.0, 1.0)))
        self.points = normals @ _frame(mean).T
        self.setAccessibleDescription(f"particle {particle}: {'; '.join(self._list())}")
        self.update()

    def show_nothing(self) -> None:
        """Ask for a particle."""
        self._particle = None
        self.setAccessibleDescription("")
        self.update()

    def show_selection(self, names: Sequence[str]) -> None:
        """Mark the selected subjects."""
        self._selected = names
        self.update()

    def _list(self) -> list[str]:
        order = np.argsort(-self._angles)[:_LISTED]
        return [f"{self._names[m]} {self._angles[m]:.0f}°" for m in order]

    @property
    def _disc(self) -> QRectF:
        side = min(self.height(), self.width() // 2) - 2 * _MARGIN
        return QRectF(_MARGIN, (self.height() - side) / 2, side, side)

    def _place(self, point: FloatArray) -> QPointF:
        disc = self._disc
        return disc.center() + QPointF(point[0], -point[1]) * (disc.width() / 2)

    def _at(self, position: QPointF) -> int | None:
        if self._particle is None or not len(self.points):
            return None
        apart = [(self._place(point) - position).manhattanLength() for point in self.points]
        nearest = int(np.argmin(apart))
        return nearest if apart[nearest] <= 2 * _DOT else None

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Choose the subject that was clicked."""
        hit = self._at(event.position())
        if hit is not None:
            self.subject_chosen.emit(self._names[hit])

    def event(self, event: QEvent) -> bool:
        """Name the subject under the mouse."""
        if isinstance(event, QHelpEvent):
            hit = self._at(QPointF(event.pos()))
            text = f"{self._names[hit]}: {self._angles[hit]:.1f}°" if hit is not None else ""
            QToolTip.showText(event.globalPos(), text, self)
            return True
        return super().event(event)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Paint the sphere, the normals and the list of the largest angles."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        font = QFont(self.font())
        font.setPixelSize(scaled(12))
        painter.setFont(font)
        colours = self._theme.colours
        painter.fillRect(self.rect(), QColor(colours.surface))
        if self._particle is None:
            painter.setPen(QColor(colours.dim))
            flags = Qt.AlignmentFlag.AlignCenter | Qt.TextFlag.TextWordWrap
            text = "Choose a particle: its normals on all shapes appear here."
            painter.drawText(self.rect().adjusted(24, 0, -24, 0), flags, text)
        else:
            self._paint_globe(painter)
            self._paint_normals(painter)
            self._paint_text(painter)
        painter.end()

    def _paint_globe(self, painter: QPainter) -> None:
        colours, disc = self._theme.colours, self._disc
        light = QRadialGradient(disc.center() - QPointF(disc.width(), disc.width()) / 6, disc.width() * 0.75)
        light.setColorAt(0.0, QColor(colours.raised))
        light.setColorAt(1.0, QColor(colours.sunken))
        painter.setPen(QPen(QColor(colours.dim), 1))
        painter.setBrush(light)
        painter.drawEllipse(disc)
        painter.setBrush(Qt.BrushStyle.NoBrush)
        for ring in _RINGS:
            painter.setPen(QPen(QColor(colours.line), 1))
            radius = disc.width() / 2 * np.sin(np.radians(ring))
            painter.drawEllipse(disc.center(), radius, radius)

    def _paint_normals(self, painter: QPainter) -> None:
        colours = self._theme.colours
        text, accent = QColor(colours.text), QColor(colours.accent)
        for m in np.argsort(self.points[:, 2]):
            chosen = self._names[m] in self._selected
            ink = accent if chosen else text
            painter.setPen(QPen(ink, 1.6))
            in_front = self.points[m, 2] >= 0.0
            painter.setBrush(ink if in_front else Qt.BrushStyle.NoBrush)
            at, radius = self._place(self.points[m]), _DOT if chosen else 0.7 * _DOT
            painter.drawEllipse(at, radius, radius)
            if chosen:
                painter.setBrush(Qt.BrushStyle.NoBrush)
                painter.drawEllipse(at, radius + 4, radius + 4)
        painter.setPen(QPen(accent, 2))
        middle = self._disc.center()
        for arm in (QPointF(8, 0), QPointF(0, 8)):
            painter.drawLine(middle - arm, middle + arm)

    def _paint_text(self, painter: QPainter) -> None:
        colours, disc = self._theme.colours, self._disc
        left, top = disc.right() + 2 * _MARGIN, disc.top() + 14
        painter.setPen(QColor(colours.text))
        painter.drawText(
            QPointF(left, top), f"Normals of particle {self._particle} on {len(self._names)} shapes"
        )
        painter.setPen(QColor(colours.dim))
        painter.drawText(
            QPointF(left, top + 18), "+ mean normal. Rings: 30°, 60°, 90° from it. Hollow: more than 90°."
        )
        painter.drawText(QPointF(left, top + 44), "Farthest from the mean:")
        painter.setPen(QColor(colours.text))
        for row, line in enumerate(self._list()):
            y = top + 64 + 18 * row
            if y < self.height() - 4:
                painter.drawText(QPointF(left + 8, y), line)


def _frame(mean: FloatArray) -> FloatArray:
    """Return right, up and towards the eye as rows, looking onto the sphere from the mean."""
    head = np.array([0.0, 0.0, 1.0]) if abs(mean[2]) < 0.9 else np.array([0.0, -1.0, 0.0])
    right = np.cross(head, mean)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(mean, right), mean])
