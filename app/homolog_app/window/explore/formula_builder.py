"""A formula put together from columns: main effects, interactions, repeated measures, strata."""

from collections.abc import Sequence
from itertools import combinations

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QGridLayout, QLineEdit, QPushButton, QWidget

from homolog.cohort.column_types import CATEGORY, plain_name
from homolog.comparison.choices import covariates_of, strata_of, subjects_of
from homolog.comparison.sample import LOG_SIZE
from homolog.errors import InputError
from homolog.statistics.design import formula_text, parsed
from homolog_app.rendering.text import shortened
from homolog_app.window.session import Session
from homolog_app.window.widgets import (
    button,
    choice,
    clear_grid,
    column,
    having,
    label,
    link,
    named_rows,
    offer,
    say,
)

__all__ = ["FormulaBuilder"]

_IN_A_ROW = 3
_LETTERS = 16  # of a column's name on its chip
_ALONE, _NO_STRATA = "Each row is another subject", "None"


class FormulaBuilder(QWidget):
    """Chips of the columns and of the pairs of those chosen, and the formula that they make.

    The formula can be typed, too; chips then show what it says.
    """

    edited = Signal()

    def __init__(self, session: Session) -> None:
        super().__init__()
        self._session = session
        self._terms: list[tuple[str, ...]] = []
        self.problem = ""
        self.chips: dict[tuple[str, ...], QPushButton] = {}
        tip = "Columns, + (and), : (interaction), * (both and their interaction)"
        self.text = having(
            QLineEdit(placeholderText="~ group * age + sex"), accessibleName="Formula", toolTip=tip
        )
        repeated = "Column of the subject whose rows are repeated measures, such as visits or sides"
        self.subject = choice("Repeated within", tip=repeated)
        self.strata = choice("Strata", tip="Column such as the site; effects are those within")
        self._columns, self._interactions = QGridLayout(), QGridLayout()
        self._between = label("Interactions", "Hint")
        self.fault = label("", "Problem", wrap=True)
        within = named_rows((("Repeated within", self.subject), ("Within strata", self.strata)))
        terms = (label("Main effects", "Hint"), self._columns, self._between, self._interactions)
        column(*terms, self.text, self.fault, within, on=self)
        self.text.editingFinished.connect(self._read)
        link(self.edited, self.subject.activated, self.strata.activated)
        self._show()

    @property
    def formula(self) -> str:
        """The formula; empty without a term."""
        return formula_text(self._terms) if self._terms else ""

    def offer(self) -> None:
        """Offer the columns of the cohort; terms whose columns are gone are dropped."""
        cohort = self._session.study.cohort
        clear_grid(self._columns)
        self.chips = {}
        usable = covariates_of(cohort, "")
        offered = {plain_name(name) if name.endswith(CATEGORY) else name: why for name, why in usable.items()}
        for name, problem in {**offered, LOG_SIZE: ""}.items():
            chip = having(
                self._chip((name,), name), enabled=not problem, toolTip=problem or f"Effect of {name}"
            )
            _place(self._columns, chip)
        offer(self.subject, {_ALONE: None} | {name: name for name in subjects_of(cohort)})
        offer(self.strata, {_NO_STRATA: None} | {name: name for name in strata_of(cohort)})
        known = set(offered) | {LOG_SIZE}
        self._terms = [term for term in self._terms if set(term) <= known]
        self._show()

    def show_question(self, formula: str, subject: str | None, strata: str | None) -> None:
        """Show a formula with its columns of subjects and strata."""
        self.text.setText(formula)
        self._read()
        for box, name in ((self.subject, subject), (self.strata, strata)):
            box.setCurrentIndex(max(box.findData(name), 0) if name else 0)

    def _chip(self, term: tuple[str, ...], text: str) -> QPushButton:
        short = shortened(text, _LETTERS * len(term)).replace("&", "&&")
        chip = button(short, "pick", lambda _: self._turn(term), checkable=True, accessibleName=text)
        self.chips[term] = chip
        return chip

    def _turn(self, term: tuple[str, ...]) -> None:
        """Add a term, or remove it and those that contain it."""
        if term in self._terms:
            self._terms = [item for item in self._terms if not set(term) <= set(item)]
        else:
            self._terms.append(term)
        self.problem = ""
        self._show()
        self.edited.emit()

    def _read(self) -> None:
        """Take over the formula that was typed."""
        if self.text.text().strip() == self.formula:
            return
        try:
            terms: Sequence[tuple[str, ...]] = parsed(self.text.text()) if self.text.text().strip() else ()
            unknown = {name for term in terms for name in term} - {name for name, *_ in self.chips}
            self.problem = f"The cohort has no column {min(unknown)!r}." if unknown else ""
            self._terms = [] if unknown else list(terms)
        except InputError as error:
            self.problem, self._terms = str(error), []
        self._show(rewrites=not self.problem)
        self.edited.emit()

    def _show(self, *, rewrites: bool = True) -> None:
        clear_grid(self._interactions)
        self.chips = {term: chip for term, chip in self.chips.items() if len(term) == 1}
        mains = [name for name, *rest in self._terms if not rest]
        pairs = [*combinations(mains, 2), *(term for term in self._terms if len(term) > 1)]
        for pair in {frozenset(pair): pair for pair in pairs}.values():
            _place(self._interactions, self._chip(pair, " × ".join(pair)))
        chosen = {frozenset(term) for term in self._terms}
        for term, chip in self.chips.items():
            chip.setChecked(frozenset(term) in chosen)
        self._between.setVisible(bool(pairs))
        if rewrites:
            self.text.setText(self.formula)
        say(self.fault, self.problem)


def _place(grid: QGridLayout, chip: QPushButton) -> None:
    grid.addWidget(chip, grid.count() // _IN_A_ROW, grid.count() % _IN_A_ROW)
