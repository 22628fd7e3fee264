"""All texts of a view: caption, letters, scale bar, numbers; in a strip where they would lie on a shape."""

from typing import Any

import numpy as np
import pyvista as pv
from vtkmodules.vtkRenderingCore import (
    vtkActor2D,
    vtkCoordinate,
    vtkPolyDataMapper2D,
)  # flat, unlike pyvista's

from homolog.arrays import Array, FloatArray
from homolog_app.rendering.camera import round_length
from homolog_app.rendering.colours import Colours, rgb
from homolog_app.rendering.content import Content, Numbers
from homolog_app.rendering.text import edge_letters, font_file, short, written

__all__ = ["STRIP_ROWS", "Caption", "NumberLabels", "ScaleBar", "Strip", "ViewTexts", "text_at", "text_box"]


_EDGES = ((0.015, 0.5), (0.985, 0.5), (0.5, 0.015), (0.5, 0.985))
_FREE, _ROOM, _LEAST = 0.43, 0.97, 4
_CUT, _BETWEEN = "…", " · "
_PLATE = 0.75  # opacity
_LETTER = 1.8  # distance from a letter's position that it needs free, in text heights
_LINE = 1.2  # line spacing


class Caption:
    """A caption of two lines (one in a strip), which always fits into its view, and four letters."""

    def __init__(self, renderer: Any) -> None:  # noqa: ANN401 - VTK is untyped
        self._renderer = renderer
        self._lines: list[str] = []
        self._small, self._lettered = False, True
        self._shown: object = None
        self._fitted: object = None
        self._measured: object = None
        self._box, self._name_px = np.zeros(4), 0.0
        self.caption = text_at(0.015, 0.975)
        self.caption.GetTextProperty().SetVerticalJustificationToTop()
        self._letters = [text_at(x, y) for x, y in _EDGES]
        for actor, across, along in zip(self._letters, (0, 2, 1, 1), (1, 1, 0, 2), strict=True):
            actor.GetTextProperty().SetJustification(across)
            actor.GetTextProperty().SetVerticalJustification(along)
        for actor in (self.caption, *self._letters):
            renderer.AddViewProp(actor)

    def show(self, lines: list[str], size: int, *, small: bool, letters: bool) -> None:
        """Show a caption with a text height [pixels], or hide it.

        In small views the letter at the top, where the name is, is omitted; its opposite is at the bottom.
        """
        state = (lines, size, small, letters)
        if state == self._shown:
            return
        self._shown, self._fitted, self._measured = state, None, None
        self._lines, self._small, self._lettered = lines, small, letters
        for actor in (self.caption, *self._letters):
            actor.SetVisibility(bool(lines) and (letters or actor is self.caption))
            actor.GetTextProperty().SetFontSize(size)

    def face(
        self,
        axes: FloatArray,
        right: FloatArray,
        up: FloatArray,
        *,
        in_strip: bool = False,
        taken: float = 0.0,
    ) -> None:
        """Before each drawing: update the letters for a patient's axes (3, 3), and fit the caption.

        In a strip the caption is one line, and a width `taken` at its right remains free [pixels].
        """
        for actor, text in zip(self._letters, edge_letters(axes, right, up), strict=True):
            if actor.GetInput() != text:
                actor.SetInput(text)
        width, height = self._renderer.GetSize()
        if (width, height, in_strip, taken) != self._fitted:
            self._fitted = width, height, in_strip, taken
            self._fit(width, height, in_strip=in_strip, taken=taken)

    def has_room(self, taken: float) -> bool:
        """Whether the first line fits into a strip of which a width `taken` is occupied [pixels]."""
        width = self._renderer.GetSize()[0]
        return not self._lines or self._name_px + taken <= _ROOM * width

    @property
    def free_box(self) -> FloatArray:
        """Left, lower, right and upper edge of the caption outside a strip [pixels]."""
        size = self._renderer.GetSize()
        if self._lines and size != self._measured:
            self._measured, self._fitted = size, None
            self._fit(*size, in_strip=False, taken=0.0)
            self._box = text_box(self._renderer, self.caption)
            self._name_px = self._length(written(self._lines[0], font_file(self._lines[0])))
            self._fitted = None
        return self._box if self._lines else np.zeros(4)

    def leave_free(self, low: FloatArray, high: FloatArray) -> None:
        """Before each drawing: omit letters on a shape.

        The shape is given by its parts' lower left and upper right corners (n, 2) in the view, from 0 to 1.
        """
        room = np.array(self._renderer.GetSize(), dtype=np.float64)
        for actor, edge in zip(self._letters, _EDGES, strict=True):
            reach = _LETTER * actor.GetTextProperty().GetFontSize() / room
            covered = bool(((low < edge + reach) & (high > edge - reach)).all(axis=1).any())
            actor.GetTextProperty().SetOpacity(0.0 if covered else 1.0)
            actor.GetTextProperty().SetBackgroundOpacity(0.0 if covered else _PLATE)

    def paint(self, colours: Colours) -> None:
        """Apply the scheme's colours."""
        self.caption.GetTextProperty().SetColor(*rgb(colours.text))
        for actor in self._letters:
            actor.GetTextProperty().SetColor(*rgb(colours.accent))
        for actor in (self.caption, *self._letters):
            actor.GetTextProperty().SetBackgroundColor(*rgb(colours.scene))
            actor.GetTextProperty().SetBackgroundOpacity(_PLATE)

    def _fit(self, width: int, height: int, *, in_strip: bool, taken: float) -> None:
        """Shorten lines to the view; omit letters that the caption would touch."""
        text = (_BETWEEN if in_strip else "\n").join(self._lines)
        font = font_file(text + _CUT)
        self.caption.GetTextProperty().SetFontFile(str(font))
        room = _ROOM * width - taken
        lines = written(text, font).split("\n")
        if in_strip and self._length(lines[0]) > room:  # the whole name is preferred to parts of both lines
            lines = written(self._lines[0], font).split("\n") if self._lines else lines
        lengths = [self._length(line) for line in lines]
        fitting = [self._shortened(*parts, room) for parts in zip(lines, lengths, strict=True)]
        self.caption.SetInput("\n".join(fitting))
        free = max(lengths, default=0.0) <= _FREE * width
        lettered = bool(self._lines) and self._lettered
        self._letters[-1].SetVisibility(lettered and not self._small and free)
        size = self.caption.GetTextProperty().GetFontSize()
        high = _LINE * (len(lines) + 0.5) * size < 0.5 * height
        for actor in self._letters[:2]:
            actor.SetVisibility(lettered and high)

    def _shortened(self, line: str, length: float, room: float) -> str:
        """Return a line, shortened in the middle to fit into a width."""
        short, keep = line, len(line)
        while length > room and keep > _LEAST:
            keep = max(_LEAST, min(keep - 1, int(keep * room / length)))
            short = f"{line[: keep - keep // 2]}{_CUT}{line[-(keep // 2) :]}"
            length = self._length(short)
        return short

    def _length(self, line: str) -> float:
        """Return the width of a line [pixels]."""
        size = [0.0, 0.0]
        self.caption.SetInput(line)
        self.caption.GetSize(self._renderer, size)
        return size[0]


def text_at(x: float, y: float) -> pv.Text:
    """Return an empty text at a position of the view, in fractions of it."""
    actor = _plain_text()
    actor.GetPositionCoordinate().SetCoordinateSystemToNormalizedViewport()
    actor.SetPosition(x, y)
    actor.prop.SetLineSpacing(_LINE)
    return actor


def text_box(renderer: Any, text: Any) -> FloatArray:  # noqa: ANN401 - VTK is untyped
    """Return left, lower, right and upper edge of a text in its view [pixels]."""
    size = [0.0, 0.0]
    text.GetSize(renderer, size)
    x, y = text.GetPositionCoordinate().GetComputedViewportValue(renderer)
    left = {"left": 0.0, "center": 0.5, "right": 1.0}[text.prop.justification_horizontal]
    low = {"bottom": 0.0, "center": 0.5, "top": 1.0}[text.prop.justification_vertical]
    start = np.array([x - left * size[0], y - low * size[1]])
    return np.concatenate([start, start + size])


def _plain_text() -> pv.Text:
    actor = pv.Text()
    actor.prop.set_font_file(font_file())  # VTK's own fonts have no Greek letters
    return actor


_SHARE, _MOST = 0.22, 140
_PLACE = 1.2, 1.1  # lower left end, in heights of the text
_BAR_TEXT = 6.5  # width of text and gaps in a strip, in heights of the text
_LOWEST = 5.5  # height of the lowest view with a scale bar and a caption, in heights of the text


class ScaleBar:
    """A line with its length in millimetres, at the lower left of a view in parallel projection.

    In the strip of a view it is at the right.
    """

    def __init__(self, renderer: Any) -> None:  # noqa: ANN401 - VTK is untyped
        self._renderer = renderer
        self._data = pv.PolyData(np.zeros((4, 3)), lines=[4, 0, 1, 2, 3])
        mapper = vtkPolyDataMapper2D()
        mapper.SetInputData(self._data)
        self._line, self._text = vtkActor2D(), _plain_text()
        self._line.SetMapper(mapper)
        self._text.prop.justification_horizontal = "center"
        self._size, self._wanted = 0, False
        self._drawn: object = None
        self.show(False, 12)
        for actor in (self._line, self._text):
            renderer.AddViewProp(actor)

    def show(self, shown: bool, size: int) -> None:
        """Show the bar with a text height [pixels], or hide it."""
        self._size, self._wanted, self._drawn = size, shown, None
        for actor in (self._line, self._text):
            actor.SetVisibility(shown)

    def paint(self, colours: Colours) -> None:
        """Apply the scheme's colours."""
        self._line.GetProperty().SetColor(*rgb(colours.text))
        look = self._text.GetTextProperty()
        look.SetColor(*rgb(colours.text))
        look.SetBackgroundColor(*rgb(colours.scene))
        look.SetBackgroundOpacity(_PLATE)

    @property
    def free_box(self) -> FloatArray:
        """Approximate left, lower, right and upper edge outside a strip [pixels]; zeros without a bar."""
        if not self._is_shown:
            return np.zeros(4)
        left, bottom = _PLACE[0] * self._size, _PLACE[1] * self._size
        return np.array([left, bottom, left + self._length()[1], bottom + 1.3 * self._size])

    @property
    def taken(self) -> float:
        """Width of the bar in a strip [pixels]."""
        return self._length()[1] + _BAR_TEXT * self._size if self._is_shown else 0.0

    @property
    def _is_shown(self) -> bool:
        return self._wanted and self._renderer.GetSize()[1] >= _LOWEST * self._size

    def _length(self) -> tuple[float, float]:
        """Return the length of the bar in mm and in pixels."""
        width, height = self._renderer.GetSize()
        millimetres = 2.0 * self._renderer.GetActiveCamera().GetParallelScale() / max(height, 1)
        length = round_length(min(_SHARE * width, _MOST * self._size / 12.0) * millimetres)
        return length, length / millimetres

    def hide(self) -> None:
        """Before each drawing: hide the bar."""
        self._drawn = None
        for actor in (self._line, self._text):
            actor.SetVisibility(False)

    def face(self, strip: float | None = None) -> None:
        """Before each drawing: adapt the length to the camera; `strip` is the middle of a strip [pixels]."""
        size = self._renderer.GetSize()
        state = size, self._size, self._renderer.GetActiveCamera().GetParallelScale(), strip
        if not self._wanted or not size[0] * size[1] or state == self._drawn:
            return
        self._drawn = state
        for actor in (self._line, self._text):
            actor.SetVisibility(self._is_shown)
        length, across = self._length()
        tick, look = 0.3 * self._size, self._text.prop
        look.font_size = self._size
        self._text.SetInput(f"{short(length)} mm")
        look.justification_horizontal = "center" if strip is None else "right"
        look.justification_vertical = "bottom" if strip is None else "center"
        if strip is None:
            left, bottom = _PLACE[0] * self._size, _PLACE[1] * self._size
            self._text.SetPosition(left + across / 2.0, bottom + 0.3 * self._size)
        else:
            left, bottom = size[0] - across - self._size, strip - tick / 2.0
            self._text.SetPosition(left - 0.5 * self._size, strip)
        right, up = left + across, bottom + tick
        self._data.points = [(left, up, 0.0), (left, bottom, 0.0), (right, bottom, 0.0), (right, up, 0.0)]
        self._line.GetProperty().SetLineWidth(max(1.0, 1.6 * self._size / 12.0))


_TOP = 0.025  # distance of the texts from the upper edge, as a fraction of the view
_ROW = 1.4  # height of a row, in text heights
STRIP_ROWS = 2.0 * _ROW + 0.3
"""Height of a strip with numbers, in text heights."""
_GAP = 0.35  # distance of numbers from each other and from the edges, in text heights
_RING = 0.83  # distance of a leader's end from its point, as a fraction of `Numbers.beside`
_ASIDE = 1.3  # distance of a leader from another point, in radii of its ring
_WIDTH = 1.6  # of leaders, for a text of 12 pixels


class Strip:
    """A band at the top of a view, in front of the shapes."""

    def __init__(self, renderer: Any) -> None:  # noqa: ANN401 - VTK is untyped
        self._renderer = renderer
        self._band = pv.PolyData(np.zeros((4, 3)), faces=[4, 0, 1, 2, 3])
        self._edge = pv.PolyData(np.zeros((2, 3)), lines=[2, 0, 1])
        self._actors = [_flat(data) for data in (self._band, self._edge)]
        for actor in self._actors:
            renderer.AddViewProp(actor)
        self._bounds: object = None
        self.face(0, 12)

    def paint(self, colours: Colours) -> None:
        """Apply the scheme's colours."""
        for actor, colour in zip(self._actors, (colours.scene, colours.line), strict=True):
            actor.GetProperty().SetColor(*rgb(colour))

    def face(self, rows: int, size: int) -> None:
        """Before each drawing: set the number of rows for texts of a height [pixels], or hide the strip."""
        width, height = self._renderer.GetSize()
        self._rows, self._size, self._height = rows, size, float(height)
        for actor in self._actors:
            actor.SetVisibility(rows > 0)
        if (width, height, rows, size) == self._bounds or not rows:
            return
        self._bounds = width, height, rows, size
        low = self.bottom
        self._band.points = [(0, low, 0), (width, low, 0), (width, height, 0), (0, height, 0)]
        self._edge.points = [(0, low, 0), (width, low, 0)]

    @property
    def shown(self) -> bool:
        """Whether the strip is visible."""
        return self._rows > 0

    @property
    def bottom(self) -> float:
        """Lower edge in the view [pixels]."""
        return self._height * (1.0 - _TOP) - _ROW * self._size * self._rows if self._rows else self._height

    def middle(self, row: int) -> float:
        """Return the middle of a row in the view [pixels]; the uppermost is 0."""
        return self._height * (1.0 - _TOP) - _ROW * self._size * (row + 0.38)


class NumberLabels:
    """Numbers in a row at the top of a view, each with a leader to its point."""

    def __init__(self, renderer: Any) -> None:  # noqa: ANN401 - VTK is untyped
        self._renderer = renderer
        self._texts: list[Any] = []
        self._numbers: Numbers | None = None
        self._size = 12
        self._data = pv.PolyData()
        self._leaders = _flat(self._data)
        self._leaders.VisibilityOff()
        renderer.AddViewProp(self._leaders)

    def show(self, numbers: Numbers | None, size: int) -> None:
        """Show numbers with a text height [pixels]."""
        self._numbers, self._size = numbers, size
        values = [] if numbers is None else numbers.values.tolist()
        while len(self._texts) < len(values):
            text = text_at(0.0, 0.0)
            text.GetPositionCoordinate().SetCoordinateSystemToViewport()
            text.GetTextProperty().SetJustificationToCentered()
            text.GetTextProperty().SetVerticalJustificationToCentered()
            text.GetTextProperty().SetBackgroundOpacity(1.0)
            self._renderer.AddViewProp(text)
            self._texts.append(text)
        self._leaders.SetVisibility(bool(values))
        for index, text in enumerate(self._texts):
            text.SetVisibility(index < len(values))
            if numbers is not None and index < len(values):
                text.SetInput(f" {values[index]} ")
                look = text.GetTextProperty()
                look.SetFontSize(size)
                look.SetBold(True)
                look.SetBackgroundColor(1.0, 1.0, 1.0)  # in both schemes: the colours are those of the marks
                look.SetColor(*(numbers.colours[index] / 255.0).tolist())

    def face(self, right: FloatArray, strip: Strip, inset: FloatArray) -> None:
        """Before each drawing: place numbers above their points, in the last row of a strip.

        A number is omitted if it doesn't fit, or if its point is not visible: outside the view, under
        the strip, or under the inset, a box (4,) in fractions of the view.
        """
        if self._numbers is None:
            return
        width, height = self._renderer.GetSize()
        points = np.array([self._in_view(place) for place in self._numbers.places])
        reach = self._numbers.beside * right
        rings = [
            _RING * float(np.linalg.norm(self._in_view(place + reach) - point))
            for place, point in zip(self._numbers.places, points, strict=True)
        ]
        low, high = np.split(inset * np.tile([width, height], 2), 2)
        free = (points >= 0.0).all(axis=1) & (points < [width, strip.bottom]).all(axis=1)
        free &= ~((points >= low) & (points <= high)).all(axis=1)
        gap = _GAP * self._size
        boxes = [text_box(self._renderer, text) for text in self._texts[: len(points)]]
        wide = np.array([box[2] - box[0] for box in boxes])
        free &= np.cumsum(np.where(free, wide + gap, 0.0)) <= width - gap
        shown = np.flatnonzero(free)
        wanted = _clear_of_rings(points[shown], np.array(rings)[shown], strip.bottom)
        order, wanted = shown[np.argsort(wanted)], np.sort(wanted)
        middles = _spread(wanted, wide[order], gap, width)
        row = strip.middle(1)
        for index, text in enumerate(self._texts):
            text.SetVisibility(bool(index < len(free) and free[index]))
        ends, colours = [], []
        for index, middle in zip(order, middles, strict=True):
            self._texts[index].SetPosition(middle, row)
            start = np.array([middle, strip.bottom])
            along = points[index] - start
            length = float(np.linalg.norm(along))
            ends += [start, start + max(0.0, 1.0 - rings[index] / max(length, 1e-9)) * along]
            colours.append(self._numbers.colours[index])
        self._draw(np.array(ends).reshape(-1, 2), np.array(colours, np.uint8).reshape(-1, 3))

    def _draw(self, ends: FloatArray, colours: Array) -> None:
        """Draw leaders between pairs of ends (2 k, 2) [pixels]."""
        self._leaders.SetVisibility(len(ends) > 0)
        if not len(ends):
            return
        segments = np.column_stack([np.full(len(colours), 2), np.arange(len(ends)).reshape(-1, 2)])
        lines = pv.PolyData(np.column_stack([ends, np.zeros(len(ends))]), lines=segments.ravel())
        lines.cell_data.set_array(colours, "colours")
        lines.cell_data.active_scalars_name = "colours"
        self._data.copy_from(lines, deep=True)
        self._leaders.GetProperty().SetLineWidth(max(1.0, _WIDTH * self._size / 12.0))

    def _in_view(self, place: FloatArray) -> FloatArray:
        coordinate = vtkCoordinate()
        coordinate.SetCoordinateSystemToWorld()
        coordinate.SetValue(*place.tolist())
        return np.array(coordinate.GetComputedDoubleViewportValue(self._renderer)[:2])


def _clear_of_rings(points: FloatArray, rings: FloatArray, top: float) -> FloatArray:
    """Return where leaders from points (n, 2) reach a height (n,), past the rings of higher points."""
    wanted = points[:, 0].astype(float)
    for index, (x, y) in enumerate(points):
        for (other_x, other_y), ring in zip(points, _ASIDE * rings, strict=True):
            share = (other_y - y) / (top - y)
            if share > 0.0 and abs(x + share * (wanted[index] - x) - other_x) < ring:
                side = 1.0 if x > other_x else -1.0
                wanted[index] = x + (other_x + side * ring - x) / share
    return wanted


def _spread(places: FloatArray, wide: FloatArray, gap: float, width: float) -> FloatArray:
    """Return centres of texts near sorted positions, without overlap and within the width."""
    middles = places.astype(float)
    edge = gap
    for index, half in enumerate(wide / 2.0):
        middles[index] = max(middles[index], edge + half)
        edge = middles[index] + half + gap
    edge = width - gap
    for index in reversed(range(len(middles))):
        half = wide[index] / 2.0
        middles[index] = min(middles[index], edge - half)
        edge = middles[index] - half - gap
    return middles


def _flat(data: pv.PolyData) -> Any:  # noqa: ANN401 - VTK is untyped
    mapper = vtkPolyDataMapper2D()
    mapper.SetInputData(data)
    actor = vtkActor2D()
    actor.SetMapper(mapper)
    return actor


class ViewTexts:
    """The texts of a view, which are moved to a strip at its top if they would overlap the shape.

    Attributes
    ----------
    caption : Caption
    """

    def __init__(self, renderer: Any) -> None:  # noqa: ANN401 - VTK is untyped
        self._renderer = renderer
        self._strip = Strip(renderer)  # first: the others are drawn over it
        self.caption, self._bar, self._numbers = Caption(renderer), ScaleBar(renderer), NumberLabels(renderer)
        self._content: Content | None = None
        self._size = 12
        self._points = np.empty((0, 2))
        self._is_close = False

    def show(self, content: Content | None, size: int, *, small: bool, letters: bool, bar: bool) -> None:
        """Show the texts of a content with a text height [pixels]."""
        self._content, self._size = content, size
        self.caption.show(content.caption if content else [], size, small=small, letters=letters)
        self._bar.show(bar and content is not None, round(0.85 * size))
        self._numbers.show(content.numbers if content else None, size)

    def paint(self, colours: Colours) -> None:
        """Apply the scheme's colours."""
        for part in (self.caption, self._bar, self._strip):
            part.paint(colours)

    def follow(self, points: FloatArray, *, is_close: bool) -> None:
        """Before each drawing: set a shape's points (n, 2), from 0 to 1, and whether it is a close-up."""
        self._points, self._is_close = points * self._renderer.GetSize(), is_close

    @property
    def need_strip(self) -> bool:
        """Whether a text would overlap the shape, or numbers are shown."""
        content = self._content
        if content is None:
            return False
        return self._covers_bar or content.numbers is not None or _covers(self.caption.free_box, self._points)

    @property
    def _covers_bar(self) -> bool:
        return self._is_close or _covers(self._bar.free_box, self._points)

    def face(
        self, axes: FloatArray, low: FloatArray, high: FloatArray, inset: FloatArray, in_strip: bool
    ) -> None:
        """Before each drawing, after `follow`: place the texts.

        Parameters
        ----------
        axes : (3, 3) array
            Directions to the right, upwards and ahead.
        low, high : (n, 2) array
            Corners of the shape's parts in the view, from 0 to 1.
        inset : (4,) array
            Box of the view's overview, in fractions of the view.
        in_strip : bool
            Whether the texts are in the strip.
        """
        content = self._content
        if content is None:
            self._strip.face(0, self._size)
            return
        self._strip.face(1 + (content.numbers is not None) if in_strip else 0, self._size)
        taken = self._bar.taken if in_strip and self._covers_bar else 0.0
        if not taken or self.caption.has_room(taken):
            self._bar.face(self._strip.middle(0) if taken else None)
        else:  # the name has priority
            self._bar.hide()
            taken = 0.0
        right, up, _ = axes
        self.caption.face(content.patient_axes, right, up, in_strip=in_strip, taken=taken)
        seen = low[:, 1] * self._renderer.GetSize()[1] < self._strip.bottom
        self.caption.leave_free(low[seen], high[seen])
        self._numbers.face(right, self._strip, inset)


def _covers(box: FloatArray, points: FloatArray) -> bool:
    """Whether a box (4,) contains any of the points (n, 2)."""
    return bool(((points >= box[:2]) & (points <= box[2:])).all(axis=1).any())
