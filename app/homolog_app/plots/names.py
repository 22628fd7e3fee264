"""Names of subjects in a plot, which cover neither each other nor marks."""

from collections.abc import Iterator, Sequence
from textwrap import fill

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.lines import Line2D
from matplotlib.text import Annotation, Text
from matplotlib.transforms import Bbox

from homolog.arrays import BoolArray, FloatArray
from homolog_app.plots.model import FONT_PT, TICK_PT, letters, points_in
from homolog_app.rendering.colours import Colours
from homolog_app.rendering.text import complete_text, shortened

__all__ = ["draw_all_names", "draw_subjects"]

_NOTE = "{} of {} names shown; enlarge the plot for the rest"
_LETTERS = 28  # of a name
_CORNERS = ((8.0, 5.0), (-8.0, 5.0), (8.0, -5.0), (-8.0, -5.0))  # from a mark to its name [points]
_SIDES = ((9.0, 0.0), (-9.0, 0.0), (0.0, 9.0), (0.0, -9.0))
_FAR = (16.0, 24.0, 34.0, 46.0, 60.0)  # distances of names with a leader [points]
_ANGLES = np.radians(
    [20, 160, -20, -160, 60, 120, -60, -120, 0, 180, 90, -90, 40, 140, -40, -140, 75, 105, -75, -105]
)
_MARK, _RING, _LEADER = 4.0, 8.0, 1.5  # radii that names leave free around marks, rings, leaders [points]
_LINE = {"arrowstyle": "-", "linewidth": 0.7, "shrinkA": 0.0, "shrinkB": 3.0}
_STEP = 3.0  # distance of the points that stand for a leader [points]


def draw_all_names(
    axes: Axes, points: FloatArray, names: Sequence[str], selected: Sequence[str], colours: Colours
) -> None:
    """Write all names that have room; below the plot, say how many these are if some are missing."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    figure.draw_without_rendering()  # the layout decides how far marks are apart
    drawn = draw_subjects(axes, points, names, selected, colours)
    if _count(drawn) == len(names):
        return
    for artist in drawn:
        artist.remove()
    room = max(letters(axes, figure.bbox.width), 12)
    note = figure.supxlabel(
        fill(_NOTE.format(0, len(names)), room), x=0.01, ha="left", fontsize=TICK_PT, color=colours.dim
    )
    figure.draw_without_rendering()
    shown = _count(draw_subjects(axes, points, names, selected, colours))
    note.set_text(fill(_NOTE.format(shown, len(names)), room))


def _count(drawn: Sequence[Artist]) -> int:
    return sum(isinstance(artist, Annotation) for artist in drawn)


def draw_subjects(
    axes: Axes,
    points: FloatArray,
    names: Sequence[str],
    selected: Sequence[str],
    colours: Colours,
    *,
    others: bool = True,
) -> list[Artist]:
    """Write names near subjects' points (n, 2), and draw a ring around selected ones.

    `others` names also those that are not selected. A name stands next to its mark or, with a leader, at some
    distance. A name that would cover a mark or another name everywhere, or leave the frame, is left out. The
    axes keep their limits, and their layout must be known.
    """
    drawn: list[Artist] = []
    scale = points_in(axes, 1.0)
    marks = scale * axes.transData.transform(points)
    is_selected = np.array([name in selected for name in names], dtype=bool)
    room = _Room(Bbox(scale * axes.bbox.get_points()))
    room.take(scale * _marks_in(axes), _MARK)
    room.take(marks, _MARK)
    room.take(marks[is_selected], _RING)
    for (x, y), chosen in zip(points, is_selected, strict=True):
        if chosen:
            ring = Line2D([x], [y], marker="o", markersize=13, mfc="none", mec=colours.text, mew=1.5)
            drawn.append(axes.add_artist(ring))
    for index in np.argsort(~is_selected, kind="stable"):
        if not (others or is_selected[index]):
            break
        text = axes.annotate(
            shortened(names[index], _LETTERS),
            tuple(points[index]),
            (0.0, 0.0),
            textcoords="offset points",
            fontsize=FONT_PT if is_selected[index] else TICK_PT,
            color=colours.text,
            zorder=5,
            arrowprops=_LINE | {"color": colours.dim},
            ha="center",
            va="center",
        )
        complete_text(text)
        text.set_in_layout(False)
        place = room.find(marks[index], scale * np.array(Text.get_window_extent(text).size))
        if place is None:
            text.remove()
            continue
        middle, is_far = place
        text.set_position(tuple(middle - marks[index]))
        if text.arrow_patch is not None and not is_far:
            text.arrow_patch.set_visible(False)
        drawn.append(text)
    return drawn


def _marks_in(axes: Axes) -> FloatArray:
    """Return where marks are drawn, (n, 2) [pixels]: subjects and means of groups."""
    drawn = [item for item in axes.collections if isinstance(item, PathCollection)]
    places = [axes.transData.transform(np.asarray(item.get_offsets(), dtype=np.float64)) for item in drawn]
    places += [
        axes.transData.transform(np.asarray(line.get_xydata(), dtype=np.float64))
        for line in axes.lines
        if line.get_marker() not in ("None", "", " ", None)
    ]
    return np.concatenate([np.empty((0, 2)), *places])


class _Room:
    """The free part of a frame, in points."""

    def __init__(self, frame: Bbox) -> None:
        self._frame = frame
        self._boxes: list[Bbox] = []
        self._centres, self._radii = np.empty((0, 2)), np.empty(0)

    def take(self, centres: FloatArray, radius: float) -> None:
        """Leave circles around centres (n, 2) free."""
        self._centres = np.concatenate([self._centres, centres])
        self._radii = np.concatenate([self._radii, np.full(len(centres), radius)])

    def find(self, mark: FloatArray, size: FloatArray) -> tuple[FloatArray, bool] | None:
        """Take the best free place of a name of some size (2,): its middle, and whether it has a leader."""
        for middle, is_far in _places(mark, size):
            box = Bbox([middle - size / 2.0, middle + size / 2.0])
            leader = _leader(mark, box) if is_far else np.empty((0, 2))
            if self._is_free(box) and self._is_passable(leader, mark):
                self._boxes.append(box)
                self.take(leader, _LEADER)
                return middle, is_far
        return None

    def _is_free(self, box: Bbox) -> bool:
        inside = np.all(box.min >= self._frame.min) and np.all(box.max <= self._frame.max)
        away = self._centres - np.clip(self._centres, box.min, box.max)
        return bool(
            inside
            and not box.count_overlaps(self._boxes)
            and (np.linalg.norm(away, axis=1) >= self._radii).all()
        )

    def _is_passable(self, leader: FloatArray, mark: FloatArray) -> bool:
        """Whether a leader from a mark (2,) crosses neither names nor other marks."""
        others = self._others(mark)
        apart = np.linalg.norm(leader[:, None] - self._centres[None, others], axis=2)
        return not any(box.count_contains(leader) for box in self._boxes) and bool(
            (apart >= self._radii[others]).all()
        )

    def _others(self, mark: FloatArray) -> BoolArray:
        return np.asarray(np.linalg.norm(self._centres - mark, axis=1) > 1e-6)


def _places(mark: FloatArray, size: FloatArray) -> Iterator[tuple[FloatArray, bool]]:
    """Yield middles of a name near a mark, the best first, and whether it needs a leader there."""
    for offset in np.array([*_CORNERS, *_SIDES]):
        yield mark + offset + np.sign(offset) * size / 2.0, False
    for distance in _FAR:
        for angle in _ANGLES:
            offset = distance * np.array([np.cos(angle), np.sin(angle)])
            sides = np.where(np.abs(offset) > 0.5 * distance, np.sign(offset), 0.0)
            yield mark + offset + sides * size / 2.0, True


def _leader(mark: FloatArray, box: Bbox) -> FloatArray:
    """Return points (n, 2) of the way from a mark to its name."""
    end = np.clip(mark, box.min, box.max)
    length = float(np.linalg.norm(end - mark))
    steps = np.arange(_MARK, length, _STEP) / max(length, 1e-9)
    return np.asarray(mark + steps[:, None] * (end - mark))
