"""The strip at the top of a view, with texts that would lie on a shape."""

from typing import Any

import numpy as np
import pyvista as pv
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkCoordinate, vtkPolyDataMapper2D

from homolog.arrays import Array, FloatArray
from homolog_app.rendering.colours import Colours, rgb
from homolog_app.views.captions import text_at, text_box
from homolog_app.views.content import Numbers

__all__ = ["STRIP_ROWS", "NumberLabels", "Strip"]

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
