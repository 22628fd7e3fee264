"""What films and stills show: shapes that move, frame by frame."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.text import Text
from numpy.typing import NDArray

from homolog.analysis.reconstruction import warp_surface
from homolog.analysis.shape_model import ShapeModel
from homolog.arrays import FloatArray
from homolog.errors import InputError
from homolog.files.results import Result
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.films.page import SCALE_SHARE, Board, Box, Cell, make_plan, turned
from homolog_app.films.settings import Background, Colouring, FilmSettings, PictureSettings, camera_view
from homolog_app.pictures import (
    DARK,
    LIGHT,
    VIEWS,
    View,
    common_limit,
    outward_displacement,
    three_quarter_view,
)
from homolog_app.rendering.camera import Clip, Frame, cut_of
from homolog_app.rendering.colours import Theme, diverging_colours
from homolog_app.rendering.draw import draw
from homolog_app.rendering.rays import hollows
from homolog_app.rendering.scene import Scene, surface
from homolog_app.rendering.text import edge_letters

__all__ = ["Film", "Motion", "group_means", "group_motion", "mode_motions", "standing"]


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A surface that moves on straight lines.

    Attributes
    ----------
    start : TriangleMesh
        Where nothing has moved.
    displacement : (V, 3) array
        How its vertices move for an amount of 1 [mm].
    low, high : float
        Amounts at the ends.
    label : function of the amount
        The caption: what is shown, and how far it has moved.
    """

    start: TriangleMesh
    displacement: FloatArray
    low: float
    high: float
    label: Callable[[float], str]

    @property
    def moves(self) -> bool:
        """Whether it moves at all."""
        return self.high > self.low

    def at(self, amount: float) -> TriangleMesh:
        """Return the surface moved by an amount."""
        return TriangleMesh(self.start.vertices + amount * self.displacement, self.start.faces)


def mode_motions(result: Result, modes: Sequence[int], deviations: float) -> list[Motion]:
    """Return the mean surface moving along each of some modes.

    Parameters
    ----------
    result : Result
    modes : sequence of int
        Counted from 1.
    deviations : float
        How far to either side, in standard deviations.

    Raises
    ------
    InputError
        If there is no such mode.
    """
    model = ShapeModel.fit(result.world, names=result.names)
    count = len(model.explained_variance)
    for mode in modes:
        if not 1 <= mode <= count:
            raise InputError(f"mode {mode}: the result has {count} modes; choose one from 1 to {count}")
    chosen = np.array(modes) - 1
    moves = _carried(result, (model.components * model.standard_deviations[:, None, None])[chosen])
    return [
        Motion(result.mean_surface, move, -deviations, deviations, _mode_words(model, mode, result))
        for mode, move in zip(chosen.tolist(), moves, strict=True)
    ]


def _mode_words(model: ShapeModel, mode: int, result: Result) -> Callable[[float], str]:
    aside = f", {result.mirrored} mirrored" if result.mirrored else ""
    title = f"Mode {mode + 1} ({100.0 * model.explained_variance_ratio[mode]:.1f} % of variance{aside})"
    return lambda amount: f"{title}   {_signed(amount)} SD"


def group_means(result: Result, column: str, groups: Sequence[str]) -> list[FloatArray]:
    """Return the mean particles of some groups of a column, (N, 3) each [mm].

    Raises
    ------
    InputError
        If there is no such column or nobody is in one of the groups.
    """
    from homolog_app.report.study import column_of, levels  # brings slow imports along

    labels = np.array(column_of(result, column))
    for group in groups:
        if group not in labels:
            there = ", ".join(levels(labels.tolist())) or "no values; fill in the column first"
            raise InputError(f"column {column!r}: no subject is in {group!r}; groups are: {there}")
    return [result.world[labels == group].mean(axis=0) for group in groups]


def group_motion(result: Result, column: str, first: str, second: str) -> Motion:
    """Return the surface that goes from one group's mean to another's; raises as `group_means` does."""
    start, end = group_means(result, column, [first, second])
    mean = result.world.mean(axis=0)
    aside = f" ({result.mirrored} mirrored)" if result.mirrored else ""
    to_start, move = _carried(result, np.stack([start - mean, end - start]))

    def label(amount: float) -> str:
        percent = f"{100.0 * amount:.0f}".rjust(3, "\u2007")  # as wide as a digit: the line stands still
        return f"{column}: {first} → {second}{aside}   {percent} %"

    mesh = result.mean_surface
    return Motion(TriangleMesh(mesh.vertices + to_start, mesh.faces), move, 0.0, 1.0, label)


def standing(result: Result) -> Motion:
    """Return the mean surface at rest."""
    surface = result.mean_surface
    label = f"Mean shape ({result.mirrored} mirrored)" if result.mirrored else "Mean shape"
    return Motion(surface, np.zeros_like(surface.vertices), 0.0, 0.0, lambda _: label)


def _carried(result: Result, displacements: FloatArray) -> FloatArray:
    """Return how the mean surface's vertices move (K, V, 3) when the mean particles do (K, N, 3) [mm]."""
    mean = result.world.mean(axis=0)
    return warp_surface(mean, result.mean_surface.vertices, displacements, result.smoothing)


def _signed(amount: float) -> str:
    text = f"{amount:+.1f}".replace("-", "−")
    return "0.0" if text[1:] == "0.0" else text


_RIM = 1.4  # letters around a picture [em]
_THEMES = {Background.LIGHT: LIGHT, Background.DARK: DARK}


class Film:
    """Draws motions at any moment; all share one scale, one view direction each column, one colour scale.

    Parameters
    ----------
    motions : sequence of Motion
        At least one.
    sights : sequence of str
        Of `settings.SIGHTS`, or cameras (`settings.camera_sight`); at least one.
    settings : PictureSettings
        Size, colours, captions.
    turntable : bool
        Whether the views turn.
    transparent : bool
        Whether there is no background.

    Raises
    ------
    InputError
        If the page is too small for so many pictures.
    """

    def __init__(
        self,
        motions: Sequence[Motion],
        sights: Sequence[str],
        settings: PictureSettings,
        *,
        turntable: bool = False,
        transparent: bool = False,
    ) -> None:
        theme = _THEMES[settings.background]
        coloured = settings.colours is Colouring.DISPLACEMENT and any(motion.moves for motion in motions)
        limit = _limit(motions) if coloured else None
        self._board = Board(settings.width, settings.height, theme, transparent=transparent)
        one_line = settings.caption and len(motions) == 1
        plan = make_plan(
            motions,
            _views(motions, sights),
            (settings.width, settings.height),
            self._board.em,
            turntable=turntable,
            strip=settings.scale_bar or one_line,
            caption=settings.caption,
            bar=coloured,
            rim=round(_RIM * self._board.em) if settings.directions else 0,
        )
        if not np.isfinite(plan.millimetres):
            raise InputError(
                f"{settings.width} x {settings.height} pixels are too few for {len(plan.cells)} pictures; "
                "choose a larger size, fewer modes or fewer views"
            )
        self._actors = [_Actor(motion, theme, limit, settings.cutting) for motion in motions]
        self._cells = plan.cells
        self._captions = [
            self._board.changing_text(x, y, motion.label(motion.low), room=room)
            for motion, (x, y, room) in zip(motions, plan.captions, strict=True)
            if settings.caption
        ]
        for x, y, room, name in plan.names:
            self._board.text(x, y, name, room=room, size=0.8)
        self.letters = [self._letters_of(cell) for cell in self._cells] if settings.directions else []
        if settings.scale_bar:
            em = self._board.em
            most = SCALE_SHARE * settings.width
            self._board.scale_bar(0.8 * em, settings.height - 0.9 * em, most, plan.millimetres)
        if plan.bar is not None and limit is not None:
            self._board.colour_bar(plan.bar, limit)

    @property
    def boxes(self) -> tuple[Box, ...]:
        """Where on the page the pictures are, motion by motion."""
        return tuple(cell.box for cell in self._cells)

    def draw(self, share: float, turn: float = 0.0) -> NDArray[np.uint8]:
        """Return the page at a moment, shape (height, width, 4).

        Parameters
        ----------
        share : float
            Way from the low end of each motion, 0, to its high end, 1.
        turn : float
            Of the views around the upright axis [radians].
        """
        for actor in self._actors:
            actor.go(share)
        for text, actor in zip(self._captions, self._actors, strict=False):
            text.set_text(actor.motion.label(actor.amount(share)))
        frames = [turned(cell.frame, turn) for cell in self._cells]
        for texts, frame in zip(self.letters, frames, strict=False):
            right, up, _ = frame.view.axes
            for text, letters in zip(texts, edge_letters(np.eye(3), right, up), strict=True):
                text.set_text(letters)
        return self._board.compose(
            [
                (cell.box, self._actors[cell.motion].draw(frame, cell.box.width))
                for cell, frame in zip(self._cells, frames, strict=True)
            ]
        )

    def _letters_of(self, cell: Cell) -> list[Text]:
        """Return the texts at the left, right, lower and upper edge of a shape."""
        em, box = self._board.em, cell.box
        x, y = box.x + box.width / 2.0, box.y + box.height / 2.0
        across, along = ((size + _RIM * em) / 2.0 for size in cell.taken)
        places = ((x - across, y), (x + across, y), (x, y + along), (x, y - along))
        return [self._board.changing_text(*place, "LA", room=_RIM * em, size=0.7) for place in places]

    def moment(self, index: int, settings: FilmSettings) -> NDArray[np.uint8]:
        """Return a frame of a film: going smoothly up and, in a loop, down again."""
        whole = settings.frames if settings.loop else settings.frames - 1
        way = 2.0 * np.pi * index / whole if settings.loop else np.pi * index / whole
        turn = 2.0 * np.pi * index / settings.frames if settings.turntable else 0.0
        return self.draw(float(0.5 - 0.5 * np.cos(way)), turn)


class _Actor:
    """A motion with its renderer."""

    def __init__(self, motion: Motion, theme: Theme, limit: float | None, clip: Clip | None) -> None:
        self.motion = motion
        self._clip, self._cap = clip, theme.cut
        self._middle = motion.at((motion.low + motion.high) / 2.0).vertices  # the plane stands still
        self._limit = limit
        self._plain = np.array(theme.surface)
        self._outward = outward_displacement(motion.start, motion.displacement)
        self._amounts = np.unique([motion.low, (motion.low + motion.high) / 2.0, motion.high])
        self._shadows = np.stack([hollows(motion.at(float(amount))) for amount in self._amounts])

    def amount(self, share: float) -> float:
        """Return how far it has moved after a share of its way."""
        return self.motion.low + share * (self.motion.high - self.motion.low)

    def go(self, share: float) -> None:
        """Move there."""
        amount = self.amount(share)
        colours = self._plain if self._limit is None else self._colours(amount, self._limit)
        self._surface = surface(self.motion.at(amount), colours, self._shadow(amount))

    def draw(self, frame: Frame, width: int) -> NDArray[np.uint8]:
        """Draw it, cut open if that is wanted."""
        cut = cut_of(self._clip, self._middle, frame.view.axes[2])
        return draw(Scene((self._surface,), cut=cut, cap=self._cap), frame, width)

    def _colours(self, amount: float, limit: float) -> FloatArray:
        return diverging_colours(amount * self._outward, limit)

    def _shadow(self, amount: float) -> FloatArray:
        """Interpolate the hollows' shadows between the ends: casting them takes longer than drawing."""
        last = len(self._amounts) - 1
        place = float(np.interp(amount, self._amounts, np.arange(last + 1.0)))
        before = min(int(place), max(last - 1, 0))
        after = min(before + 1, last)
        return np.asarray(
            (before + 1.0 - place) * self._shadows[before] + (place - before) * self._shadows[after]
        )


def _limit(motions: Sequence[Motion]) -> float:
    return common_limit(
        [
            max(-motion.low, motion.high) * outward_displacement(motion.start, motion.displacement)
            for motion in motions
            if motion.moves
        ]
    )


def _views(motions: Sequence[Motion], sights: Sequence[str]) -> list[View]:
    """Return the views; the oblique one is the same for all motions."""
    effort = np.sum([(motion.displacement**2).sum(axis=1) for motion in motions], axis=0)
    own = three_quarter_view(motions[0].start.vertices, effort if effort.any() else None)
    other = own.opposite
    oblique, opposite = View(own.toward, own.up, "oblique"), View(other.toward, other.up, "opposite")
    known = {"oblique": oblique, "opposite": opposite, **VIEWS}
    return [camera_view(sight) or known[sight] for sight in sights]
