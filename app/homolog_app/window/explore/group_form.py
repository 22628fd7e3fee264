"""The question: which column, from which group to which."""

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QCheckBox, QGridLayout, QLabel, QWidget

from homolog_app.window.session import Session
from homolog_app.window.study import Study
from homolog_app.window.widgets import GRID, choice

__all__ = ["GroupForm", "values_of"]

_MOST_VALUES = 12
_LEAST = 2


def values_of(study: Study, column: str) -> list[str]:
    """Return the values of a column that two or more included subjects have, sorted."""
    cells = [one.group or "" if column == "group" else one.columns.get(column, "") for one in study.included]
    return sorted({cell for cell in cells if cell and cells.count(cell) >= _LEAST})


class GroupForm(QWidget):
    """Column, first and second group, and what is taken into account."""

    edited = Signal()

    def __init__(self, session: Session) -> None:
        super().__init__()
        self._session = session
        self.column = choice("Column of the comparison")
        self.first, self.second = choice("From"), choice("To")
        self.every = QCheckBox("Test all groups of the column (Holm's correction)")
        self.every.setToolTip("Test for any difference, then each two groups, corrected for their number")
        self.scaling = QCheckBox("Take size out of the shapes")
        self.scaling.setToolTip("Bring all shapes to one size first; size is tested apart in any case")
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setHorizontalSpacing(GRID)
        grid.setVerticalSpacing(GRID)
        places = ((0, 0, 3), (1, 0, 1), (1, 2, 1))
        for (row, at, span), words, box in zip(
            places, ("Column", "From", "To"), (self.column, self.first, self.second), strict=True
        ):
            name = QLabel(words)
            name.setBuddy(box)
            grid.addWidget(name, row, at)
            grid.addWidget(box, row, at + 1, 1, span)
        grid.addWidget(self.every, 2, 0, 1, 4)
        grid.addWidget(self.scaling, 3, 0, 1, 4)
        for column in (1, 3):
            grid.setColumnStretch(column, 1)
        self.column.activated.connect(lambda _: self._offer_values())
        for box in (self.column, self.first, self.second):
            box.activated.connect(lambda _: self.edited.emit())
        for tick in (self.every, self.scaling):
            tick.toggled.connect(self.edited)
        session.study_changed.connect(self.offer)
        self.offer()

    @property
    def is_possible(self) -> bool:
        """Whether two different groups are chosen."""
        return self.first.count() > 1 and self.first.currentText() != self.second.currentText()

    @property
    def between(self) -> tuple[str, ...]:
        """The groups: first and second, then the others if all are to be tested."""
        two = (self.first.currentText(), self.second.currentText())
        values = [self.first.itemText(index) for index in range(self.first.count())]
        others = [value for value in values if value not in two] if self.every.isChecked() else []
        return (*two, *others)

    def offer(self) -> None:
        """Offer the columns that make groups."""
        study = self._session.study
        columns = [
            column
            for column in ("group", *study.columns)
            if 1 < len(values_of(study, column)) <= _MOST_VALUES
        ]
        held = [self.column.itemText(index) for index in range(self.column.count())]
        if columns != held:
            self.column.clear()
            self.column.addItems(columns)
        self._offer_values()

    def _offer_values(self) -> None:
        values = values_of(self._session.study, self.column.currentText())
        for index, box in enumerate((self.first, self.second)):
            if [box.itemText(at) for at in range(box.count())] != values:
                box.clear()
                box.addItems(values)
                box.setCurrentIndex(min(index, len(values) - 1))
        self.every.setVisible(len(values) > 2)
