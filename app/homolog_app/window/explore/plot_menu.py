"""What can be done with any plot: save and copy its picture, and open it in its own window."""

from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QImage
from PySide6.QtWidgets import QApplication, QDialog, QFileDialog, QMenu, QMessageBox, QVBoxLayout, QWidget

from homolog.errors import InputError
from homolog.files.names import file_stems

if TYPE_CHECKING:
    from homolog_app.window.explore.mode_plots import ScatterPlot
    from homolog_app.window.explore.plot import Plot

__all__ = ["EnlargedPlot", "axis_menu", "plot_menu", "plot_picture", "save_plot"]

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
    """Write a plot as SVG, whose texts stay texts, or as PNG.

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


def axis_menu(plot: "ScatterPlot", axis: int, parent: QWidget | None = None) -> QMenu:
    """Return the menu of what can be plotted across (0) or upwards (1)."""
    menu = QMenu(("Horizontal axis", "Vertical axis")[axis], parent or plot)
    for index, text in enumerate(plot.choices):
        action = menu.addAction(text)
        action.setCheckable(True)
        action.setChecked(index == plot.axes[axis])
        action.triggered.connect(lambda _, index=index: plot.choose_axis(axis, index))
    return menu


def _ask_and_save(plot: "Plot") -> None:
    (stem,) = file_stems([plot.title])
    kinds = "Vector graphics (*.svg);;Pictures (*.png)"
    path, _ = QFileDialog.getSaveFileName(plot.window(), "Save picture", f"{stem}.svg", kinds)
    if path:
        try:
            save_plot(plot, Path(path))
        except InputError as error:
            QMessageBox.warning(plot.window(), "Save picture", str(error))


class EnlargedPlot(QDialog):
    """A plot in its own window; it follows the plot in the dock, and the mouse does the same in both."""

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
