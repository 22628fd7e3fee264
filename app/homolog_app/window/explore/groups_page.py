"""What differs: groups, or shapes along a number, tested, and the difference on the mean shape."""

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QCheckBox, QComboBox, QHBoxLayout, QSlider

from homolog.progress import Tick, part_of
from homolog_app.window.actions import Actions
from homolog_app.window.desk import Desk
from homolog_app.window.explore.chosen import GroupsView
from homolog_app.window.explore.compare_box import CompareBox
from homolog_app.window.explore.fitted import Fitted
from homolog_app.window.explore.group_form import GroupForm
from homolog_app.window.explore.group_plot import GroupPlot
from homolog_app.window.explore.group_views import group_scene
from homolog_app.window.explore.group_words import number_rows
from homolog_app.window.explore.numbers_table import NumbersTable
from homolog_app.window.explore.page import ExplorePage
from homolog_app.window.explore.player import Player
from homolog_app.window.explore.present import with_present_table
from homolog_app.window.progress import Progress
from homolog_app.window.scene.content import Content, Shown
from homolog_app.window.widgets import GRID, button, choice, label, rule

if TYPE_CHECKING:
    from homolog_app.window.explore.group_answer import GroupAnswer

__all__ = ["GroupsPage"]

_MAPS = {"Mean difference": "difference", "Discriminant": "discriminant"}
_LAYOUTS = {"The map": 1, "Ends and maps": 4}
_WHOLE = 100
_SEEDS = 5


class GroupsPage(ExplorePage):
    """The question, its answer in words and numbers, and how the map is shown."""

    title = "Groups"
    hint = "What differs between groups, or changes with a number, and whether to trust it."
    plays = True

    def __init__(self, desk: Desk, actions: Actions, fitted: Fitted) -> None:
        super().__init__(desk, actions, fitted)
        self.answers: list[GroupAnswer] = []
        self.form = GroupForm(desk.session)
        self.verdict = label("", "SectionTitle", wrap=True)
        self.words = label("", wrap=True)
        self.cautions = label("", "Problem", wrap=True)
        self.kept = label("", "Hint", wrap=True)
        for one in (self.verdict, self.words, self.cautions, self.kept):
            one.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.numbers = NumbersTable()
        self.map = choice("Map", _MAPS)
        self.views: QComboBox = choice("Views", _LAYOUTS)
        self.significant = QCheckBox("Grey where not significant")
        self.arrows = QCheckBox("Arrows")
        self.way = QSlider(Qt.Orientation.Horizontal)
        self.way.setMaximum(_WHOLE)
        self.way.setAccessibleName("From the first group or value to the second")
        self.first, self.second = label(""), label("")
        self.player = Player(actions, lambda: fitted.draw_ms, {"": _WHOLE / 2.0})
        self.compare = CompareBox(actions, fitted)
        self.progress = Progress(actions)
        self.go = button("Compare groups", "primary")
        self.keep = button("Keep for the report")
        self.seeds = button(f"Repeat with {_SEEDS} seeds")
        self.seeds.setToolTip(
            "Place the particles again with other seeds, keep the runs in the project, and say how far the "
            "answer spreads; takes as long as that many runs"
        )
        self.plots = self.chart = GroupPlot(desk.theme)
        self._lay_out()
        self._connect(actions)
        self._show()

    def _lay_out(self) -> None:
        self.body.addWidget(self.form)
        self.body.addWidget(self.compare)
        self.body.addWidget(rule())
        self.body.addWidget(self.verdict)
        slide = QHBoxLayout()
        slide.addWidget(self.first)
        slide.addWidget(self.way, 1)
        slide.addWidget(self.second)
        self.body.addLayout(slide)
        choices = QHBoxLayout()
        for box in (self.map, self.views):
            choices.addWidget(box, 1)
        self.body.addLayout(choices)
        ticks = QHBoxLayout()
        for tick in (self.significant, self.arrows):
            ticks.addWidget(tick)
        ticks.addStretch()
        self.body.addLayout(ticks)
        self.body.addWidget(self.player)
        self.body.addWidget(rule())
        for text in (self.cautions, self.numbers, self.words, self.kept):
            self.body.addWidget(text)
        self.body.addStretch()
        self.footer.setSpacing(GRID)
        self.footer.addWidget(self.progress)
        self.footer.addWidget(self.seeds)
        self.footer.addWidget(self.keep)
        self.footer.addWidget(self.go)

    def _connect(self, actions: Actions) -> None:
        session = self.desk.session
        self.go.clicked.connect(actions["explore.test"].trigger)
        self.keep.clicked.connect(actions["explore.keep"].trigger)
        self.seeds.clicked.connect(self.repeat)
        self.form.edited.connect(self._show)
        session.study_changed.connect(self._show)
        session.selection_changed.connect(lambda: self.chart.show_selection(session.selection))
        self.fitted.changed.connect(self._follow_models)
        self.desk.work.changed.connect(self._tell_work)
        self.way.valueChanged.connect(self._follow_way)
        self.player.swung.connect(lambda value: self.way.setValue(round(_WHOLE / 2 + value)))
        for box in (self.map, self.views):
            box.activated.connect(lambda _: self.shown_changed.emit())
        for tick in (self.significant, self.arrows):
            tick.toggled.connect(self.shown_changed)
        self.chart.subject_chosen.connect(lambda name: session.select([name]))
        self.chart.morphed.connect(self._morph)

    def enter(self) -> None:
        """Fit the model if it is not."""
        self.fitted.want()

    def play_or_stop(self) -> bool:
        """Play from group to group, or hold."""
        if self.answers:
            self.player.play_or_stop()
        return True

    def stop(self) -> None:
        """Hold."""
        self.player.stop()

    def test(self) -> None:
        """Test the chosen groups in each model that is shown, in the computing thread."""
        models = self.fitted.both
        if not models or not self.form.is_possible:
            return
        cohort, request = self.desk.session.study, self.form.request

        def answer(tick: Tick) -> "list[GroupAnswer]":
            from homolog_app.window.explore.group_answer import answer_groups

            share = 1.0 / len(models)
            return [
                answer_groups(
                    model, with_present_table(model.result, cohort), request,
                    part_of(tick, index * share, (index + 1) * share),
                )
                for index, model in enumerate(models)
            ]  # fmt: skip

        words = " and ".join(request.between) or f"shapes along {request.column}"
        self.desk.work.compute("groups", answer, f"comparing {words}", self._take)

    def keep_study(self) -> None:
        """Write the answer's tables into the project, as ``homolog analyze`` does, for the report."""
        if not self.answers:
            return
        answer, project = self.answers[0], self.desk.project
        result = with_present_table(answer.shape.result, self.desk.session.study)

        def write(tick: Tick) -> Path:
            from homolog_app.report.keep import keep_study

            tick(0.0, "keeping the answer")
            return keep_study(project, answer.study, result)

        def take(folder: Path) -> None:
            self.kept.setText(f"Kept in {folder}; Export > Report has it.")

        self.desk.work.compute("study", write, "keeping the answer", take)

    def repeat(self) -> None:
        """Answer the question with other seeds of the correspondence too, as ``--seeds`` does; keep it."""
        if not self.answers:
            return
        answer, project = self.answers[0], self.desk.project
        result = with_present_table(answer.shape.result, self.desk.session.study)

        def spread(tick: Tick) -> list[str]:
            from homolog_app.report.keep import keep_study
            from homolog_app.report.seeds import answer_by_seed, spread_words, write_spread

            (found,) = answer_by_seed(project, result, [answer.study.request], _SEEDS, tick)
            write_spread(keep_study(project, answer.study, result), found)
            return spread_words(found)

        def take(words: list[str]) -> None:
            self.kept.setText("\n".join(words))

        self.desk.work.compute("seeds", spread, f"answers of {_SEEDS} seeds", take)

    def shown(self, subjects: Sequence[Content]) -> Shown:
        """Return the map of the answer; the mean shape before there is one."""
        view = self.chosen
        return Shown(subjects) if view is None else group_scene(view, self.fitted.both, self.answers)

    @property
    def chosen(self) -> GroupsView | None:
        """What the controls say, and the question that was answered; None until the model is fitted."""
        if self.fitted.shape is None:
            return None
        return GroupsView(
            request=self.answers[0].study.request if self.answers else None, map=self.map.currentData(),
            count=self.views.currentData() if self.answers else 1, way=self.way.value() / _WHOLE,
            only_significant=self.significant.isChecked(), arrows=self.arrows.isChecked(),
        )  # fmt: skip

    @property
    def layouts(self) -> tuple[int, ...] | None:
        """Before there is an answer, one view."""
        return (1,) if self.chosen is not None and not self.answers else super().layouts

    def _take(self, answers: "list[GroupAnswer]") -> None:
        self.answers = answers
        self.kept.clear()
        self._show()
        self._follow_way()

    def _follow_models(self) -> None:
        models = self.fitted.both
        again = bool(self.answers) and len(models) > len(self.answers)
        self.answers = [one for one in self.answers if one.shape in models]
        self._show()
        self.shown_changed.emit()
        if again and self.answers:
            self.test()

    def _follow_way(self) -> None:
        first, second = self.chart.ends
        self.chart.show_cursor(first + (second - first) * self.way.value() / _WHOLE, 0.0)
        self.shown_changed.emit()

    def _morph(self, x: float, _: float) -> None:
        self.player.stop()
        first, second = self.chart.ends
        self.way.setValue(round(_WHOLE * (x - first) / (second - first)))

    def _tell_work(self) -> None:
        work = self.desk.work
        own = work.kind in ("groups", "model", "compare", "study", "seeds")
        for one in (self.keep, self.seeds):
            one.setEnabled(not work.is_busy)
        self.progress.show_status(work.status if own else None)
        self.go.setVisible(not (own and work.status is not None))
        self.go.setText("Test the effect" if self.form.is_regression else "Compare groups")
        self.go.setEnabled(self.fitted.shape is not None and self.form.is_possible and not work.is_busy)

    def _show(self) -> None:
        answers = self.answers
        for one in (self.way, self.player, self.map, self.views, self.significant, self.arrows):
            one.setEnabled(bool(answers))
        if answers and answers[0].values is not None:
            self.map.setCurrentIndex(0)
            self.map.setEnabled(False)
        self.numbers.setVisible(bool(answers))
        for footer in (self.keep, self.seeds):
            footer.setVisible(bool(answers))
        if answers:
            line = ["homolog", "analyze", str(self.desk.project.folder), *answers[0].study.request.words]
            self.keep.setToolTip(f"Write its tables into the project, like: {shlex.join(line)}")
        self.first.setText(answers[0].first if answers else "")
        self.second.setText(answers[0].second if answers else "")
        self.chart.show_answer(answers[0] if answers else None)
        self._tell_words()
        self._tell_work()

    def _tell_words(self) -> None:
        answers = self.answers
        if not answers:
            possible = self.form.is_possible
            self.verdict.setText("")
            self.words.setText(
                "" if possible else "Give subjects groups in Cohort (Ctrl+G) or import a table. Two "
                "subjects make a group."
            )  # fmt: skip
            self.cautions.setText("")
            return
        from homolog_app.report.findings import cautions, findings

        found = [dict(zip(one.study.comparisons, findings(one.study), strict=True)) for one in answers]
        first = found[0][answers[0].pair]
        self.verdict.setText(first.verdict.replace(" - ", " − "))
        self.words.setText(first.numbers)
        self.cautions.setText("\n".join(cautions(answers[0].study)))
        self.cautions.setVisible(bool(self.cautions.text()))
        self.numbers.show_rows([one.shape.title for one in answers], number_rows(answers))
