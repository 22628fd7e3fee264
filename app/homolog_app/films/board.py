"""A page of so many pixels: what stands still is drawn once, captions and images anew in each frame."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.text import Text
from numpy.typing import NDArray

from homolog.arrays import Array
from homolog_app.fonts import complete_text
from homolog_app.pictures.layout import draw_displacement_bar
from homolog_app.rendering.colours import Theme
from homolog_app.rendering.views import round_length

__all__ = ["Board", "Box"]

_DPI = 100.0
_LEAST_TEXT = 8.0


@dataclass(frozen=True, slots=True)
class Box:
    """A rectangle of pixels; `x`, `y` is its upper left corner."""

    x: int
    y: int
    width: int
    height: int


class Board:
    """The page and its texts. Sizes are pixels; `em` is the size of the captions' letters."""

    def __init__(self, width: int, height: int, theme: Theme, *, transparent: bool = False) -> None:
        self.width, self.height = width, height
        self.em = float(np.clip(0.032 * min(height, 0.75 * width), 12.0, 80.0))
        self._theme = theme
        paper = "none" if transparent else theme.background
        self._figure = Figure(figsize=(width / _DPI, height / _DPI), dpi=_DPI, facecolor=paper)
        self._canvas = FigureCanvasAgg(self._figure)
        self._changing: list[Text] = []
        self._still: object | None = None

    def text(self, x: float, y: float, content: str, *, room: float, size: float = 1.0) -> Text:
        """Add a line centred on (x, y), size in em; letters shrink until the line fits into the room."""
        points = size * self.em * 72.0 / _DPI
        text = self._figure.text(
            x / self.width, 1.0 - y / self.height, content, ha="center", va="center", color=self._theme.text,
            fontsize=points,
        )  # fmt: skip
        complete_text(text)
        taken = text.get_window_extent().width
        text.set_fontsize(max(points * min(room / taken, 1.0), _LEAST_TEXT * 72.0 / _DPI))
        return text

    def changing_text(self, x: float, y: float, content: str, *, room: float, size: float = 1.0) -> Text:
        """Add a line that is drawn anew in each frame; `words` are its longest."""
        text = self.text(x, y, content, room=room, size=size)
        text.set_animated(True)
        self._changing.append(text)
        return text

    def scale_bar(self, x: float, y: float, most: float, millimetres_a_pixel: float) -> None:
        """Draw a bar of a round length, at most so many pixels long, from (x, y) to the right."""
        length = round_length(most * millimetres_a_pixel)
        pixels = length / millimetres_a_pixel
        thick = max(round(0.15 * self.em), 2)
        bar = Rectangle(
            (x / self.width, 1.0 - (y + thick) / self.height), pixels / self.width, thick / self.height,
            color=self._theme.text, linewidth=0.0,
        )  # fmt: skip
        self._figure.add_artist(bar)
        label = self.text(x + pixels / 2.0, y - 0.6 * self.em, f"{length:g} mm", room=8.0 * self.em, size=0.8)
        label.set_x(max(label.get_position()[0], (x + 2.0 * self.em) / self.width))

    def colour_bar(self, box: Box, limit: float) -> None:
        """Draw the scale of the displacement colours from -limit to limit [mm]."""
        place = self._figure.add_axes(
            (
                box.x / self.width,
                1.0 - (box.y + box.height) / self.height,
                box.width / self.width,
                box.height / self.height,
            )
        )
        draw_displacement_bar(place, limit, self._theme, 0.7 * self.em * 72.0 / _DPI)

    def compose(self, images: Sequence[tuple[Box, Array]]) -> NDArray[np.uint8]:
        """Return the page with images (red, green, blue, opacity; uint8) laid upon it, (H, W, 4)."""
        if self._still is None:
            self._canvas.draw()  # type: ignore[no-untyped-call]
            self._still = self._canvas.copy_from_bbox(self._figure.bbox)  # type: ignore[no-untyped-call]
        self._canvas.restore_region(self._still)  # type: ignore[no-untyped-call]
        for text in self._changing:
            complete_text(text)
            self._figure.draw_artist(text)
        page = np.array(self._canvas.buffer_rgba())  # type: ignore[no-untyped-call]
        for box, image in images:
            seen = image[..., 3] > 0
            rows, columns = (slice(*_ends(np.asarray(seen.any(axis=axis)))) for axis in (1, 0))
            part = page[box.y : box.y + box.height, box.x : box.x + box.width][rows, columns]
            _lay(image[rows, columns], part)
        return np.asarray(page, dtype=np.uint8)


def _ends(filled: Array) -> tuple[int, int]:
    """Return where the first run to the last true value begins and ends."""
    there = np.flatnonzero(filled)
    return (int(there[0]), int(there[-1]) + 1) if len(there) else (0, 0)


def _lay(image: Array, part: NDArray[np.uint8]) -> None:
    """Lay an image over a part of the page; only its few edge pixels have to be mixed."""
    opacity = image[..., 3]
    opaque = opacity == 255
    np.copyto(part, image, where=opaque[..., None])
    edge = (opacity > 0) & ~opaque
    part[edge] = _over(image[edge], part[edge])


def _over(image: Array, page: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Mix pixels (n, 4) of an image and the page, both with straight (not premultiplied) opacity."""
    front, behind = image[..., 3:] / np.float32(255.0), page.astype(np.float32)
    mixed = behind + front * (image - behind)
    mixed[..., 3:] = behind[..., 3:] + front * (255.0 - behind[..., 3:])
    clear = page[..., 3] < 255
    if clear.any():  # what is behind counts as much as it is opaque
        share, own = mixed[clear, 3:], 255.0 * front[clear]
        colour = own * image[clear, :3] + (share - own) * behind[clear, :3]
        mixed[clear, :3] = colour / np.maximum(share, 1e-4)
    return np.asarray(np.rint(mixed), dtype=np.uint8)
