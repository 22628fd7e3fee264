"""The question: column, groups or number, covariates, and how it is tested."""

from typing import Any

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QStandardItemModel
from PySide6.QtWidgets import QLabel, QWidget

from homolog.cohort.column_types import CATEGORY
from homolog.comparison.choices import (
    covariates_of,
    has_missing,
    numbers_of,
    pairings_of,
    size_name,
    values_of,
)
from homolog.comparison.precision import AnalysisSettings, Precision
from homolog.comparison.question import Question
from homolog.comparison.sample import SIZE
from homolog.statistics.design import reference_first
from homolog.statistics.procrustes import Alignment
from homolog_app.window.explore.controls import ColumnPicker
from homolog_app.window.explore.formula_builder import FormulaBuilder
from homolog_app.window.form import SettingsPair
from homolog_app.window.session import Session
from homolog_app.window.widgets import button, choice, column, label, link, named_rows, offer, show_all, tick

__all__ = ["GroupForm"]

_SEEDS = 5

_MOST_VALUES = 12
_LONG = 48
_ALIGNMENTS = {
    "Size, and shape without it": Alignment.SHAPE,
    "Form: size and shape together": Alignment.FORM,
    "Both: shape and form (two answers)": None,
    "As the shapes lie (not aligned)": Alignment.AS_IT_LIES,
}
_BOTH = (Alignment.SHAPE, Alignment.FORM)
_GROUPS = "groups"
_NUMBER, _AS_NUMBER = "regression", " (as a number)"
_FORMULA, _SEVERAL = "formula", "Several columns (formula)"


class GroupForm(QWidget):
    """Column, first and second group, covariates and alignment."""

    edited = Signal()

    def __init__(self, session: Session) -> None:
        super().__init__()
        self._session = session
        self.column = choice("Column of the comparison")
        self.first = choice("From", tip="Reference group: differences are relative to it")
        self.second = choice("To")
        swap = "Swap the two groups"
        self.swap = button("⇄", "flat", self._swap, toolTip=swap, accessibleName=swap)
        self.every = tick(
            "More than two groups, in pairs (Holm's correction)",
            "Test for any difference, then each pair of groups; p-values of the whole shape, of particles, "
            "of size and of the discriminant are corrected for their number",
        )
        together = "Groups that are compared with each other and with the two above"
        self.further = ColumnPicker("Further groups", together, _further_text)
        self.pairing = choice(
            "Pairs",
            tip="Column that identifies the pairs, such as the patient of two scans; tests the differences "
            "within pairs",
        )
        self.alignment = choice(
            "Alignment",
            _ALIGNMENTS,
            "How shapes are aligned before they are compared; size is always tested separately. Both "
            "asks two questions at once",
        )
        self.complete = tick(
            "Complete cases: exclude subjects with missing values",
            "Exclude subjects with missing values in the columns used, and count them",
        )
        self.builder = FormulaBuilder(session)
        self.slope = label("Does shape change with this number? (linear regression)", "Hint", wrap=True)
        removed = "Columns whose effect on shape is removed before the test"
        self.adjust = ColumnPicker("Covariates adjusted for", removed, self._covariates_text)
        self.tests = SettingsPair(AnalysisSettings, main=())
        self._settings = AnalysisSettings()
        self.tests.show_values(self._settings)
        self._lay_out()
        self.tests.edited.connect(self._set)
        self.column.activated.connect(self._offer_values)
        boxes = (self.first, self.second, self.pairing)
        link(self._offer_pairings, *(box.activated for box in boxes))
        self.complete.toggled.connect(self.offer)
        self.every.toggled.connect(self._offer_further)
        link(self.edited, *(box.activated for box in (self.column, *boxes, self.alignment)))
        link(self.edited, *(part.edited for part in (self.builder, self.adjust, self.further)))
        link(self.edited, self.every.toggled, self.complete.toggled, self.tests.marked)
        session.study_changed.connect(self.offer)
        self.offer()

    def _lay_out(self) -> None:
        self._names = [QLabel("From"), QLabel("To")]
        for name, box in zip(self._names, (self.first, self.second), strict=True):
            name.setBuddy(box)
        column(
            named_rows((("Column", self.column),)),
            [self._names[0], (self.first, 1), self._names[1], (self.second, 1), self.swap],
            *(self.builder, self.slope, self.pairing, self.adjust, self.complete, self.every, self.further),
            *(self.alignment, self.tests),
            on=self,
        )

    @property
    def is_possible(self) -> bool:
        """Whether a number or two different groups are chosen, and all settings are valid."""
        first, second = self._two
        asks = bool(self.builder.formula) if self.is_formula else self.is_regression or first != second
        return asks and not self.tests.problem

    @property
    def is_regression(self) -> bool:
        """Whether the column is used as a number."""
        return bool(self.column.count()) and self.column.currentData()[1] == _NUMBER

    @property
    def is_formula(self) -> bool:
        """Whether several columns are asked for."""
        return bool(self.column.count()) and self.column.currentData()[1] == _FORMULA

    @property
    def seeds(self) -> int:
        """Number of seeds of the correspondence in all."""
        return self._settings.seeds or _SEEDS

    @property
    def pairs(self) -> str | None:
        """The column that identifies the pairs, if pairs are compared."""
        chosen = None if self.is_regression or self.is_formula else self.pairing.currentData()
        return str(chosen) if chosen else None

    @property
    def request(self) -> Question:
        """The question, or the first of two."""
        return self.requests[0]

    @property
    def requests(self) -> tuple[Question, ...]:
        """The questions, one for each alignment."""
        column, kind = self.column.currentData()
        chosen = self.alignment.currentData()
        own: dict[str, Any] = {"kind": kind, "column": column}
        if self.is_formula:
            within = {
                "subject": self.builder.subject.currentData(),
                "strata": self.builder.strata.currentData(),
            }
            own |= {"formula": self.builder.formula, **within}
        elif self.pairs:
            own |= {"kind": "pairs", "between": self.between, "pairs": self.pairs}
        else:
            own |= {"between": () if self.is_regression else self.between, "covariates": self.covariates}
        own |= self._settings.model_dump(exclude={"seeds"}) | {"complete_cases": self.complete.isChecked()}
        return tuple(Question(alignment=item, **own) for item in (_BOTH if chosen is None else (chosen,)))

    def ask(self, request: Question) -> bool:
        """Show a question of before; return whether the cohort still has its column and groups."""
        kind = request.kind if request.kind in (_NUMBER, _FORMULA) else _GROUPS
        offered = [self.column.itemData(at) for at in range(self.column.count())]
        if (request.column, kind) not in offered:
            return False
        self.column.setCurrentIndex(offered.index((request.column, kind)))
        self.complete.setChecked(request.complete_cases)
        self._offer_values()
        if request.kind == "formula":
            self.builder.show_question(request.formula, request.subject, request.strata)
        for box, value in zip((self.first, self.second), request.between, strict=False):
            box.setCurrentText(value)
        self.every.setChecked(len(request.between) > 2)
        self._offer_pairings()
        self.pairing.setCurrentIndex(max(self.pairing.findData(request.pairs), 0))
        self._offer_pairings()  # what depends on it
        self.adjust.choose(lambda name: name in request.covariates)
        self.further.choose(lambda name: name in request.between or len(request.between) < 3)
        self._settings = self._settings.model_copy(
            update=request.model_dump(include=set(Precision.model_fields))
        )
        self.tests.show_values(self._settings)
        self.choose_alignment(request.alignment)
        return self.is_possible

    def _set(self, _: str, settings: AnalysisSettings) -> None:
        self._settings = settings
        self.edited.emit()

    def choose_alignment(self, alignment: Alignment) -> None:
        """Choose the alignment of the comparison."""
        self.alignment.setCurrentIndex(self.alignment.findData(alignment))
        self.edited.emit()

    @property
    def between(self) -> tuple[str, ...]:
        """The groups to compare, the first and the second one first."""
        takes_others = self.every.isChecked() and not self.pairs
        return *self._two, *(self.further.chosen if takes_others else ())

    @property
    def _two(self) -> tuple[str, str]:
        return self.first.currentText(), self.second.currentText()

    @property
    def covariates(self) -> tuple[str, ...]:
        """The covariates that are ticked."""
        return tuple(self.adjust.chosen)

    def offer(self) -> None:
        """Offer the columns of the cohort, keeping the choice if it still exists."""
        cohort = self._session.study.cohort
        self.complete.setVisible(self.complete.isChecked() or has_missing(cohort))
        groups = {
            column: (column, _GROUPS)
            for column in ("group", *cohort.columns)
            if 1 < len(values_of(cohort, column)) <= _MOST_VALUES
        }
        problems = {
            f"{column}{_AS_NUMBER}": problem
            for column, problem in numbers_of(cohort, complete=self.complete.isChecked()).items()
        }
        slopes = {text: (text.removesuffix(_AS_NUMBER), _NUMBER) for text in problems}
        self.builder.offer()
        offer(self.column, groups | slopes | ({_SEVERAL: ("", _FORMULA)} if cohort.columns else {}))
        model = self.column.model()
        assert isinstance(model, QStandardItemModel), "a combo box filled item by item has this model"
        for at in range(self.column.count()):
            problem = problems.get(self.column.itemText(at), "")
            model.item(at).setEnabled(not problem)
            self.column.setItemData(at, problem, Qt.ItemDataRole.ToolTipRole)
        self._offer_values()

    def _swap(self) -> None:
        """Swap the groups."""
        first, second = self.first.currentIndex(), self.second.currentIndex()
        self.first.setCurrentIndex(second)
        self.second.setCurrentIndex(first)
        self._offer_pairings()
        self.edited.emit()

    def _offer_values(self) -> None:
        slope = self.is_regression or self.is_formula
        column = self.column.currentData()[0] if self.column.count() else ""
        values = reference_first(values_of(self._session.study.cohort, column))
        for index, box in ((0, self.first), (min(1, len(values) - 1), self.second)):
            if [box.itemText(at) for at in range(box.count())] != values:
                offer(box, dict.fromkeys(values))
                box.setCurrentIndex(index if values else -1)
        show_all(not slope, *self._names, self.first, self.second, self.swap)
        self.slope.setVisible(self.is_regression)
        self.builder.setVisible(self.is_formula)
        self._offer_pairings()
        complete = self.complete.isChecked()
        self.adjust.offer(
            covariates_of(self._session.study.cohort, column, complete=complete),
            title=lambda name: name.removesuffix(CATEGORY) + " (as categories)" * name.endswith(CATEGORY),
            tip="Remove the effect of {} on shape before the test",
        )

    def _offer_pairings(self) -> None:
        slope = self.is_regression or self.is_formula or not self.column.count()
        columns = (
            [] if slope else pairings_of(self._session.study.cohort, self.column.currentData()[0], self._two)
        )
        offer(
            self.pairing, {"Subjects are not paired": None} | {f"Paired by {name}": name for name in columns}
        )
        self.pairing.setVisible(bool(columns))
        self.adjust.setVisible(not self.pairs and not self.is_formula)
        self.every.setVisible(self.first.count() > 2 and not slope and not self.pairs)
        self._offer_further()

    def _offer_further(self) -> None:
        values = [self.first.itemText(index) for index in range(self.first.count())]
        others = [value for value in values if value not in self._two]
        self.further.offer(dict.fromkeys(others, ""), ticked=True)
        one_kind = not self.is_regression and not self.is_formula and not self.pairs
        self.further.setVisible(len(others) > 1 and self.every.isChecked() and one_kind)

    def _covariates_text(self, names: list[str]) -> str:
        own = size_name(self._session.study.cohort)
        chosen = [f"{SIZE} of the shape" if name == own else name for name in names]
        text = f"Adjust for {', '.join(chosen)}" if chosen else "Adjust for covariates…"
        return text if len(text) < _LONG else f"Adjust for {len(chosen)} covariates"


def _further_text(chosen: list[str]) -> str:
    names = ", ".join(chosen) or "none"
    return f"Further groups: {names if len(names) < _LONG else len(chosen)}"
