"""The answer of the page *Groups* as a table, and the plot of its subjects."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QMargins, QRect, Qt, QTimer, Signal
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QLabel, QTreeWidget, QTreeWidgetItem, QWidget

from homolog.comparison.findings import effect_text, share_of_surface
from homolog.comparison.formula import FormulaAnswer
from homolog.comparison.question import ALIGNED, Question
from homolog.comparison.stored import StoredAnswer
from homolog.statistics.cautions import LEVEL, p_number, p_text
from homolog.statistics.data_notes import PARTNER_MISSING
from homolog_app.rendering.text import short, signed, typeset
from homolog_app.window.explore.mode_plots import ELLIPSES, ScatterPlot
from homolog_app.window.theme import Theme
from homolog_app.window.widgets import GRID, having

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

    from homolog.comparison.answer import Answer
    from homolog.statistics.anova import Allometry
    from homolog.statistics.assumptions import Dispersion
    from homolog.statistics.comparison import Comparison
    from homolog.statistics.effects import Effect
    from homolog_app.scenes.group_answers import Answers, GroupAnswer

__all__ = [
    "AnswerTable",
    "GroupPlot",
    "GroupResults",
    "SeedAnswers",
    "StoredAnswers",
    "correction_sentence",
    "number_rows",
    "question_text",
]


_HEADS = ("Effect", "D (90 % CI)", "p", "Area")
_STORED_HEADS = ("Question", "Effect (90 % CI)", "p")
_TIPS = (
    "Second minus first group, or the number",
    "Mahalanobis distance of the means, or change per unit of the variable, corrected for bias [SD]",
    "Permutation test of the whole shape; corrected for pairs of groups (Holm)",
    f"Share of the surface with p ≤ {LEVEL:g}, corrected over the surface and pairs",
)
PREDICTED = "Predicted lines"
"""Option of a plot along a number: what the formula predicts, in place of regression scores."""
_MOST_ROWS = 8
_MARGIN, _TALL = 11, 10_000  # pixels: padding of a cell (style sheet and Qt); unlimited height
_PLACE = Qt.ItemDataRole.UserRole


class AnswerTable(QTreeWidget):
    """Answers under headings: a row for each comparison, as high as its first rows.

    Parameters
    ----------
    name : str
        Accessible name.
    heads, tips : sequence of str
        The columns and their explanations; the first column takes the free width.
    """

    def __init__(self, name: str, heads: Sequence[str], tips: Sequence[str]) -> None:
        super().__init__()
        having(self, accessibleName=name, indentation=8, alternatingRowColors=True, wordWrap=True)
        having(self, rootIsDecorated=False, itemsExpandable=False, uniformRowHeights=False)
        self.texts: list[tuple[str, ...]] = []
        self.setColumnCount(len(heads))
        self.setHeaderLabels(list(heads))
        for column, tip in enumerate(tips):
            self.headerItem().setToolTip(column, tip)
        self.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        self.header().setStretchLastSection(False)
        self.header().setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        self.header().setSectionResizeMode(0, QHeaderView.ResizeMode.Stretch)
        self.header().sectionResized.connect(self._wrap)

    def show_rows(
        self, parts: "Sequence[tuple[str, Sequence[tuple[str, ...]]]]", chosen: tuple[int, int] | None = None
    ) -> None:
        """Show headings with their rows, and select the row with the given numbers of heading and row."""
        self.blockSignals(True)
        self.clear()
        tops = []
        for number, (heading, rows) in enumerate(parts):
            top = QTreeWidgetItem([heading])
            top.setFlags(Qt.ItemFlag.ItemIsEnabled)
            self.addTopLevelItem(top)
            tops.append(top)
            top.setFirstColumnSpanned(True)
            for line, row in enumerate(rows):
                item = QTreeWidgetItem(list(row))
                item.setData(0, _PLACE, (number, line))
                item.setToolTip(0, item.text(0))  # it may be elided
                top.addChild(item)
                if (number, line) == chosen:
                    self.setCurrentItem(item)
        self.texts = [self._texts(item) for item in self._rows()]
        self.expandAll()
        self.blockSignals(False)
        self._wrap(0)
        self._fit_height()

    def _wrap(self, column: int) -> None:
        """Wrap names at the new width of their column, and take the height that they need."""
        if column:
            return
        metrics, room = self.fontMetrics(), self.columnWidth(0) - self.indentation() - 2 * _MARGIN
        for row in self._rows():
            row.setData(0, Qt.ItemDataRole.SizeHintRole, None)
            wrapped = metrics.boundingRect(
                QRect(0, 0, room, _TALL), Qt.TextFlag.TextWordWrap.value, row.text(0)
            ).height()
            if row.parent() is not None and wrapped > metrics.height():  # Qt's own hint is of one line
                hint = self.sizeHintForIndex(self.indexFromItem(row))
                row.setSizeHint(0, hint.grownBy(QMargins(0, 0, 0, wrapped - metrics.height())))
        self.scheduleDelayedItemsLayout()
        QTimer.singleShot(0, self, self._fit_height)  # a layout in progress would ignore the new height

    def _fit_height(self) -> None:
        """Take the height of the first rows."""
        heights = [self.visualItemRect(row).height() for row in self._rows()[:_MOST_ROWS]]
        height = self.header().sizeHint().height() + sum(heights) + 2 * self.frameWidth() + GRID
        if height != self.height():
            self.setFixedHeight(height)
        self.updateGeometry()  # also if it was set while a layout was at work

    def _rows(self) -> list[QTreeWidgetItem]:
        """Return headings and comparisons from top to bottom."""
        tops = [self.topLevelItem(row) for row in range(self.topLevelItemCount())]
        return [row for top in tops if top is not None for row in (top, *_children(top))]

    def _texts(self, item: QTreeWidgetItem) -> tuple[str, ...]:
        return tuple(item.text(column) for column in range(self.columnCount()))


class GroupResults(AnswerTable):
    """A heading for each alignment, with the test of all groups, and a row for each pair of groups."""

    chosen = Signal(int, int)

    def __init__(self) -> None:
        super().__init__("Results of all comparisons", _HEADS, _TIPS)
        self.currentItemChanged.connect(self._choose)
        self.hide()

    def show_answers(self, answers: "Answers | None", chosen: tuple[int, int]) -> None:
        """Show the comparisons of the open result, if there is more than one."""
        studies = answers.own if answers is not None else ()
        slope = bool(studies) and studies[0].question.kind == "regression"
        self.headerItem().setText(1, "Per unit (90 % CI)" if slope else _HEADS[1])
        parts = [(_heading(study), [_values(study, pair) for pair in study.between_two]) for study in studies]
        self.show_rows(parts, chosen)
        self.setVisible(sum(len(rows) for _, rows in parts) > 1)

    def _choose(self, item: QTreeWidgetItem | None) -> None:
        place = item.data(0, _PLACE) if item is not None else None
        if place is not None:
            self.chosen.emit(*place)


def correction_sentence(answers: "Answers", others: int) -> str:
    """Describe the corrections of p.

    Parameters
    ----------
    answers : Answers
    others : int
        How many other questions were asked of the result since the project was opened.
    """
    corrected = correction_text(answers.own[0])
    if not others:
        return f"p is {corrected}." if corrected else ""
    rest = f"for {others} other question{'' if others == 1 else 's'} asked in this session"
    return f"p is {corrected}, but not {rest}." if corrected else f"p is not corrected {rest}."


def _children(top: QTreeWidgetItem) -> list[QTreeWidgetItem]:
    rows = (top.child(row) for row in range(top.childCount()))
    return [row for row in rows if row is not None]


def _heading(study: "Answer") -> str:
    """Return the alignment and, for three or more groups, whether any differ."""
    text, overall = ALIGNED[study.question.alignment], study.overall
    text = f"{text[0].upper()}{text[1:]}"
    if not study.pairwise:
        return text
    far = "" if overall.distance is None else f"D {overall.distance.value:.2f}, "
    return f"{text}; any difference: {far}{p_text(overall.p_adjusted, overall.test.permutations)}"


def _values(study: "Answer", comparison: "Comparison") -> tuple[str, str, str, str]:
    effect = _effect_text(comparison.distance if comparison.test.modes else None, study.question)
    p = p_number(comparison.p_adjusted, comparison.test.permutations)
    share = share_of_surface(study, comparison)
    return (
        typeset(comparison.title),
        effect,
        p,
        f"{share:.0f} %" if (comparison.p_fwe <= LEVEL).any() else "none",
    )


def _effect_text(distance: "Effect | None", request: Question) -> str:
    if distance is None:
        return "–"
    form = ".3g" if request.kind == "regression" else ".2f"
    return f"{distance.value:{form}} ({distance.low:{form}} to {distance.high:{form}})"


class StoredAnswers(AnswerTable):
    """The answers in the project's folder; a double click or Enter chooses one."""

    chosen = Signal(object, str)
    """The request, and the title of the comparison."""

    def __init__(self) -> None:
        super().__init__("Answers stored in the project", _STORED_HEADS, _TIPS[:3])
        self._places: list[tuple[Question, tuple[str, ...]]] = []
        self.itemActivated.connect(lambda item, _: self._choose(item))

    def show_answers(self, kept: Sequence[StoredAnswer]) -> None:
        """Show the answers, or hide the table if there are none."""
        self._places = [(study.question, tuple(study.tests)) for study in kept]
        self.show_rows(
            [
                (
                    typeset(study.question.title) + (" (primary)" if study.is_primary else ""),
                    [
                        (
                            typeset("Any difference" if name == ", ".join(study.question.between) else name),
                            _effect_text(test.distance, study.question),
                            p_number(test.p, test.permutations),
                        )
                        for name, test in study.tests.items()
                    ],
                )
                for study in kept
            ]
        )
        self.setVisible(bool(kept))

    @property
    def current_request(self) -> Question | None:
        """The request of the selected answer, if there is one."""
        item = self.currentItem()
        top = None if item is None else item.parent() or item
        return None if top is None else self._places[self.indexOfTopLevelItem(top)][0]

    def _choose(self, item: QTreeWidgetItem) -> None:
        top = item.parent() or item
        request, names = self._places[self.indexOfTopLevelItem(top)]
        place = item.data(0, _PLACE)
        self.chosen.emit(request, names[place[1]] if place is not None else "")


def _line(answer: "GroupAnswer") -> str:
    return "discriminant" if answer.discriminant is not None else "mean difference"


class SeedAnswers(QLabel):
    """How the answers vary with the seed of the correspondence; hidden until that is known."""

    STORED = "Stored in the project; Export > Report includes it."

    def __init__(self) -> None:
        super().__init__()
        selectable = Qt.TextInteractionFlag.TextSelectableByMouse
        having(self, wordWrap=True, textFormat=Qt.TextFormat.PlainText, textInteractionFlags=selectable)
        self.hide()

    def show_sentences(self, sentences: Sequence[str], reveal: Callable[[QWidget], None]) -> None:
        """Show the sentences, and bring them into view once there is room for them."""
        self.setText(typeset("\n".join([*sentences, self.STORED])))
        self.show()
        QTimer.singleShot(0, self, lambda: reveal(self))


class GroupPlot(ScatterPlot):
    """Each subject's position between the groups, one line of markers per group; click selects, drag morphs.

    `ends` are the positions of the groups' means.
    """

    def __init__(self, theme: Theme) -> None:
        super().__init__(theme)
        self.setAccessibleName("Subjects along the discriminant")
        self.hint.setText(
            "The position of each subject between the groups appears here after the comparison."
        )
        del self.options[ELLIPSES]  # the vertical position has no meaning
        self.ends = (0.0, 1.0)
        self._answer: GroupAnswer | None = None

    def show_answer(self, answer: "GroupAnswer | None") -> None:
        """Show the positions of an answer's subjects, or none."""
        if answer is None or answer.places is None:
            self._answer = None
            self.show_scores(np.empty((0, 2)), (), (), ("", ""))
            return
        self._answer = answer
        if (along := self._allometry) is None:
            self.options.pop(PREDICTED, None)
        names = [answer.shape.result.names[subject] for subject in answer.subjects]
        if answer.values is None:
            from homolog_app.plots import discriminant_points

            groups = answer.groups
            second = np.array([group == answer.second for group in groups], dtype=bool)
            points = discriminant_points(answer.places, second)
            self.ends = float(answer.places[~second].mean()), float(answer.places[second].mean())
            line = _line(answer)
            self.title, label = f"Subjects along the {line}", f"position along the {line} (mm)"
            self.show_scores(points, names, groups, (label, ""))
            return
        self.ends = float(answer.values.min()), float(answer.values.max())
        groups, places, way = answer.groups, answer.places, ""
        if along is not None:
            from homolog_app.plots import ALLOMETRY

            is_predicted = self.options.setdefault(PREDICTED, False)
            places, way = (along.scores, along.predicted)[is_predicted], ALLOMETRY[is_predicted]
            groups = tuple(answer.study.labels[subject] for subject in answer.subjects)
        self.title = f"Subjects by {answer.pair.title}"
        self.show_scores(np.column_stack([answer.values, places]), names, groups, (answer.pair.title, way))

    @property
    def _allometry(self) -> "Allometry | None":
        """How shape changes along the number shown, of a formula."""
        study = None if self._answer is None else self._answer.study
        if self._answer is None or not isinstance(study, FormulaAnswer):
            return None
        return dict(study.allometry).get(self._answer.pair.title)

    def set_option(self, text: str, shown: bool) -> None:
        """Switch one of the options."""
        super().set_option(text, shown)
        if text == PREDICTED:
            self.show_answer(self._answer)

    def draw_data(self, axes: "Axes") -> None:
        """Draw the groups, or the line of the regression among the subjects."""
        from homolog_app.plots import draw_along, draw_discriminant, draw_slope, group_order

        answer, colours = self._answer, self.theme.colours
        assert answer is not None
        assert answer.places is not None
        if answer.values is None:
            second = np.array([group == answer.second for group in self.groups], dtype=bool)
            order = group_order(answer.study.labels if answer.study.question.between else answer.groups)
            two = answer.first, answer.second
            draw_discriminant(axes, answer.places, second, two, order, colours, along=_line(answer))
            return
        if self._allometry is not None:
            draw_along(axes, self.points, self.groups, self.labels, colours)
            return
        slope = float(np.linalg.norm(answer.pair.pointwise.effect[0])) / np.sqrt(len(answer.pair.mean))
        column = answer.pair.title
        draw_slope(axes, answer.values, answer.places, self.groups, column, slope, colours)

    def draw_mark(self, axes: "Axes") -> "Artist":
        """Draw a line at the shape shown."""
        from homolog_app.plots import draw_place

        return draw_place(axes, self.mark[0], None, self.theme.colours)

    def text_of(self, name: str) -> str:
        """Return a subject's position as text."""
        index = self.names.index(name)
        x, y = self.points[index].tolist()
        if self._answer is None or self._answer.values is None:
            return f"{self.title_of(index)}: {signed(x)} mm"
        return f"{name}: {self.labels[0]} {short(x)}, {signed(y)} mm along the effect"


def correction_text(answer: "Answer") -> str:
    """Return the correction of p-values for pairs of groups, or nothing."""
    return f"corrected for {len(answer.pairwise)} pairs of groups (Holm)" if answer.pairwise else ""


def question_text(request: Question) -> str:
    """Return alignment, covariates and exclusions, for the line below the headline."""
    how = ALIGNED[request.alignment]
    parts = [f"{how[0].upper()}{how[1:]}"]
    parts += [f"paired by {request.pairs}"] if request.pairs else []
    parts += [f"adjusted for {', '.join(request.covariates)}"] if request.covariates else []
    parts += [f"repeated within {request.subject}"] if request.subject else []
    parts += [f"within {request.strata}"] if request.strata else []
    parts += ["subjects with missing values excluded"] if request.complete_cases else []
    return f"{', '.join(parts)}."


def number_rows(answers: "list[GroupAnswer]") -> list[tuple[str, ...]]:
    """Return the rows of the table: a name and a value for each answer."""
    columns = [dict(_rows(answer)) for answer in answers]
    names = list(dict.fromkeys(name for column in columns for name in column))
    return [(name, *(column.get(name, "–") for column in columns)) for name in names]


def _rows(answer: "GroupAnswer") -> list[tuple[str, str]]:
    pair, study = answer.pair, answer.study
    slope = answer.values is not None
    rows = [*_subject_rows(answer), *_test_rows(answer)]
    if pair.dispersion is not None:
        rows.append(("Dispersion", _dispersion_text(pair.dispersion)))
    inside = int(np.count_nonzero(pair.p_fwe <= LEVEL))
    share = f"{inside} of {len(pair.p_fwe)} particles, {share_of_surface(study, pair):.1f} % of the surface"
    rows.append((f"Significant area (FWE-corrected p ≤ {LEVEL:g})", share))
    likely = int(np.count_nonzero(pair.pointwise.q <= LEVEL))
    rows.append(("At a false discovery rate of 5 %", f"{likely} particles"))
    if slope:
        most = float(np.linalg.norm(answer.difference.ways, axis=1).max())
        rows.append(("Change", f"up to {short(most)} mm from {answer.first} to {answer.second}"))
    if isinstance(study, FormulaAnswer):
        row = study.coordinates[study.terms.index(pair) - len(study.terms) - 2]
        rows.append(("Degrees of freedom, sum of squares", f"{row.dof}, {row.squares:.4g} mm²"))
        rows.append(("R², F, Z", f"{row.r_squared:.3f}, {row.f or 0.0:.2f}, {row.z or 0.0:.2f}"))
    if study.question.covariates:
        rows.append(("Adjusted for", ", ".join(study.question.covariates)))
    rows += [*_classification_rows(answer), *_size_rows(answer)]
    return rows


def _subject_rows(answer: "GroupAnswer") -> list[tuple[str, str]]:
    study, slope = answer.study, answer.values is not None
    counts = answer.pair.counts.items()
    is_one = slope or study.question.kind == "formula"
    rows = [("Subjects", ", ".join(f"{count}{'' if is_one else f' {name}'}" for name, count in counts))]
    if study.left_out and study.question.complete_cases:
        incomplete = sum(why.startswith("no value") for why in study.left_out.values())
        alone = sum(why == PARTNER_MISSING for why in study.left_out.values())
        partners = f", {alone} whose partner is missing" if alone else ""
        rows.append(("Excluded", f"{incomplete} with missing values{partners} (complete cases)"))
    return rows


def _test_rows(answer: "GroupAnswer") -> list[tuple[str, str]]:
    """Return the rows on the test of the whole shape."""
    pair, test = answer.pair, answer.pair.test
    rows = [("Modes retained (parallel analysis)", str(test.modes))]
    if pair.distance is not None and test.modes:
        name = "Mahalanobis D" if answer.values is None else "Change per unit"
        rows.append((name, effect_text(pair.distance, " SD", ci="90 % CI ")))
    if pair.explained is not None:
        rows.append(("Explained variance ω²", effect_text(pair.explained, ci="90 % CI ")))
    if not test.modes:
        return rows
    how = f"All {test.permutations + 1} permutations" if test.exact else f"{test.permutations} permutations"
    rows.append((how, p_text(test.p_permutation, test.permutations)))
    if correction := correction_text(answer.study):
        rows.append(("Corrected", f"{p_text(pair.p_adjusted, test.permutations)}, {correction}"))
    if test.t_squared is not None:
        rows += [
            ("Hotelling's T²", f"{test.t_squared:.1f}"),
            (f"F({test.dof[0]:g}, {test.dof[1]:.4g})", f"{test.f:.2f}, {p_text(test.p)}"),
        ]
    return rows


def _classification_rows(answer: "GroupAnswer") -> list[tuple[str, str]]:
    pair, discriminant = answer.pair, answer.pair.discriminant
    if discriminant is None:
        return []
    right = ", ".join(
        f"{round(own, 1):g} of {count} {name}"
        for own, (name, count) in zip(discriminant.right, pair.counts.items(), strict=True)
    )
    known = ((p, discriminant.auc.permutations) for p in (pair.accuracy_p_adjusted, pair.auc_p_adjusted))
    accuracy, auc = ("" if p is None else f", {p_text(p, count)}" for p, count in known)
    return [
        (
            "Balanced accuracy",
            f"{effect_text(discriminant.accuracy, ' %', ci='95 % CI ', step=100.0)}{accuracy}",
        ),
        ("Classified correctly", right),
        ("AUC", f"{effect_text(discriminant.auc, ci='95 % CI ')}{auc}"),
    ]


def _size_rows(answer: "GroupAnswer") -> list[tuple[str, str]]:
    pair, rows = answer.pair, list[tuple[str, str]]()
    overall, between = answer.study.overall.size, answer.study.overall.size_variance
    if overall is not None and overall.p is not None and between is not None:
        p, share = p_text(overall.p, overall.permutations), between.omega_squared
        f = f"F({between.dof[0]:g}, {between.dof[1]:.3g}) = {between.f:.2f}"
        rows.append(("Size of all groups", f"{f}, ω² = {effect_text(share, ci='90 % CI ')}, {p}"))
    if pair.size is not None and pair.size_p_adjusted is not None:
        unit = f" mm per unit of {pair.title}" if answer.values is not None else " mm"
        p = p_text(pair.size_p_adjusted, pair.size.permutations)
        rows.append(("Size", f"{effect_text(pair.size, unit, ci='95 % CI ', sign=True)}, {p}"))
    return rows


def _dispersion_text(dispersion: "Dispersion") -> str:
    """Return the dispersion of groups, or its change along a variable, with interval and p."""
    groups = ", ".join(f"{name} {value:.2g} mm" for name, value in dispersion.by_group.items())
    ratio = "" if dispersion.effect is None else effect_text(dispersion.effect, ci="95 % CI ")
    second = f"{'ratio' if groups else 'mm per unit'} {ratio}" if ratio else ""
    return ", ".join(filter(None, (groups, second, p_text(dispersion.p, dispersion.permutations))))
