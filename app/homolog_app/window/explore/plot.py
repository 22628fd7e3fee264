"""What the plots of Explore share: a frame with round ticks, and colours and markers of groups."""

from collections.abc import Sequence

from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import (
    QColor,
    QContextMenuEvent,
    QFont,
    QFontMetrics,
    QMouseEvent,
    QPainter,
    QPainterPath,
    QPaintEvent,
    QPen,
    QPolygonF,
)
from PySide6.QtWidgets import QWidget

from homolog_app.window.quantities import tick_words, ticks
from homolog_app.window.theme import Theme

__all__ = ["MARKERS", "Plot", "apart", "group_colour", "marker"]

# Okabe and Ito (2008), a little darker on light ground and lighter on dark ground for contrast.
_ON_LIGHT = ("#0068a3", "#b84e00", "#00795a", "#a8487f", "#2f7fae", "#8a6400", "#5f5f5f")
_ON_DARK = ("#56b4e9", "#f2864b", "#2fc79c", "#e08fc0", "#9ad2f2", "#f0c04a", "#b5b5b5")
MARKERS = ("disc", "square", "triangle", "diamond", "triangle down", "plus", "cross")
_LEFT, _TOP, _RIGHT, _BOTTOM = 56, 30, 16, 40


def group_colour(index: int, theme: Theme) -> QColor:
    """Return the colour of a group by its place in the order of groups."""
    colours = _ON_DARK if theme.is_dark else _ON_LIGHT
    return QColor(colours[(index + index // len(MARKERS)) % len(colours)])  # no two groups look alike


def marker(index: int, at: QPointF, radius: float) -> QPainterPath:
    """Return the marker of a group: each has a shape of its own."""
    path = QPainterPath()
    r = radius
    shapes = {
        "square": [(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)],
        "triangle": [(0, -1.15), (1.1, 0.85), (-1.1, 0.85)],
        "diamond": [(0, -1.3), (1.1, 0), (0, 1.3), (-1.1, 0)],
        "triangle down": [(0, 1.15), (1.1, -0.85), (-1.1, -0.85)],
        "plus": [(-0.4, -1.2), (0.4, -1.2), (0.4, -0.4), (1.2, -0.4), (1.2, 0.4), (0.4, 0.4), (0.4, 1.2),
                 (-0.4, 1.2), (-0.4, 0.4), (-1.2, 0.4), (-1.2, -0.4), (-0.4, -0.4)],
        "cross": [(0, -0.55), (0.7, -1.25), (1.25, -0.7), (0.55, 0), (1.25, 0.7), (0.7, 1.25), (0, 0.55),
                  (-0.7, 1.25), (-1.25, 0.7), (-0.55, 0), (-1.25, -0.7), (-0.7, -1.25)],
    }  # fmt: skip
    name = MARKERS[index % len(MARKERS)]
    if name == "disc":
        path.addEllipse(at, r, r)
    else:
        path.addPolygon(QPolygonF([QPointF(at.x() + r * x, at.y() + r * y) for x, y in shapes[name]]))
        path.closeSubpath()
    return path


def apart(places: Sequence[float], widths: Sequence[float], gap: float = 6.0) -> set[int]:
    """Return which words, centred on ascending places and so wide [pixels], can stand beside each other."""
    kept, end = set(), float("-inf")
    for index, (place, width) in enumerate(zip(places, widths, strict=True)):
        if place - width / 2.0 >= end:
            kept.add(index)
            end = place + width / 2.0 + gap
    return kept


class Plot(QWidget):
    """A plot with two axes. A subclass sets the ranges and paints inside the frame."""

    def __init__(self, theme: Theme, name: str, hint: str) -> None:
        super().__init__()
        self.theme = theme
        self.title, self.x_label, self.y_label = name, "", ""
        self.x_range, self.y_range = (0.0, 1.0), (0.0, 1.0)
        self.x_ticks: Sequence[float] | None = None
        self.y_ticks: Sequence[float] | None = None
        self.hint = hint
        self.options: dict[str, bool] = {}
        """What the menu switches on and off, by its words."""
        self._area: QRectF | None = None
        self.setMinimumSize(184, 180)
        self.setAccessibleName(name)
        theme.changed.connect(self.update)

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to plot yet."""
        return True

    @property
    def area(self) -> QRectF:
        """What is painted on: the widget, or part of a picture."""
        return self._area if self._area is not None else QRectF(self.rect())

    def set_option(self, text: str, shown: bool) -> None:
        """Switch one of the options."""
        self.options[text] = shown
        self.update()

    @property
    def frame(self) -> QRectF:
        """Where the data are."""
        return self.area.adjusted(_LEFT, _TOP, -_RIGHT, -_BOTTOM)

    def place(self, x: float, y: float) -> QPointF:
        """Return where a point of the data is painted."""
        frame, (left, right), (low, high) = self.frame, self.x_range, self.y_range
        return QPointF(
            frame.left() + frame.width() * (x - left) / (right - left),
            frame.bottom() - frame.height() * (y - low) / (high - low),
        )

    def value(self, at: QPointF) -> tuple[float, float]:
        """Return the data's coordinates of a place."""
        frame, (left, right), (low, high) = self.frame, self.x_range, self.y_range
        return (
            left + (right - left) * (at.x() - frame.left()) / frame.width(),
            low + (high - low) * (frame.bottom() - at.y()) / frame.height(),
        )

    def paintEvent(self, event: QPaintEvent) -> None:
        """Paint the plot."""
        painter = QPainter(self)
        self.paint_on(painter, QRectF(self.rect()))
        if self.hasFocus():
            painter.setPen(QPen(QColor(self.theme.colours.accent), 2))
            painter.setBrush(Qt.BrushStyle.NoBrush)
            painter.drawRect(self.rect().adjusted(1, 1, -1, -1))
        painter.end()

    def paint_on(self, painter: QPainter, area: QRectF) -> None:
        """Paint axes and data, or what will be here, on an area of any size."""
        self._area = area
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        font = QFont(self.font())
        font.setPixelSize(12)
        painter.setFont(font)
        painter.fillRect(area, QColor(self.theme.colours.surface))
        if self.is_empty:
            painter.setPen(QColor(self.theme.colours.dim))
            flags = Qt.AlignmentFlag.AlignCenter | Qt.TextFlag.TextWordWrap
            painter.drawText(area.adjusted(24, 0, -24, 0), flags, self.hint)
        else:
            self._paint_axes(painter)
            self.paint_data(painter)
        self._area = None

    def contextMenuEvent(self, event: QContextMenuEvent) -> None:
        """Offer to save, copy and enlarge the plot."""
        from homolog_app.window.explore.plot_menu import plot_menu

        menu = plot_menu(self)
        menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        menu.popup(event.globalPos())

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        """Open the plot in its own window."""
        from homolog_app.window.explore.plot_menu import EnlargedPlot

        if event.button() == Qt.MouseButton.LeftButton and not self.is_empty:
            EnlargedPlot(self).show()

    def legend_width(self, metrics: QFontMetrics) -> float:
        """Return how many pixels at the right of the title are taken."""
        return 0.0

    def paint_data(self, painter: QPainter) -> None:
        """Paint what is inside the frame."""
        raise NotImplementedError

    def _paint_axes(self, painter: QPainter) -> None:
        colours, frame = self.theme.colours, self.frame
        painter.setPen(QColor(colours.text))
        metrics = painter.fontMetrics()
        room = round(self.area.right() - frame.left() - self.legend_width(metrics))
        painter.drawText(
            QPointF(frame.left(), 18), metrics.elidedText(self.title, Qt.TextElideMode.ElideRight, room)
        )
        painter.setPen(QPen(QColor(colours.line), 1))
        painter.drawLine(frame.bottomLeft(), frame.bottomRight())
        painter.drawLine(frame.bottomLeft(), frame.topLeft())
        painter.setPen(QColor(colours.dim))
        xs = self.x_ticks if self.x_ticks is not None else ticks(*self.x_range, self._about(frame.width()))
        named = tick_words(xs)
        places = [self.place(x, self.y_range[0]) for x in xs]
        widths = [metrics.horizontalAdvance(words) for words in named]
        room_for = apart([at.x() for at in places], widths)
        for index, (at, words) in enumerate(zip(places, named, strict=True)):
            painter.drawLine(at, at + QPointF(0, 4))
            if index not in room_for:
                continue
            painter.drawText(QRectF(at.x() - 30, at.y() + 4, 60, 16), Qt.AlignmentFlag.AlignCenter, words)
        right = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        most = max(2, int(frame.height() // 36))
        ys = self.y_ticks if self.y_ticks is not None else ticks(*self.y_range, most)
        if len(ys) == 1:
            ys = ticks(*self.y_range, 2 * most)
        for y, words in zip(ys, tick_words(ys), strict=True):
            at = self.place(self.x_range[0], y)
            painter.drawLine(at, at - QPointF(4, 0))
            painter.drawText(QRectF(at.x() - 54, at.y() - 8, 46, 16), right, words)
        below = QRectF(frame.left(), frame.bottom() + 20, frame.width(), 18)
        label = metrics.elidedText(self.x_label, Qt.TextElideMode.ElideRight, round(frame.width()))
        painter.drawText(below, Qt.AlignmentFlag.AlignCenter, label)
        if self.y_label:
            painter.save()
            painter.translate(11, frame.center().y())
            painter.rotate(-90)
            across = QRectF(-frame.height() / 2 - 30, -9, frame.height() + 60, 18)
            label = metrics.elidedText(self.y_label, Qt.TextElideMode.ElideRight, round(across.width()))
            painter.drawText(across, Qt.AlignmentFlag.AlignCenter, label)
            painter.restore()

    @staticmethod
    def _about(width: float) -> int:
        return max(3, int(width // 70))
