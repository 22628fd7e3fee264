"""The matplotlib canvas of plots in the window."""

from collections.abc import Sequence
from typing import Protocol

from matplotlib.artist import Artist
from matplotlib.backends.backend_qtagg import FigureCanvasQTAgg
from matplotlib.figure import Figure
from PySide6.QtCore import Qt, SignalInstance
from PySide6.QtGui import QPaintEvent, QResizeEvent, QWheelEvent

from homolog_app.plots import DPI, new_figure
from homolog_app.rendering.text import complete_texts
from homolog_app.window.theme import Theme, text_scale

__all__ = ["PlotCanvas", "figure_of"]


class Drawn(Protocol):
    """The interface between a canvas and its plot."""

    theme: Theme
    usual: tuple[int, int]

    @property
    def redrawn(self) -> SignalInstance: ...

    @property
    def moved(self) -> SignalInstance: ...

    @property
    def is_empty(self) -> bool: ...

    def width(self) -> int: ...

    def height(self) -> int: ...

    def accessibleName(self) -> str: ...

    def accessibleDescription(self) -> str: ...

    def listen(self, canvas: "PlotCanvas") -> None: ...

    def draw(self, figure: Figure) -> None: ...

    def draw_moving(self, figure: Figure) -> Sequence[Artist]: ...


class PlotCanvas(FigureCanvasQTAgg):
    """Shows a plot. The static part is cached as a picture, so that the moving part is drawn quickly over it.

    Hidden plots are not drawn.
    """

    def __init__(self, plot: Drawn) -> None:
        figure = Figure(dpi=DPI, layout="constrained")
        super().__init__(figure)  # type: ignore[no-untyped-call]
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent, on=False)  # it may be dimmed
        self._plot = plot
        self._is_new = self._is_due = True
        self._drawn: object = None
        self._ground: object | None = None
        self._moving: list[Artist] = []
        self.setAccessibleName(plot.accessibleName())
        plot.redrawn.connect(self.renew)
        plot.moved.connect(self.move_over)
        plot.listen(self)

    def renew(self) -> None:
        """Redraw everything."""
        self._is_new = True
        self.setAccessibleDescription(self._plot.accessibleDescription())
        self.draw_idle()

    def move_over(self) -> None:
        """Draw the moving part over the static part."""
        if self._is_due or self._ground is None or self._drawn != self._extent:
            self.draw_idle()
            return
        self.restore_region(self._ground)  # type: ignore[no-untyped-call]
        self._draw_moving()
        self.update()

    def draw_idle(self) -> None:
        """Draw when the canvas is next painted."""
        self._is_due = True
        self.update()

    def draw(self) -> None:
        """Draw the static part, and the moving part over it."""
        if self._is_new:
            self._is_new, self._moving = False, []
            _fill(self.figure, self._plot)
        super().draw()  # type: ignore[no-untyped-call]
        self._ground = self.copy_from_bbox(self.figure.bbox)  # type: ignore[no-untyped-call]
        self._draw_moving()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw if necessary, and paint."""
        extent = self._extent
        if (self._is_due or extent != self._drawn) and self.width() > 0 and self.height() > 0:
            self._is_new |= extent != self._drawn  # the size decides which texts are shortened
            self._is_due, self._drawn = False, extent
            dpi = _dpi(self.width(), self.height(), self._plot.usual)
            self.figure.set_dpi(dpi * self.device_pixel_ratio)
            size = self.width() / dpi, self.height() / dpi
            self.figure.set_size_inches(
                *size, forward=False
            )  # the event of a resize may come after the paint
            self.draw()
        super().paintEvent(event)  # type: ignore[no-untyped-call]

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Keep the picture: a dock that is opened again passes through other sizes to the one it had."""
        is_due = self._is_due
        super().resizeEvent(event)  # type: ignore[no-untyped-call]
        self._is_due = is_due

    @property
    def _extent(self) -> tuple[int, int, float]:
        return self.width(), self.height(), self.devicePixelRatioF()

    def wheelEvent(self, event: QWheelEvent) -> None:
        """Leave the wheel to the parent widget."""
        event.ignore()

    def _draw_moving(self) -> None:
        for artist in self._moving:
            artist.remove()
        self._moving = []
        if not self._plot.is_empty:
            self._moving = list(self._plot.draw_moving(self.figure))
        for artist in self._moving:
            artist.set_animated(True)
            self.figure.draw_artist(artist)


def _dpi(width: int, height: int, usual: tuple[int, int]) -> float:
    """Return the resolution of a plot of some size: texts grow with the system's font where there is room."""
    room = min(width / usual[0], height / usual[1])
    return DPI * min(text_scale(), max(1.0, room))


def figure_of(plot: Drawn) -> Figure:
    """Return a figure of a plot as large as on the screen, for a file or the clipboard."""
    dpi = _dpi(plot.width(), plot.height(), plot.usual)
    figure = new_figure(plot.width() / dpi, plot.height() / dpi, plot.theme.colours)
    _fill(figure, plot)
    figure.draw_without_rendering()  # names are placed in the final layout
    plot.draw_moving(figure)
    complete_texts(figure)
    return figure


def _fill(figure: Figure, plot: Drawn) -> None:
    """Draw a plot on a figure."""
    figure.clear()
    figure.set_facecolor(plot.theme.colours.surface)
    if not plot.is_empty:
        plot.draw(figure)
        complete_texts(figure)
