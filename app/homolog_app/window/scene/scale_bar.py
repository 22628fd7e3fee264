"""A bar of a round length in the corner of a view."""

from typing import Any

from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkPolyDataMapper2D, vtkTextActor

from homolog_app.rendering.camera import round_length
from homolog_app.rendering.text import font_file, short

__all__ = ["ScaleBar"]

_FONT_FILE = 4  # VTK_FONT_FILE
_SHARE, _MOST = 0.22, 140


class ScaleBar:
    """A line with its length in millimetres, at the lower left of a view in parallel projection."""

    def __init__(self, renderer: Any) -> None:  # noqa: ANN401 - VTK is untyped
        self._renderer = renderer
        self._data = vtkPolyData()
        lines = vtkCellArray()
        for ends in ((0, 1), (1, 2), (2, 3)):
            lines.InsertNextCell(2, ends)
        self._data.SetPoints(vtkPoints())
        self._data.GetPoints().SetNumberOfPoints(4)
        self._data.SetLines(lines)
        mapper = vtkPolyDataMapper2D()
        mapper.SetInputData(self._data)
        self._line, self._text = vtkActor2D(), vtkTextActor()
        self._line.SetMapper(mapper)
        look = self._text.GetTextProperty()
        look.SetFontFamily(_FONT_FILE)
        look.SetFontFile(str(font_file()))
        look.SetJustificationToCentered()
        self._size = 0
        self._drawn: object = None
        self.show(False, 12)
        for actor in (self._line, self._text):
            renderer.AddViewProp(actor)

    def show(self, shown: bool, size: int) -> None:
        """Show the bar, its words so many pixels high, or hide it."""
        self._size = size
        for actor in (self._line, self._text):
            actor.SetVisibility(shown)

    def paint(self, colour: tuple[float, float, float]) -> None:
        """Take a colour."""
        self._line.GetProperty().SetColor(*colour)
        self._text.GetTextProperty().SetColor(*colour)

    def face(self) -> None:
        """Before each drawing: be as long as the camera shows so many millimetres."""
        width, height = self._renderer.GetSize()
        wanted = width, height, self._size, self._renderer.GetActiveCamera().GetParallelScale()
        if not self._line.GetVisibility() or not width * height or wanted == self._drawn:
            return
        self._drawn = wanted
        millimetres = 2.0 * wanted[3] / height
        ratio = self._size / 12.0
        length = round_length(min(_SHARE * width, _MOST * ratio) * millimetres)
        left, bottom, tick = 1.2 * self._size, 1.1 * self._size, 0.3 * self._size
        right = left + length / millimetres
        places = ((left, bottom + tick), (left, bottom), (right, bottom), (right, bottom + tick))
        for index, (x, y) in enumerate(places):
            self._data.GetPoints().SetPoint(index, x, y, 0.0)
        self._data.GetPoints().Modified()
        self._line.GetProperty().SetLineWidth(max(1.0, 1.6 * ratio))
        self._text.GetTextProperty().SetFontSize(self._size)
        self._text.SetInput(f"{short(length)} mm")
        self._text.SetPosition((left + right) / 2.0, bottom + 0.3 * self._size)
