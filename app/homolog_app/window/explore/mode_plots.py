"""Plots of the modes: eigenvalues above chance, and the subjects' scores in two modes."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QEvent, QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QColor, QFontMetrics, QKeyEvent, QMouseEvent, QPainter, QPen, QPolygonF
from PySide6.QtWidgets import QToolTip

from homolog.arrays import FloatArray
from homolog_app.window.explore.plot import Plot, group_colour, marker
from homolog_app.window.quantities import signed
from homolog_app.window.theme import Theme

if TYPE_CHECKING:
    from homolog_app.window.explore.model_shape import ModelShape

__all__ = ["ScatterPlot", "ScreePlot"]

_MOST_BARS, _DENSE = 16, 10
_VEIL = 180
_NEAR_PX = 10.0
_NAME_PX = 180
_KEY_PX = 28
_WIDE_PX = 240
_DRAG_PX = 4.0
_REACH = 3.0
_QUANTILE = 5.991464547107979  # 95 % of the chi-squared distribution with two degrees of freedom
_LEAST = 3
NAMES, ELLIPSES = "Names of all subjects", "95 % ellipses of the groups"


class ScreePlot(Plot):
    """Variance of each mode as a bar, and the line that chance reaches (parallel analysis)."""

    mode_chosen = Signal(int)

    def __init__(self, theme: Theme) -> None:
        super().__init__(theme, "Variance of the modes", "The variance of each mode appears here.")
        self._shares: FloatArray = np.empty(0)
        self._chance: FloatArray = np.empty(0)
        self._n_retained = 0
        self.y_label, self.x_label = "share of variance (%)", "mode"

    @property
    def is_empty(self) -> bool:
        """Whether there is no model yet."""
        return not len(self._shares)

    def show_model(self, shape: "ModelShape | None") -> None:
        """Show the eigenvalues of a model."""
        self._shares = self._chance = np.empty(0)
        if shape is not None:
            parallel = shape.parallel
            percent = 100.0 / parallel.eigenvalues.sum()
            self._shares = (parallel.eigenvalues * percent)[:_MOST_BARS]
            self._chance = (parallel.threshold * percent)[:_MOST_BARS]
            self._n_retained = parallel.n_retained
            shown = len(self._shares)
            self.x_range, self.x_ticks = (0.4, shown + 0.6), range(1, shown + 1, 1 + (shown > _DENSE))
            self.y_range = (0.0, 1.08 * float(max(self._shares.max(), self._chance.max())))
            self.title = f"{self._n_retained} mode{'s' * (self._n_retained != 1)} above chance"
            self.setAccessibleDescription(
                f"{self.title}; " + ", ".join(f"mode {n + 1}: {s:.1f} %" for n, s in enumerate(self._shares))
            )
        self.update()

    def paint_data(self, painter: QPainter) -> None:
        """Paint bars, filled above chance and hatched below, and the line of chance."""
        ink, faint = group_colour(0, self.theme), QColor(self.theme.colours.dim)
        for index, share in enumerate(self._shares):
            corner, base = self.place(index + 0.68, share), self.place(index + 1.32, 0.0)
            painter.setPen(QPen(ink if index < self._n_retained else faint, 1))
            style = Qt.BrushStyle.SolidPattern if index < self._n_retained else Qt.BrushStyle.BDiagPattern
            painter.setBrush(ink if index < self._n_retained else faint)
            brush = painter.brush()
            brush.setStyle(style)
            painter.setBrush(brush)
            painter.drawRect(QRectF(corner, base))
        line = QPolygonF([self.place(index + 1, share) for index, share in enumerate(self._chance)])
        painter.setPen(QPen(group_colour(1, self.theme), 2, Qt.PenStyle.DashLine))
        painter.setBrush(Qt.BrushStyle.NoBrush)
        painter.drawPolyline(line)
        frame = self.frame
        wide = frame.width() > _WIDE_PX
        words, start = ("chance (95th percentile)", 190) if wide else ("chance", 80)
        painter.drawLine(QPointF(frame.right() - start, 34), QPointF(frame.right() - start + 24, 34))
        painter.setPen(QColor(self.theme.colours.text))
        painter.drawText(QPointF(frame.right() - start + 30, 38), words)

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Choose the mode whose bar is clicked."""
        mode = round(self.value(event.position())[0]) - 1
        if 0 <= mode < len(self._shares):
            self.mode_chosen.emit(mode)


class ScatterPlot(Plot):
    """Each subject's place in two modes. Click selects; a drag morphs the shape to where the pointer is.

    A click with Ctrl adds a subject to the selection, or removes it; selected subjects are named.

    With the keyboard, the left and right arrow go from subject to subject.
    """

    subject_chosen = Signal(str)
    subject_toggled = Signal(str)
    morphed = Signal(float, float)

    def __init__(self, theme: Theme) -> None:
        super().__init__(theme, "Subjects in two modes", "The scores of the subjects appear here.")
        self.title = "Subjects"
        self.unit = "SD"
        self._points: FloatArray = np.empty((0, 2))
        self._names: Sequence[str] = ()
        self._groups: Sequence[str] = ()
        self._order: list[str] = []
        self._selected: Sequence[str] = ()
        self.mark = (0.0, 0.0)
        self._pressed: QPointF | None = None
        self._dragged = False
        self.options = {NAMES: False, ELLIPSES: False}
        self.setMouseTracking(True)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setToolTip("")

    @property
    def is_empty(self) -> bool:
        """Whether there are no scores yet."""
        return not len(self._points)

    def show_scores(
        self, points: FloatArray, names: Sequence[str], groups: Sequence[str], labels: tuple[str, str]
    ) -> None:
        """Show scores (M, 2) [SD] of subjects, with their groups and what stands at the axes."""
        self._points, self._names, self._groups = points, names, groups
        self._order = sorted(set(groups))
        self.x_label, self.y_label = labels
        reach = 1.1 * max(_REACH, float(np.abs(points).max(initial=0.0)))
        self.x_range = self.y_range = (-reach, reach)
        self.setAccessibleDescription(f"{labels[0]} and {labels[1]} of {len(names)} subjects")
        self.update()

    def show_selection(self, names: Sequence[str]) -> None:
        """Mark selected subjects."""
        self._selected = names
        self.update()

    def show_cursor(self, x: float, y: float) -> None:
        """Mark where the shape that is shown lies [SD]."""
        self.mark = (x, y)
        self.update()

    def paint_data(self, painter: QPainter) -> None:
        """Paint the axes through zero, the subjects, the legend and the shape's place."""
        colours = self.theme.colours
        painter.setPen(QPen(QColor(colours.line), 1))
        self.paint_ground(painter)
        if self.options.get(ELLIPSES):
            self._paint_ellipses(painter)
        for (x, y), group in zip(self._points, self._groups, strict=True):
            index, at = self._order.index(group), self.place(x, y)
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(group_colour(index, self.theme))
            painter.drawPath(marker(index, at, 4.5))
        self._paint_selection(painter)
        self._paint_legend(painter)
        painter.setPen(QPen(QColor(colours.accent), 2))
        self.paint_cursor(painter)

    def paint_ground(self, painter: QPainter) -> None:
        """Paint the axes through zero."""
        painter.drawLine(self.place(self.x_range[0], 0.0), self.place(self.x_range[1], 0.0))
        painter.drawLine(self.place(0.0, self.y_range[0]), self.place(0.0, self.y_range[1]))

    def paint_cursor(self, painter: QPainter) -> None:
        """Paint a cross where the shape that is shown lies."""
        at = self.place(*self.mark)
        for way in (QPointF(9, 0), QPointF(0, 9)):
            painter.drawLine(at - way, at + way)

    def _paint_ellipses(self, painter: QPainter) -> None:
        """Paint where 95 % of a normal distribution with each group's mean and covariance lie."""
        turn = np.linspace(0.0, 2.0 * np.pi, 73)
        circle = np.stack([np.cos(turn), np.sin(turn)])
        labels = np.array(self._groups, dtype=object)
        for index, group in enumerate(self._order):
            part = np.asarray(self._points[labels == group], np.float64)
            if len(part) < _LEAST:
                continue
            values, axes = np.linalg.eigh(np.cov(part.T))
            line = part.mean(axis=0)[:, None] + axes @ (
                np.sqrt(_QUANTILE * values.clip(0.0))[:, None] * circle
            )
            painter.setPen(QPen(group_colour(index, self.theme), 1.5))
            painter.setBrush(Qt.BrushStyle.NoBrush)
            painter.drawPolyline(QPolygonF([self.place(x, y) for x, y in line.T]))
        painter.setPen(QPen(QColor(self.theme.colours.line), 1))

    def _paint_selection(self, painter: QPainter) -> None:
        colours, metrics = self.theme.colours, painter.fontMetrics()
        for (x, y), name in zip(self._points, self._names, strict=True):
            if name in self._selected or self.options[NAMES]:
                at = self.place(x, y)
                told = metrics.elidedText(name, Qt.TextElideMode.ElideMiddle, _NAME_PX)
                words = QRectF(at.x() + 12, at.y() - 20, metrics.horizontalAdvance(told) + 4, 16)
                words.moveLeft(min(words.left(), self.area.right() - words.width()))
                behind = QColor(colours.surface)
                behind.setAlpha(_VEIL)
                painter.fillRect(words, behind)
                painter.setPen(QPen(QColor(colours.text), 2))
                painter.setBrush(Qt.BrushStyle.NoBrush)
                if name in self._selected:
                    painter.drawEllipse(at, 9, 9)
                painter.drawText(words, Qt.AlignmentFlag.AlignCenter, told)

    def legend_width(self, metrics: QFontMetrics) -> float:
        """Return what the groups' names take."""
        words = self._legend(metrics)
        return sum(metrics.horizontalAdvance(one) + _KEY_PX for one in words) + (_KEY_PX if words else 0)

    def _legend(self, metrics: QFontMetrics) -> list[str]:
        """Return what is written for each group, shortened where there is no room for all."""
        if self._order == [""]:
            return []
        room = self.frame.width() / max(1, len(self._order))
        least = max(round(room) - 2 * _KEY_PX, _KEY_PX)
        told = [
            metrics.elidedText(one or "no group", Qt.TextElideMode.ElideMiddle, least) for one in self._order
        ]
        counts = [list(self._groups).count(one) for one in self._order]
        return [f"{name} ({count})" for name, count in zip(told, counts, strict=True)]

    def _paint_legend(self, painter: QPainter) -> None:
        metrics, x = painter.fontMetrics(), self.frame.right()
        for index, words in reversed(list(enumerate(self._legend(metrics)))):
            x -= metrics.horizontalAdvance(words)
            painter.setPen(QColor(self.theme.colours.text))
            painter.drawText(QPointF(x, 18), words)
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(group_colour(index, self.theme))
            painter.drawPath(marker(index, QPointF(x - 9, 14), 4.5))
            x -= _KEY_PX

    def _nearest(self, at: QPointF) -> str | None:
        if self.is_empty:
            return None
        places = [self.place(x, y) for x, y in self._points]
        gaps = [np.hypot(one.x() - at.x(), one.y() - at.y()) for one in places]
        found = int(np.argmin(gaps))
        return self._names[found] if gaps[found] <= _NEAR_PX else None

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Begin a click or a drag."""
        if event.button() == Qt.MouseButton.LeftButton:
            self._pressed, self._dragged = event.position(), False

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        """Name the subject under the pointer, or morph the shape."""
        if self._pressed is None:
            name = self._nearest(event.position())
            QToolTip.showText(event.globalPosition().toPoint(), self.words_of(name) if name else "", self)
            return
        way = event.position() - self._pressed
        if self._dragged or np.hypot(way.x(), way.y()) > _DRAG_PX:
            self._dragged = True
            self.morphed.emit(*self.value(event.position()))

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        """Select the subject that was clicked."""
        name = self._nearest(event.position())
        if self._pressed is not None and not self._dragged and name is not None:
            adds = bool(event.modifiers() & Qt.KeyboardModifier.ControlModifier)
            (self.subject_toggled if adds else self.subject_chosen).emit(name)
        self._pressed = None

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Go to the next or previous subject."""
        step = {Qt.Key.Key_Right: 1, Qt.Key.Key_Left: -1}.get(Qt.Key(event.key()), 0)
        if not step or self.is_empty:
            super().keyPressEvent(event)
            return
        chosen = [self._names.index(name) for name in self._selected if name in self._names]
        following = (chosen[0] + step) % len(self._names) if chosen else 0
        self.subject_chosen.emit(self._names[following])

    def leaveEvent(self, event: QEvent) -> None:
        """Take the name away."""
        QToolTip.hideText()

    def point_of(self, name: str) -> tuple[float, float]:
        """Return where a subject lies."""
        x, y = self._points[self._names.index(name)]
        return float(x), float(y)

    def words_of(self, name: str) -> str:
        """Return a subject's place in words."""
        (x, y), group = self.point_of(name), self._groups[self._names.index(name)]
        place = signed(x) if self.y_ticks == [] else f"{signed(x)}, {signed(y)}"
        return f"{name}{f' ({group})' if group else ''}: {place} {self.unit}"
