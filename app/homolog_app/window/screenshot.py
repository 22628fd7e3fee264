"""Saving a picture of the views."""

from pathlib import Path

from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QFileDialog,
    QFormLayout,
    QWidget,
)

from homolog.errors import InputError
from homolog_app.window.scene.scene import Scene
from homolog_app.window.widgets import GRID

__all__ = ["PictureDialog", "save_picture"]


class PictureDialog(QDialog):
    """Size and background of the picture."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setWindowTitle("Screenshot")
        self.scale = QComboBox()
        for factor in (1, 2, 3, 4):
            self.scale.addItem(f"{factor} x the size on screen", factor)
        self.scale.setCurrentIndex(1)
        self.transparent = QCheckBox("Transparent background")
        buttons = QDialogButtonBox(
            QDialogButtonBox.StandardButton.Save | QDialogButtonBox.StandardButton.Cancel
        )
        buttons.accepted.connect(self.accept)
        buttons.rejected.connect(self.reject)
        form = QFormLayout(self)
        form.setContentsMargins(3 * GRID, 3 * GRID, 3 * GRID, 2 * GRID)
        form.setVerticalSpacing(2 * GRID)
        form.addRow("Size", self.scale)
        form.addRow("", self.transparent)
        form.addRow(buttons)


def save_picture(parent: QWidget, scene: Scene) -> None:
    """Ask how and where, and save the picture.

    Raises
    ------
    InputError
        If the file can't be written.
    """
    dialog = PictureDialog(parent)
    chosen = dialog.exec() == QDialog.DialogCode.Accepted
    scale, transparent = int(dialog.scale.currentData()), dialog.transparent.isChecked()
    dialog.deleteLater()
    if not chosen:
        return
    path, _ = QFileDialog.getSaveFileName(parent, "Save screenshot", "homolog.png", "PNG pictures (*.png)")
    if not path:
        return
    target = Path(path) if Path(path).suffix else Path(path).with_suffix(".png")
    if not scene.picture(scale, transparent=transparent).save(str(target)):
        raise InputError(f"{target}: can't be written; choose a folder that is writable and has room")
