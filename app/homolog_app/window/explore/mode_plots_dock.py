"""The plots of the modes side by side, as they stand in the dock."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QComboBox, QHBoxLayout, QLabel, QVBoxLayout, QWidget

from homolog.arrays import FloatArray
from homolog_app.window.explore.mode_plots import ScatterPlot, ScreePlot
from homolog_app.window.theme import Theme
from homolog_app.window.widgets import GRID

if TYPE_CHECKING:
    from homolog_app.window.explore.model_shape import ModelShape

__all__ = ["ModePlots"]


class ModePlots(QWidget):
    """Eigenvalues at the left, subjects at the right, with the two modes to choose beside them."""

    axes_changed = Signal()

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.setObjectName("Curves")
        self.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        self.scree, self.scatter = ScreePlot(theme), ScatterPlot(theme)
        self.across, self.along = QComboBox(), QComboBox()
        axes = QVBoxLayout()
        axes.setContentsMargins(GRID, GRID, GRID, GRID)
        for text, box in (("Across", self.across), ("Upwards", self.along)):
            name = QLabel(text)
            name.setBuddy(box)
            box.setAccessibleName(f"Mode plotted {text.lower()}")
            box.setFixedWidth(104)
            box.activated.connect(lambda _: self.axes_changed.emit())
            axes.addWidget(name)
            axes.addWidget(box)
        axes.addStretch()
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(0)
        row.addWidget(self.scree, 2)
        row.addWidget(self.scatter, 3)
        row.addLayout(axes)

    @property
    def axes(self) -> tuple[int, int]:
        """The modes plotted across and upwards, counted from 0."""
        return max(0, self.across.currentIndex()), max(0, self.along.currentIndex())

    def show_model(self, shape: "ModelShape | None") -> None:
        """Show the eigenvalues of a model and offer its modes."""
        self.scree.show_model(shape)
        for box, index in ((self.across, 0), (self.along, 1)):
            box.clear()
            box.addItems([f"Mode {mode + 1}" for mode in range(shape.modes if shape else 0)])
            box.setCurrentIndex(min(index, box.count() - 1))

    def show_scores(self, scores: FloatArray, shape: "ModelShape", groups: Sequence[str]) -> None:
        """Show the subjects' scores (M, K) [SD] in the two modes."""
        x, y = self.axes
        texts = [
            f"mode {mode + 1} ({100 * shape.model.explained_variance_ratio[mode]:.1f} %), SD"
            for mode in (x, y)
        ]
        self.scatter.show_scores(scores[:, [x, y]], shape.result.names, groups, (texts[0], texts[1]))
