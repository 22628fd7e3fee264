"""Texts in views: names, letters, scale bar."""

from typing import Any

import numpy as np
import pyvista as pv
from vtkmodules.vtkRenderingCore import (
    vtkActor2D,
    vtkPolyDataMapper2D,
)  # flat, unlike pyvista's

from homolog.arrays import FloatArray
from homolog_app.rendering.camera import round_length
from homolog_app.rendering.colours import Colours, rgb
from homolog_app.rendering.text import edge_letters, font_file, short, written

__all__ = ["Caption", "ScaleBar", "text_at", "text_box"]


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
