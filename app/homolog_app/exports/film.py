"""Frames: motions from several directions, with captions and scales, on a page."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.text import Text
from numpy.typing import NDArray
from PIL import Image

from homolog.arrays import Array, FloatArray
from homolog.errors import InputError
from homolog_app.exports.motion import SCALE_SHARE, Box, Motion, ViewCell, make_plan, turned
from homolog_app.exports.settings import Background, Colouring, FilmSettings, PictureSettings, camera_view
from homolog_app.pictures import DARK, LIGHT, VIEWS, View, three_quarter_view
from homolog_app.pictures.layout import draw_colour_bar
from homolog_app.rendering.camera import Clip, Frame, cut_of, round_length
from homolog_app.rendering.colours import (
    Theme,
    common_limit,
    displacement_scale,
    diverging_colours,
    outward_displacement,
)
from homolog_app.rendering.draw import draw
from homolog_app.rendering.rays import hollows
from homolog_app.rendering.scene import Scene, surface
from homolog_app.rendering.text import complete_text, edge_letters

__all__ = ["Board", "Film"]


_DPI = 100.0
_LEAST_TEXT = 8.0


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
        """Add a line centred on (x, y), size in em; it is reduced to fit the space."""
        points = size * self.em * 72.0 / _DPI
        text = self._figure.text(
            x / self.width,
            1.0 - y / self.height,
            content,
            ha="center",
            va="center",
            color=self._theme.text,
            fontsize=points,
        )
        complete_text(text)
        taken = text.get_window_extent().width
        text.set_fontsize(max(points * min(room / taken, 1.0), _LEAST_TEXT * 72.0 / _DPI))
        return text

    def changing_text(self, x: float, y: float, content: str, *, room: float, size: float = 1.0) -> Text:
        """Add a line that changes with each frame; `words` is its longest text."""
        text = self.text(x, y, content, room=room, size=size)
        text.set_animated(True)
        self._changing.append(text)
        return text

    def scale_bar(self, x: float, y: float, most: float, millimetres_a_pixel: float) -> None:
        """Draw a bar of a round length, at most `most` pixels long, from (x, y) to the right."""
        length = round_length(most * millimetres_a_pixel)
        pixels = length / millimetres_a_pixel
        thick = max(round(0.15 * self.em), 2)
        bar = Rectangle(
            (x / self.width, 1.0 - (y + thick) / self.height),
            pixels / self.width,
            thick / self.height,
            color=self._theme.text,
            linewidth=0.0,
        )
        self._figure.add_artist(bar)
        label = self.text(x + pixels / 2.0, y - 0.6 * self.em, f"{length:g} mm", room=8.0 * self.em, size=0.8)
        label.set_x(max(label.get_position()[0], (x + 2.0 * self.em) / self.width))

    def legend(self, entries: Mapping[str, tuple[int, int, int]], y: float, *, room: float) -> None:
        """Write names beside patches of their colours, up to the right edge of the page."""
        size = 0.8
        texts = [self.text(0.0, y, name, room=room / len(entries), size=size) for name in entries]
        side, x = 0.7 * self.em, self.width - 0.8 * self.em
        for text, colour in list(zip(texts, entries.values(), strict=True))[::-1]:
            taken = text.get_window_extent().width
            text.set_x((x - taken / 2.0) / self.width)
            x -= taken + 1.5 * side
            place = x / self.width, 1.0 - (y + side / 2.0) / self.height
            own = [part / 255.0 for part in colour]
            self._figure.add_artist(
                Rectangle(place, side / self.width, side / self.height, color=own, linewidth=0.0)
            )
            x -= self.em

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
        draw_colour_bar(place, displacement_scale(limit), self._theme, 0.7 * self.em * 72.0 / _DPI)

    def compose(self, images: Sequence[tuple[Box, Array]]) -> NDArray[np.uint8]:
        """Return the page with images (red, green, blue, opacity; uint8) composited onto it, (H, W, 4)."""
        if self._still is None:
            self._canvas.draw()  # type: ignore[no-untyped-call]
            self._still = self._canvas.copy_from_bbox(self._figure.bbox)  # type: ignore[no-untyped-call]
        self._canvas.restore_region(self._still)  # type: ignore[no-untyped-call]
        for text in self._changing:
            complete_text(text)
            self._figure.draw_artist(text)
        page = Image.fromarray(np.array(self._canvas.buffer_rgba()))  # type: ignore[no-untyped-call]
        for box, image in images:
            page.alpha_composite(Image.fromarray(image), (box.x, box.y))
        return np.asarray(page)


_LEGEND = 0.3  # largest share of the page's width for the names of structures
_RIM = 1.4  # space for letters around a picture [em]
_THEMES = {Background.LIGHT: LIGHT, Background.DARK: DARK}


class Film:
    """Draws motions at any time. All have the same scale and colour scale; each column has one view.

    Parameters
    ----------
    motions : sequence of Motion
        At least one motion.
    sights : sequence of str
        At least one view direction of `settings.SIGHTS`, or camera (`settings.camera_direction`).
    settings : PictureSettings
        Size, colours, captions.
    turntable : bool
        Whether the views rotate.
    transparent : bool
        Whether the background is transparent.

    Raises
    ------
    InputError
        If the page is too small for the pictures.
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
        names = {} if coloured else motions[0].structures
        plan = make_plan(
            motions,
            _views(motions, sights),
            (settings.width, settings.height),
            self._board.em,
            turntable=turntable,
            strip=settings.scale_bar or one_line or bool(names),
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
        if names:
            self._board.legend(names, settings.height - 0.9 * self._board.em, room=_LEGEND * settings.width)
        if plan.bar is not None and limit is not None:
            self._board.colour_bar(plan.bar, limit)

    @property
    def boxes(self) -> tuple[Box, ...]:
        """Positions of the pictures on the page, by motion."""
        return tuple(cell.box for cell in self._cells)

    def draw(self, share: float, turn: float = 0.0) -> NDArray[np.uint8]:
        """Return the page at a time, shape (height, width, 4).

        Parameters
        ----------
        share : float
            Position between the low end of each motion, 0, and its high end, 1.
        turn : float
            Rotation of the views about the vertical axis [rad].
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

    def _letters_of(self, cell: ViewCell) -> list[Text]:
        """Return the letters at the left, right, lower and upper edge of a shape."""
        em, box = self._board.em, cell.box
        x, y = box.x + box.width / 2.0, box.y + box.height / 2.0
        across, along = ((size + _RIM * em) / 2.0 for size in cell.taken)
        places = ((x - across, y), (x + across, y), (x, y + along), (x, y - along))
        return [self._board.changing_text(*place, "LA", room=_RIM * em, size=0.7) for place in places]

    def moment(self, index: int, settings: FilmSettings) -> NDArray[np.uint8]:
        """Return the position of a film's frame: smoothly forward and, in a loop, back."""
        whole = settings.frames if settings.loop else settings.frames - 1
        way = 2.0 * np.pi * index / whole if settings.loop else np.pi * index / whole
        turn = 2.0 * np.pi * index / settings.frames if settings.turntable else 0.0
        return self.draw(float(0.5 - 0.5 * np.cos(way)), turn)


class _Actor:
    """A motion with its renderer."""

    def __init__(self, motion: Motion, theme: Theme, limit: float | None, clip: Clip | None) -> None:
        self.motion = motion
        self._clip, self._cap = clip, theme.cut
        self._middle = motion.at((motion.low + motion.high) / 2.0).vertices  # the plane does not move
        self._limit = limit
        self._plain = np.array(theme.surface) if motion.colours is None else motion.colours
        self._outward = outward_displacement(motion.start, motion.displacement)
        self._amounts = np.unique([motion.low, (motion.low + motion.high) / 2.0, motion.high])
        self._shadows = np.stack([hollows(motion.at(float(amount))) for amount in self._amounts])

    def amount(self, share: float) -> float:
        """Return the amount at a position from 0 to 1."""
        return self.motion.low + share * (self.motion.high - self.motion.low)

    def go(self, share: float) -> None:
        """Move the surface to a position from 0 to 1."""
        amount = self.amount(share)
        colours = self._plain if self._limit is None else self._colours(amount, self._limit)
        self._surface = surface(self.motion.at(amount), colours, self._shadow(amount))

    def draw(self, frame: Frame, width: int) -> NDArray[np.uint8]:
        """Draw the surface, cut open if requested."""
        cut = cut_of(self._clip, self._middle, frame.view.axes[2])
        return draw(Scene((self._surface,), cut=cut, cap=self._cap), frame, width)

    def _colours(self, amount: float, limit: float) -> FloatArray:
        return diverging_colours(amount * self._outward, limit)

    def _shadow(self, amount: float) -> FloatArray:
        """Interpolate ambient occlusion between the ends: computing it takes longer than drawing."""
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
