"""What can be done with any plot: save and copy its picture, and open it in its own window."""

from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QEvent, QObject, QRect, QRectF, QSize, Qt
from PySide6.QtGui import QImage, QPainter, QPaintEvent
from PySide6.QtSvg import QSvgGenerator
from PySide6.QtWidgets import QApplication, QDialog, QFileDialog, QMenu, QMessageBox, QVBoxLayout, QWidget

from homolog.errors import InputError
from homolog.files.names import file_stems

if TYPE_CHECKING:
    from homolog_app.window.explore.plot import Plot

__all__ = ["EnlargedPlot", "plot_menu", "plot_picture", "save_plot"]

_SCALE = 2
_ENLARGED = QSize(960, 640)


def plot_picture(plot: "Plot", scale: int = _SCALE) -> QImage:
    """Return a plot as a picture, so many times as large as on the screen."""
    image = QImage(plot.size() * scale, QImage.Format.Format_ARGB32)
    image.setDevicePixelRatio(scale)
    painter = QPainter(image)
    plot.paint_on(painter, QRectF(plot.rect()))
    painter.end()
    return image


def save_plot(plot: "Plot", path: Path) -> None:
    """Write a plot as SVG, whose texts stay texts, or as PNG.

    Raises
    ------
    InputError
        If the file can't be written.
    """
    if path.suffix.lower() != ".svg":
        written = plot_picture(plot).save(str(path))
    else:
        drawing = QSvgGenerator()
        drawing.setFileName(str(path))
        drawing.setSize(plot.size())
        drawing.setViewBox(QRect(plot.rect()))
        drawing.setTitle(plot.title)
        painter = QPainter()
        written = painter.begin(drawing)
        if written:
            plot.paint_on(painter, QRectF(plot.rect()))
            painter.end()
    if not written:
        raise InputError(
            f"{path}: can't be written; choose another folder, or a name that ends in .svg or .png"
        )


def plot_menu(plot: "Plot") -> QMenu:
    """Return the menu of a plot."""
    menu = QMenu(plot)
    menu.addAction("Save picture…", lambda: _ask_and_save(plot))
    menu.addAction("Copy picture", lambda: QApplication.clipboard().setImage(plot_picture(plot)))
    menu.addAction("Enlarge", lambda: EnlargedPlot(plot).show())
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
    path, _ = QFileDialog.getSaveFileName(plot.window(), "Save picture", f"{stem}.svg", kinds)
    if path:
        try:
            save_plot(plot, Path(path))
        except InputError as error:
            QMessageBox.warning(plot.window(), "Save picture", str(error))


class EnlargedPlot(QDialog):
    """A plot in its own window; it follows the plot in the dock."""

    def __init__(self, plot: "Plot") -> None:
        super().__init__(plot.window())
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.setWindowTitle(plot.title)
        self.setWindowFlag(Qt.WindowType.WindowMaximizeButtonHint)
        self.resize(_ENLARGED)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        self.mirror = _Mirror(plot)
        layout.addWidget(self.mirror)


class _Mirror(QWidget):
    """Paints a plot at its own size, whenever the plot is painted."""

    def __init__(self, plot: "Plot") -> None:
        super().__init__()
        self._plot = plot
        self.setAccessibleName(plot.accessibleName())
        self.setAccessibleDescription(plot.accessibleDescription())
        plot.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Follow the plot."""
        if event.type() == QEvent.Type.Paint:
            self.update()
        return False

    def paintEvent(self, event: QPaintEvent) -> None:
        """Paint the plot."""
        painter = QPainter(self)
        self._plot.paint_on(painter, QRectF(self.rect()))
        painter.end()
