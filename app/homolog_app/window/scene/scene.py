"""The grid of linked views."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from PySide6.QtCore import QTimer, Signal
from PySide6.QtGui import QImage
from PySide6.QtWidgets import QVBoxLayout, QWidget
from vtkmodules.vtkRenderingCore import vtkRenderer

from homolog.arrays import Array, FloatArray
from homolog_app.window.scene.cameras import Cameras
from homolog_app.window.scene.cell import Cell
from homolog_app.window.scene.colour_bar import ColourBar
from homolog_app.window.scene.colours import colours_by_place
from homolog_app.window.scene.content import Content, Shown
from homolog_app.window.scene.interactor import SMOOTH, Interactor
from homolog_app.window.scene.picking import Picker, aim
from homolog_app.window.theme import Colours, rgb

__all__ = ["LAYOUTS", "Scene"]

LAYOUTS = (1, 4, 9, 16)
_SLOW_MS = 40.0
_LIVE_MS = (30.0, 55.0)
_MOST_CELLS = LAYOUTS[-1]
_REFINE_MS = 400
_GAP = 0.0015
_CLOSE_UP = 0.6


class Scene(QWidget):
    """Shows a page of contents, one a view, all turned together unless unlinked.

    Subjects are paged through in the user's layout; shapes of the model come in a grid of their own. Below
    the views stands what colours mean.
    """

    page_changed = Signal()

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self._plot = Interactor(self)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        self.bar = ColourBar(self)
        layout.addWidget(self._plot, 1)
        layout.addWidget(self.bar)
        window: Any = self._plot.ren_win
        self._backdrop = vtkRenderer()
        self._backdrop.InteractiveOff()
        self._cells = [Cell(renderer) for renderer in self._plot.renderers]
        for cell in self._cells:
            window.RemoveRenderer(cell.renderer)
        for renderer in (self._backdrop, *(cell.renderer for cell in self._cells)):
            window.AddRenderer(renderer)
        window.SetMultiSamples(self._plot.smoothing)
        self._observers = (
            window.AddObserver("StartEvent", self._before_drawing),
            window.AddObserver("EndEvent", self._after_drawing),
        )
        self.picker = Picker(self._plot, self._cells, self._particles_of)
        self._contents: Sequence[Content] = ()
        self._particles: Mapping[str, FloatArray] = {}
        self._tints: Array | Mapping[str, Array] | None = None
        self._radius = 1.0
        self._layout, self._columns = 1, 0
        self._page = 0
        self._told = (-1, 0, 0)
        self._raw, self._groomed, self._balls, self._opacity = True, True, True, 1.0
        self._quick = False
        self._share, self._turn, self._partial = _MOST_CELLS, 0, False
        self._size: object = None
        self._fitted = False
        self._refine = QTimer(self, interval=_REFINE_MS, singleShot=True)
        self._refine.timeout.connect(self._draw_fine)
        self._cameras = Cameras(self._cells)
        self.set_layout(4)
        self._plot.iren.add_observer("StartInteractionEvent", self._draw_quick)
        self._plot.iren.add_observer("EndInteractionEvent", lambda *_: self._refine.start())

    @property
    def draw_ms(self) -> float:
        """How long a drawing takes [ms], smoothed."""
        return self._plot.draw_ms

    @property
    def page(self) -> int:
        """Index of the page shown."""
        return self._page

    @property
    def pages(self) -> int:
        """Number of pages."""
        return max(1, -(-len(self._contents) // self._count))

    @property
    def columns(self) -> int:
        """Columns of a grid of the contents' own; 0 in the user's layout."""
        return self._columns

    @property
    def _grid(self) -> tuple[int, int]:
        """Rows and columns of views."""
        if self._columns:
            return max(1, -(-len(self._contents) // self._columns)), self._columns
        side = round(self._layout**0.5)
        return side, side

    @property
    def _count(self) -> int:
        rows, columns = self._grid
        return rows * columns

    @property
    def shown(self) -> Sequence[Content]:
        """The subjects of the page."""
        return self._contents[self._page * self._count : (self._page + 1) * self._count]

    @property
    def layout_count(self) -> int:
        """Number of views in the user's layout."""
        return self._layout

    def set_layout(self, count: int) -> None:
        """Show 1, 4, 9 or 16 views of subjects; the first one stays in sight."""
        first = self._page * self._layout
        self._layout = count
        if not self._columns:
            self._place_cells()
            self.show_page(first // count)

    def display(self, shown: Shown) -> None:
        """Show other contents.

        Parameters
        ----------
        shown : Shown
            At most sixteen contents if it has columns.
        """
        had, grid = self._contents, self._grid
        self._contents, self._columns = shown.contents, shown.columns or 0
        if shown.particles is not None:
            self._take_particles(shown.particles, shown.tints)
        self.bar.show_scale(shown.scale)
        if self._grid != grid:
            self._place_cells()
        self.show_page(min(self._page, self.pages - 1))
        if shown.contents and (not had or not self._fitted):
            self.look("corner")
        elif self._grid != grid:
            self.fit()

    def show_page(self, page: int) -> None:
        """Show a page of the contents."""
        self._page = max(0, min(page, self.pages - 1))
        shown = self.shown
        for index, cell in enumerate(self._cells):
            cell.fill(shown[index] if index < min(len(shown), self._count) else None)
        self._refresh()
        if (self._page, self.pages, self._columns) != self._told:
            self._told = (self._page, self.pages, self._columns)
            self.page_changed.emit()

    def show_name(self, name: str) -> None:
        """Turn to the page with a subject."""
        for index, content in enumerate(self._contents):
            if content.name == name and index // self._count != self._page:
                self.show_page(index // self._count)

    def switch(
        self, *, raw: bool | None = None, groomed: bool | None = None, particles: bool | None = None,
        opacity: float | None = None,
    ) -> None:  # fmt: skip
        """Show or hide the input surface, the groomed one and the particles; set how opaque surfaces are."""
        self._raw = self._raw if raw is None else raw
        self._groomed = self._groomed if groomed is None else groomed
        self._balls = self._balls if particles is None else particles
        self._opacity = self._opacity if opacity is None else opacity
        self._refresh()

    def show_particles(self, particles: Mapping[str, FloatArray], *, live: bool = False) -> None:
        """Show particles by subject, (N, 3) [mm] each in common coordinates.

        Colours are given anew when the number of particles changes, and when a run has ended. Live particles
        may be drawn on lighter surfaces.
        """
        count = len(next(iter(particles.values()))) if particles else 0
        tints = self._tints if live and not isinstance(self._tints, Mapping) else None
        self._take_particles(particles, tints if tints is not None and len(tints) == count else None)
        if live:
            self._draw_quick()
            self._refine.start()
            self._refresh_some()
        else:
            self._refresh()

    def _take_particles(
        self, particles: Mapping[str, FloatArray], tints: Array | Mapping[str, Array] | None
    ) -> None:
        if particles and tints is None:
            tints = colours_by_place(np.mean([np.asarray(one) for one in particles.values()], axis=0))
        self._particles, self._tints = particles, tints

    def set_linked(self, linked: bool) -> None:
        """Turn all views together, or each alone."""
        self._cameras.link(linked)
        self._plot.update()

    def look(self, view: str) -> None:
        """Look from one of `VIEWS` and fit the shapes."""
        self._cameras.turn(view)
        self.fit()

    def fit(self) -> None:
        """Show the whole shapes, as large as the largest allows."""
        rows, columns = self._grid
        shape = self._plot.width() * rows / max(1, self._plot.height() * columns)
        self._fitted = self._cameras.fit(self._count, shape) or self._fitted
        self._plot.update()

    def go_to(self, name: str, place: FloatArray, normal: FloatArray) -> None:
        """Show a subject's page and look at a place of its surface from outside, close enough to see it."""
        self.show_name(name)
        bounds = self._bounds()
        if bounds is not None:
            height = _CLOSE_UP * max(bounds[1] - bounds[0], bounds[3] - bounds[2], bounds[5] - bounds[4])
            for camera in self._cameras.each:
                aim(camera, place, normal, height)
            self._plot.update()

    def paint(self, colours: Colours) -> None:
        """Take the colours of the scheme."""
        self._backdrop.SetBackground(*rgb(colours.line))
        for cell in self._cells:
            cell.paint(colours)
        self.bar.paint(colours)
        self._plot.update()

    def picture(self, scale: int = 1, *, transparent: bool = False) -> QImage:
        """Return what is shown, up to four times as large."""
        self._draw_fine()
        self._show_words(scale)
        self._backdrop.SetDraw(not transparent)
        self._plot.ren_win.SetMultiSamples(SMOOTH)
        self._plot.grabFramebuffer()  # draws now; repaint() waits if the last drawing was under a frame ago
        pixels = np.ascontiguousarray(
            self._plot.screenshot(return_img=True, scale=scale, transparent_background=transparent)
        )
        self._show_words()
        self._backdrop.SetDraw(True)
        self._plot.ren_win.SetMultiSamples(self._plot.smoothing)
        kind = QImage.Format.Format_RGBA8888 if pixels.shape[2] == 4 else QImage.Format.Format_RGB888
        image = QImage(pixels.tobytes(), pixels.shape[1], pixels.shape[0], pixels.strides[0], kind).copy()
        self._plot.update()
        return self.bar.below(image, scale * self.devicePixelRatioF())

    def close_scene(self) -> None:
        """Let go of everything of VTK; the last thing before the window closes."""
        self._refine.stop()
        window: Any = self._plot.ren_win
        if window is not None:
            for observer in self._observers:
                window.RemoveObserver(observer)
        self._cells.clear()  # the picker holds the same list
        self._plot.close()

    def _place_cells(self) -> None:
        rows, columns = self._grid
        for index, cell in enumerate(self._cells):
            row, column = divmod(index, columns)
            left, bottom = column / columns, 1.0 - (row + 1) / rows
            box = (left + _GAP, bottom + _GAP, left + 1.0 / columns - _GAP, bottom + 1.0 / rows - _GAP)
            cell.place(box if index < self._count else None)

    def _refresh(self) -> None:
        self._after_drawing()
        self._show_words()
        self._radius = self._ball_radius(len(next(iter(self._particles.values()), ())))
        for cell in self._cells[: self._count]:
            content = cell.content
            cell.show(self._raw, self._groomed, self._quick, self._opacity)
            points = self._particles.get(content.name) if content is not None and self._balls else None
            cell.show_particles(points, self._tints_of(cell), self._radius)
        self._plot.update()

    def _show_words(self, scale: float = 1.0) -> None:
        """Write names and letters, as large on every screen and in every picture."""
        size = {1: 16, 4: 15, 9: 13}.get(self._count, 12) * scale * self.devicePixelRatioF()
        for cell in self._cells[: self._count]:
            cell.show_words(round(size), small=self._count > 4)

    def _refresh_some(self) -> None:
        """Move the particles of a few views, and draw only these: as many as are drawn fast enough.

        What is not drawn keeps its last picture, as each renderer clears its own part of the window only. A
        slow machine so updates the views in turn instead of keeping the user's clicks waiting.
        """
        spent = self._plot.last_ms
        if spent > _LIVE_MS[1]:
            self._share = max(1, min(self._share, self._count) * 2 // 3)
        elif spent < _LIVE_MS[0]:
            self._share = min(_MOST_CELLS, self._share + 1)
        share = min(self._share, self._count)
        chosen = {(self._turn + step) % self._count for step in range(share)}
        self._turn = (self._turn + share) % self._count
        for index in chosen:
            cell = self._cells[index]
            points = self._particles.get(cell.content.name) if cell.content and self._balls else None
            cell.show_particles(points, self._tints_of(cell), self._radius)
        self._draw_cells(chosen)
        self._partial = share < self._count
        self._plot.update()

    def _draw_cells(self, chosen: Collection[int]) -> None:
        for index, cell in enumerate(self._cells[: self._count]):
            cell.renderer.SetDraw(index in chosen)
        self._backdrop.SetDraw(len(chosen) == self._count)

    def _after_drawing(self, *_: object) -> None:
        if self._partial:
            self._partial = False
            self._draw_cells(range(self._count))

    def _tints_of(self, cell: Cell) -> Array | None:
        if isinstance(self._tints, Mapping):
            return self._tints.get(cell.content.name) if cell.content is not None else None
        return self._tints

    def _particles_of(self, cell: Cell) -> tuple[FloatArray | None, float]:
        """Return the particles that a view shows, and how large."""
        content = cell.content if self._balls else None
        return self._particles.get(content.name) if content is not None else None, self._radius

    def _ball_radius(self, count: int) -> float:
        """Return a radius that leaves half of the surface free, whatever the number of particles."""
        bounds = self._bounds()
        if bounds is None or not count:
            return 1.0
        size = float(np.mean([bounds[1] - bounds[0], bounds[3] - bounds[2], bounds[5] - bounds[4]]))
        return float(np.clip(0.42 * size / np.sqrt(count), 0.006 * size, 0.035 * size))

    def _bounds(self) -> tuple[float, ...] | None:
        boxes = [box for cell in self._cells[: self._count] if (box := cell.bounds) is not None]
        if not boxes:
            return None
        return tuple(pick(box[at] for box in boxes) for at, pick in enumerate((min, max) * 3))

    def _before_drawing(self, *_: object) -> None:
        size = self._plot.ren_win.GetSize()
        if size != self._size:  # the picture of the views that are not drawn is gone
            self._size = size
            self._after_drawing()
        bounds = self._bounds()
        if bounds is not None:
            for cell in self._cells[: self._count]:
                cell.face_camera(bounds)

    def _draw_quick(self, *_: object) -> None:
        self._set_quick(self._quick or self.draw_ms > _SLOW_MS)

    def _draw_fine(self) -> None:
        self._set_quick(False)

    def _set_quick(self, quick: bool) -> None:
        if quick != self._quick:
            self._quick = quick
            self._refresh()
