"""The page of a frame: where pictures, captions and scales go, and how they are drawn on it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.text import Text
from numpy.typing import NDArray

from homolog.arrays import Array, FloatArray
from homolog_app.films.film import Motion
from homolog_app.pictures.layout import draw_displacement_bar
from homolog_app.rendering.camera import Frame, View, frame_around, round_length
from homolog_app.rendering.colours import Theme
from homolog_app.rendering.text import complete_text

__all__ = ["SCALE_SHARE", "Board", "Box", "Cell", "Plan", "make_plan", "turned"]


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


SCALE_SHARE = 0.12
"""Most of the page's width that the scale bar takes."""

_STRIP = 2.0  # caption and scale bar of the page [em]
_BAR_STRIP = 7.0  # colour bar and its words [em]
_LINE = 1.5  # captions of cells [em]
_MARGIN = 0.03


@dataclass(frozen=True, slots=True)
class Cell:
    """One picture: which motion, seen how, where on the page, and the most that the shape takes [pixels]."""

    motion: int
    frame: Frame
    box: Box
    taken: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Plan:
    """A page.

    Attributes
    ----------
    cells : tuple of Cell
        The pictures, all of one scale.
    captions : tuple of (float, float, float)
        Middle and room of each motion's line [pixels].
    names : tuple of (float, float, float, str)
        Middle, room and words of the views' names, where there are several.
    millimetres : float
        Of a pixel.
    bar : Box or None
        The colour bar.
    """

    cells: tuple[Cell, ...]
    captions: tuple[tuple[float, float, float], ...]
    names: tuple[tuple[float, float, float, str], ...]
    millimetres: float
    bar: Box | None


def make_plan(
    motions: Sequence[Motion],
    views: Sequence[View],
    size: tuple[int, int],
    em: float,
    *,
    turntable: bool = False,
    strip: bool = True,
    caption: bool = True,
    bar: bool = False,
    rim: int = 0,
) -> Plan:
    """Lay a page out: a row for each motion and a column for each view, or whatever grid shows them largest.

    Parameters
    ----------
    motions : sequence of Motion
    views : sequence of View
    size : (int, int)
        Width and height of the page [pixels].
    em : float
        Size of the captions' letters [pixels].
    turntable : bool
        Whether the views turn once around.
    strip : bool
        Whether room for a line is left at the lower edge.
    caption : bool
        Whether there are captions.
    bar : bool
        Whether there is a colour bar.
    rim : int
        Room around each picture [pixels].
    """
    edge = max(round(0.6 * em), 6)
    width, height = size
    above = round(_LINE * em) if len(views) > 1 and caption else 0
    below = round(_LINE * em) if len(motions) > 1 and caption else 0
    table = min(len(motions), len(views)) > 1
    head = above if table else 0  # one line of names over a table, one over each picture elsewhere
    area = Box(
        edge,
        edge + head,
        width - 2 * edge - (round(_BAR_STRIP * em) if bar else 0),
        height - 2 * edge - head - (round(_STRIP * em) if strip else 0),
    )
    needs = [[_extent(motion, view, turntable) for view in views] for motion in motions]
    count = len(motions) * len(views)
    grids = [
        _Grid(columns, -(-count // columns), area, above - head, below, rim)
        for columns in ([len(views)] if table else range(1, count + 1))
    ]
    flat = [item for row in needs for item in row]
    millimetres, _, grid = min((grid.scale(flat), index, grid) for index, grid in enumerate(grids))
    boxes = list(grid.boxes(len(flat)))
    inner = [Box(box.x + rim, box.y + rim, box.width - 2 * rim, box.height - 2 * rim) for box in boxes]
    cells = tuple(
        Cell(
            index // len(views), _sized(frame, box, millimetres), box,
            (frame.width / millimetres, frame.height / millimetres),
        )
        for index, (frame, box) in enumerate(zip(flat, inner, strict=True))
    )  # fmt: skip
    middle = area.x + area.width / 2.0
    if len(motions) == 1:
        room = area.width - 2.0 * (SCALE_SHARE * width + 1.5 * em)
        captions = [(middle, height - edge - 0.6 * em, room)]
    else:
        captions = [_below(boxes[at : at + len(views)], em) for at in range(0, len(boxes), len(views))]
    names = [
        (box.x + box.width / 2.0, box.y - 0.6 * em, float(box.width), views[index % len(views)].name)
        for index, box in enumerate(boxes[: len(views)])
        if above
    ]
    place = _bar(area, width, edge, em) if bar else None
    return Plan(cells, tuple(captions), tuple(names), millimetres, place)


def turned(frame: Frame, angle: float) -> Frame:
    """Return a frame seen from further around the picture's upright axis [radians]."""
    right, up, back = frame.view.axes
    toward = np.cos(angle) * back + np.sin(angle) * right
    view = View(_triple(toward), _triple(up), frame.view.name)
    return Frame(view, frame.centre, frame.width, frame.height, frame.depth)


class _Grid:
    """Equal cells, each with a line above and below its picture."""

    def __init__(self, columns: int, rows: int, area: Box, above: int, below: int, rim: int) -> None:
        self.columns, self.rows, self.area, self.above, self.rim = columns, rows, area, above, rim
        self.width = area.width // columns - 2 * rim
        self.height = area.height // rows - above - below - 2 * rim

    def scale(self, frames: Sequence[Frame]) -> float:
        """Return the millimetres of a pixel with which all the frames fit into cells."""
        if min(self.width, self.height) < 8:
            return np.inf
        return max(max(frame.width / self.width, frame.height / self.height) for frame in frames)

    def boxes(self, count: int) -> Iterator[Box]:
        """Yield where the pictures go; a last row that is not full stands in the middle."""
        for index in range(count):
            row, column = divmod(index, self.columns)
            missing = self.columns - min(self.columns, count - row * self.columns)
            x = self.area.x + round((column + missing / 2.0) * self.area.width / self.columns)
            y = self.area.y + row * (self.area.height // self.rows) + self.above
            yield Box(x, y, self.width + 2 * self.rim, self.height + 2 * self.rim)


def _extent(motion: Motion, view: View, turntable: bool) -> Frame:
    """Return the smallest frame that holds a motion all the time."""
    ends = [motion.at(amount).vertices for amount in sorted({motion.low, motion.high})]
    if not turntable:
        return frame_around(ends, view)
    points = np.concatenate(ends)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
    upright = view.axes[1]
    along = (points - middle) @ upright
    radius = float(np.linalg.norm(points - middle - along[:, None] * upright, axis=1).max())
    centre = middle + upright * (along.min() + along.max()) / 2.0
    rim = 2.0 * _MARGIN * radius
    return Frame(view, _triple(centre), 2.0 * radius + rim, float(np.ptp(along)) + rim, 2.0 * radius + rim)


def _sized(frame: Frame, box: Box, millimetres: float) -> Frame:
    return Frame(frame.view, frame.centre, box.width * millimetres, box.height * millimetres, frame.depth)


def _below(boxes: Sequence[Box], em: float) -> tuple[float, float, float]:
    """Return middle and room of the line below the pictures of one motion."""
    left, right = boxes[0].x, boxes[-1].x + boxes[-1].width
    bottom = boxes[-1].y + boxes[-1].height
    return (left + right) / 2.0, bottom + 0.7 * em, 0.88 * (right - left)


def _bar(area: Box, width: int, edge: int, em: float) -> Box:
    length = round(min(0.6 * area.height, 14.0 * em))
    middle = width - edge - _BAR_STRIP * em / 2.0
    thick = max(round(0.8 * em), 6)
    return Box(round(middle - em), round(area.y + (area.height - length) / 2.0), thick, length)


def _triple(values: FloatArray) -> tuple[float, float, float]:
    x, y, z = map(float, values)
    return x, y, z
