"""The box of *Groom* with the tools that cut a part of a subject away."""

from collections.abc import Mapping

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QPushButton, QWidget

from homolog_app.window.actions import Actions
from homolog_app.window.widgets import (
    ActionButton,
    ValueEdit,
    button,
    choice,
    column,
    label,
    offer,
    row,
    slider,
)

__all__ = ["BACK", "BRUSH", "PLANE", "CutBox"]

PLANE, BRUSH, BACK = "plane", "brush", "back"
_PLACES = {
    "Across the long axis": "long",
    "Along it, broad section": "short",
    "Along it, narrow section": "middle",
    "Through three landmarks": "landmarks",
}
_SIZES = (1, 40)
"""Radius of the brush, in hundredths of the shape's length."""


class CutBox(QWidget):
    """The tools that cut a part of the selected subject away, and what is done with the cuts.

    Attributes
    ----------
    tools : dict of str to QPushButton
        The plane, the brush, and the brush that puts back.
    """

    tool_changed = Signal()
    plane_wanted = Signal()

    def __init__(self, actions: Actions) -> None:
        super().__init__()
        tips = {
            PLANE: ("Plane", "Cut at a plane: drag its arrow to turn it, the plane to push it."),
            BRUSH: ("Brush", "Paint what is cut away on the shape of any subject."),
            BACK: ("Put back", "Paint what is to be kept again."),
        }
        self.tools: dict[str, QPushButton] = {}
        for name, (text, tip) in tips.items():
            self.tools[name] = tool = button(text, "pick")
            tool.setCheckable(True)
            tool.setToolTip(tip)
            tool.clicked.connect(lambda _, chosen=name: self._choose(chosen))
        self.place = choice("Place of the plane", _PLACES, "Where the plane begins")
        self.place.activated.connect(self.plane_wanted)
        self.structure = choice("Structure", tip="Structure that is cut away")
        self.structure.activated.connect(self.tool_changed)
        self.keep = ValueEdit("Length kept along the long axis [mm]", 0.1, 9999.0)
        self.keep.setPlaceholderText("keep")
        self.keep.setToolTip("Place the plane across the long axis so that this length is kept")
        self.radius = slider("Radius of the brush", *_SIZES, value=8)
        self.radius.setToolTip("Radius of the brush, in hundredths of the shape's length")
        self.where = QWidget()
        row((self.place, 1), self.keep, label("mm", "Unit"), on=self.where)
        self.brush = QWidget()
        row(label("Brush", "Hint"), (self.radius, 1), on=self.brush)
        column(
            label("Cut away", "SectionTitle"),
            row(*self.tools.values()),
            self.structure,
            self.where,
            self.brush,
            row(
                ActionButton("Carry to all", actions["edit.carry"]),
                ActionButton("Remove", actions["edit.uncut"]),
            ),
            on=self,
        )
        self._show()

    @property
    def tool(self) -> str:
        """The tool in use; empty if there is none."""
        return next((name for name, tool in self.tools.items() if tool.isChecked()), "")

    def offer(self, structures: Mapping[str, str]) -> None:
        """Let the user choose among several structures, by name, with what they are in the files."""
        offer(self.structure, structures)
        self._show()

    def drop(self) -> None:
        """Put the tool down."""
        for tool in self.tools.values():
            tool.setChecked(False)
        self._show()

    def _choose(self, chosen: str) -> None:
        for name, tool in self.tools.items():
            tool.setChecked(name == chosen and tool.isChecked())
        self._show()
        self.tool_changed.emit()

    def _show(self) -> None:
        self.structure.setVisible(self.tool == PLANE and self.structure.count() > 1)
        self.where.setVisible(self.tool == PLANE)
        self.brush.setVisible(self.tool in (BRUSH, BACK))
