"""A grid of views in a VTK window, drawn on screen or off screen at any size, and their cameras; no Qt."""

import sys
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow  # plotters own theirs, in fixed grids

from homolog.arrays import Array, FloatArray
from homolog.geometry import scale_of, transform_points
from homolog.surfaces.mirroring import mirrors
from homolog_app.rendering.actors import Overview, SceneActors
from homolog_app.rendering.camera import VIEWS as ANATOMICAL
from homolog_app.rendering.camera import Box, Canvas, Clip, Cut, Display, Layer, View, around, extent_of
from homolog_app.rendering.colour_bar import legend_picture, scale_picture
from homolog_app.rendering.colours import LIGHT_SCHEME, Colours, colours_by_place, rgb, rgb_bytes
from homolog_app.rendering.content import Content, ViewContents
from homolog_app.rendering.opengl import SMOOTH, need_no_display, pixels_of
from homolog_app.rendering.scene import Balls, Scene, Surface, ball_radius
from homolog_app.rendering.view_texts import STRIP_ROWS, ViewTexts

__all__ = ["VIEWS", "Cameras", "Grid", "ViewCell", "ViewMargins", "drawn"]


VIEWS = {
    "right": ANATOMICAL["right"],
    "left": ANATOMICAL["left"],
    "front": ANATOMICAL["anterior"],
    "back": ANATOMICAL["posterior"],
    "feet": ANATOMICAL["inferior"],
    "head": ANATOMICAL["superior"],
    "corner": View((-0.45, -1.0, 0.75), (0.0, 0.0, 1.0)),
}
"""View directions of the window's commands."""

_FREE = 0.45
"""Fraction of a view that is always available to shapes."""


@dataclass(frozen=True, slots=True)
class ViewMargins:
    """A view and its margins for texts; lengths in pixels.

    Attributes
    ----------
    width, height : float
        Of the view.
    beside, above : float
        Margins at the left and right, and at the top and bottom.
    caption : float
        Width of the longest caption.
    below : float
        Margin at the top and bottom of shapes that are so wide that they are placed below the caption.
    """

    width: float
    height: float
    beside: float
    above: float
    caption: float
    below: float

    def scale(self, across: float, along: float) -> float:
        """Return the parallel scale that shows shapes up to a distance from the middle [mm]."""
        scale = self._scale(across, along, self.above)
        aside = self.width / 2.0 - across * self.height / max(scale, 1e-9) / 2.0 >= self.caption
        return scale if aside else self._scale(across, along, self.below)

    def _scale(self, across: float, along: float, above: float) -> float:
        free = max(self.width - 2.0 * self.beside, _FREE * self.width)
        free_along = max(self.height - 2.0 * above, _FREE * self.height)
        return self.height * max(across / free, along / free_along)


class Cameras:
    """The cameras of all views, linked at first."""

    def __init__(self, cells: "Sequence[ViewCell]") -> None:
        self._cells = cells
        self._linked = True
        self.frame: Array | None = None
        """Points that fit into the views beside the contents, (n, 3) [mm]."""

    @property
    def linked(self) -> bool:
        """Whether there is one camera for all views."""
        return self._linked

    @property
    def each(self) -> list[Any]:
        """The common camera of all views, or the camera of each view if they are not linked."""
        return [cell.renderer.GetActiveCamera() for cell in self._first(self._cells)]

    def link(self, linked: bool) -> None:
        """Rotate all views together, or each independently."""
        self._linked = linked
        for cell in self._cells[1:]:
            self.add(cell.renderer)

    def add(self, renderer: Any) -> None:  # noqa: ANN401 - VTK is untyped
        """Add a view with the first one's direction, with the common camera or its own."""
        camera = self._cells[0].renderer.GetActiveCamera()
        camera.ParallelProjectionOn()
        if self._linked:
            renderer.SetActiveCamera(camera)
        else:
            alone = camera.NewInstance()
            alone.DeepCopy(camera)
            renderer.SetActiveCamera(alone)

    def turn(self, view: str) -> None:
        """Set the direction to one of `VIEWS`."""
        look = VIEWS[view]
        for camera in self.each:
            camera.SetFocalPoint(0.0, 0.0, 0.0)
            camera.SetPosition(*look.toward)
            camera.SetViewUp(*look.up)

    def fit(self, count: int, room: ViewMargins) -> bool:
        """Zoom so that the whole shapes of the first views are visible.

        Parameters
        ----------
        count : int
            Number of views.
        room : ViewMargins
            Of a view.

        Returns
        -------
        bool
            Whether there is anything to show.
        """
        cells = self._cells[:count]
        points = self._framed(cells)
        for cell in self._first(cells) if len(points) else ():
            cell.fit(points, room)
        return len(points) > 0

    def widen(self, count: int, room: ViewMargins) -> None:
        """Zoom out if shapes of the first views would be cut off; parameters as for `fit`."""
        cells = self._cells[:count]
        points = self._framed(cells)
        for cell in self._first(cells) if len(points) else ():
            cell.widen(points, room)

    def _framed(self, cells: "Sequence[ViewCell]") -> FloatArray:
        points = np.concatenate([cell.points for cell in cells])
        return points if self.frame is None or not len(points) else np.concatenate([points, self.frame])

    def _first(self, cells: "Sequence[ViewCell]") -> "Sequence[ViewCell]":
        return cells[: 1 if self._linked else None]


_OVER = 0.5
"""Opacity of a surface that is drawn over another."""
_LEAST_MARGIN, _SMALL, _SPARSE = 0.94, 0.5, 5
_SURFACES = ("raw", "groomed", "coarse")
_UNPAINTED = np.zeros(3, np.uint8)


class ViewCell:
    """One renderer and its actors, reused for different contents."""

    def __init__(self, renderer: Any) -> None:  # noqa: ANN401 - VTK is untyped
        self.renderer = renderer
        self.content: Content | None = None
        self._actors = SceneActors(renderer)
        self._placed: dict[str, FloatArray] = {}
        self._boxes: dict[str, Box] = {}
        self._surfaces: dict[str, list[Surface]] = {}
        self._shown: dict[str, float] = {}
        self._display = Display()
        self._values: tuple[Array | None, list[Array]] = None, []
        self._balls: Balls | None = None
        self._cut: Cut | None = None
        self._colours = LIGHT_SCHEME
        self._plain: dict[str, Array] = {}
        self.texts = ViewTexts(renderer)
        self.overview = Overview(renderer)
        self._corners = np.empty((0, 2)), np.empty((0, 2))

    def place(self, viewport: tuple[float, float, float, float] | None) -> None:
        """Set the view's part of the window, or none."""
        self.renderer.SetViewport(*(viewport or (0.0, 0.0, 0.0, 0.0)))
        self.renderer.SetDraw(viewport is not None)
        self.renderer.SetInteractive(viewport is not None)
        self.overview.hide()

    def fill(self, content: Content | None) -> None:
        """Set the content, or none; moved surfaces are updated in place. `show_particles` draws it."""
        if content is self.content:
            return
        before, self.content = self.content, content
        for name in _SURFACES:
            mesh = getattr(content, name, None)
            if mesh is None or content is None:
                for kept in (self._placed, self._boxes, self._surfaces):
                    kept.pop(name, None)
            elif (
                before is None
                or mesh is not getattr(before, name)
                or before.alignment is not content.alignment
            ):
                self._placed[name] = transform_points(content.alignment, mesh.vertices)
                self._boxes[name] = extent_of(self._placed[name])
                self._surfaces.pop(name, None)
        if before is None or content is None or before.name != content.name:
            self._balls = None
        if content is None:
            self._update()

    def show(self, display: Display, *, quick: bool) -> None:
        """Set which surfaces `show_particles` draws; of both, the raw one is a transparent shell.

        Fast drawing uses the simplified surface, unless the full one has colours at its vertices.
        """
        overlaid = self.content is not None and self.content.overlaid
        faded = self.content is not None and self.content.faded and "raw" in self._placed
        raw, groomed, opacity = display.raw or overlaid or faded, display.groomed, display.opacity
        self._display = display
        both = raw and groomed and "groomed" in self._placed
        coloured = self.content is not None and self.content.colours is not None
        light = quick and not coloured and "coarse" in self._placed
        self._shown = {"raw": 0.35 * opacity if both and not overlaid else opacity} if raw else {}
        self._shown |= (
            {"coarse" if light else "groomed": (_OVER if overlaid else 1.0) * opacity} if groomed else {}
        )

    def cut(self, clip: Clip | None, box: Box) -> None:
        """Before each drawing: cut the shapes open for the current camera, or leave them whole."""
        cut = None if clip is None else clip.cut(box, self.axes[2])
        if cut is None or self._cut is None:
            changed = cut is not self._cut
        else:
            changed = not all(np.array_equal(part, other) for part, other in zip(cut, self._cut, strict=True))
        if changed:
            self._cut = cut
            self._update()

    def show_particles(self, points: FloatArray | None, colours: Array | None, radius: float) -> None:
        """Move the particles, or hide them, and draw the current content."""
        self._balls = None
        if points is not None and colours is not None:
            points, colours = np.asarray(points), np.asarray(colours)
            if hidden := [place for place, layer in enumerate(self._layers) if not layer.shown]:
                assert self.content is not None
                seen = ~np.isin(self.content.owners(len(points)), hidden)
                points, colours = points[seen], colours[seen] if colours.ndim > 1 else colours
            self._balls = Balls(points, radius, colours)
        self._update()

    def _update(self) -> None:
        """Apply all settings to the actors."""
        content = self.content
        self._actors.show(
            Scene(
                tuple(surface for name in _SURFACES for surface in self._parts_of(name)),
                self._balls,
                arrows=content.arrows if content is not None else None,
                lines=content.lines if content is not None else None,
                marks=rgb_bytes(self._colours.mark),
                through=content is not None and content.through,
                cut=self._cut,
                cap=rgb_bytes(self._colours.cut),
            )
        )

    @property
    def _layers(self) -> list[Layer]:
        """How each structure of the content is shown; none for a single one."""
        return [self._display.layer(name) for name in (self.content.structures if self.content else ())]

    def _parts_of(self, name: str) -> list[Surface | None]:
        """Return a displayed surface by structure; the same objects as long as they are unchanged."""
        content, layers = self.content, self._layers
        if content is None or name not in self._placed or name not in self._shown:
            return [None] * max(1, len(layers))
        if name not in self._surfaces:
            self._surfaces[name] = self._built(content, name)
        parts = self._surfaces[name]
        layers = layers if len(layers) == len(parts) else [Layer(name="")]
        values = content.colours if name == "groomed" else None
        if values is not None and values is not self._values[0]:
            self._values = values, np.split(values, np.cumsum([len(part.vertices) for part in parts])[:-1])
        plain = self._plain[name]
        for place, (part, layer) in enumerate(zip(parts, layers, strict=False)):
            own = np.array(layer.colour_at(place), np.uint8) if len(layers) > 1 else plain
            colours = own if values is None else self._values[1][place]
            opacity = layer.opacity * self._shown[name]
            is_same = colours is part.colours or (values is None and np.array_equal(colours, part.colours))
            if not is_same or opacity != part.opacity:
                parts[place] = replace(part, colours=colours, opacity=opacity)
        return [part if layer.shown else None for part, layer in zip(parts, layers, strict=False)]

    def _built(self, content: Content, name: str) -> list[Surface]:
        """Return a surface by structure, still without colours."""
        mesh, linear = getattr(content, name), content.alignment[:3, :3]
        own = content.normals if name == "groomed" else None
        normals = (mesh.vertex_normals if own is None else own) @ linear.T / scale_of(content.alignment)
        turned, parts, begin = mirrors(content.alignment), [], 0
        for part in mesh.parts:
            end = begin + len(part.vertices)
            faces = part.faces[:, ::-1] if turned else part.faces
            vertices = self._placed[name][begin:end]
            parts.append(Surface(vertices, normals[begin:end], faces, _UNPAINTED, 1.0))
            begin = end
        return parts

    def show_caption(self, size: int, *, small: bool, letters: bool, bar: bool) -> None:
        """Show the subject's name and note, the letters and a scale bar, with a text height [pixels]."""
        self.texts.show(self.content, size, small=small, letters=letters, bar=bar)

    def paint(self, colours: Colours) -> None:
        """Apply the scheme's colours."""
        self._colours = colours
        bone = np.array(rgb_bytes(colours.bone), np.uint8)
        self._plain = {"groomed": bone, "coarse": bone, "raw": np.array(rgb_bytes(colours.raw), np.uint8)}
        self.renderer.SetBackground(*rgb(colours.scene))
        self.texts.paint(colours)
        self.overview.paint(colours)
        self._update()

    def face_camera(self, bounds: tuple[float, ...]) -> None:
        """Before each drawing: update depth range and letters, and lift particles towards the viewer."""
        self.renderer.ResetCameraClippingRange(bounds)
        right, up, ahead = self.axes
        self._actors.lift(-(self._balls.radius if self._balls is not None else 0.0) * ahead)
        shown = _some_of(self._placed[name] for name in self._shown if name in self._placed)
        self.overview.face(self.surface_actors, shown, np.stack([right, up, ahead]))
        points = self._in_view(shown) if len(shown) else np.empty((0, 2))
        self.texts.follow(points, is_close=self.overview.shown)
        self._corners = self._parts() if self.overview.shown else (points, points)

    def face_texts(self, in_strip: bool) -> None:
        """Before each drawing, after `face_camera`: place the texts, in a strip or not."""
        self.texts.face(self.axes, *self._corners, self.overview.box, in_strip)

    def _parts(self) -> tuple[FloatArray, FloatArray]:
        """Return the lower left and upper right corners of the drawn triangles in the view, (n, 2) each."""
        low, high = [np.empty((0, 2))], [np.empty((0, 2))]
        for name in self._shown:
            light = "coarse" if name == "groomed" and "coarse" in self._placed else name
            mesh = getattr(self.content, light, None)
            if mesh is not None and light in self._placed:
                corners = self._in_view(self._placed[light])[mesh.faces]
                low.append(corners.min(axis=1))
                high.append(corners.max(axis=1))
        return np.concatenate(low), np.concatenate(high)

    def _in_view(self, points: FloatArray) -> FloatArray:
        """Return points (n, 3) in view coordinates (n, 2), from 0 at the left and lower edge to 1."""
        camera, (width, height) = self.renderer.GetActiveCamera(), self.renderer.GetSize()
        half = camera.GetParallelScale() * np.array([width / max(height, 1), 1.0])
        apart = (points - np.array(camera.GetFocalPoint())) @ self.axes[:2].T
        return np.asarray((apart / half + 1.0) / 2.0, dtype=np.float64)

    @property
    def axes(self) -> FloatArray:
        """Directions to the right, upwards and ahead in the current view, (3, 3)."""
        camera = self.renderer.GetActiveCamera()
        ahead = np.array(camera.GetDirectionOfProjection())
        right = np.cross(ahead, camera.GetViewUp())
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(right, ahead), ahead])

    @property
    def vertices(self) -> FloatArray:
        """Vertices of the groomed surface, or else of the input [mm], (n, 3)."""
        return self._placed.get("groomed", self._placed.get("raw", np.empty((0, 3))))

    @property
    def points(self) -> FloatArray:
        """A subset of the vertices of the surfaces [mm], (n, 3), whether they are shown or not."""
        return _some_of(self._placed.values())

    def fit(self, points: FloatArray, room: ViewMargins) -> None:
        """Zoom so that points (n, 3) fill the current view."""
        camera, axes = self.renderer.GetActiveCamera(), self.axes
        low, high = (pick(points @ axes.T, axis=0) for pick in (np.min, np.max))
        middle = axes.T @ ((low + high) / 2.0)
        camera.SetFocalPoint(*middle)
        camera.SetPosition(*(middle - max(np.linalg.norm(high - low), 1e-6) * axes[2]))
        across, along, _ = (high - low) / 2.0
        camera.SetParallelScale(max(room.scale(across, along), 1e-6))

    def widen(self, points: FloatArray, room: ViewMargins) -> None:
        """Zoom out if points (n, 3) would reach the letters at the edges, with the same centre.

        Motion therefore remains visible. If points fill less than half of the view, they belong to another
        structure, and the view is fitted to them.
        """
        camera = self.renderer.GetActiveCamera()
        across, along, _ = np.abs((points - camera.GetFocalPoint()) @ self.axes.T).max(axis=0)
        needed = room.scale(across, along)
        if _LEAST_MARGIN * needed > camera.GetParallelScale():
            camera.SetParallelScale(needed)
        elif needed < _SMALL * camera.GetParallelScale():
            self.fit(points, room)

    @property
    def surface_actors(self) -> list[Any]:
        """Pickable actors: surfaces, shown or not, and caps, which occlude shapes behind them."""
        return self._actors.clickable

    def is_cap(self, actor: Any) -> bool:  # noqa: ANN401 - VTK is untyped
        """Whether a VTK actor is the cut surface."""
        return self._actors.is_cap(actor)

    @property
    def bounds(self) -> Box | None:
        """Extent of the surfaces [mm], with the input only where it is shown; None without surfaces."""
        raw = "raw" in self._shown or len(self._boxes) == 1
        return around([box for name, box in self._boxes.items() if raw or name != "raw"])


def _some_of(surfaces: Iterable[FloatArray]) -> FloatArray:
    """Return a subset of the vertices of each surface, (n, 3) together."""
    return np.concatenate([np.empty((0, 3)), *(vertices[::_SPARSE] for vertices in surfaces)])


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
        self.columns = 0
        self.display = Display(layout=1, raw=True)
        """What the user chose to see; replaced by `show`."""
        self.uncovering: Clip | None = None
        """A plane in front of what a close-up shows, unless the user cuts the shapes open."""
        self.box: Box | None = None
        """Extent that the user's plane refers to [mm], which stays where shapes only move."""
        self._boxed: list[str] = []
        self.cameras = Cameras(self.cells)
        self.place_cells()
        self.paint()

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
        side = round(self.display.layout**0.5)
        return side, side

    @property
    def pages(self) -> int:
        """Number of pages."""
        return max(1, -(-len(self._contents) // self.count))

    @property
    def page(self) -> int:
        """Index of the page that is shown."""
        return min(self.display.page, self.pages - 1)

    @property
    def contents(self) -> Sequence[Content]:
        """The contents of all pages."""
        return self._contents

    @property
    def shown(self) -> Sequence[Content]:
        """The contents of the page."""
        return self._contents[self.page * self.count : (self.page + 1) * self.count]

    @property
    def structures(self) -> list[str]:
        """The structures of the contents of the page."""
        return list(dict.fromkeys(name for content in self.shown for name in content.structures))

    @property
    def is_coloured(self) -> bool:
        """Whether colours of surfaces mean values, not structures."""
        return any(content.colours is not None for content in self.shown)

    def cell_of(self, name: str) -> ViewCell | None:
        """Return the view of a content by its name; None if it is not shown."""
        return next(
            (cell for cell in self.cells[: self.count] if cell.content and cell.content.name == name), None
        )

    def take(self, shown: ViewContents) -> None:
        """Set the contents; call `show_page` afterwards."""
        self._contents, self.columns, self.cameras.frame = shown.contents, shown.columns or 0, shown.frame
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
        self.display = self.display.changed(page=max(0, min(page, self.pages - 1)))
        shown = self.shown
        for index, cell in enumerate(self.cells):
            cell.fill(shown[index] if index < min(len(shown), self.count) else None)
        self.refresh()
        if (
            names := [content.name for content in shown]
        ) != self._boxed:  # the plane stays where shapes only move
            self._boxed, self.box = names, self.bounds

    def refresh(self) -> None:
        """Update surfaces, particles and texts."""
        size, display = self._text_px * self.ratio, self.display
        for index, cell in enumerate(self.cells[: self.count]):
            cell.show(display, quick=self.quick)
            bar = display.scale_bar and (self.count <= _FEW or index == 0 or not self.cameras.linked)
            cell.show_caption(round(size), small=self.count > _FEW, letters=display.letters, bar=bar)
        self.radius = self._ball_radius(len(next(iter(self.particles.values()), ())))
        self.refresh_particles(range(self.count))

    def refresh_particles(self, chosen: Collection[int]) -> None:
        """Move the particles of some views."""
        for index in chosen:
            cell = self.cells[index]
            cell.show_particles(self.particles_of(cell)[0], self._tints_of(cell), self.radius)

    def particles_of(self, cell: ViewCell) -> tuple[FloatArray | None, float]:
        """Return the particles of a view, and their radius."""
        content = cell.content if self.display.particles else None
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

    def show(self, display: Display) -> None:
        """Display the contents in another way; call `refresh` or `show_page` afterwards."""
        before, self.display = self.display, display
        if display.layout != before.layout:
            self.place_cells()
        if display.scheme != before.scheme:
            self.paint()

    def paint(self) -> None:
        """Apply the scheme's colours."""
        self._backdrop.SetBackground(*rgb(self.display.colours.line))
        for cell in self.cells:
            cell.paint(self.display.colours)

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
        self.cells[-1].paint(self.display.colours)
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
        clip = self.display.clip or self.uncovering
        return clip and clip.model_copy(update={"box": clip.box or self.box})

    def _before_drawing(self, *_: object) -> None:
        self._window.SetDPI(_DPI)
        bounds = self.bounds
        if bounds is not None:
            cells = self.cells[: self.count]
            for cell in cells:
                cell.face_camera(bounds)
                cell.cut(self.display.clip or self.uncovering, self.box or bounds)
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
        Red, green, blue, opacity; with the colour scale or the names of structures, if any, at the lower
        edge.
    """
    need_no_display()
    _release_context_of_qt()
    ratio = scale * canvas.ratio
    window: Any = vtkRenderWindow()
    window.SetOffScreenRendering(True)
    window.SetMultiSamples(SMOOTH)
    window.SetAlphaBitPlanes(True)
    window.SetNumberOfLayers(1)
    window.SetSize(round(canvas.width * ratio), round(canvas.height * ratio))
    grid = Grid(window)
    grid.ratio, grid.text, grid.display = ratio, canvas.text, canvas
    grid.paint()
    grid.show_backdrop(not transparent)
    grid.take(shown)
    _look(grid, canvas)
    grid.show_page(canvas.page)
    window.Render()
    pixels = pixels_of(window)
    structures = [] if grid.is_coloured else grid.structures
    grid.close()
    window.Finalize()
    if not transparent:
        pixels[..., 3] = 255
    if shown.scale is not None:
        strip = scale_picture(
            shown.scale, canvas.colours, pixels.shape[1], ratio * canvas.text, transparent=transparent
        )
        pixels = np.concatenate([pixels, strip])
    elif names := [name for name in structures if canvas.layer(name).shown]:
        entries = {name: canvas.layer(name).colour_at(structures.index(name)) for name in names}
        strip = legend_picture(
            entries, canvas.colours, pixels.shape[1], ratio * canvas.text, transparent=transparent
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
