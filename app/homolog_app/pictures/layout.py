"""Layout of panels with captions and colour bars; views of regions."""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from homolog.arrays import Array, FloatArray, IntArray
from homolog.io.atomic import atomic_write
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.pictures.png import png_of
from homolog_app.rendering.camera import View, frame_around
from homolog_app.rendering.colours import LIGHT, ColourScale, Theme, displacement_scale
from homolog_app.rendering.rays import Software
from homolog_app.rendering.scene import Scene, Surface
from homolog_app.rendering.text import complete_texts

__all__ = [
    "Panel",
    "arrange",
    "draw_colour_bar",
    "view_of_region",
    "write_picture",
]


_GLANCE = 72
"""Width [pixels] of the picture in which a region's visible part is counted."""


def view_of_region(mesh: TriangleMesh, vertices: IntArray, centre: int) -> View:
    """Return the direction from which most of a region is visible.

    Parameters
    ----------
    mesh : TriangleMesh
    vertices : (n,) int array
        Vertices of the region.
    centre : int
        Its central vertex, whose normal is tried first.
    """
    marked = np.zeros(mesh.vertices.shape, np.uint8)
    marked[vertices] = 255
    scene, software = Scene((Surface(mesh.vertices, mesh.vertex_normals, mesh.faces, marked),)), Software()
    ways = [np.array(way, dtype=np.float64) for way in product((-1, 0, 1), repeat=3) if any(way)]
    views = [_view(way) for way in [mesh.vertex_normals[centre], *ways]]
    width = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))  # the same scale for all
    seen = [
        float(image[..., :3].sum())
        for image in (
            software.draw(scene, frame_around([mesh.vertices], view, width=width), _GLANCE) for view in views
        )
    ]
    return views[int(np.argmax(seen))]


def _view(toward: FloatArray) -> View:
    x, y, z = (toward / np.linalg.norm(toward)).tolist()
    return View((x, y, z), (0.0, 0.0, 1.0) if abs(z) < 0.9 else (0.0, -1.0, 0.0))


_DPI = 200
_UNDATED = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
_FONT_PT = 8.5
_TITLE_PT = 10.5
# Lengths on the page [inches].
_LINE = 0.19
_GAP = 0.12
_GROUP_GAP = 0.25
_EDGE = 0.15
_ROW_LABEL = 0.30
_BAR_AREA, _BAR_WIDTH, _BAR_LENGTH = 1.15, 0.15, 2.4


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """One image with a caption below it.

    Attributes
    ----------
    image : (H, W, 4) uint8 array
        Red, green, blue, opacity.
    caption : str
        Caption of one line; may be empty.
    """

    image: Array
    caption: str = ""


class _PixelImage(AxesImage):
    """An image that is copied if its pixels are those of the page, since resampling is slow."""

    def set_data(self, A: Any) -> None:  # noqa: ANN401 - matplotlib's name
        self._A = A  # bytes, which need no check for missing values
        self.stale = True

    def make_image(
        self,
        renderer: Any,  # noqa: ANN401
        magnification: float = 1.0,
        unsampled: bool = False,
    ) -> Any:  # noqa: ANN401
        left, right, bottom, top = self.get_extent()
        low, high = self.get_transform().transform([(left, bottom), (right, top)])
        pixels = np.asarray(self.get_array())
        if unsampled or tuple(np.round(high - low)) != pixels.shape[1::-1]:
            return super().make_image(renderer, magnification, unsampled)
        return np.ascontiguousarray(pixels[::-1]), *np.round(low), None


class _Page:
    """A figure with lengths in inches from the upper left corner."""

    def __init__(self, width: float, height: float, theme: Theme) -> None:
        self.figure = Figure(figsize=(width, height), dpi=_DPI, facecolor=theme.background)
        FigureCanvasAgg(self.figure)
        self._size = width, height
        self._theme = theme
        self._images: Axes | None = None

    def axes(self, x: float, y: float, w: float, h: float) -> Axes:
        """Return axes whose upper left corner is at (x, y)."""
        width, height = self._size
        return self.figure.add_axes((x / width, 1.0 - (y + h) / height, w / width, h / height))

    def image(self, x: float, y: float, w: float, h: float, pixels: Array) -> None:
        """Draw an image whose upper left corner is at (x, y).

        All images share one axes object, since axes are slow to create.
        """
        if self._images is None:
            width, height = self._size
            self._images = self.axes(0.0, 0.0, width, height)
            self._images.axis("off")
            limits = {"xlim": (0.0, width), "ylim": (height, 0.0), "autoscale_on": False}
            self._images.set(xticks=(), yticks=(), **limits)  # ticks are slow to create, even invisible ones
        image = _PixelImage(self._images, interpolation="none", origin="upper", extent=(x, x + w, y + h, y))
        image.set_data(pixels)
        image.set_clip_path(self._images.patch)
        self._images.add_image(image)

    def text(self, x: float, y: float, content: str, size: float = _FONT_PT, **style: Any) -> None:  # noqa: ANN401
        """Draw text centred on x."""
        width, height = self._size
        style = {"ha": "center", "va": "top", "fontsize": size, "color": self._theme.text, **style}
        self.figure.text(x / width, 1.0 - y / height, content, **style)


def arrange(
    rows: Sequence[Sequence[Panel]],
    *,
    title: str = "",
    row_labels: Sequence[str] = (),
    headings: Sequence[str] = (),
    limit: float | None = None,
    scale: ColourScale | None = None,
    theme: Theme = LIGHT,
) -> Figure:
    """Lay out panels in a grid, with one page pixel per image pixel.

    Parameters
    ----------
    rows : sequence of rows of Panel
        Rows may differ in length and height.
    title : str
        Heading over everything.
    row_labels : sequence of str
        A label along the left side of each row.
    headings : sequence of str
        Headings that divide the columns evenly, from the left.
    limit : float, optional
        If given, draw the bar of the displacement colours, from -limit to limit [mm].
    scale : ColourScale, optional
        If given, draw the bar of this scale.
    theme : Theme
        Background and text.
    """
    panels = [panel for row in rows for panel in row]
    if limit and scale is None:
        scale = displacement_scale(limit)
    wide = max(panel.image.shape[1] for panel in panels) / _DPI
    heights = [max(panel.image.shape[0] for panel in row) / _DPI for row in rows]
    caption = _LINE if any(panel.caption for panel in panels) else 0.0
    columns = max(len(row) for row in rows)
    left = _EDGE + (_ROW_LABEL if row_labels else 0.0)
    top = _EDGE + (_LINE * 1.6 if title else 0.0) + (_LINE * 1.3 if headings else 0.0)
    groups = max(len(headings), 1)
    right = left + columns * (wide + _GAP) - _GAP + (groups - 1) * _GROUP_GAP
    bottom = top + sum(heights) + len(rows) * (caption + _GAP) - _GAP
    bottom = max(bottom, top + _BAR_LENGTH / 2.0 + 4.0 * _LINE) if scale else bottom
    page = _Page(right + _EDGE + (_BAR_AREA if scale else 0.0), bottom + _EDGE, theme)
    if title:
        page.text((left + right) / 2.0, _EDGE, title, _TITLE_PT)
    for index, heading in enumerate(headings):
        middle = left + (index + 0.5) * (right - left) / len(headings)
        page.text(middle, top - _LINE * 1.3, heading, _FONT_PT + 1.0, weight="bold")
    y = top
    for index, (row, high) in enumerate(zip(rows, heights, strict=True)):
        if row_labels:
            page.text(_EDGE, y + high / 2.0, row_labels[index], ha="left", va="center", rotation=90)
        for column, panel in enumerate(row):
            x = left + column * (wide + _GAP) + column * groups // columns * _GROUP_GAP
            h, w = (side / _DPI for side in panel.image.shape[:2])
            page.image(x + (wide - w) / 2.0, y + (high - h) / 2.0, w, h, panel.image)
            page.text(x + wide / 2.0, y + high + 0.02, panel.caption)
        y += high + caption + _GAP
    if scale:
        length = min(bottom - top - 4.5 * _LINE, _BAR_LENGTH)
        x = right + _EDGE + (_BAR_AREA - _BAR_WIDTH) / 2.0
        draw_colour_bar(page.axes(x, (top + bottom - length) / 2.0, _BAR_WIDTH, length), scale, theme)
    return page.figure


def draw_colour_bar(place: Axes, scale: ColourScale, theme: Theme, font_pt: float = _FONT_PT) -> None:
    """Draw the colours of a scale that is symmetric about 0, with its labels."""
    colours = ScalarMappable(Normalize(scale.low, scale.high), ListedColormap(scale.table / 255.0))
    ticks = np.linspace(scale.low, scale.high, 5)
    bar = place.figure.colorbar(colours, cax=place, ticks=ticks)
    bar.ax.set_yticklabels([f"{tick:+.3g}".replace("-", "−") if tick else "0" for tick in ticks])
    bar.ax.tick_params(labelsize=font_pt, colors=theme.text, length=2.5)
    bar.outline.set_edgecolor(theme.text)
    bar.outline.set_linewidth(0.5)
    style: dict[str, Any] = {
        "xycoords": "axes fraction",
        "textcoords": "offset points",
        "ha": "center",
        "color": theme.text,
        "fontsize": font_pt,
    }
    high, low = (f"{end}\n({scale.unit})" for end in (scale.high_label, scale.low_label))
    place.annotate(high, (0.5, 1.0), (0.0, 0.7 * font_pt), va="bottom", **style)
    place.annotate(low, (0.5, 0.0), (0.0, -0.7 * font_pt), va="top", **style)


def write_picture(figure: Figure, path: Path) -> None:
    """Store a picture as PNG, PDF or SVG, by the path's suffix, atomically.

    The output is reproducible: the same picture gives the same bytes.

    Raises
    ------
    InputError
        If the file can't be written.
    """
    complete_texts(figure)
    drawn, kind = io.BytesIO(), path.suffix.lower().removeprefix(".")  # some backends leave files open
    with rc_context({"svg.hashsalt": "homolog", "svg.fonttype": "none", "image.composite_image": False}):
        figure.savefig(
            drawn,
            format="rgba" if kind == "png" else kind,
            dpi=_DPI,
            facecolor=figure.get_facecolor(),
            metadata=_UNDATED.get(path.suffix),
        )
    content = drawn.getvalue()
    if kind == "png":
        width = int(figure.get_figwidth() * _DPI)
        content = png_of(np.frombuffer(content, np.uint8).reshape(-1, width, 4), _DPI)
    with atomic_write(path) as part:
        part.write_bytes(content)
