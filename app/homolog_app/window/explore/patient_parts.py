"""Parts of the page *Patient*: the form of a patient's data, and further times and groups."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, Qt, Signal
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QFormLayout,
    QHBoxLayout,
    QHeaderView,
    QLabel,
    QLineEdit,
    QTableView,
    QVBoxLayout,
    QWidget,
)

from homolog.cohort import LEFT, RIGHT, SIDE_COLUMN
from homolog.errors import InputError
from homolog.progress import Tick
from homolog_app.views.follow_up import PatientTimes, change_text, with_file
from homolog_app.window.actions import Actions
from homolog_app.window.explore.controls import SubjectTable
from homolog_app.window.widgets import GRID, ActionButton, choice, dress_table, label
from homolog_app.window.workspace import Workspace

if TYPE_CHECKING:
    from homolog.patient import PatientComparison, Reference
    from homolog_app.report.patient_texts import GroupRow
    from homolog_app.views.patient import ComparedPatient

__all__ = ["FollowUpPart", "PatientForm", "region_table", "remark_texts"]

_ABOVE = ("Controls", "Adjust for", "Seen twice")  # names of the reference's fields
_HEADS = ("Region", "Area\n(mm²)", "Mean\n(mm)", "z")
_SIDES = {"not given": "", LEFT: LEFT, RIGHT: RIGHT}


class PatientForm(QFormLayout):
    """Fields of the patient's data that a reference needs.

    Attributes
    ----------
    fields : dict of str to QLineEdit
        Fields of the covariates, by name.
    side : QComboBox or None
        None if the controls' sides are not known.
    cut_off : QCheckBox
    """

    def __init__(self) -> None:
        super().__init__()
        self.setHorizontalSpacing(GRID)
        self.setLabelAlignment(Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter)
        self.fields: dict[str, QLineEdit] = {}
        self.side: QComboBox | None = None
        self.cut_off = QCheckBox("Cut off at a flat end")
        self.cut_off.setToolTip("The segmentation ends at a plane: the missing part is not a difference")

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
            self.addRow(_named(name.capitalize()), self.fields[name])
        if reference.provenance.side:
            self.side = choice("Side", _SIDES)
            self.addRow(_named("Side"), self.side)


def _named(text: str) -> QLabel:
    """Return a label as wide as those of the reference above, so that the fields are aligned."""
    name = label(text)
    name.setMinimumWidth(max(map(name.fontMetrics().horizontalAdvance, _ABOVE)))
    return name


def region_table(owner: QObject) -> tuple[QTableView, SubjectTable]:
    """Return a table of a patient's regions beyond the limit, and its model."""
    table, rows = QTableView(), SubjectTable(_HEADS, owner)
    dress_table(table, "Regions beyond the limit", 120)
    table.setModel(rows)
    table.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
    table.horizontalHeader().setSectionResizeMode(0, QHeaderView.ResizeMode.Stretch)
    return table, rows


class FollowUpPart(QWidget):
    """Further groups and times of the patient, with the results in sentences.

    Attributes
    ----------
    times : Times or None
        Times of the patient; None without a patient.
    groups : tuple of GroupRow
        How typical the patient is of each group; empty while there is one reference only.
    """

    changed = Signal()

    def __init__(self, workspace: Workspace, actions: Actions) -> None:
        super().__init__()
        self.workspace = workspace
        self.times: PatientTimes | None = None
        self.groups: tuple[GroupRow, ...] = ()
        self._patient: tuple[ComparedPatient, Reference, Callable[[], Mapping[str, str]]] | None = None
        self._others: dict[str, Reference] = {}
        body = QVBoxLayout(self)
        body.setContentsMargins(0, 0, 0, 0)
        body.addWidget(label("Further groups", "SectionTitle"))
        body.addWidget(ActionButton("Compare with groups…", actions["patient.groups"]))
        self.typical = label("", wrap=True)
        self.caution = label("", "FieldHelp", wrap=True)
        body.addWidget(self.typical)
        body.addWidget(self.caution)
        body.addWidget(label("Follow-up", "SectionTitle"))
        row = QHBoxLayout()
        row.addWidget(ActionButton("Add later time…", actions["patient.later"]), 1)
        row.addWidget(ActionButton("Add repeat…", actions["patient.repeat"]), 1)
        body.addLayout(row)
        self.change = label("", wrap=True)
        body.addWidget(self.change)
        for text in (self.typical, self.change):
            text.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self._show()

    def set_patient(
        self,
        compared: "ComparedPatient | None",
        reference: "Reference | None",
        values: Callable[[], Mapping[str, str]],
    ) -> None:
        """Set another patient, or none; `values` returns the entered covariates."""
        self._patient = (compared, reference, values) if compared and reference else None
        self.times = PatientTimes((compared.comparison,)) if compared else None
        self.groups = ()
        self._show()

    def add_time(self, path: Path, *, repeats: bool) -> None:
        """Compare a file of a later time, or another segmentation of the first one."""
        if self._patient is None or self.times is None:
            raise InputError(f"{path}: there is no patient yet; choose the file of the first time first")
        _, reference, values = self._patient
        work = partial(with_file, self.times, reference, path, dict(values()), repeats)
        self.workspace.work.compute("follow-up", work, "comparing the times", self._receive_times)

    def compare_groups(self, paths: list[Path]) -> None:
        """Read references of further groups and show how typical the patient is of each."""
        from homolog.patient import Reference

        if self._patient is None:
            raise InputError("there is no patient yet; choose a patient's file first")
        self._others |= {str(path): Reference.load(path) for path in paths}
        compared, reference, values = self._patient
        work = partial(_typical, compared, reference, tuple(self._others.values()), dict(values()))
        self.workspace.work.compute("typical", work, "comparing with groups", self._receive_groups)

    def _receive_times(self, times: PatientTimes) -> None:
        self.times = times
        self._show()
        self.changed.emit()

    def _receive_groups(self, groups: "tuple[GroupRow, ...]") -> None:
        self.groups = groups
        self._show()

    def _show(self) -> None:
        self.typical.setText("")
        self.caution.setText("")
        if self.groups:
            from homolog_app.report.patient_texts import GROUP_CAUTION, group_sentence

            self.typical.setText("\n".join(group_sentence(row) for row in self.groups))
            self.caution.setText(GROUP_CAUTION)
        self.change.setText(change_text(self.times) if self.times else "")
        for text in (self.typical, self.caution, self.change):
            text.setVisible(bool(text.text()))


def remark_texts(comparison: "PatientComparison | None") -> tuple[str, str]:
    """Return the notes of grooming and the cautions of a comparison, one sentence per line."""
    cautions = comparison.cautions if comparison else ()
    notes = [text for text in comparison.remarks if text not in cautions] if comparison else []
    first, second = (
        "\n".join(f"{text[:1].upper()}{text[1:]}" for text in each) for each in (notes, cautions)
    )
    return first, second


def _typical(
    compared: "ComparedPatient",
    reference: "Reference",
    others: "tuple[Reference, ...]",
    values: Mapping[str, str],
    tick: Tick,
) -> "tuple[GroupRow, ...]":
    from homolog.patient import compare_patient
    from homolog_app.report.patient_texts import group_rows

    compare = partial(compare_patient, subject=compared.subject, covariates=values, tick=tick)
    return tuple(group_rows(compared.comparison, reference, others, compare))
