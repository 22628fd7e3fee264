"""Motions (the mean along a mode, or from one group's mean to another's), and the layout of the page."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from homolog.arrays import FloatArray
from homolog.errors import InputError
from homolog.io.results import Result
from homolog.statistics.reconstruction import warp_surface
from homolog.statistics.shape_model import ShapeModel
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.rendering.camera import Frame, View, frame_around
from homolog_app.rendering.colours import structure_colour

__all__ = [
    "SCALE_SHARE",
    "Box",
    "Motion",
    "Plan",
    "ViewCell",
    "group_means",
    "group_motion",
    "make_plan",
    "mode_motions",
    "static_motion",
    "turned",
]


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A surface that moves linearly.

    Attributes
    ----------
    start : TriangleMesh
        The surface at an amount of 0.
    displacement : (V, 3) array
        Displacement of its vertices at an amount of 1 [mm].
    low, high : float
        Amounts at the ends of the motion.
    label : function of the amount
        Returns the caption.
    structures : mapping of str to tuple of 3 int
        Colour of each of several structures, red, green, blue in 0 ... 255; empty for a single one.
    """

    start: TriangleMesh
    displacement: FloatArray
    low: float
    high: float
    label: Callable[[float], str]
    structures: Mapping[str, tuple[int, int, int]] = field(default_factory=dict)

    @property
    def colours(self) -> FloatArray | None:
        """Colour of each vertex of several structures, red, green, blue in [0, 1]; None for a single one."""
        if not self.structures:
            return None
        counts = [len(part.vertices) for part in self.start.parts]
        return np.repeat(list(self.structures.values()), counts, axis=0) / 255.0

    @property
    def moves(self) -> bool:
        """Whether the surface moves."""
        return self.high > self.low

    def at(self, amount: float) -> TriangleMesh:
        """Return the surface moved by an amount."""
        return self.start.moved(self.start.vertices + amount * self.displacement)


def mode_motions(result: Result, modes: Sequence[int], deviations: float) -> list[Motion]:
    """Return the mean surface moving along each of some modes.

    Parameters
    ----------
    result : Result
    modes : sequence of int
        Counted from 1.
    deviations : float
        Range on both sides, in standard deviations.

    Raises
    ------
    InputError
        If there is no such mode.
    """
    model = ShapeModel().fit(result.world, names=result.names)
    count = len(model.explained_variance_)
    for mode in modes:
        if not 1 <= mode <= count:
            raise InputError(f"mode {mode}: the result has {count} modes; choose one from 1 to {count}")
    chosen = np.array(modes) - 1
    moves = _warp(result, (model.components_ * model.standard_deviations_[:, None, None])[chosen])
    return [
        Motion(
            result.mean_surface,
            move,
            -deviations,
            deviations,
            _mode_text(model, mode, result),
            _structures(result),
        )
        for mode, move in zip(chosen.tolist(), moves, strict=True)
    ]


def _mode_text(model: ShapeModel, mode: int, result: Result) -> Callable[[float], str]:
    aside = f", {result.mirrored} mirrored" if result.mirrored else ""
    title = f"Mode {mode + 1} ({100.0 * model.explained_variance_ratio_[mode]:.1f} % of variance{aside})"
    return lambda amount: f"{title}   {_signed(amount)} SD"


def group_means(result: Result, column: str, groups: Sequence[str]) -> list[FloatArray]:
    """Return the mean particles of some groups of a column, (N, 3) each [mm].

    Raises
    ------
    InputError
        If there is no such column, or a group is empty.
    """
    from homolog.comparison.sample import column_of, levels

    labels = np.array(column_of(result, column))
    for group in groups:
        if group not in labels:
            known = ", ".join(levels(labels.tolist())) or "no values; fill in the column first"
            raise InputError(f"column {column!r}: no subject is in {group!r}; groups are: {known}")
    return [result.world[labels == group].mean(axis=0) for group in groups]


def group_motion(result: Result, column: str, first: str, second: str) -> Motion:
    """Return the motion from one group's mean to another's; raises as `group_means` does."""
    start, end = group_means(result, column, [first, second])
    mean = result.world.mean(axis=0)
    aside = f" ({result.mirrored} mirrored)" if result.mirrored else ""
    to_start, move = _warp(result, np.stack([start - mean, end - start]))

    def label(amount: float) -> str:
        percent = f"{100.0 * amount:.0f}".rjust(3, "\u2007")  # figure space, so that the line keeps its width
        return f"{column}: {first} → {second}{aside}   {percent} %"

    mesh = result.mean_surface
    return Motion(mesh.moved(mesh.vertices + to_start), move, 0.0, 1.0, label, _structures(result))


def static_motion(result: Result) -> Motion:
    """Return the mean surface at rest."""
    surface = result.mean_surface
    label = f"Mean shape ({result.mirrored} mirrored)" if result.mirrored else "Mean shape"
    return Motion(surface, np.zeros_like(surface.vertices), 0.0, 0.0, lambda _: label, _structures(result))


def _structures(result: Result) -> dict[str, tuple[int, int, int]]:
    return {part.name: structure_colour(place) for place, part in enumerate(result.parts)}


def _warp(result: Result, displacements: FloatArray) -> FloatArray:
    """Return displacements (K, V, 3) of the mean surface for those of the mean particles (K, N, 3) [mm]."""
    mean = result.world.mean(axis=0)
    return warp_surface(mean, result.mean_surface.vertices, displacements, result.smoothing, result.pieces)


def _signed(amount: float) -> str:
    text = f"{amount:+.1f}".replace("-", "−")
    return "0.0" if text[1:] == "0.0" else text


SCALE_SHARE = 0.12
"""Largest fraction of the page's width for the scale bar."""

_STRIP = 2.0  # caption and scale bar of the page [em]
_BAR_STRIP = 7.0  # colour bar with labels [em]
_LINE = 1.5  # captions of cells [em]
_MARGIN = 0.03


@dataclass(frozen=True, slots=True)
class Box:
    """A rectangle of pixels; `x`, `y` is its upper left corner."""

    x: int
    y: int
    width: int
    height: int


@dataclass(frozen=True, slots=True)
class ViewCell:
    """One picture: motion, view, position on the page, and largest extent of the shape [pixels]."""

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
        The pictures, all at the same scale.
    captions : tuple of (float, float, float)
        Centre and available width of each motion's line [pixels].
    names : tuple of (float, float, float, str)
        Centre, available width and text of the views' names, if there are several views.
    millimetres : float
        Millimetres per pixel.
    bar : Box or None
        The colour bar.
    """

    cells: tuple[ViewCell, ...]
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
    """Lay out a page: one row per motion and one column per view, or the grid with the largest pictures.

    Parameters
    ----------
    motions : sequence of Motion
    views : sequence of View
    size : (int, int)
        Width and height of the page [pixels].
    em : float
        Size of the captions' letters [pixels].
    turntable : bool
        Whether the views rotate once.
    strip : bool
        Whether to reserve space for a line at the lower edge.
    caption : bool
        Whether there are captions.
    bar : bool
        Whether there is a colour bar.
    rim : int
        Margin of each picture [pixels].
    """
    edge = max(round(0.6 * em), 6)
    width, height = size
    above = round(_LINE * em) if len(views) > 1 and caption else 0
    below = round(_LINE * em) if len(motions) > 1 and caption else 0
    table = min(len(motions), len(views)) > 1
    head = above if table else 0  # a line of names above a table, otherwise above each picture
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
        ViewCell(
            index // len(views),
            _sized(frame, box, millimetres),
            box,
            (frame.width / millimetres, frame.height / millimetres),
        )
        for index, (frame, box) in enumerate(zip(flat, inner, strict=True))
    )
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
    """Return a frame rotated about the picture's vertical axis [radians]."""
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
        """Return the smallest scale [mm/pixel] at which all frames fit into cells."""
        if min(self.width, self.height) < 8:
            return np.inf
        return max(max(frame.width / self.width, frame.height / self.height) for frame in frames)

    def boxes(self, count: int) -> Iterator[Box]:
        """Yield the positions of the pictures; an incomplete last row is centred."""
        for index in range(count):
            row, column = divmod(index, self.columns)
            missing = self.columns - min(self.columns, count - row * self.columns)
            x = self.area.x + round((column + missing / 2.0) * self.area.width / self.columns)
            y = self.area.y + row * (self.area.height // self.rows) + self.above
            yield Box(x, y, self.width + 2 * self.rim, self.height + 2 * self.rim)


def _extent(motion: Motion, view: View, turntable: bool) -> Frame:
    """Return the smallest frame that contains the whole motion."""
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
    """Return centre and available width of the line below the pictures of one motion."""
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
