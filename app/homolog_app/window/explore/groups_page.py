"""The page *Groups*: tests of group differences or of a number's effect, and their map."""

import shlex
from functools import partial
from typing import TYPE_CHECKING

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QComboBox

from homolog.arrays import Array
from homolog.io.results import Result
from homolog.progress import Tick
from homolog_app.rendering.content import SubjectContents, ViewContents
from homolog_app.rendering.text import shortened, typeset
from homolog_app.scenes.group_answers import (
    Answers,
    answer_question,
    map_answers,
    question_of,
)
from homolog_app.scenes.shapes import PALE_LABELS, group_scene
from homolog_app.scenes.states import GroupsView
from homolog_app.window.actions import Actions
from homolog_app.window.explore.controls import NumbersTable, Player
from homolog_app.window.explore.group_form import GroupForm
from homolog_app.window.explore.group_results import (
    GroupPlot,
    GroupResults,
    SeedAnswers,
    correction_sentence,
    number_rows,
    question_text,
)
from homolog_app.window.explore.page import CompareBox, ExplorePage, ModelCache
from homolog_app.window.explore.verdict_bar import may_use
from homolog_app.window.session import PAGE_OF_JOB
from homolog_app.window.widgets import (
    PercentEdit,
    Progress,
    button,
    choice,
    enable_all,
    fill,
    having,
    held,
    label,
    link,
    named_rows,
    prose,
    rule,
    say,
    set_dimmed,
    set_enabled,
    set_primary,
    show_all,
    slider,
    tick,
)
from homolog_app.window.workspace import Workspace

if TYPE_CHECKING:
    from homolog_app.scenes.group_answers import GroupAnswer, GroupMap

__all__ = ["GroupsPage"]

_MAPS = {"Mean difference": "difference", "Discriminant": "discriminant"}
_LAYOUTS = {"The map": 1, "Group means and maps": 4}
_WHOLE = 100
_END = 14  # maximum letters of a group's name next to the slider


_AGAIN = (
    "Place the particles again with other seeds, store the runs in the project, and report how the "
    "answer varies; takes as long as that many runs"
)


class GroupsPage(ExplorePage):
    """The question, its answer in words and numbers, and how the map is shown."""

    title = "Groups"
    compares = True
    hint = "Differences between groups, or effects of a number, with their tests."

    answered = Signal()

    def __init__(self, workspace: Workspace, actions: Actions, fitted: ModelCache) -> None:
        super().__init__(workspace, actions, fitted)
        self.answers: list[GroupAnswer] = []
        self.all: Answers | None = None
        self._mapped = (0, 0)
        self._questions: frozenset[str] = frozenset()
        self._current = True
        self.form = GroupForm(workspace.session)
        needs = "Assign groups in Cohort (Ctrl+G) or import a table. A group needs two subjects."
        self.nothing = label(needs, wrap=True)
        changed = "The question has changed. Compare again to update the answer."
        self.stale = label(changed, "Problem", wrap=True)
        self.verdict, self.effect, self.question = prose("SectionTitle"), prose(), prose("Hint")
        self.results, self.others, self.summary = GroupResults(), prose("Hint"), prose()
        self.cautions, self.kept, self.by_seed = prose("Problem"), prose("Hint"), SeedAnswers()
        self.numbers = NumbersTable()
        self.map = choice("Map", _MAPS)
        self.views: QComboBox = choice("Views", _LAYOUTS)
        self.significant, self.arrows = tick("Significance", checked=True), tick("Arrows")
        largest = "Show the largest significant region of the map"
        self.to_significant = button("Go to largest", does=self._go_to_significant, toolTip=largest)
        self.way = slider("From the first group or value to the second", 0, _WHOLE)
        self.first, self.second = label(""), label("")
        self.player: Player = Player(actions, lambda: fitted.draw_ms, {"": _WHOLE / 2.0})
        self.compare = CompareBox(actions, fitted)
        self.progress = Progress(actions["run.cancel"])
        self.go = button("Compare groups", "primary", actions["explore.test"].trigger)
        self.keep = button("Add to report", does=actions["explore.keep"].trigger)
        self.seeds = button("", does=self.repeat, toolTip=_AGAIN)
        self.plots = self.chart = GroupPlot(workspace.theme)
        self._lay_out()
        self._connect()
        self.show_answers()

    def _lay_out(self) -> None:
        percent = PercentEdit("Percent of the way to the second group or value", self.way)
        self.answer = held(
            *(self.verdict, self.effect, self.question, self.results, self.others, self.by_seed),
            [self.first, (self.way, 1), self.second, percent, label("%", "Unit")],
            named_rows((("Map", self.map), ("Views", self.views))),
            [self.significant, self.arrows, ..., self.to_significant],
            *(self.player, rule(), self.cautions, self.numbers, self.summary),
        )
        fill(self.body, self.form, self.compare, rule(), self.nothing, self.stale, self.answer, ...)
        fill(self.footer, self.progress, self.kept, [self.seeds, self.keep], self.go)

    def _connect(self) -> None:
        session = self.workspace.session
        self.results.chosen.connect(self.choose_pair)
        for signal in (self.form.edited, session.study_changed):
            signal.connect(self.show_answers)
            signal.connect(self.shown_changed)
        self.chart.follow_selection(session)
        self.fitted.changed.connect(self._follow_models)
        self.way.valueChanged.connect(self._follow_path)
        self.player.swung.connect(lambda value: self.way.setValue(round(_WHOLE / 2 + value)))
        link(self.shown_changed, self.map.activated, self.views.activated)
        link(self.shown_changed, self.significant.toggled, self.arrows.toggled)
        self.map.activated.connect(self._update_map)
        self.chart.morphed.connect(self._morph)

    def test(self, *, turns: bool = True) -> None:
        """Open this page and test the chosen groups in each model shown."""
        if turns:
            self.page_wanted.emit()
        models = self.fitted.both
        if not models or not self.form.is_possible or not may_use(self.window(), self.workspace.session):
            return
        requests = self.form.requests
        answer = partial(answer_question, models, self.workspace.session.study.whole, requests)
        text = " and ".join(requests[0].between) or f"shapes by {requests[0].formula or requests[0].column}"
        self.workspace.work.compute("groups", answer, f"comparing {text}", self._receive)

    @property
    def is_current(self) -> bool:
        """Whether the answer shown, if any, belongs to the question in the form."""
        return self._current

    def _is_current(self) -> bool:
        if self.all is None or not self.answers:
            return True
        if not self.form.is_possible:
            return False
        result = self.answers[0].shape.result
        return (
            question_of(self.form.requests, result, self.workspace.session.study.whole) == self.all.question
        )

    def store(self) -> None:
        """Write the answer's tables into the project, as ``homolog analyze`` does, for the report."""
        answers = self.all
        if answers is None or not self._current:
            return
        project, result = self.workspace.shown_project, self._tested(answers)

        def store(tick: Tick) -> None:
            from homolog.comparison.tables import store

            tick(0.0, "storing the answer")
            for answer in answers.own:
                store(project, answer, result)

        self.workspace.work.compute(
            "study",
            store,
            "storing the answer",
            lambda _: say(self.kept, SeedAnswers.STORED),
        )

    def _tested(self, answers: Answers) -> Result:
        """Return the result that was asked about, with the current table."""
        return answers.models[0].result.with_table_of(self.workspace.session.study.whole.subjects)

    def repeat(self) -> None:
        """Answer the question with other seeds of the correspondence, as ``--seeds`` does, and store all."""
        answers = self.all
        if answers is None or not self._current:
            return
        project, result, seeds = self.workspace.shown_project, self._tested(answers), self.form.seeds

        def repeat(tick: Tick) -> list[str]:
            from homolog.comparison.project import repeat_answers

            return repeat_answers(project, result, answers.own, seeds, tick)

        self.workspace.work.compute(
            "seeds",
            repeat,
            f"answers of {seeds} seeds",
            lambda sentences: self.by_seed.show_sentences(sentences, self.reveal),
        )

    def shown(self, subjects: SubjectContents) -> ViewContents:
        """Return the map of the answer, or the mean shape before there is an answer."""
        view = self.chosen
        return ViewContents(subjects) if view is None else group_scene(view, self.fitted.both, self.answers)

    @property
    def chosen(self) -> GroupsView | None:
        """The state of the controls, and the answered question; None until the model is fitted."""
        if self.fitted.shape is None:
            return None
        return GroupsView(
            request=self.answers[0].study.question if self.answers else None,
            pair=self._mapped[1],
            map=self.map.currentData(),
            outdated=not self._current,
            count=self.views.currentData() if self.answers else 1,
            way=self.way.value() / _WHOLE,
            only_significant=self.significant.isChecked(),
            arrows=self.arrows.isChecked(),
            colour_range=self.colour_range,
            from_middle=self.fitted.from_middle,
        )

    @property
    def layouts(self) -> tuple[int, ...] | None:
        """One view before there is an answer."""
        return (1,) if self.chosen is not None and not self.answers else super().layouts

    def _receive(self, answered: "tuple[Answers, list[GroupAnswer]]") -> None:
        self.all, self.answers = answered
        self._mapped = (0, 0)
        self._questions |= self.all.question.titles
        say(self.kept, "")
        self.by_seed.hide()
        self.show_answers()
        self._follow_path()
        if (finding := self._finding) is not None:
            self.turn_wanted.emit(*finding)
        self.answered.emit()

    def choose_pair(self, request: int, pair: int) -> None:
        """Show another comparison: its numbers, and its map once it is computed."""
        answers, models, cohort = self.all, self.fitted.both, self.workspace.session.study.whole
        if answers is None or (request, pair) == self._mapped or self.workspace.session.job.is_busy:
            return

        def take(mapped: "list[GroupAnswer]") -> None:
            self.answers, self._mapped = mapped, (request, pair)
            self.show_answers()
            self._follow_path()

        self.workspace.work.compute(
            "groups",
            lambda tick: map_answers(answers, models, cohort, (request, pair), tick),
            "mapping",
            take,
        )

    def _follow_models(self) -> None:
        models = self.fitted.both
        again = bool(self.answers) and len(models) > len(self.answers) and self._current
        self.answers = [answer for answer in self.answers if answer.shape in models]
        if not self.answers:
            self.all, self._questions = None, frozenset()
        self.show_answers()
        self.shown_changed.emit()
        if again and self.answers:
            self.test(turns=False)

    def _follow_path(self) -> None:
        first, second = self.chart.ends
        self.chart.show_cursor(first + (second - first) * self.way.value() / _WHOLE, 0.0)
        self.shown_changed.emit()

    def _morph(self, x: float, _: float) -> None:
        self.player.stop()
        first, second = self.chart.ends
        self.way.setValue(round(_WHOLE * (x - first) / (second - first)))

    @property
    def _map(self) -> "GroupMap | None":
        """The map that is chosen, of the open result."""
        answer = self.answers[0] if self.answers else None
        if answer is None:
            return None
        return answer.discriminant if self.map.currentData() == "discriminant" else answer.difference

    def _update_map(self) -> None:
        """Explain grey on the chosen map, and enable the button for the largest region."""
        self.significant.setToolTip(f"Pale: {PALE_LABELS[self.map.currentData()]}")
        self.to_significant.setEnabled(self._map is not None and bool(self._map.significant.any()))

    @property
    def _finding(self) -> tuple[str, Array, Array] | None:
        """The middle of the largest significant region as it is shown: content, place, outward normal."""
        drawn, (content, *_) = self._map, self.shown(SubjectContents()).contents or (None,)
        if drawn is None or not drawn.significant.any() or content is None or content.groomed is None:
            return None
        shape = self.answers[0].shape
        vertex = drawn.middle(shape.mean)
        surface = content.groomed.placed(content.alignment)
        return content.name, surface.vertices[vertex], surface.vertex_normals[vertex]

    def _go_to_significant(self) -> None:
        """Show the largest significant region."""
        if (finding := self._finding) is not None:
            self.place_wanted.emit(*finding)

    def show_state(self) -> None:
        """Update status and buttons."""
        session, form = self.workspace.session, self.form
        idle = not session.job.is_busy
        enable_all(idle and self._current and not session.read_only, self.keep, self.seeds)
        self.results.setEnabled(idle)
        status = session.job.status if PAGE_OF_JOB.get(session.job.kind) == self.title else None
        self.progress.show_status(status)
        asks = (
            "Test the effect" if form.is_regression else "Compare pairs" if form.pairs else "Compare groups"
        )
        self.go.setText("Test the terms" if form.is_formula else asks)
        self.seeds.setText(f"Repeat with {form.seeds} seeds")
        has_result = session.result is not None and self.fitted.shape is not None
        set_enabled(self.go, has_result and form.is_possible and idle)
        self.go.setVisible(status is None)
        set_primary(self.go, not (self.answers and self._current))

    def show_answers(self) -> None:
        """Show the answers and whether they match the form."""
        answers = self.answers
        self._current = self._is_current()
        ways = (self.way, self.player, self.map, self.views, self.significant, self.arrows)
        enable_all(bool(answers), *ways)
        if answers and answers[0].discriminant is None:
            self.map.setCurrentIndex(0)
            self.map.setEnabled(False)
        show_all(bool(answers), self.keep, self.seeds)
        if self.all is not None:
            folder = str(self.workspace.shown_project.folder)
            line = ["homolog", "analyze", folder, *self.all.question.arguments]
            self.keep.setToolTip(f"Write its tables into the project; equivalent command: {shlex.join(line)}")
        names = (answers[0].first, answers[0].second) if answers else ("", "")
        for end, name in zip((self.first, self.second), names, strict=True):
            having(end, text=shortened(name, _END), toolTip=name)
        self.chart.show_answer(answers[0] if answers else None)
        self._update_texts()
        self._update_map()
        self.show_state()

    def _update_texts(self) -> None:
        answers = self.answers
        self.nothing.setVisible(not answers and not self.form.is_possible)
        self.answer.setVisible(bool(answers))
        self.stale.setVisible(not self._current)
        for widget in (self.answer, self.chart):
            set_dimmed(widget, not self._current)
        if not answers or self.all is None:
            return
        from homolog.comparison.findings import CONTROLS, cautions, findings

        study = answers[0].study
        sentences = dict(zip(study.comparisons, findings(study), strict=True))
        first = sentences[answers[0].pair]
        self.verdict.setText(typeset(first.title))
        named_lines = {f"{name}: {text}": name in ("Covariates", "Power") for name, text in first.lines}
        self.effect.setText(
            typeset("\n".join(text for text, is_further in named_lines.items() if not is_further))
        )
        self.question.setText(question_text(study.question))
        self.results.show_answers(self.all, self._mapped)
        say(self.others, correction_sentence(self.all, len(self._questions - self.all.question.titles)))
        self.summary.setText(
            typeset(
                "\n".join(
                    [
                        *(text for text, is_further in named_lines.items() if is_further),
                        *study.further_lines,
                        CONTROLS,
                    ]
                )
            )
        )
        say(self.cautions, typeset("\n".join(cautions(study))))
        shapes = [answer.shape for answer in answers]
        self.numbers.show_rows([shape.title_among(shapes) for shape in shapes], number_rows(answers))
