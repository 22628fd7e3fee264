"""Slices of a subject's voxels with the groomed contour over them, so that grooming can be trusted."""

import numpy as np
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QImage, QPainter, QPaintEvent, QPen, QPolygonF, QWheelEvent
from PySide6.QtWidgets import QComboBox, QHBoxLayout, QSlider, QVBoxLayout, QWidget
from scipy import ndimage

from homolog.arrays import Array, BoolArray, FloatArray
from homolog.grooming.images import Segmentation
from homolog.surfaces.distance_field import DistanceField
from homolog_app.letters import direction_letters
from homolog_app.window.scheme import rgb
from homolog_app.window.theme import Theme
from homolog_app.window.widgets import GRID, label

__all__ = ["SliceView", "contour_in_slice"]

_FINE = 3


def contour_in_slice(voxels: Segmentation, field: DistanceField, axis: int, index: int) -> list[FloatArray]:
    """Cut the groomed surface with a slice of the voxels.

    Returns
    -------
    list of (K, 2) array
        Closed lines, in voxels along the two other axes.
    """
    from skimage.measure import find_contours

    rest = [one for one in range(3) if one != axis]
    sides = [np.arange(0, voxels.mask.shape[one] - 1 + 1e-9, 1.0 / _FINE) for one in rest]
    grid = np.zeros((3, len(sides[0]), len(sides[1])))
    grid[axis] = index
    grid[rest[0]], grid[rest[1]] = np.meshgrid(*sides, indexing="ij")
    points = voxels.origin + (voxels.rotation @ (grid.reshape(3, -1) * voxels.spacing[:, None])).T
    inverse = np.linalg.inv(field.index_to_world)
    nodes = points @ inverse[:3, :3].T + inverse[:3, 3]
    outside = float(field.values.max())
    values = ndimage.map_coordinates(field.values, nodes.T, order=1, mode="constant", cval=outside)
    return [line / _FINE for line in find_contours(values.reshape(grid.shape[1:]), 0.0)]


class SliceView(QWidget):
    """One slice at a time, turned as radiologists see it, with letters at the edges."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.canvas = _Canvas(theme)
        self.axis = QComboBox()
        self.axis.setAccessibleName("Orientation of slices")
        self.axis.addItems(["Axial", "Coronal", "Sagittal"])
        self.position = QSlider(Qt.Orientation.Horizontal)
        self.position.setAccessibleName("Slice")
        self.words = label("", "Hint")
        self.words.setMinimumWidth(200)
        self._voxels: Segmentation | None = None
        self._field: DistanceField | None = None
        row = QHBoxLayout()
        row.setContentsMargins(2 * GRID, GRID, 2 * GRID, GRID)
        row.setSpacing(GRID)
        for one in (self.axis, self.position, self.words):
            row.addWidget(one, 1 if one is self.position else 0)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addWidget(self.canvas, 1)
        layout.addLayout(row)
        self.axis.currentIndexChanged.connect(self._turn)
        self.position.valueChanged.connect(self._cut)

    def show_subject(self, name: str, voxels: Segmentation | None, field: DistanceField | None) -> None:
        """Show a subject; without voxels (surfaces) a word about it."""
        same = voxels is self._voxels
        self._voxels, self._field = voxels, field
        self.canvas.name = name
        if same:
            self._cut()
        else:
            self._turn()

    def wheelEvent(self, event: QWheelEvent) -> None:
        """Go through the slices."""
        self.position.setValue(self.position.value() + (1 if event.angleDelta().y() > 0 else -1))

    def _grid_axis(self) -> int:
        """Return the axis of the file that is closest to the head, back or left direction."""
        assert self._voxels is not None
        row = (2, 1, 0)[self.axis.currentIndex()]
        return int(np.argmax(np.abs(self._voxels.rotation[row])))

    def _turn(self) -> None:
        if self._voxels is not None:
            size = self._voxels.mask.shape[self._grid_axis()]
            self.position.blockSignals(True)
            self.position.setRange(0, size - 1)
            self.position.setValue(size // 2)
            self.position.blockSignals(False)
        self._cut()

    def _cut(self) -> None:
        voxels = self._voxels
        if voxels is None:
            self.canvas.show_slice(None, [], (1.0, 1.0), ("", "", "", ""))
            self.words.setText("")
            return
        axis, index = self._grid_axis(), self.position.value()
        lines = contour_in_slice(voxels, self._field, axis, index) if self._field is not None else []
        self.canvas.show_slice(*_oriented(voxels, axis, index, lines))
        millimetres = voxels.spacing[axis]
        self.words.setText(f"Slice {index + 1} of {voxels.mask.shape[axis]} · {millimetres:.3g} mm thick")


def _oriented(
    voxels: Segmentation, axis: int, index: int, lines: list[FloatArray]
) -> tuple[BoolArray, list[FloatArray], tuple[float, float], tuple[str, str, str, str]]:
    """Turn a slice so that left or back is at the right and head or front at the top."""
    rest = [one for one in range(3) if one != axis]
    mask: BoolArray = np.take(voxels.mask, index, axis=axis)
    directions = [voxels.rotation[:, one] for one in rest]
    across = 0 if _rank(directions[0]) < _rank(directions[1]) else 1
    if across == 0:
        mask, lines = mask.T, [line[:, ::-1] for line in lines]
    down_axis, across_axis = rest[1 - across], rest[across]
    down, right = voxels.rotation[:, down_axis], voxels.rotation[:, across_axis]
    lines = [line.copy() for line in lines]
    if _sign(right) < 0:
        mask, right = mask[:, ::-1], -right
        for line in lines:
            line[:, 1] = mask.shape[1] - 1 - line[:, 1]
    points_up = _sign(down) > 0 if abs(down[2]) == np.abs(down).max() else _sign(down) < 0
    if points_up:
        mask, down = mask[::-1], -down
        for line in lines:
            line[:, 0] = mask.shape[0] - 1 - line[:, 0]
    letters = (
        direction_letters(-right),
        direction_letters(right),
        direction_letters(down),
        direction_letters(-down),
    )
    return mask, lines, (float(voxels.spacing[down_axis]), float(voxels.spacing[across_axis])), letters


def _rank(direction: FloatArray) -> int:
    """Say how early a direction is taken across the screen: left first, then back, then head."""
    return int(np.argmax(np.abs(direction)))


def _sign(direction: FloatArray) -> float:
    return float(direction[np.argmax(np.abs(direction))])


class _Canvas(QWidget):
    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self._theme = theme
        self._mask: Array | None = None
        self._lines: list[FloatArray] = []
        self._spacing = (1.0, 1.0)
        self._letters = ("", "", "", "")
        self.name = ""
        theme.changed.connect(self.update)

    def show_slice(
        self, mask: Array | None, lines: list[FloatArray], spacing: tuple[float, float],
        letters: tuple[str, str, str, str],
    ) -> None:  # fmt: skip
        self._mask, self._lines, self._spacing, self._letters = mask, lines, spacing, letters
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        colours = self._theme.colours
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.fillRect(self.rect(), QColor(colours.scene))
        painter.setPen(QColor(colours.text))
        if self._mask is None:
            text = "A surface has no slices." if self.name else "Choose a subject in the table."
            painter.drawText(self.rect(), Qt.AlignmentFlag.AlignCenter, text)
        else:
            self._paint_slice(painter, self._mask)
        painter.end()

    def _paint_slice(self, painter: QPainter, mask: Array) -> None:
        colours = self._theme.colours
        high, wide = mask.shape[0] * self._spacing[0], mask.shape[1] * self._spacing[1]
        scale = min((self.width() - 96) / wide, (self.height() - 96) / high)
        box = QRectF(0, 0, wide * scale, high * scale)
        box.moveCenter(QRectF(self.rect()).center())
        rgba = np.zeros((*mask.shape, 4), dtype=np.uint8)
        rgba[mask] = (*(round(255 * part) for part in rgb(colours.bone)), 255)
        image = QImage(rgba.tobytes(), mask.shape[1], mask.shape[0], QImage.Format.Format_RGBA8888)
        painter.setPen(QPen(QColor(colours.line), 1))
        painter.drawRect(box)
        painter.drawImage(box, image)
        painter.setPen(QPen(QColor(colours.accent), 2))
        step = (self._spacing[0] * scale, self._spacing[1] * scale)
        for line in self._lines:
            points = [
                QPointF(box.left() + (x + 0.5) * step[1], box.top() + (y + 0.5) * step[0]) for y, x in line
            ]
            painter.drawPolyline(QPolygonF(points))
        self._paint_words(painter, box)

    def _paint_words(self, painter: QPainter, box: QRectF) -> None:
        colours = self._theme.colours
        painter.setPen(QColor(colours.text))
        painter.drawText(QRectF(12, 8, self.width() - 24, 20), Qt.AlignmentFlag.AlignLeft, self.name)
        painter.setPen(QColor(colours.accent))
        middle = box.center()
        places = (
            QPointF(box.left() - 20, middle.y()), QPointF(box.right() + 20, middle.y()),
            QPointF(middle.x(), box.bottom() + 20), QPointF(middle.x(), box.top() - 20),
        )  # fmt: skip
        for place, text in zip(places, self._letters, strict=True):
            area = QRectF(place.x() - 20, place.y() - 10, 40, 20)
            painter.drawText(area, Qt.AlignmentFlag.AlignCenter, text)
