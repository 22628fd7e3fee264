"""A subject's scan or segmentation in three linked planes, to check grooming and maps."""

from collections.abc import Callable
from functools import partial

import numpy as np
from PySide6.QtCore import QRectF, Qt, Signal
from PySide6.QtGui import QColor, QIcon, QImage, QPainter, QPixmap
from PySide6.QtWidgets import QCheckBox, QWidget

from homolog.arrays import Array, FloatArray
from homolog.geometry import transform_points
from homolog_app.rendering.colours import rgb
from homolog_app.rendering.text import typeset
from homolog_app.scenes.slices import (
    AUTOMATIC,
    PRESETS,
    GreyWindow,
    Grid,
    Plane,
    SliceScene,
    mask_contour,
    planes_of,
    section_of,
)
from homolog_app.window.slice_canvas import MARGIN, Line, ScanReader, SliceCanvas, SliceContent
from homolog_app.window.theme import Theme
from homolog_app.window.widgets import GRID, button, choice, column, grid, having, label, say

__all__ = ["SliceView"]


_NARROWEST, _WIDEST = 176, 480
_TITLES = ("Axial", "Coronal", "Sagittal")
_STRUCTURE, _WHOLE = "Field of view: structure", "Field of view: whole scan"
_FINER = 2
_ROOM = 1.3
"""Margin around the structure."""
_SEGMENTATION, _GROOMED = "#ffb000", "#00c2ff"
_LPS = (("R", "L"), ("A", "P"), ("I", "S"))
_NO_SLICES = "A surface has no slices; add its scan."
_NO_SUBJECT = "Choose a subject in the table."


class SliceView(QWidget):
    """Three planes and, in the fourth corner, legend and controls."""

    scan_wanted = Signal(str)

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self._theme = theme
        self.sliced = SliceScene("")
        self._grid: Grid | None = None
        self._planes: tuple[Plane, ...] = ()
        self._corners: list[FloatArray] = []
        self._place = self._centre = np.zeros(3)
        self._aim = "", self._place
        self._structure = np.empty((0, 3))
        self._zoom = 1.0
        self._alone: SliceCanvas | None = None
        self._window = PRESETS["CT soft tissue"]
        self.reader = ScanReader(self)
        self.canvases = tuple(SliceCanvas(theme, title) for title in _TITLES)
        self.title = label("", "SectionTitle", wrap=True)
        self.about = label("", "Hint", wrap=True)
        self.problem = label("", "Problem", wrap=True)
        self.readout = label("", "Hint", wrap=True)
        self.window_box = choice("Grey values", {f"Window: {name}": name for name in (AUTOMATIC, *PRESETS)})
        self.window_box.setToolTip("Window of grey values; drag with the right button to change it")
        self.field = choice("Field of view", {name: name for name in (_STRUCTURE, _WHOLE)})
        self.field.setToolTip("Ctrl and the wheel zoom; the middle button pans")
        self.segmentation, self.contours = QCheckBox("Segmentation"), QCheckBox("Groomed surface")
        self.beside = QCheckBox("Show 3-D views")
        self.choose = button("Choose scan…")
        self._lay_out()
        self._connect()

    def _lay_out(self) -> None:
        how = (self.window_box, self.field, self.readout)
        controls = (*how, self.segmentation, self.contours, self.beside, self.choose)
        for widget in controls:
            having(widget, maximumWidth=_WIDEST)
        self._info, texts = having(QWidget(), minimumWidth=_NARROWEST), (self.title, self.about, self.problem)
        edges = (2 * GRID, GRID, 2 * GRID, GRID)
        column(*texts, *controls, ..., on=self._info, edges=edges, gap=GRID // 2)
        self._tiles = grid(self, 2, 2)
        self._arrange()

    def _arrange(self) -> None:
        """Lay out three planes with legend and controls, or one plane."""
        axial, coronal, sagittal = self.canvases
        for widget in (*self.canvases, self._info):
            self._tiles.removeWidget(widget)
        if self._alone is None:
            for number, widget in enumerate((axial, sagittal, coronal, self._info)):
                self._tiles.addWidget(widget, number // 2, number % 2)
        else:
            self._tiles.addWidget(self._alone, 0, 0, 2, 1)
            self._tiles.addWidget(self._info, 0, 1, 2, 1)
        for part in range(2):
            self._tiles.setRowStretch(part, 1)
        self._tiles.setColumnStretch(0, 1)
        self._tiles.setColumnStretch(1, int(self._alone is None))
        for canvas in self.canvases:
            canvas.setVisible(self._alone in (None, canvas))

    def _connect(self) -> None:
        for number, canvas in enumerate(self.canvases):
            canvas.pointed.connect(self._with_plane(number, self._point))
            canvas.stepped.connect(self._with_plane(number, self._step))
            canvas.panned.connect(self._with_plane(number, self._pan))
            canvas.zoomed.connect(self._zoom_by)
            canvas.windowed.connect(self._drag_window)
            canvas.enlarged.connect(partial(self._enlarge, canvas))
            canvas.resized.connect(self._draw)
        self.reader.changed.connect(self._receive_scan)
        self.window_box.activated.connect(self._choose_window)
        self.field.activated.connect(self._fit)
        for box, colour in ((self.segmentation, _SEGMENTATION), (self.contours, _GROOMED)):
            pixels = QPixmap(12, 12)
            pixels.fill(QColor(colour))
            self._patch = QIcon(pixels)
            box.setIcon(self._patch)
            box.setChecked(True)
            box.toggled.connect(self._draw)
        self.choose.clicked.connect(lambda: self.scan_wanted.emit(self.sliced.name))

    def show_subject(self, sliced: SliceScene) -> None:
        """Show a subject, with its scan once it is read."""
        before, self.sliced = self.sliced, sliced
        self.reader.want(sliced)
        same = before.name == sliced.name and before.voxels is sliced.voxels
        self._set_grid(keep=same and self._grid is not None)

    def go_to(self, name: str, place: FloatArray) -> None:
        """Move the crosshair to a point of a subject, LPS [mm], even if it is shown later."""
        self._aim = name, np.array(place, np.float64)
        if name == self.sliced.name:
            self._place = self._aim[1]
            self._draw()

    def picture(self) -> QImage:
        """Return a picture of the planes and their legend, without the controls."""
        colours, area = self._theme.colours, QRectF(self._info.geometry())
        picture = QImage(self.size() * _FINER, QImage.Format.Format_RGB32)
        picture.setDevicePixelRatio(_FINER)
        picture.fill(QColor(colours.line))
        painter = QPainter(picture)
        for canvas in self.canvases:
            if not canvas.isHidden():
                painter.save()
                painter.translate(canvas.pos())
                canvas.draw(painter)
                painter.restore()
        painter.fillRect(area, QColor(colours.scene))
        mapped = self.contours.icon().isNull()  # the contour has the colours of a map
        legend = ((self.segmentation, _SEGMENTATION), (self.contours, colours.text if mapped else _GROOMED))
        lines = [(text.text(), colours.text) for text in (self.title, self.about, self.readout)]
        lines += [(box.text(), colour) for box, colour in legend if not box.isHidden() and box.isChecked()]
        room = area.adjusted(2.0 * GRID, GRID, -2.0 * GRID, 0.0)
        for text, colour in lines:
            painter.setPen(QColor(colour))
            painter.drawText(room, Qt.TextFlag.TextWordWrap, text)
            room.setTop(painter.boundingRect(room, Qt.TextFlag.TextWordWrap, text).bottom() + GRID)
        painter.end()
        return picture

    @property
    def place(self) -> FloatArray:
        """Position of the crosshair, LPS [mm], (3,)."""
        return self._place

    @property
    def name(self) -> str:
        """The subject whose slices are shown."""
        return self.sliced.name

    def close_slices(self) -> None:
        """Stop the thread that reads scans."""
        self.reader.close()

    def _receive_scan(self) -> None:
        read = self.reader.read
        if read is not None:
            self.window_box.setCurrentIndex(self.window_box.findData(read.preset))
            self._choose_window()
        self._set_grid(keep=False)

    def _set_grid(self, *, keep: bool) -> None:
        """Use the grid of the scan, else that of the segmentation; the crosshair starts at its centre."""
        read, voxels = self.reader.read, self.sliced.voxels
        self._grid = Grid.of_scan(read.scan) if read else Grid.of_mask(voxels) if voxels else None
        grid = self._grid
        self._planes = planes_of(grid) if grid else ()
        self._corners = (
            [grid.indices(outline.mesh.vertices) for outline in self.sliced.outlines] if grid else []
        )
        self._structure = grid.box_of(self.sliced.points) if grid else self._structure
        if keep:
            self._draw()
            return
        self._fit()
        self._place = self._aim[1] if self._aim[0] == self.sliced.name else self._centre
        self._draw()

    def _fit(self) -> None:
        """Fit the structure or the whole scan into the planes."""
        self._zoom = 1.0
        if self._grid is not None:
            middle = self._box(self._grid).mean(axis=0, keepdims=True)
            self._centre = transform_points(self._grid.matrix, middle)[0]
        self._draw()

    def _box(self, grid: Grid) -> FloatArray:
        """Return the lowest and highest indices of the field of view, (2, 3)."""
        whole = np.stack([np.full(3, -0.5), np.array(grid.shape) - 0.5])
        if self.field.currentText() == _WHOLE:
            return whole
        middle, half = self._structure.mean(axis=0), 0.5 * (self._structure[1] - self._structure[0])
        return np.stack([middle - _ROOM * half, middle + _ROOM * half])

    def _scale(self, grid: Grid) -> float:
        """Return pixels per mm, equal in all planes, so that the field of view fits into each."""
        extent = (self._box(grid)[1] - self._box(grid)[0]) * grid.spacing
        shown = [
            (plane, canvas)
            for plane, canvas in zip(self._planes, self.canvases, strict=True)
            if not canvas.isHidden()
        ]
        sizes = [
            min(
                (canvas.width() - 2 * MARGIN) / extent[plane.across],
                (canvas.height() - 2 * MARGIN) / extent[plane.down],
            )
            for plane, canvas in shown
        ]
        return float(max(min(sizes), 1e-3)) * self._zoom

    def _with_plane(self, number: int, act: Callable[..., None]) -> Callable[..., None]:
        def call(*values: float) -> None:
            if self._grid is not None:
                act(self._grid, self._planes[number], *values)

        return call

    def _point(self, grid: Grid, plane: Plane, across: float, down: float) -> None:
        index = plane.moved(self._index(grid), (across, down), grid.shape)
        self._set_index(grid, index)

    def _step(self, grid: Grid, plane: Plane, by: float) -> None:
        index = np.round(self._index(grid))
        index[plane.axis] += by
        self._set_index(grid, index)

    def _pan(self, grid: Grid, plane: Plane, across: float, down: float) -> None:
        middle = grid.indices(self._centre[None])[0]
        x, y = plane.places(middle, grid.shape).tolist()
        moved = plane.moved(middle, (x + across, y + down), grid.shape)
        self._centre = transform_points(grid.matrix, moved[None])[0]
        self._draw()

    def _zoom_by(self, factor: float) -> None:
        self._zoom = float(np.clip(self._zoom * factor, 0.2, 40.0))
        self._centre = self._place + (self._centre - self._place) / factor
        self._draw()

    def _index(self, grid: Grid) -> FloatArray:
        index: FloatArray = grid.indices(self._place[None])[0]
        return np.clip(index, 0.0, np.array(grid.shape) - 1.0)

    def _set_index(self, grid: Grid, index: FloatArray) -> None:
        inside = np.clip(index, 0.0, np.array(grid.shape) - 1.0)
        self.go_to(self.sliced.name, transform_points(grid.matrix, inside[None])[0])

    def _drag_window(self, right: float, down: float) -> None:
        if self.reader.read is not None:
            self._window = self._window.dragged(right, down)
            self.window_box.setCurrentIndex(-1)
            self._draw()

    def _choose_window(self) -> None:
        name, read = self.window_box.currentData(), self.reader.read
        if name in PRESETS:
            self._window = PRESETS[name]
        elif read is not None:
            self._window = GreyWindow.between(*read.automatic)
        self._draw()

    def _enlarge(self, canvas: SliceCanvas) -> None:
        self._alone = None if self._alone is canvas else canvas
        self._arrange()
        self._draw()

    def _draw(self) -> None:
        """Draw all planes and the legend."""
        grid = self._grid
        if grid is None:
            for canvas in self.canvases:
                canvas.show_plane(None)
        else:
            scale = self._scale(grid)
            for plane, canvas in zip(self._planes, self.canvases, strict=True):
                if not canvas.isHidden():
                    canvas.show_plane(self._drawn(grid, plane, scale))
        self._say(grid)

    def _drawn(self, grid: Grid, plane: Plane, scale: float) -> SliceContent:
        index, middle = self._index(grid), grid.indices(self._centre[None])[0]
        at = round(float(index[plane.axis]))
        read, voxels = self.reader.read, self.sliced.voxels
        lines = []
        if read is None:
            assert voxels is not None
            picture = _coloured(plane.picture(np.moveaxis(voxels.mask, plane.axis, 0)[at]), self._theme)
        else:
            picture = _grey(plane.picture(self._window.shades(read.scan.plane(plane.axis, at))))
            if voxels is not None and self.segmentation.isChecked():
                border = mask_contour(voxels, grid, plane.axis, at)
                polygons = [plane.places(line, grid.shape) for line in border]
                lines.append(Line(polygons, colour=_SEGMENTATION, width=1.5))
        if self.contours.isChecked():
            for outline, corners in zip(self.sliced.outlines, self._corners, strict=True):
                cut = section_of(corners, outline.mesh.faces, outline.colours, plane.axis, at)
                segments = plane.places(cut.segments, grid.shape)
                lines.append(
                    Line((), segments, cut.colours, _GROOMED, 2.0 if outline.colours is None else 4.0)
                )
        x, y = plane.places(index, grid.shape).tolist()
        right, low = plane.places(middle, grid.shape).tolist()
        return SliceContent(
            plane.title,
            f"{at + 1} of {grid.shape[plane.axis]} · {grid.spacing[plane.axis]:.3g} mm",
            picture,
            read is not None,
            (float(grid.spacing[plane.across]), float(grid.spacing[plane.down])),
            scale,
            (right, low),
            (x, y),
            lines,
            plane.letters,
        )

    def _say(self, grid: Grid | None) -> None:
        sliced, read = self.sliced, self.reader.read
        self.title.setText(sliced.name)
        if read is not None:
            text = "\n".join((f"Scan: {read.scan.path.name}", *read.notes))
        elif self.reader.is_busy:
            text = f"Reading {sliced.image.name if sliced.image else 'the scan'}…"
        elif sliced.image is not None and self.reader.problem:
            text = ""
        elif grid is None:
            text = _NO_SLICES if sliced.name else _NO_SUBJECT
        else:
            text = "No scan: the voxels of the segmentation are shown."
        say(self.about, text)
        say(self.problem, self.reader.problem)
        notes = [outline.note for outline in sliced.outlines if outline.note and grid is not None]
        self.readout.setText("\n".join(part for part in (self._readout(grid), *notes) if part))
        self.window_box.setVisible(read is not None)
        self.segmentation.setVisible(read is not None and sliced.voxels is not None)
        for widget in (self.field, self.contours):
            widget.setVisible(grid is not None)
        coloured = any(outline.colours is not None for outline in sliced.outlines)
        self.contours.setIcon(QIcon() if coloured else self._patch)
        self.contours.setEnabled(bool(sliced.outlines))
        self.contours.setText(" and ".join(outline.title for outline in sliced.outlines) or "Groomed surface")
        self.choose.setEnabled(bool(sliced.name))

    def _readout(self, grid: Grid | None) -> str:
        """Return the position of the crosshair, and the grey value there."""
        if grid is None:
            return ""
        place = " ".join(
            f"{ends[int(value >= 0.0)]} {abs(value):.1f}"
            for ends, value in zip(_LPS, self._place.tolist(), strict=True)
        )
        read = self.reader.read
        if read is None:
            return f"{place} mm"
        i, j, k = np.round(self._index(grid)).astype(int).tolist()
        value = float(read.scan.values[i, j, k]) * read.scan.slope + read.scan.intercept
        text = f"{place} mm: {value:.4g}\nWidth {self._window.width:.4g}, level {self._window.level:.4g}"
        return typeset(text)


def _grey(shades: Array) -> QImage:
    high, wide = shades.shape
    return QImage(np.ascontiguousarray(shades).tobytes(), wide, high, wide, QImage.Format.Format_Grayscale8)


def _coloured(mask: Array, theme: Theme) -> QImage:
    rgba = np.zeros((*mask.shape, 4), dtype=np.uint8)
    rgba[mask] = (*(round(255 * part) for part in rgb(theme.colours.bone)), 255)
    return QImage(rgba.tobytes(), mask.shape[1], mask.shape[0], QImage.Format.Format_RGBA8888)
