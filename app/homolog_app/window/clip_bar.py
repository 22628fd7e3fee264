"""The strip with the cutting plane's place, seen while shapes are cut open."""

from PySide6.QtCore import Qt, Signal, Slot
from PySide6.QtWidgets import QFrame, QHBoxLayout, QSlider

from homolog_app.rendering.camera import Clip, ClipPlane
from homolog_app.window.widgets import GRID, button, choice, label

__all__ = ["ClipBar"]

_PLANES = {
    "Axial": ClipPlane.AXIAL,
    "Coronal": ClipPlane.CORONAL,
    "Sagittal": ClipPlane.SAGITTAL,
    "Facing the camera": ClipPlane.VIEW,
}
_ENDS = {
    ClipPlane.AXIAL: ("I", "S"),
    ClipPlane.CORONAL: ("A", "P"),
    ClipPlane.SAGITTAL: ("R", "L"),
    ClipPlane.VIEW: ("near", "far"),
}
_STEPS = 200


class ClipBar(QFrame):
    """Orientation and position of the plane, and which side is removed."""

    changed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("ViewBar")
        self.plane = choice("Cutting plane", _PLANES)
        self.plane.setMinimumContentsLength(14)
        self.plane.setToolTip("Orientation of the cutting plane; the same for all shapes")
        self.position = QSlider(Qt.Orientation.Horizontal)
        self.position.setRange(0, _STEPS)
        self.position.setValue(_STEPS // 2)
        self.position.setPageStep(_STEPS // 10)
        self.position.setMinimumWidth(120)
        self.position.setAccessibleName("Position of the cutting plane")
        self.position.setToolTip("Position of the cutting plane")
        self.low, self.high = label("", "Hint"), label("", "Hint")
        self.percent = label("", "Hint")
        self.percent.setMinimumWidth(36)
        self.flip = button("Flip", "pick")
        self.flip.setCheckable(True)
        self.flip.setToolTip("Remove the other side")
        row = QHBoxLayout(self)
        row.setContentsMargins(GRID, GRID // 2, GRID, GRID // 2)
        row.setSpacing(GRID)
        row.addWidget(self.plane)
        for widget in (self.low, self.position, self.high, self.percent, self.flip):
            row.addWidget(widget, 1 if widget is self.position else 0)
        self.plane.currentIndexChanged.connect(self._follow)
        self.position.valueChanged.connect(self._follow)
        self.flip.toggled.connect(self._follow)
        self._follow()
        self.hide()

    @property
    def clip(self) -> Clip:
        """The plane that is chosen."""
        return Clip(
            plane=self.plane.currentData(),
            position=self.position.value() / _STEPS,
            flipped=self.flip.isChecked(),
        )

    @Slot()
    def _follow(self) -> None:
        low, high = _ENDS[self.plane.currentData()]
        self.low.setText(low)
        self.high.setText(high)
        self.percent.setText(f"{100 * self.position.value() / _STEPS:.0f} %")
        self.changed.emit()
