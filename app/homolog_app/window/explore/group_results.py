"""All comparisons of a question in a table; one of them is chosen for the map."""

from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QTreeWidget, QTreeWidgetItem

from homolog_app.report.findings import LEVEL, correction_text, p_text
from homolog_app.report.request import SIZE_WORDS

if TYPE_CHECKING:
    from homolog.analysis.comparison import Comparison
    from homolog_app.report.study import Study
    from homolog_app.studies.answers import Answers

__all__ = ["GroupResults", "correction_sentence"]

_HEADS = ("Comparison", "D (95 % CI)", "p", "Surface")
_TIPS = (
    "Second minus first group",
    "Mahalanobis distance of the means, corrected for bias [SD]",
    "Permutation test of the whole shape; corrected for pairs of groups (Holm) and answers (Bonferroni)",
    f"Share of the surface with p ≤ {LEVEL:g}, corrected over the surface, pairs and answers",
)
_MOST_ROWS = 8
_PLACE = Qt.ItemDataRole.UserRole


class GroupResults(QTreeWidget):
    """A heading for each alignment, with the test of all groups, and a row for each pair of groups."""

    chosen = Signal(int, int)

    def __init__(self) -> None:
        super().__init__()
        self.setAccessibleName("Results of all comparisons")
        self.texts: list[tuple[str, ...]] = []
        self.setColumnCount(len(_HEADS))
        self.setHeaderLabels(_HEADS)
        for column, tip in enumerate(_TIPS):
            self.headerItem().setToolTip(column, tip)
        self.setRootIsDecorated(False)
        self.setIndentation(8)
        self.setItemsExpandable(False)
        self.setAlternatingRowColors(True)
        self.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        self.header().setStretchLastSection(False)
        self.header().setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        self.header().setSectionResizeMode(0, QHeaderView.ResizeMode.Stretch)
        self.currentItemChanged.connect(self._choose)
        self.hide()

    def show_answers(self, answers: "Answers | None", chosen: tuple[int, int]) -> None:
        """Show the comparisons of the open result, if there is more than one."""
        self.blockSignals(True)
        self.clear()
        count, tops = 0, []
        for number, study in enumerate(answers.own if answers is not None else ()):
            top = QTreeWidgetItem([_heading(study)])
            top.setFlags(Qt.ItemFlag.ItemIsEnabled)
            self.addTopLevelItem(top)
            tops.append(top)
            pairs = study.pairwise or (study.overall,)
            top.setFirstColumnSpanned(True)
            for pair, comparison in enumerate(pairs):
                item = QTreeWidgetItem(list(_values(study, comparison)))
                item.setData(0, _PLACE, (number, pair))
                top.addChild(item)
                if (number, pair) == chosen:
                    self.setCurrentItem(item)
                count += 1
        self.texts = [_texts(item) for top in tops for item in (top, *_children(top))]
        self.expandAll()
        self.blockSignals(False)
        rows = min(count + self.topLevelItemCount(), _MOST_ROWS)
        height = self.sizeHintForRow(0) if rows else 0
        self.setFixedHeight(self.header().sizeHint().height() + (rows + 1) * max(height, 1))
        self.setVisible(count > 1)

    def _choose(self, item: QTreeWidgetItem | None) -> None:
        place = item.data(0, _PLACE) if item is not None else None
        if place is not None:
            self.chosen.emit(*place)


def correction_sentence(answers: "Answers", others: int) -> str:
    """Say what p is corrected for, and what not.

    Parameters
    ----------
    answers : Answers
    others : int
        How many other questions were asked of the result since the project was opened.
    """
    corrected = correction_text(answers.own[0])
    if not others:
        return f"p is {corrected}." if corrected else ""
    plural = "question" if others == 1 else "questions"
    rest = f"for the {others} other {plural} asked in this session"
    return f"p is {corrected}, but not {rest}." if corrected else f"p is not corrected {rest}."


def _children(top: QTreeWidgetItem) -> list[QTreeWidgetItem]:
    rows = (top.child(row) for row in range(top.childCount()))
    return [row for row in rows if row is not None]


def _texts(item: QTreeWidgetItem) -> tuple[str, ...]:
    return tuple(item.text(column) for column in range(len(_HEADS)))


def _heading(study: "Study") -> str:
    """Return the alignment, and of three or more groups whether any differ."""
    text, overall = SIZE_WORDS[study.request.alignment], study.overall
    text = f"{text[0].upper()}{text[1:]}"
    if not study.pairwise or not overall.test.modes:
        return text
    return f"{text}; any difference: {p_text(overall.p_adjusted, overall.test.permutations)}"


def _values(study: "Study", comparison: "Comparison") -> tuple[str, str, str, str]:
    distance = comparison.distance
    effect = "–"
    if distance is not None and comparison.test.modes:
        effect = f"{distance.value:.2f} ({distance.low:.2f} to {distance.high:.2f})"
    p = "–"
    if comparison.test.modes:
        p = p_text(comparison.p_adjusted, comparison.test.permutations).removeprefix("p ").removeprefix("= ")
    significant = comparison.p_fwe <= LEVEL
    share = (
        100.0 * float(study.areas[significant].sum()) / max(float(study.areas.sum()), np.finfo(float).tiny)
    )
    return (
        comparison.title.replace(" - ", " − "),
        effect,
        p,
        f"{share:.0f} %" if significant.any() else "none",
    )
