"""What the page *Patient* asks of a patient: covariates, side, and whether the shape is cut off."""

from typing import TYPE_CHECKING

from PySide6.QtWidgets import QCheckBox, QComboBox, QFormLayout, QLineEdit

from homolog.cohort import LEFT, RIGHT, SIDE_COLUMN
from homolog_app.window.widgets import choice

if TYPE_CHECKING:
    from homolog.patient import Reference

__all__ = ["PatientForm"]

_SIDES = {"not given": "", LEFT: LEFT, RIGHT: RIGHT}


class PatientForm(QFormLayout):
    """Fields of a patient, as a reference needs them.

    Attributes
    ----------
    fields : dict of str to QLineEdit
        Of the covariates.
    side : QComboBox or None
        None if the controls' sides are not known.
    cut_off : QCheckBox
    """

    def __init__(self) -> None:
        super().__init__()
        self.fields: dict[str, QLineEdit] = {}
        self.side: QComboBox | None = None
        self.cut_off = QCheckBox("Cut off at a flat end")
        self.cut_off.setToolTip("The segmentation ends at a plane: what is missing there is no difference")

    @property
    def values(self) -> dict[str, str]:
        """Covariates and side as entered."""
        side = {} if self.side is None else {SIDE_COLUMN: self.side.currentData()}
        return {**side, **{name: field.text() for name, field in self.fields.items()}}

    def show_reference(self, reference: "Reference | None") -> None:
        """Offer a field for each covariate of a reference, and its side."""
        while self.rowCount():
            self.removeRow(0)
        self.fields, self.side = {}, None
        if reference is None:
            return
        for name in reference.coding.names:
            self.fields[name] = QLineEdit()
            self.fields[name].setAccessibleName(name)
            self.addRow(name.capitalize(), self.fields[name])
        if reference.provenance.side:
            self.side = choice("Side", _SIDES)
            self.addRow("Side", self.side)
