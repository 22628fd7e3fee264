"""What is written in a view: the name at the top, letters at the edges, and numbers at particles."""

from typing import Any

from vtkmodules.vtkRenderingCore import vtkTextActor
from vtkmodules.vtkRenderingFreeType import vtkTextRendererStringToImage  # noqa: F401 - loads what writes

from homolog.arrays import FloatArray
from homolog_app.rendering.scheme import Colours, rgb
from homolog_app.rendering.text import edge_letters, font_file, written
from homolog_app.window.scene.content import Numbers

__all__ = ["Caption", "NumberLabels"]

_FONT_FILE = 4  # VTK_FONT_FILE: VTK's own fonts know no Greek
_EDGES = ((0.015, 0.5), (0.985, 0.5), (0.5, 0.015), (0.5, 0.985))
_FREE, _ROOM, _LEAST = 0.43, 0.97, 4
_CUT = "…"
_PLATE = 0.75  # opacity


class Caption:
    """A caption of two lines that never leaves its view, and four letters."""

    def __init__(self, renderer: Any) -> None:  # noqa: ANN401 - VTK is untyped
        self._renderer = renderer
        self._lines: list[str] = []
        self._small, self._lettered = False, True
        self._shown: object = None
        self._fitted: object = None
        self.caption = _text(0.015, 0.975)
        self.caption.GetTextProperty().SetVerticalJustificationToTop()
        self._letters = [_text(x, y) for x, y in _EDGES]
        for actor, across, along in zip(self._letters, (0, 2, 1, 1), (1, 1, 0, 2), strict=True):
            actor.GetTextProperty().SetJustification(across)
            actor.GetTextProperty().SetVerticalJustification(along)
        for actor in (self.caption, *self._letters):
            renderer.AddViewProp(actor)

    def show(self, lines: list[str], size: int, *, small: bool, letters: bool) -> None:
        """Write a caption of so many lines, or nothing, so many pixels high.

        Small views leave out the letter at the top, where the name is; its opposite is at the bottom.
        """
        wanted = (lines, size, small, letters)
        if wanted == self._shown:
            return
        self._shown, self._fitted = wanted, None
        self._lines, self._small, self._lettered = lines, small, letters
        for actor in (self.caption, *self._letters):
            actor.SetVisibility(bool(lines) and (letters or actor is self.caption))
            actor.GetTextProperty().SetFontSize(size)

    def face(self, axes: FloatArray, right: FloatArray, up: FloatArray) -> None:
        """Before each drawing: the letters of a patient's axes (3, 3) as seen now, and the caption's room."""
        for actor, text in zip(self._letters, edge_letters(axes, right, up), strict=True):
            if actor.GetInput() != text:
                actor.SetInput(text)
        width, _ = self._renderer.GetSize()
        if width != self._fitted:
            self._fitted = width
            self._fit(width)

    def paint(self, colours: Colours) -> None:
        """Take the colours of the scheme."""
        self.caption.GetTextProperty().SetColor(*rgb(colours.text))
        for actor in self._letters:
            actor.GetTextProperty().SetColor(*rgb(colours.accent))

    def _fit(self, width: int) -> None:
        """Shorten lines that the view has no room for; leave out the letter that the caption would touch."""
        text = "\n".join(self._lines)
        font = font_file(text + _CUT)
        self.caption.GetTextProperty().SetFontFile(str(font))
        lines = written(text, font).split("\n")
        lengths = [self._length(line) for line in lines]
        fitting = [self._shortened(*parts, _ROOM * width) for parts in zip(lines, lengths, strict=True)]
        self.caption.SetInput("\n".join(fitting))
        free = max(lengths, default=0.0) <= _FREE * width
        self._letters[-1].SetVisibility(bool(lines) and self._lettered and not self._small and free)

    def _shortened(self, line: str, length: float, room: float) -> str:
        """Return a line, so many pixels long, without so much of its middle that it fits into the room."""
        short, keep = line, len(line)
        while length > room and keep > _LEAST:
            keep = max(_LEAST, min(keep - 1, int(keep * room / length)))
            short = f"{line[: keep - keep // 2]}{_CUT}{line[-(keep // 2) :]}"
            length = self._length(short)
        return short

    def _length(self, line: str) -> float:
        """Return how many pixels a line takes."""
        size = [0.0, 0.0]
        self.caption.SetInput(line)
        self.caption.GetSize(self._renderer, size)
        return size[0]


class NumberLabels:
    """Numbers next to places, each on a plate, so that it is read on any shape."""

    def __init__(self, renderer: Any) -> None:  # noqa: ANN401 - VTK is untyped
        self._renderer = renderer
        self._texts: list[Any] = []
        self._numbers: Numbers | None = None
        self._plate = (1.0, 1.0, 1.0)

    def show(self, numbers: Numbers | None, size: int) -> None:
        """Write these numbers, so many pixels high."""
        self._numbers = numbers
        values = [] if numbers is None else numbers.values.tolist()
        while len(self._texts) < len(values):
            text = _text(0.0, 0.0)
            text.GetPositionCoordinate().SetCoordinateSystemToWorld()
            text.GetTextProperty().SetVerticalJustificationToCentered()
            text.GetTextProperty().SetBackgroundOpacity(_PLATE)
            self._renderer.AddViewProp(text)
            self._texts.append(text)
        for index, text in enumerate(self._texts):
            text.SetVisibility(index < len(values))
            if numbers is not None and index < len(values):
                text.SetInput(f" {values[index]} ")
                look = text.GetTextProperty()
                look.SetFontSize(size)
                look.SetBold(True)
                look.SetBackgroundColor(*self._plate)
                look.SetColor(*(numbers.colours[index] / 255.0).tolist())

    def face(self, right: FloatArray) -> None:
        """Before each drawing: put them to the right of their places as they are seen now."""
        if self._numbers is not None:
            places = self._numbers.places + self._numbers.beside * right
            for text, place in zip(self._texts, places.tolist(), strict=False):
                text.GetPositionCoordinate().SetValue(*place)

    def paint(self, colours: Colours) -> None:
        """Take the colours of the scheme; `show` follows."""
        self._plate = rgb(colours.scene)


def _text(x: float, y: float) -> Any:  # noqa: ANN401
    actor = vtkTextActor()
    actor.GetPositionCoordinate().SetCoordinateSystemToNormalizedViewport()
    actor.SetPosition(x, y)
    look = actor.GetTextProperty()
    look.SetFontFamily(_FONT_FILE)
    look.SetFontFile(str(font_file()))
    look.SetLineSpacing(1.2)
    return actor
