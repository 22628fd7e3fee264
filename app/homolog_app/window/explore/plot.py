"""A plot in the window: data, hint, menu and events. `homolog_app.plots` draws it."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QContextMenuEvent, QShowEvent
from PySide6.QtWidgets import QStackedLayout, QWidget

from homolog_app.window.theme import Theme
from homolog_app.window.widgets import label

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.backend_bases import MouseEvent
    from matplotlib.figure import Figure
    from PySide6.QtWidgets import QMenu

    from homolog_app.window.explore.plot_canvas import PlotCanvas

__all__ = ["Plot"]

_FOCUS_PX = 2


class Plot(QWidget):
    """A plot, or a hint while there are no data. matplotlib is loaded when the first plot is seen.

    A subclass holds the data, draws them (`draw`, and `draw_moving` for what moves over them), and calls
    `redraw` or `follow` when they change.

    Attributes
    ----------
    title : str
        Names the window and the file of the plot.
    options : dict of str to bool
        What the menu switches on and off, by its text.
    canvas : PlotCanvas or None
        What shows the plot; None before it is seen.
    """

    redrawn = Signal()
    moved = Signal()

    def __init__(self, theme: Theme, name: str, hint: str) -> None:
        super().__init__()
        self.theme, self.title = theme, name
        self.options: dict[str, bool] = {}
        self.canvas: PlotCanvas | None = None
        self.hint = label(hint, "Hint", wrap=True)
        self.hint.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self._layers = QStackedLayout(self)
        self.setContentsMargins(_FOCUS_PX, _FOCUS_PX, _FOCUS_PX, _FOCUS_PX)
        self._layers.addWidget(self.hint)
        self.setObjectName("Plot")
        self.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        self.setMinimumSize(184, 180)
        self.setAccessibleName(name)
        theme.changed.connect(self.redraw)

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to plot yet."""
        raise NotImplementedError

    def draw(self, figure: "Figure") -> None:
        """Draw what stays."""
        raise NotImplementedError

    def draw_moving(self, figure: "Figure") -> "Sequence[Artist]":
        """Draw and return what moves."""
        return ()

    def press(self, event: "MouseEvent") -> None:
        """Do what a click orders."""

    def redraw(self) -> None:
        """Draw everything anew, once it is seen."""
        if self.isVisible():
            self._show_layer()
        self.redrawn.emit()

    def follow(self) -> None:
        """Draw what moves anew."""
        self.moved.emit()

    def submenus(self, menu: "QMenu") -> "Sequence[QMenu]":
        """Return what the plot's menu has besides what every plot has."""
        return ()

    def set_option(self, text: str, shown: bool) -> None:
        """Switch one of the options."""
        self.options[text] = shown
        self.redraw()

    def showEvent(self, event: QShowEvent) -> None:
        """Show the plot, or the hint."""
        super().showEvent(event)
        self._show_layer()

    def contextMenuEvent(self, event: QContextMenuEvent) -> None:
        """Offer to save, copy and enlarge the plot."""
        from homolog_app.window.explore.plot_menu import plot_menu

        if not self.is_empty:
            menu = plot_menu(self)
            menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
            menu.popup(event.globalPos())

    def listen(self, canvas: "PlotCanvas") -> None:
        """Answer what the mouse does on a canvas."""
        canvas.mpl_connect("button_press_event", self._press)

    def _press(self, event: "MouseEvent") -> None:
        from homolog_app.window.explore.plot_menu import EnlargedPlot

        if event.button != 1:
            return
        if event.dblclick and event.canvas is self.canvas:
            EnlargedPlot(self).show()
        else:
            self.press(event)

    def _show_layer(self) -> None:
        if self.canvas is None and not self.is_empty:
            from homolog_app.window.explore.plot_canvas import PlotCanvas

            self.canvas = PlotCanvas(self)
            self._layers.addWidget(self.canvas)
        self._layers.setCurrentIndex(0 if self.is_empty else 1)
