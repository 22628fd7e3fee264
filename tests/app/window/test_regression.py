"""Questions about a number, covariates, and answers that are kept, on the real window."""

import shlex

import numpy as np
import pytest

pytestmark = [pytest.mark.window, pytest.mark.own_window]


@pytest.fixture
def page(explore, bean_project, window):
    """Return the Groups page of ten beans, whose table says where each slot is, and who scanned it."""
    from dataclasses import replace

    from homolog.beans.generate import draw_beans

    page, study = explore(bean_project, "groups"), window.workspace.session.study
    changed = {
        member.name: replace(
            member,
            subject=replace(
                member.subject,
                columns={"slot": f"{bean.position:.3f}", "scanner": "AB"[index % 2], "site": "x"},
            ),
        )
        for index, (member, bean) in enumerate(zip(study.members, draw_beans(10), strict=True))
    }
    window.workspace.session.edit("Table", study.with_members(changed))
    return page


def compared(page, window, wait, column):
    page.form.column.setCurrentText(column)
    page.form.column.activated.emit(page.form.column.currentIndex())
    page.answers = []
    window.commands["explore.test"].trigger()
    wait(lambda: bool(page.answers), seconds=300, what="for the answer")
    return page.answers[0]


def test_numbers_are_offered_as_numbers_and_groups_as_groups(page):
    offered = [page.form.column.itemText(index) for index in range(page.form.column.count())]
    assert offered == [
        "group",
        "scanner",
        "slot (as a number)",
        "size (as a number)",
        "Several columns (formula)",
    ]
    page.form.column.setCurrentIndex(2)
    page.form.column.activated.emit(2)
    assert page.go.text() == "Test the effect"
    assert not page.form.first.isVisible()
    assert page.form.request.kind == "regression"


def test_shape_moves_with_the_number_as_the_beans_were_made(page, window, wait):
    page.form.alignment.setCurrentText("As the shapes lie (not aligned)")
    answer = compared(page, window, wait, "slot (as a number)")
    assert "Shape" not in page.effect.text()  # it is of form and pose
    assert "form or pose changes" in page.effect.text()
    scene, model = window.views.stage.scene, answer.shape
    values, places = answer.values, answer.places
    assert abs(np.corrcoef(values, places)[0, 1]) > 0.99
    ends = []
    for value, end in ((0, values.min()), (100, values.max())):
        page.way.setValue(value)
        ends.append(scene.shown[0].groomed.vertices)
        assert scene.shown[0].note == f"slot {end:.3g}".replace("-", "−")
    slope = np.polyfit(values, model.result.world.reshape(10, -1), 1)[0].reshape(-1, 3)
    expected = model.carried(slope[None] * np.ptp(values))[0]
    np.testing.assert_allclose(ends[1] - ends[0], expected, atol=0.02)
    names = {name for name, _ in page.numbers.texts}
    assert "Change" in names
    assert "Mahalanobis D" not in names  # standard deviations apart are of groups
    assert page.chart.title == "Subjects by slot"
    assert "mm along the effect" in page.chart.text_of(model.result.names[0])


def test_a_covariate_is_allowed_for_as_the_command_line_does(page, window, wait):
    from dataclasses import replace

    from homolog.comparison.ask import ask
    from homolog.comparison.question import Question
    from homolog.comparison.sample import Sample

    session = window.workspace.session
    member = session.study.members[0]
    blank = replace(member.subject, columns={**member.subject.columns, "slot": "NA"})
    session.edit("Table", session.study.with_members({member.name: replace(member, subject=blank)}))
    page.form.complete.setChecked(True)
    actions = {action.text(): action for action in page.form.adjust.menu().actions()}
    assert not actions["site"].isEnabled()
    assert actions["site"].toolTip() == "The same for all subjects"
    actions["slot"].setChecked(True)
    assert page.form.adjust.text() == "Adjust for slot"
    answer = compared(page, window, wait, "group")
    assert answer.study.question.covariates == ("slot",)
    texts = dict(page.numbers.texts)
    assert texts["Adjusted for"] == "slot"
    assert texts["Excluded"] == "1 with missing values (complete cases)"

    result = answer.shape.result.with_table_of(window.workspace.session.study.whole.subjects)
    question = Question(between=("slim", "wide"), covariates=("slot",), permutations=499)
    question = question.model_copy(update={"complete_cases": True})
    same = ask(Sample.of(result), question)
    assert same.overall.test.p_permutation == answer.pair.test.p_permutation
    np.testing.assert_array_equal(same.overall.pointwise.effect, answer.pair.pointwise.effect)


def test_settings_of_the_tests_are_those_of_the_command_line_and_of_stored_answers(page):
    from PySide6.QtWidgets import QWidget

    from homolog import analyze
    from homolog.comparison.precision import AnalysisSettings
    from homolog.comparison.question import Question
    from homolog.parameters import parameters
    from homolog_app.cli import command_parser

    options = command_parser()[0].parse_args(["analyze", "PROJECT", "--modes=3", "--permutations=99"])
    assert (options.modes, options.permutations) == ("3", "99")
    names = {parameter.name for parameter in parameters(AnalysisSettings)}
    given = {**analyze.__kwdefaults__, "seed": analyze.__kwdefaults__["random_state"]}
    settings = AnalysisSettings()
    assert {name: given[name] for name in names} == settings.model_dump()
    shown = {row.accessibleName() for row in page.form.tests.more.findChildren(QWidget)}
    assert {parameter.label for parameter in parameters(AnalysisSettings)} <= shown
    stored = Question(between=("slim", "wide"), modes=3, seed=4)
    assert page.form.ask(stored)
    assert (page.form.request.modes, page.form.request.seed) == (3, 4)
    assert {"--modes", "--seed"} <= set(page.form.request.arguments)
    assert page.form.ask(Question(between=("slim", "wide")))
    assert page.form.request.modes is None


def test_three_of_four_groups_can_be_chosen_and_are_chosen_by_a_stored_answer(page, window):
    from dataclasses import replace

    from homolog.comparison.question import Question

    session, form = window.workspace.session, page.form
    members = {
        member.name: replace(member, subject=replace(member.subject, columns={"centre": "ABCD"[index % 4]}))
        for index, member in enumerate(session.study.members)
    }
    session.edit("Table", session.study.with_members(members))
    form.column.setCurrentText("centre")
    form.column.activated.emit(form.column.currentIndex())
    assert form.between == ("A", "B")
    assert not form.further.isVisible()
    form.every.click()
    assert form.further.isVisible()
    assert form.between == ("A", "B", "C", "D")
    form.further.menu().actions()[0].trigger()
    assert form.request.between == ("A", "B", "D")
    assert form.further.text() == "Further groups: D"
    assert form.ask(Question(column="centre", between=("B", "C", "D")))
    assert set(form.request.between) == {"B", "C", "D"}


def test_an_answer_is_kept_as_the_command_line_keeps_it(
    page, window, wait, tmp_path, capsys, own_permutations
):
    from homolog_app.cli import main

    window.projects.save()
    answer = compared(page, window, wait, "slot (as a number)")
    window.commands["explore.keep"].trigger()
    wait(page.kept.text)
    project = window.workspace.project.folder
    folder = project / "analysis" / answer.study.question.name
    dated = ("tests.csv", "tests_without_outliers.csv", "study.json")  # say when they were computed
    mine = {file.name: file.read_bytes() for file in folder.iterdir() if file.name not in dated}
    assert len(mine) > 2
    for file in folder.iterdir():
        file.unlink()
    line = page.keep.toolTip().partition("command: ")[2]
    assert main([*shlex.split(line)[1:], "--progress", "none"]) == 0
    assert {file.name: file.read_bytes() for file in folder.iterdir() if file.name not in dated} == mine


def test_the_answers_of_other_seeds_can_be_cancelled_and_are_shown_where_they_are_read(page, window, wait):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest
    from PySide6.QtWidgets import QAbstractButton, QLineEdit

    (seeds,) = (editor for editor in page.form.findChildren(QLineEdit) if editor.accessibleName() == "seeds")
    seeds.clear()
    seeds.insert("2")
    seeds.textEdited.emit("2")
    assert page.seeds.text() == "Repeat with 2 seeds"
    window.projects.save()
    compared(page, window, wait, "group")
    job = window.workspace.session
    (cancel,) = page.progress.findChildren(QAbstractButton)
    QTest.mouseClick(page.seeds, Qt.MouseButton.LeftButton)
    wait(lambda: job.job.status is not None and "seed 1" in job.job.status.message, what="for seed 1")
    assert not page.seeds.isEnabled()
    QTest.mouseClick(cancel, Qt.MouseButton.LeftButton)
    wait(lambda: not job.job.is_busy, what="for the end")
    assert page.seeds.isEnabled()
    assert not page.by_seed.isVisible()
    QTest.mouseClick(page.seeds, Qt.MouseButton.LeftButton)
    wait(page.by_seed.isVisible, seconds=300, what="for the answers")
    wait(lambda: not page.by_seed.visibleRegion().isEmpty(), what="to see them")
    assert "over 2 seeds" in page.by_seed.text()
    folder = window.workspace.project.folder
    assert (folder / "analysis" / page.answers[0].study.question.name / "seeds.csv").is_file()
