"""A plot in the window: data, hint, menu and events. `homolog_app.plots` draws it."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QSize, Qt, Signal
from PySide6.QtGui import QContextMenuEvent, QImage, QShowEvent
from PySide6.QtWidgets import (
    QApplication,
    QDialog,
    QMenu,
    QMessageBox,
    QStackedLayout,
    QVBoxLayout,
    QWidget,
)

from homolog.errors import InputError
from homolog.io.names import file_stems
from homolog_app.window.theme import Theme
from homolog_app.window.widgets import label

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.backend_bases import MouseEvent
    from matplotlib.figure import Figure

    from homolog_app.window.explore.plot_canvas import PlotCanvas
    from homolog_app.window.workspace import FileDialogs

__all__ = ["EnlargedPlot", "Plot", "plot_menu", "plot_picture", "plots_of", "save_plot"]


_SCALE = 2
_ENLARGED = QSize(960, 640)


def plot_picture(plot: "Plot") -> QImage:
    """Return a plot as a picture, twice as large as on the screen."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    from homolog_app.plots import DPI
    from homolog_app.window.explore.plot_canvas import figure_of

    figure = figure_of(plot)
    figure.set_dpi(_SCALE * DPI)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    width, height = canvas.get_width_height()
    pixels = bytes(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
    return QImage(pixels, width, height, QImage.Format.Format_RGBA8888).copy()


def save_plot(plot: "Plot", path: Path) -> None:
    """Write a plot as SVG with text as text, or as PNG.

    Raises
    ------
    InputError
        If the file can't be written.
    """
    from homolog_app.pictures import write_picture
    from homolog_app.window.explore.plot_canvas import figure_of

    if path.suffix.lower() not in (".svg", ".png"):
        raise InputError(f"{path}: can't be written; choose a name that ends in .svg or .png")
    write_picture(figure_of(plot), path)


def plot_menu(plot: "Plot") -> QMenu:
    """Return the menu of a plot."""
    menu = QMenu(plot)
    menu.addAction("Save picture…", lambda: _ask_and_save(plot))
    menu.addAction("Copy picture", lambda: QApplication.clipboard().setImage(plot_picture(plot)))
    menu.addAction("Enlarge", lambda: EnlargedPlot(plot).show())
    for entry in plot.submenus(menu):
        menu.addMenu(entry)
    if plot.options:
        menu.addSeparator()
    for text in plot.options:
        action = menu.addAction(text)
        action.setCheckable(True)
        action.setChecked(plot.options[text])
        action.toggled.connect(lambda shown, text=text: plot.set_option(text, shown))
    return menu


def _ask_and_save(plot: "Plot") -> None:
    (stem,) = file_stems([plot.title])
    kinds = "Vector graphics (*.svg);;Pictures (*.png)"
    assert plot.files is not None, "plots of the window have file dialogs"
    path = plot.files.new(plot.window(), "Save picture", f"{stem}.svg", kinds)
    if path:
        try:
            save_plot(plot, path)
        except InputError as error:
            QMessageBox.warning(plot.window(), "Save picture", str(error))


class EnlargedPlot(QDialog):
    """A plot in its own window, which is updated with the plot in the dock and handles the same clicks."""

    def __init__(self, plot: "Plot") -> None:
        from homolog_app.window.explore.plot_canvas import PlotCanvas

        super().__init__(plot.window())
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.setWindowTitle(plot.title)
        self.setWindowFlag(Qt.WindowType.WindowMaximizeButtonHint)
        self.resize(_ENLARGED)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        self.canvas = PlotCanvas(plot)
        layout.addWidget(self.canvas)


def plots_of(widget: QWidget) -> list["Plot"]:
    """Return the plots in a widget, including the widget itself if it is one."""
    return [*([widget] if isinstance(widget, Plot) else []), *widget.findChildren(Plot)]


_FOCUS_PX = 2


class Plot(QWidget):
    """A plot, or a hint while there are no data. matplotlib is loaded when the first plot is seen.

    A subclass holds the data, draws them (`draw`, and `draw_moving` for the moving part), and calls
    `redraw` or `follow` when they change.

    Attributes
    ----------
    title : str
        Name of the plot's window and file.
    options : dict of str to bool
        States of the menu's checkable entries, by text.
    canvas : PlotCanvas or None
        Canvas of the plot; None before the plot is visible.
    files : FileDialogs or None
        The dialogs that ask where to save the plot.
    usual : (int, int)
        Width and height that texts of the usual size need [pixels].
    """

    usual = (240, 150)

    redrawn = Signal()
    moved = Signal()

    def __init__(self, theme: Theme, name: str, hint: str) -> None:
        super().__init__()
        self.theme, self.title = theme, name
        self.options: dict[str, bool] = {}
        self.canvas: PlotCanvas | None = None
        self.files: FileDialogs | None = None
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
        """Draw the static part."""
        raise NotImplementedError

    def draw_moving(self, figure: "Figure") -> "Sequence[Artist]":
        """Draw and return the moving part."""
        return ()

    def press(self, event: "MouseEvent") -> None:
        """Handle a click."""

    def redraw(self) -> None:
        """Redraw everything when it becomes visible."""
        if self.isVisible():
            self._show_layer()
        self.redrawn.emit()

    def follow(self) -> None:
        """Redraw the moving part."""
        self.moved.emit()

    def submenus(self, menu: "QMenu") -> "Sequence[QMenu]":
        """Return further entries of the plot's menu."""
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
        if not self.is_empty:
            menu = plot_menu(self)
            menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
            menu.popup(event.globalPos())

    def listen(self, canvas: "PlotCanvas") -> None:
        """Handle mouse events of a canvas."""
        canvas.mpl_connect("button_press_event", self._press)

    def _press(self, event: "MouseEvent") -> None:

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
        self._layers.setCurrentWidget(self.hint if self.canvas is None or self.is_empty else self.canvas)
