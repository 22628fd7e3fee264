"""A grid of views in a VTK window, drawn on screen or off screen at any size; no Qt."""

import sys
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow  # plotters own theirs, in fixed grids

from homolog.arrays import Array, FloatArray
from homolog_app.rendering.camera import Box, Canvas, Clip, around
from homolog_app.rendering.colours import DARK_SCHEME, LIGHT_SCHEME, Colours, colours_by_place, rgb
from homolog_app.rendering.opengl import SMOOTH, need_no_display, pixels_of
from homolog_app.rendering.scene import ball_radius
from homolog_app.views.cell import Cameras, ViewCell, ViewMargins
from homolog_app.views.colour_bar import scale_picture
from homolog_app.views.content import Content, ViewContents
from homolog_app.views.strip import STRIP_ROWS

__all__ = ["Grid", "drawn"]


_GAP = 0.0015
_FEW = 4
_DPI = 72  # text sizes are pixels; the window of pyvistaqt would scale them twice on high-resolution screens
_TEXT_PX = {1: 16, 4: 15, 9: 13}  # by the largest number of views
_TYPICAL = 500  # maximum number of subjects whose mean determines the colours of particles
_LETTER = 0.55  # approximate ratio of a letter's width to its height


class Grid:
    """Shows a page of contents, one per view.

    Subjects are paged in the user's layout; shapes of the model have their own columns.

    Parameters
    ----------
    window : vtkRenderWindow
        A renderer is added to it for each view that is needed.
    """

    def __init__(self, window: Any) -> None:  # noqa: ANN401 - VTK is untyped
        self._window = window
        self._backdrop = vtkRenderer()
        self._backdrop.InteractiveOff()
        window.AddRenderer(self._backdrop)
        self.cells: list[ViewCell] = []
        self._observer = window.AddObserver("StartEvent", self._before_drawing)
        self.ratio = 1.0
        """Pixels of the picture per pixel of a screen without scaling, by which texts are enlarged."""
        self.text = 1.0
        """Size of the texts relative to a system font of 12 pixels."""
        self.quick = False
        """Whether simplified surfaces are drawn instead of full ones."""
        self._contents: Sequence[Content] = ()
        self.particles: Mapping[str, FloatArray] = {}
        self.tints: Array | Mapping[str, Array] | None = None
        self.radius = 1.0
        self.layout, self.columns, self.page = 1, 0, 0
        self.raw, self.groomed, self.balls, self.opacity = True, True, True, 1.0
        self.letters, self.scale_bar = True, True
        self.clip: Clip | None = None
        """The plane that cuts all shapes open."""
        self._box: Box | None = None
        self._boxed: list[str] = []
        self._colours = LIGHT_SCHEME
        self.cameras = Cameras(self.cells)
        self.place_cells()

    @property
    def count(self) -> int:
        """Number of views."""
        rows, columns = self.shape
        return rows * columns

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of views."""
        if self.columns:
            return max(1, -(-len(self._contents) // self.columns)), self.columns
        side = round(self.layout**0.5)
        return side, side

    @property
    def pages(self) -> int:
        """Number of pages."""
        return max(1, -(-len(self._contents) // self.count))

    @property
    def contents(self) -> Sequence[Content]:
        """The contents of all pages."""
        return self._contents

    @property
    def shown(self) -> Sequence[Content]:
        """The contents of the page."""
        return self._contents[self.page * self.count : (self.page + 1) * self.count]

    def take(self, shown: ViewContents) -> None:
        """Set the contents; call `show_page` afterwards."""
        self._contents, self.columns = shown.contents, shown.columns or 0
        if shown.particles is not None:
            self.set_particles(shown.particles, shown.tints)
        self.place_cells()

    def set_particles(
        self, particles: Mapping[str, FloatArray], tints: Array | Mapping[str, Array] | None
    ) -> None:
        """Set the particles, coloured by position unless colours are given."""
        if particles and tints is None:
            sample = list(particles.values())[:: -(-len(particles) // _TYPICAL)]
            tints = colours_by_place(np.mean([np.asarray(points) for points in sample], axis=0))
        self.particles, self.tints = particles, tints

    def show_page(self, page: int) -> None:
        """Fill the views with the contents of a page."""
        self.page = max(0, min(page, self.pages - 1))
        shown = self.shown
        for index, cell in enumerate(self.cells):
            cell.fill(shown[index] if index < min(len(shown), self.count) else None)
        self.refresh()
        if (
            names := [content.name for content in shown]
        ) != self._boxed:  # the plane stays where shapes only move
            self._boxed, self._box = names, self.bounds

    def refresh(self) -> None:
        """Update surfaces, particles and texts."""
        size = self._text_px * self.ratio
        for index, cell in enumerate(self.cells[: self.count]):
            cell.show(self.raw, self.groomed, self.quick, self.opacity)
            bar = self.scale_bar and (self.count <= _FEW or index == 0 or not self.cameras.linked)
            cell.show_caption(round(size), small=self.count > _FEW, letters=self.letters, bar=bar)
        self.radius = self._ball_radius(len(next(iter(self.particles.values()), ())))
        self.refresh_particles(range(self.count))

    def refresh_particles(self, chosen: Collection[int]) -> None:
        """Move the particles of some views."""
        for index in chosen:
            cell = self.cells[index]
            cell.show_particles(self.particles_of(cell)[0], self._tints_of(cell), self.radius)

    def particles_of(self, cell: ViewCell) -> tuple[FloatArray | None, float]:
        """Return the particles of a view, and their radius."""
        content = cell.content if self.balls else None
        return self.particles.get(content.name) if content is not None else None, self.radius

    def fit(self, width: float, height: float) -> bool:
        """Zoom to the whole shapes; return whether there is anything to show."""
        return self.cameras.fit(self.count, self._room(width, height))

    def widen(self, width: float, height: float) -> None:
        """Zoom out if shapes would be cut off."""
        self.cameras.widen(self.count, self._room(width, height))

    def _room(self, width: float, height: float) -> ViewMargins:
        """Return the margins of a view: shapes remain below wide captions and clear of letters."""
        rows, columns = self.shape
        wide, high = max(1.0, width / columns), max(1.0, height / rows)
        longest = max((len(line) for item in self.shown for line in item.caption), default=0)
        caption = wide if self.count == 1 else longest * _LETTER * self._text_px
        numbered = any(item.numbers is not None for item in self.shown)
        texts = (STRIP_ROWS, STRIP_ROWS) if numbered else (1.4, 2.6)
        aside, below = (lines * self._text_px + 0.025 * high for lines in texts)
        return ViewMargins(wide, high, 1.6 * self._text_px, aside, caption, below)

    @property
    def _text_px(self) -> float:
        """Height of the texts, in pixels of a screen without scaling."""
        return self.text * next((size for most, size in _TEXT_PX.items() if self.count <= most), 12)

    def paint(self, colours: Colours) -> None:
        """Apply the scheme's colours."""
        self._colours = colours
        self._backdrop.SetBackground(*rgb(colours.line))
        for cell in self.cells:
            cell.paint(colours)

    def show_backdrop(self, shown: bool) -> None:
        """Show or hide the background of the views and the lines between them."""
        self._backdrop.SetDraw(shown)

    def place_cells(self) -> None:
        """Place the views in the window; create missing ones."""
        rows, columns = self.shape
        while len(self.cells) < rows * columns:
            self._add_cell()
        for index, cell in enumerate(self.cells):
            row, column = divmod(index, columns)
            left, bottom = column / columns, 1.0 - (row + 1) / rows
            box = (left + _GAP, bottom + _GAP, left + 1.0 / columns - _GAP, bottom + 1.0 / rows - _GAP)
            cell.place(box if index < self.count else None)

    def _add_cell(self) -> None:
        renderer = vtkRenderer()
        self._window.AddRenderer(renderer)
        self.cells.append(ViewCell(renderer))
        self.cells[-1].paint(self._colours)
        self.cameras.add(renderer)

    def close(self) -> None:
        """Release the graphics."""
        self._window.RemoveObserver(self._observer)
        self.cells.clear()  # the picker holds the same list

    @property
    def bounds(self) -> Box | None:
        """Extent of all contents of the views [mm]; None if there are none."""
        return around([box for cell in self.cells[: self.count] if (box := cell.bounds) is not None])

    @property
    def full_clip(self) -> Clip | None:
        """The cutting plane with the extent that its position refers to."""
        return self.clip and self.clip.model_copy(update={"box": self.clip.box or self._box})

    def _before_drawing(self, *_: object) -> None:
        self._window.SetDPI(_DPI)
        bounds = self.bounds
        if bounds is not None:
            cells = self.cells[: self.count]
            for cell in cells:
                cell.face_camera(bounds)
                cell.cut(self.clip, self._box or bounds)
            in_strips = any(cell.texts.need_strip for cell in cells)
            for cell in cells:
                cell.face_texts(in_strips)

    def _tints_of(self, cell: ViewCell) -> Array | None:
        if isinstance(self.tints, Mapping):
            return self.tints.get(cell.content.name) if cell.content is not None else None
        return self.tints

    def _ball_radius(self, count: int) -> float:
        """Return the radius of `count` particles on the shapes of the page."""
        bounds = self.bounds
        return 1.0 if bounds is None or not count else ball_radius(bounds, count)


def drawn(
    shown: ViewContents, canvas: Canvas, scale: int = 1, *, transparent: bool = False
) -> NDArray[np.uint8]:
    """Draw the views.

    Parameters
    ----------
    shown : ViewContents
        With its particles.
    canvas : Canvas
        Size, camera and layout.
    scale : int
        Factor from the size on the screen.
    transparent : bool
        Whether the background is transparent.

    Returns
    -------
    (height, width, 4) uint8 array
        Red, green, blue, opacity; with the colour scale, if any, at the lower edge.
    """
    need_no_display()
    _release_context_of_qt()
    colours = DARK_SCHEME if canvas.scheme == "dark" else LIGHT_SCHEME
    ratio = scale * canvas.ratio
    window: Any = vtkRenderWindow()
    window.SetOffScreenRendering(True)
    window.SetMultiSamples(SMOOTH)
    window.SetAlphaBitPlanes(True)
    window.SetNumberOfLayers(1)
    window.SetSize(round(canvas.width * ratio), round(canvas.height * ratio))
    grid = Grid(window)
    grid.ratio, grid.text, grid.layout = ratio, canvas.text, canvas.layout
    grid.raw, grid.groomed, grid.balls = canvas.raw, canvas.groomed, canvas.particles
    grid.letters, grid.scale_bar = canvas.letters, canvas.scale_bar
    grid.opacity, grid.clip = canvas.opacity, canvas.clip
    grid.paint(colours)
    grid.show_backdrop(not transparent)
    grid.take(shown)
    _look(grid, canvas)
    grid.show_page(canvas.page)
    window.Render()
    pixels = pixels_of(window)
    grid.close()
    window.Finalize()
    if not transparent:
        pixels[..., 3] = 255
    if shown.scale is not None:
        strip = scale_picture(
            shown.scale, colours, pixels.shape[1], ratio * canvas.text, transparent=transparent
        )
        pixels = np.concatenate([pixels, strip])
    return pixels


def _release_context_of_qt() -> None:
    """Tell Qt that its context is no longer current, if this process has Qt windows.

    VTK makes its own context current without telling Qt. Qt would still assume that the context of the views
    is current, and free OpenGL objects in no context or in another one when a window is deleted.
    """
    gui = sys.modules.get("PySide6.QtGui")
    context = gui.QOpenGLContext.currentContext() if gui is not None else None
    if context is not None:
        context.doneCurrent()


def _look(grid: Grid, canvas: Canvas) -> None:
    if len(canvas.cameras) > 1:
        grid.cameras.link(False)
    for camera, state in zip(grid.cameras.each, canvas.cameras, strict=False):
        state.set(camera)
    if not canvas.cameras:
        grid.show_page(canvas.page)  # the camera needs contents
        grid.cameras.turn("corner")
        grid.fit(canvas.width, canvas.height)
