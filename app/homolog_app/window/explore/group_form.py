"""The question: column, groups or number, covariates, and how it is tested."""

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QAction, QStandardItemModel
from PySide6.QtWidgets import QCheckBox, QGridLayout, QLabel, QMenu, QWidget

from homolog.comparison.precision import AnalysisSettings, Precision
from homolog.comparison.question import Question
from homolog.statistics.design import reference_first
from homolog.statistics.procrustes import Alignment
from homolog_app.studies.questions import (
    SIZE,
    covariates_of,
    has_missing,
    numbers_of,
    pairings_of,
    size_name,
    values_of,
)
from homolog_app.window.explore.formula_builder import FormulaBuilder
from homolog_app.window.form import SettingsPair
from homolog_app.window.session import Session
from homolog_app.window.widgets import GRID, button, choice, label

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
_NUMBER, _AS_NUMBER = "number", " (as a number)"
_FORMULA, _SEVERAL = "formula", "Several columns (formula)"


class GroupForm(QWidget):
    """Column, first and second group, covariates and alignment."""

    edited = Signal()

    def __init__(self, session: Session) -> None:
        super().__init__()
        self._session = session
        self.column = choice("Column of the comparison")
        self.first, self.second = choice("From"), choice("To")
        self.first.setToolTip("Reference group: differences are relative to it")
        self.swap = button("⇄", "flat")
        self.swap.setToolTip("Swap the two groups")
        self.swap.setAccessibleName("Swap the two groups")
        self.swap.clicked.connect(self._swap)
        self.every = QCheckBox("More than two groups, in pairs (Holm's correction)")
        self.every.setToolTip(
            "Test for any difference, then each pair of groups; p-values of the whole shape, of particles, "
            "of size and of the discriminant are corrected for their number"
        )
        self.further = button("")
        self.further.setAccessibleName("Further groups")
        self.further.setToolTip("Groups that are compared with each other and with the two above")
        self.further_menu = QMenu(self.further)
        self.further.setMenu(self.further_menu)
        self.pairing = choice("Pairs")
        self.pairing.setToolTip(
            "Column that identifies the pairs, such as the patient of two scans; tests the differences "
            "within pairs"
        )
        self.alignment = choice("Alignment", _ALIGNMENTS)
        self.alignment.setToolTip(
            "How shapes are aligned before they are compared; size is always tested separately. Both "
            "asks two questions at once"
        )
        self.complete = QCheckBox("Complete cases: exclude subjects with missing values")
        self.complete.setToolTip("Exclude subjects with missing values in the columns used, and count them")
        self.builder = FormulaBuilder(session)
        self.slope = label("Does shape change with this number? (linear regression)", "Hint", wrap=True)
        self.adjust = button("")
        self.adjust.setAccessibleName("Covariates adjusted for")
        self.adjust.setToolTip("Columns whose effect on shape is removed before the test")
        self.covariate_menu = QMenu(self.adjust)
        self.covariate_menu.setToolTipsVisible(True)
        self.adjust.setMenu(self.covariate_menu)
        self.tests = SettingsPair(AnalysisSettings, main=())
        self._settings = AnalysisSettings()
        self.tests.show_values(self._settings)
        self._lay_out()
        self.tests.edited.connect(self._set)
        self.tests.marked.connect(self.edited)
        self.column.activated.connect(lambda _: self._offer_values())
        self.builder.edited.connect(self.edited)
        for box in (self.first, self.second, self.pairing):
            box.activated.connect(lambda _: self._offer_pairings())
        for box in (self.column, self.first, self.second, self.pairing, self.alignment):
            box.activated.connect(lambda _: self.edited.emit())
        self.complete.toggled.connect(self.offer)
        self.every.toggled.connect(self._offer_further)
        for tick in (self.every, self.complete):
            tick.toggled.connect(self.edited)
        session.study_changed.connect(self.offer)
        self.offer()

    def _lay_out(self) -> None:
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setHorizontalSpacing(GRID)
        grid.setVerticalSpacing(GRID)
        self._names = [QLabel(text) for text in ("Column", "From", "To")]
        places = ((0, 0, 4), (1, 0, 1), (1, 2, 1))
        boxes = (self.column, self.first, self.second)
        for (row, at, span), name, box in zip(places, self._names, boxes, strict=True):
            name.setBuddy(box)
            grid.addWidget(name, row, at)
            grid.addWidget(box, row, at + 1, 1, span)
        grid.addWidget(self.swap, 1, 4)
        for row, widget in enumerate(
            (
                self.builder,
                self.slope,
                self.pairing,
                self.adjust,
                self.complete,
                self.every,
                self.further,
                self.alignment,
                self.tests,
            ),
            start=2,
        ):
            grid.addWidget(widget, row, 0, 1, 5)
        for column in (1, 3):
            grid.setColumnStretch(column, 1)

    @property
    def is_possible(self) -> bool:
        """Whether a number or two different groups are chosen, and all settings are valid."""
        if self.is_formula:
            return not self.tests.problem and bool(self.builder.formula)
        return not self.tests.problem and (
            self.is_regression
            or (self.first.count() > 1 and self.first.currentText() != self.second.currentText())
        )

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
        """The question, once for each requested alignment."""
        column, _ = self.column.currentData()
        chosen = self.alignment.currentData()
        alignments = _BOTH if chosen is None else (chosen,)
        tests = self._settings.model_dump(exclude={"seeds"})
        if self.is_formula:
            return tuple(
                Question(
                    kind="formula",
                    column="",
                    formula=self.builder.formula,
                    subject=self.builder.subject.currentData(),
                    strata=self.builder.strata.currentData(),
                    alignment=alignment,
                    complete_cases=self.complete.isChecked(),
                    **tests,
                )
                for alignment in alignments
            )
        return tuple(
            Question(
                kind="regression" if self.is_regression else "pairs" if self.pairs else "groups",
                column=column,
                between=() if self.is_regression else self.between,
                pairs=self.pairs,
                covariates=() if self.pairs else self.covariates,
                alignment=alignment,
                complete_cases=self.complete.isChecked(),
                **tests,
            )
            for alignment in alignments
        )

    def ask(self, request: Question) -> bool:
        """Choose the question of a request; return False if the cohort's table no longer allows it."""
        kind = {"regression": _NUMBER, "formula": _FORMULA}.get(request.kind, "groups")
        choice = (request.column, kind)
        offered = [self.column.itemData(at) for at in range(self.column.count())]
        if choice not in offered:
            return False
        self.column.setCurrentIndex(offered.index(choice))
        self.complete.setChecked(request.complete_cases)
        self._offer_values()
        if request.kind == "formula":
            self.builder.show_question(request.formula, request.subject, request.strata)
        for box, value in zip((self.first, self.second), request.between, strict=False):
            box.setCurrentText(value)
        self.every.setChecked(len(request.between) > 2)
        self._offer_pairings()
        self.pairing.setCurrentIndex(max(self.pairing.findData(request.pairs), 0))
        self._offer_pairings()
        self.alignment.setCurrentIndex(self.alignment.findData(request.alignment))
        for action in self.covariate_menu.actions():
            action.setChecked(action.isEnabled() and action.data() in request.covariates)
        for action in self.further_menu.actions():
            action.setChecked(action.data() in request.between or len(request.between) < 3)
        kept = request.model_dump(include=set(Precision.model_fields))
        self._settings = self._settings.model_copy(update=kept)
        self.tests.show_values(self._settings)
        self.edited.emit()
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
        """The groups: first and second, then the others to be tested."""
        takes_others = self.every.isChecked() and not self.pairs
        others = [action.data() for action in self.further_menu.actions() if action.isChecked()]
        return (*self._two, *(others if takes_others else ()))

    @property
    def _two(self) -> tuple[str, str]:
        return self.first.currentText(), self.second.currentText()

    @property
    def covariates(self) -> tuple[str, ...]:
        """The covariates: columns that are adjusted for."""
        return tuple(action.data() for action in self.covariate_menu.actions() if action.isChecked())

    def offer(self) -> None:
        """Offer the columns of groups, then those of numbers."""
        study = self._session.study
        self.complete.setVisible(self.complete.isChecked() or has_missing(study))
        groups = {
            column: (column, "groups")
            for column in ("group", *study.columns)
            if 1 < len(values_of(study, column)) <= _MOST_VALUES
        }
        problems = {
            f"{column}{_AS_NUMBER}": problem
            for column, problem in numbers_of(study, complete=self.complete.isChecked()).items()
        }
        slopes = {text: (text.removesuffix(_AS_NUMBER), _NUMBER) for text in problems}
        self.builder.offer()
        offered = groups | slopes | ({_SEVERAL: ("", _FORMULA)} if study.columns else {})
        held = {self.column.itemText(at): self.column.itemData(at) for at in range(self.column.count())}
        if offered != held:
            self.column.clear()
            for text, data in offered.items():
                self.column.addItem(text, data)
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
        slope, column = self.is_regression or self.is_formula, ""
        if self.column.count():
            column, _ = self.column.currentData()
        values = reference_first(values_of(self._session.study, column))
        for index, box in ((0, self.first), (min(1, len(values) - 1), self.second)):
            if [box.itemText(at) for at in range(box.count())] != values:
                box.clear()
                box.addItems(values)
                box.setCurrentIndex(index if values else -1)
        for widget in (*self._names[1:], self.first, self.second, self.swap):
            widget.setVisible(not slope)
        self.slope.setVisible(self.is_regression)
        self.builder.setVisible(self.is_formula)
        self._offer_pairings()
        self._offer_covariates(column)

    def _offer_pairings(self) -> None:
        """Offer the columns that pair the two groups; pairs have neither covariates nor further groups."""
        slope = self.is_regression or self.is_formula or not self.column.count()
        columns = [] if slope else pairings_of(self._session.study, self.column.currentData()[0], self._two)
        offered = {"Subjects are not paired": None} | {f"Paired by {name}": name for name in columns}
        if list(offered) != [self.pairing.itemText(at) for at in range(self.pairing.count())]:
            kept = self.pairing.currentData()
            self.pairing.clear()
            for text, name in offered.items():
                self.pairing.addItem(text, name)
            self.pairing.setCurrentIndex(max(self.pairing.findData(kept), 0) if kept else 0)
        self.pairing.setVisible(bool(columns))
        self.adjust.setVisible(not self.pairs and not self.is_formula)
        self.every.setVisible(self.first.count() > 2 and not slope and not self.pairs)
        self._offer_further()

    def _offer_further(self) -> None:
        """Offer the other groups; initially all are chosen."""
        held = {action.data(): action.isChecked() for action in self.further_menu.actions()}
        values = [self.first.itemText(index) for index in range(self.first.count())]
        others = [value for value in values if value not in self._two]
        if others != list(held):
            self.further_menu.clear()
            for value in others:
                action = QAction(value.replace("&", "&&"), self.further_menu, checkable=True)
                action.setData(value)
                action.setChecked(held.get(value, True))
                action.toggled.connect(self._update_further)
                self.further_menu.addAction(action)
        self.further.setVisible(
            len(others) > 1
            and self.every.isChecked()
            and not (self.is_regression or self.is_formula)
            and not self.pairs
        )
        self._name_further()

    def _update_further(self) -> None:
        self._name_further()
        self.edited.emit()

    def _name_further(self) -> None:
        chosen = [action.data() for action in self.further_menu.actions() if action.isChecked()]
        names = ", ".join(chosen) or "none"
        text = f"Further groups: {names if len(names) < _LONG else len(chosen)}"
        self.further.setText(text.replace("&", "&&"))

    def _offer_covariates(self, column: str) -> None:
        """Offer the other columns, and size; unusable ones give the reason."""
        kept = self.covariates
        self.covariate_menu.clear()
        for name, problem in covariates_of(
            self._session.study, column, complete=self.complete.isChecked()
        ).items():
            text = name.removesuffix(":c") + " (as categories)" * name.endswith(":c")
            action = QAction(text.replace("&", "&&"), self.covariate_menu, checkable=True)
            action.setData(name)
            action.setEnabled(not problem)
            action.setToolTip(problem or f"Remove the effect of {name} on shape before the test")
            action.setChecked(name in kept and not problem)
            action.toggled.connect(self._update_covariates)
            self.covariate_menu.addAction(action)
        self._name_covariates()

    def _update_covariates(self) -> None:
        self._name_covariates()
        self.edited.emit()

    def _name_covariates(self) -> None:
        own = size_name(self._session.study)
        chosen = [f"{SIZE} of the shape" if name == own else name for name in self.covariates]
        text = f"Adjust for {', '.join(chosen)}" if chosen else "Adjust for covariates…"
        self.adjust.setText(
            (text if len(text) < _LONG else f"Adjust for {len(chosen)} covariates").replace("&", "&&")
        )
