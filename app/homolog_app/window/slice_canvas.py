"""One plane: slice, contours and crosshair, with mouse and keyboard events."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from PySide6.QtCore import QLineF, QObject, QPointF, QRectF, Qt, Signal, Slot
from PySide6.QtGui import (
    QColor,
    QImage,
    QKeyEvent,
    QMouseEvent,
    QPainter,
    QPaintEvent,
    QPen,
    QPolygonF,
    QResizeEvent,
    QWheelEvent,
)
from PySide6.QtWidgets import QSizePolicy, QWidget

from homolog.arrays import Array, FloatArray
from homolog.errors import InputError
from homolog.io.scans import Scan, check_frame, read_scan
from homolog.progress import Tick
from homolog_app.rendering.camera import round_length
from homolog_app.rendering.text import short
from homolog_app.scenes.slices import SliceScene, first_preset
from homolog_app.window.runner import JobOutcome, Runner, Task
from homolog_app.window.theme import Theme

__all__ = ["MARGIN", "Line", "ReadScan", "ScanReader", "SliceCanvas", "SliceContent"]

_log = logging.getLogger(__name__)


MARGIN = 28
"""Pixels around the slice, for letters."""
_EDGE = 4.0
_BAR_SHARE = 0.25
_NOTCH = 120.0
_ZOOM = 1.25
_KEYS = {
    Qt.Key.Key_Left: (-1.0, 0.0),
    Qt.Key.Key_Right: (1.0, 0.0),
    Qt.Key.Key_Up: (0.0, -1.0),
    Qt.Key.Key_Down: (0.0, 1.0),
}


_BORDER = "#26262b"
"""Border of coloured contours, whose colours may be those of what is behind them."""


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """A contour in voxels of the picture: polygons (K, 2), or segments (S, 2, 2) with colours (S, 3)."""

    polygons: Sequence[FloatArray] = ()
    segments: FloatArray | None = None
    colours: Array | None = None
    colour: str = ""
    width: float = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class SliceContent:
    """Content of a plane.

    Attributes
    ----------
    title, text : str
        Texts in the upper corners.
    image : QImage
    is_smooth : bool
        Whether voxels are interpolated on the screen.
    spacing : tuple of float
        Size of a voxel to the right and down [mm].
    scale : float
        Pixels per mm.
    centre, cross : tuple of float
        Centre of the widget and position of the crosshair, in voxels of the picture.
    lines : sequence of Line
    letters : tuple of str
        Directions at the left, right, bottom and top.
    """

    title: str
    text: str
    image: QImage
    is_smooth: bool
    spacing: tuple[float, float]
    scale: float
    centre: tuple[float, float]
    cross: tuple[float, float]
    lines: Sequence[Line]
    letters: tuple[str, str, str, str]


class SliceCanvas(QWidget):
    """Draws a plane. Positions are in voxels to the right and down from the picture's corner."""

    pointed = Signal(float, float)
    stepped = Signal(int)
    zoomed = Signal(float)
    panned = Signal(float, float)
    windowed = Signal(float, float)
    enlarged = Signal()
    resized = Signal()

    def __init__(self, theme: Theme, title: str) -> None:
        super().__init__()
        self._theme = theme
        self.drawn: SliceContent | None = None
        self._last: QPointF | None = None
        self.setAccessibleName(f"{title} slice")
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setMinimumSize(120, 120)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        theme.changed.connect(self.update)

    def show_plane(self, drawn: SliceContent | None) -> None:
        """Set the content."""
        self.drawn = drawn
        self.update()

    def wheelEvent(self, event: QWheelEvent) -> None:
        """Scroll through the slices; with Ctrl, zoom."""
        notches = event.angleDelta().y() / _NOTCH
        if event.modifiers() & Qt.KeyboardModifier.ControlModifier:
            self.zoomed.emit(_ZOOM**notches)
        elif notches:
            self.stepped.emit(1 if notches > 0 else -1)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Move the crosshair, and with it the other planes, by a voxel; zoom with + and -."""
        way = _KEYS.get(Qt.Key(event.key()))
        if way is not None and self.drawn is not None:
            self.pointed.emit(self.drawn.cross[0] + way[0], self.drawn.cross[1] + way[1])
        elif event.key() in (Qt.Key.Key_Plus, Qt.Key.Key_Minus):
            self.zoomed.emit(_ZOOM if event.key() == Qt.Key.Key_Plus else 1.0 / _ZOOM)
        else:
            super().keyPressEvent(event)

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Begin to drag; the left button moves the crosshair at once."""
        self._last = event.position()
        if event.button() == Qt.MouseButton.LeftButton and not self._pans(event):
            self._point(event.position())

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        """Move the crosshair; drag the grey-value window (right button) or the picture (middle button)."""
        if self._last is None:
            return
        moved, self._last = event.position() - self._last, event.position()
        if self._pans(event):
            self._pan(moved)
        elif event.buttons() & Qt.MouseButton.LeftButton:
            self._point(event.position())
        elif event.buttons() & Qt.MouseButton.RightButton:
            self.windowed.emit(moved.x() / self.width(), moved.y() / self.height())

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        """End the drag."""
        self._last = None

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        """Show this plane alone, or all three again."""
        self.enlarged.emit()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Request a new scale."""
        super().resizeEvent(event)
        self.resized.emit()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the slice, the contours, the crosshair and the letters."""
        painter = QPainter(self)
        self.draw(painter)
        if self.hasFocus():
            painter.setPen(QPen(QColor(self._theme.colours.accent), 1))
            painter.drawRect(self.rect().adjusted(0, 0, -1, -1))
        painter.end()

    def draw(self, painter: QPainter) -> None:
        """Draw the plane within its rectangle."""
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setClipRect(self.rect())
        painter.fillRect(self.rect(), QColor(self._theme.colours.scene))
        if self.drawn is not None:
            self._paint(painter, self.drawn)

    def _pans(self, event: QMouseEvent) -> bool:
        middle = event.buttons() & Qt.MouseButton.MiddleButton
        return bool(middle or event.modifiers() & Qt.KeyboardModifier.ShiftModifier)

    def _pan(self, moved: QPointF) -> None:
        if self.drawn is not None:
            across, down = self._pixels(self.drawn)
            self.panned.emit(-moved.x() / across, -moved.y() / down)

    def _point(self, at: QPointF) -> None:
        drawn = self.drawn
        if drawn is not None:
            across, down = self._pixels(drawn)
            x = drawn.centre[0] + (at.x() - 0.5 * self.width()) / across
            y = drawn.centre[1] + (at.y() - 0.5 * self.height()) / down
            self.pointed.emit(x, y)

    @staticmethod
    def _pixels(drawn: SliceContent) -> tuple[float, float]:
        """Return the size of a voxel on the screen."""
        return drawn.spacing[0] * drawn.scale, drawn.spacing[1] * drawn.scale

    def _paint(self, painter: QPainter, drawn: SliceContent) -> None:
        across, down = self._pixels(drawn)
        corner = np.array(
            [0.5 * self.width() - drawn.centre[0] * across, 0.5 * self.height() - drawn.centre[1] * down]
        )
        size = np.array([across, down])
        left, top = corner.tolist()
        box = QRectF(left, top, drawn.image.width() * across, drawn.image.height() * down)
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform, drawn.is_smooth)
        painter.drawImage(box, drawn.image)
        for line in drawn.lines:
            self._paint_line(painter, line, corner, size)
        x, y = (corner + np.array(drawn.cross) * size).tolist()
        painter.setPen(QPen(QColor(self._theme.colours.mark if not drawn.is_smooth else "#ffffff"), 1))
        gap = 8.0
        painter.drawLines(
            [
                QLineF(box.left(), y, x - gap, y),
                QLineF(x + gap, y, box.right(), y),
                QLineF(x, box.top(), x, y - gap),
                QLineF(x, y + gap, x, box.bottom()),
            ]
        )
        self._paint_texts(painter, drawn)
        self._paint_scale_bar(painter, drawn.scale)

    @staticmethod
    def _paint_line(painter: QPainter, line: Line, corner: FloatArray, size: FloatArray) -> None:
        painter.setPen(QPen(QColor(line.colour or "#ffffff"), line.width))
        for polygon in line.polygons:
            points = corner + polygon * size
            painter.drawPolyline(QPolygonF([QPointF(x, y) for x, y in points.tolist()]))
        if line.segments is None:
            return
        ends = (corner + line.segments * size).reshape(-1, 4).tolist()
        if line.colours is None:
            painter.drawLines([QLineF(*four) for four in ends])
            return
        painter.setPen(QPen(QColor(_BORDER), line.width + 2.0, c=Qt.PenCapStyle.RoundCap))
        painter.drawLines([QLineF(*four) for four in ends])
        for four, tint in zip(ends, line.colours.tolist(), strict=True):
            painter.setPen(QPen(QColor(*tint), line.width, c=Qt.PenCapStyle.RoundCap))
            painter.drawLine(QLineF(*four))

    def _paint_texts(self, painter: QPainter, drawn: SliceContent) -> None:
        """Draw title, slice number and letters on patches of the background, for contrast."""
        wide, high = float(self.width()), float(self.height())
        colours = self._theme.colours
        left, right, bottom, top = drawn.letters
        texts = (
            (left, colours.accent, 0.0, 0.5),
            (right, colours.accent, 1.0, 0.5),
            (bottom, colours.accent, 0.5, 1.0),
            (top, colours.accent, 0.5, 0.0),
            (drawn.title, colours.text, 0.0, 0.0),
            (drawn.text, colours.dim, 1.0, 0.0),
        )
        metrics = painter.fontMetrics()
        used = metrics.horizontalAdvance(f"{drawn.title}{top}{drawn.text}") + 10.0 * _EDGE
        patch = QColor(colours.scene)
        patch.setAlpha(200)
        for text, colour, x, y in texts:
            if text and (used <= wide or text != drawn.text):
                width, height = metrics.horizontalAdvance(text) + 8.0, metrics.height() + 2.0
                room = (wide - width - 2.0 * _EDGE, high - height - 2.0 * _EDGE)
                area = QRectF(_EDGE + x * room[0], _EDGE + y * room[1], width, height)
                painter.fillRect(area, patch)
                painter.setPen(QColor(colour))
                painter.drawText(area, Qt.AlignmentFlag.AlignCenter, text)

    def _paint_scale_bar(self, painter: QPainter, scale: float) -> None:
        """Draw a bar of a round length at the lower left, on a patch of the background."""
        colours, metrics = self._theme.colours, painter.fontMetrics()
        millimetres = round_length(_BAR_SHARE * self.width() / scale)
        text, length = f"{short(millimetres)} mm", millimetres * scale
        wide, high = max(length, float(metrics.horizontalAdvance(text))) + 8.0, metrics.height() + 6.0
        area = QRectF(_EDGE, self.height() - high - _EDGE, wide, high)
        patch = QColor(colours.scene)
        patch.setAlpha(200)
        painter.fillRect(area, patch)
        painter.setPen(QPen(QColor(colours.text), 2))
        left, y = area.left() + 4.0, area.bottom() - 3.0
        painter.drawLine(QLineF(left, y, left + length, y))
        painter.drawText(area.adjusted(4.0, 0.0, 0.0, -5.0), Qt.AlignmentFlag.AlignLeft, text)


class ReadScan:
    """A scan with its initial grey-value window and notes."""

    def __init__(self, scan: Scan, inside: float) -> None:
        self.scan = scan
        self.automatic = scan.automatic_window()
        self.preset = first_preset(scan)
        outside = round(100.0 * (1.0 - inside))
        beyond = (f"{outside} % of the structure lies outside the scan",) if outside else ()
        self.notes = (*scan.notes, *beyond)


class ScanReader(QObject):
    """Reads the most recently requested scan, after releasing the previous one."""

    changed = Signal()

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self.read: ReadScan | None = None
        self.problem = ""
        self._wanted: tuple[str, Path] | None = None
        self._next: Task | None = None
        self._runner: Runner | None = None

    @property
    def is_busy(self) -> bool:
        """Whether the scan is being read."""
        return self._runner is not None and self._runner.job is not None

    def want(self, sliced: SliceScene) -> None:
        """Read a subject's scan unless it is loaded or being read."""
        scan = None if sliced.image is None else (sliced.name, sliced.image)
        if scan == self._wanted:
            return
        self._wanted, self.read, self.problem, self._next = scan, None, "", None
        if self._runner is not None:
            self._runner.cancel()
        if scan is None:
            return
        task = Task(partial(_read, scan[1], sliced.name, sliced.points), "reading the scan")
        if self._runner is None:
            self._runner = Runner(self)
            self._runner.ended.connect(self._ended)
        if self._runner.job is None:
            self._runner.start(task)
        else:
            self._next = task

    def close(self) -> None:
        """Stop the thread."""
        if self._runner is not None:
            self._runner.close()

    @Slot(object)
    def _ended(self, ended: JobOutcome) -> None:
        assert self._runner is not None
        if self._next is not None:
            task, self._next = self._next, None
            self._runner.start(task)
            return
        if ended.error is not None:
            known = isinstance(ended.error, InputError)
            self.problem = str(ended.error) if known else f"The scan can't be read: {ended.error!r}"
            _log.warning("%s", self.problem, exc_info=None if known else ended.error)
        elif not ended.cancelled and self._wanted is not None:
            self.read = ended.result
        self.changed.emit()


def _read(path: Path, name: str, points: FloatArray, tick: Tick) -> ReadScan:
    scan = read_scan(path, tick)
    return ReadScan(scan, check_frame(scan, points, name) if len(points) else 1.0)
