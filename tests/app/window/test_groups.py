"""The Groups page on the real window: beans of two widths, and ventricles of patients."""

import csv
import re
import traceback
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QPoint
from PySide6.QtGui import QImage
from PySide6.QtWidgets import QMainWindow

pytestmark = pytest.mark.window

_EACH = 3


@pytest.fixture(scope="session")
def ventricles(data, run, tmp_path_factory):
    """Return a project of left ventricles: normal, with thick walls (HCM), and widened (DCM)."""
    from homolog.cohort import Cohort, Subject

    folder = data / "lv_acdc_dev"
    with (folder / "subjects.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    subjects = [
        Subject(row["id"], (folder / row["iso"]).resolve(), group)
        for group in ("NOR", "HCM", "DCM")
        for row in [item for item in rows if item["group"] == group][:_EACH]
    ]
    cohort = Cohort(tuple(subjects), folder)
    return run(tmp_path_factory.mktemp("ventricles") / "lv", cohort, mesh_edge=5.0, spacing=3.0)


@pytest.fixture
def compare(window, wait, explore):
    """Return a function that opens a project and compares two of its groups."""

    def tested(project, first, second, alignment="Form: size and shape together"):
        page = window.inspector.explore.page
        if window.workspace.session.result is None:
            page = explore(project, "groups")
        page.form.first.setCurrentText(first)
        page.form.second.setCurrentText(second)
        page.form.alignment.setCurrentText(alignment)
        page.answers = []
        window.commands["explore.test"].trigger()
        wait(lambda: bool(page.answers), seconds=300, what="for the test")
        return page

    return tested


def test_beans_with_wide_slots_differ_at_the_slot_and_nowhere_else(compare, bean_project, window):
    page = compare(bean_project, "slim", "wide")
    (answer,) = page.answers
    vertices, outward = answer.shape.mean.vertices, answer.difference.outward
    below = vertices[:, 2] < -5.0
    in_slot = np.square(vertices / (40.0, 30.0, 20.0)).sum(axis=1) < 0.85
    assert np.abs(outward[in_slot]).mean() > 4.0 * np.abs(outward[below]).mean()
    assert outward[in_slot].mean() < 0.0  # what is carved deeper has contracted


def test_a_click_passes_the_functions_that_the_architecture_names(
    compare, bean_project, explore, window, wait, monkeypatch
):
    from homolog.comparison import answer
    from homolog_app.window.runner import Runner

    core, start, passed = answer.compare_two_groups, Runner.start, {}

    def names(frames):
        ours = [frame for frame in frames if "homolog_app" in frame.filename and "<lambda>" not in frame.name]
        return [item.name for item in ours]

    def started(runner, job):
        passed["window"] = [*names(traceback.extract_stack()), "start"]
        start(runner, job)

    def computed(*given, **named):
        passed["thread"] = names(traceback.extract_stack())
        return core(*given, **named)

    explore(bean_project, "groups")
    wait(lambda: window.workspace.work.runner.job is None, what="for what is done in the background")
    monkeypatch.setattr(Runner, "start", started)
    monkeypatch.setattr(answer, "compare_two_groups", computed)
    compare(bean_project, "slim", "wide")
    architecture = (Path(__file__).parents[3] / "docs/architecture.md").read_text()
    (row,) = [line for line in architecture.splitlines() if line.startswith("| *Compare groups*")]
    _, _, in_window, in_thread, _, _ = row.split("|")
    for place, cell in (("window", in_window), ("thread", in_thread)):
        assert passed[place] == [name.split(".")[-1] for name in re.findall(r"`([^`]+)`", cell)]


def test_the_table_says_what_the_analysis_found(compare, bean_project, own_permutations, monkeypatch):
    page = compare(bean_project, "slim", "wide")
    (answer,) = page.answers
    test, texts = answer.pair.test, dict(page.numbers.texts)
    assert texts["Subjects"] == "5 slim, 5 wide"
    assert texts["Hotelling's T²"] == f"{test.t_squared:.1f}"
    assert test.exact
    assert texts[f"All {test.permutations + 1} permutations"].startswith("p = ")
    assert "90 % CI" in texts["Mahalanobis D"]
    local = texts["Significant area (FWE-corrected p ≤ 0.05)"]
    assert "of 128 particles" in local
    assert "slim" in page.verdict.text()
    assert [line.partition(":")[0] for line in page.effect.text().splitlines()] == ["Size", "Form", "Place"]
    told = "homolog.comparison.findings.cautions"
    monkeypatch.setattr(told, lambda study: (f"look at {study.names[0]}",))
    page.show_answers()
    assert page.cautions.isVisible()
    assert answer.study.names[0] in page.cautions.text()


def test_the_slider_goes_from_one_groups_mean_to_the_others(compare, bean_project, window):
    page = compare(bean_project, "slim", "wide", "As the shapes lie (not aligned)")
    (answer,) = page.answers
    scene, result = window.views.stage.scene, answer.shape.result
    labels = np.array(answer.study.labels)
    for value, group in ((0, "slim"), (100, "wide")):
        page.way.setValue(value)
        (shown,) = scene.shown
        mean = result.world[labels == group].mean(axis=0)
        moved = answer.shape.mean.vertices + answer.shape.carried((mean - answer.shape.model.mean_)[None])[0]
        np.testing.assert_allclose(shown.groomed.vertices, moved, atol=0.01)


def test_what_is_not_significant_is_pale_with_a_line_around_the_rest_in_both_maps(
    compare, bean_project, window
):
    page = compare(bean_project, "slim", "wide")
    (answer,) = page.answers
    scene = window.views.stage.scene
    assert page.significant.isChecked()  # nothing stands coloured as firm that is not
    colours, firm = scene.shown[0].colours.astype(int), answer.difference.significant
    if firm.any() and not firm.all():
        assert len(scene.shown[0].lines) > 0
    scale = scene.bar.scale
    assert scale.low == -scale.high
    assert scale.unit == "mm"
    assert "pale: p > 0.05, corrected over the surface" in scale.note
    page.significant.setChecked(False)
    full = scene.shown[0].colours.astype(int)
    assert (np.ptp(colours[~firm], axis=1) <= np.ptp(full[~firm], axis=1)).all()  # every effect is faded
    assert np.ptp(colours[~firm], axis=1).sum() < 0.5 * np.ptp(full[~firm], axis=1).sum()
    np.testing.assert_array_equal(colours[firm], full[firm])  # and the significant part saturated
    assert scene.shown[0].lines is None
    assert "pale" not in scene.bar.scale.note
    page.significant.setChecked(True)
    page.map.setCurrentText("Discriminant")
    page.map.activated.emit(1)
    assert "interval" in page.significant.toolTip()
    assert "interval" in window.views.stage.scene.bar.scale.note
    if answer.pair.p_adjusted > 0.05:
        assert not answer.discriminant.significant.any()
        assert not page.to_significant.isEnabled()


@pytest.mark.own_window
def test_a_button_goes_to_the_largest_significant_place(compare, bean_project, window):
    page = compare(bean_project, "slim", "wide")
    answer = page.answers[0]
    firm = np.zeros_like(answer.difference.significant)
    top, left = answer.shape.mean.vertices.argmax(axis=0)[[2, 0]]
    near = np.linalg.norm(answer.shape.mean.vertices - answer.shape.mean.vertices[top], axis=1) < 8.0
    firm[near] = firm[left] = True
    page.answers = [replace(answer, difference=replace(answer.difference, significant=firm))]
    page.show_answers()
    gone = []
    page.place_wanted.connect(lambda _, place, __: gone.append(place))
    page.to_significant.click()
    assert np.linalg.norm(gone[0] - answer.shape.mean.vertices[top]) < 8.0


def test_a_second_run_stands_below_with_the_same_colours_and_its_own_numbers(
    compare, bean_project, window, wait
):
    page = compare(bean_project, "slim", "wide")
    page.fitted.compare_with(bean_project)
    wait(lambda: len(page.answers) == 2, seconds=300)
    scene = window.views.stage.scene
    assert (scene.grid.columns, len(scene.shown)) == (1, 2)
    np.testing.assert_array_equal(scene.shown[0].colours, scene.shown[1].colours)
    assert all(len(row) == 3 for row in page.numbers.texts)


def test_the_original_method_stands_above_the_proposed_one(compare, bean_project, window):
    from homolog.settings import Method
    from homolog_app.scenes.shapes import group_scene
    from homolog_app.scenes.states import GroupsView

    (answer,) = compare(bean_project, "slim", "wide").answers
    original = replace(answer.shape, name="first", method=Method.EUCLIDEAN)
    both = [answer, replace(answer, shape=original)]
    shown = group_scene(GroupsView(), [answer.shape, original], both)
    assert [content.name for content in shown.contents] == [
        "first (Euclidean)",
        "project (geodesics and normals)",
    ]


def test_groups_edited_after_the_run_are_the_ones_compared(compare, bean_project, window, explore):
    page = explore(bean_project, "groups")
    session = window.workspace.session
    names = [member.name for member in session.study.members]
    session.select(names[:4])
    session.set_group("early")
    session.select(names[4:])
    session.set_group("late")
    page = compare(bean_project, "early", "late")
    assert page.answers[0].pair.counts == {"early": 4, "late": 6}


def test_an_answer_whose_question_has_changed_is_dimmed_and_says_so(compare, bean_project, window):
    page = compare(bean_project, "slim", "wide")
    scene = window.views.stage.scene
    assert page.question.text() == "Form (size and shape)."
    assert page.is_current
    assert not page.stale.isVisible()
    page.significant.setChecked(False)
    colours = np.ptp(scene.shown[0].colours.astype(int), axis=1).max()
    box = page.form.alignment
    box.setCurrentText("Size, and shape without it")
    box.activated.emit(box.currentIndex())
    assert page.stale.isVisible()
    assert page.answer.graphicsEffect().isEnabled()
    assert not page.keep.isEnabled()
    assert page.question.text() == "Form (size and shape)."  # what the answer is still about
    assert np.ptp(scene.shown[0].colours.astype(int), axis=1).max() < 0.3 * colours
    assert "the question has changed" in scene.bar.scale.note
    box.setCurrentText("Form: size and shape together")
    box.activated.emit(box.currentIndex())
    assert page.is_current
    assert page.keep.isEnabled()
    session = window.workspace.session
    session.select([session.study.members[0].name])
    session.set_group("third")
    assert page.stale.isVisible()
    session.undo.undo()
    assert not page.stale.isVisible()


def test_a_dimmed_plot_is_paler_on_the_screen(qapp, plots, wait):
    from homolog_app.window.explore.plot import Plot
    from homolog_app.window.theme import Theme
    from homolog_app.window.widgets import set_dimmed

    class Line(Plot):
        is_empty = False

        def draw(self, figure):
            figure.add_subplot().plot([0.0, 1.0], linewidth=8.0)

    def contrast():
        corner = plot.mapToGlobal(QPoint(0, 0))
        shot = (
            qapp.primaryScreen().grabWindow(0, corner.x(), corner.y(), plot.width(), plot.height()).toImage()
        )
        grey = shot.convertToFormat(QImage.Format.Format_Grayscale8)
        return np.frombuffer(grey.constBits(), np.uint8).std()

    holder = QMainWindow()
    plot = Line(Theme(qapp, "light"), "line", "")
    holder.setCentralWidget(plot)
    holder.resize(400, 300)
    holder.show()
    wait(lambda: contrast() > 20.0)
    plotted = contrast()
    set_dimmed(plot, dimmed=True)
    wait(lambda: contrast() < 0.6 * plotted, 5.0)
    holder.close()


@pytest.mark.own_window
def test_all_pairs_of_groups_are_asked_of_shape_and_form_at_once_with_corrected_p(
    explore, bean_project, window, wait
):
    from homolog.comparison.stored import StoredAnswer, StoredTest

    page, session = explore(bean_project, "groups"), window.workspace.session
    names = [member.name for member in session.study.members]
    for group, members in (("a", names[:4]), ("b", names[4:7]), ("c", names[7:])):
        session.select(members)
        session.set_group(group)
    page.form.every.setChecked(True)
    page.form.alignment.setCurrentText("Both: shape and form (two answers)")
    window.commands["explore.test"].trigger()
    wait(lambda: bool(page.answers), seconds=300)
    shape, form = page.all.own
    titles = [row[0].partition(";")[0] for row in page.results.texts]
    pairs = ["b − a", "c − a", "c − b"]
    assert titles == ["Shape (size removed)", *pairs, "Form (size and shape)", *pairs]
    assert dict(page.numbers.texts)["Size of all groups"].startswith("F(2, ")
    assert page.others.text() == "p is corrected for 3 pairs of groups (Holm)."
    top = page.results.topLevelItem(1)
    page.results.setCurrentItem(top.child(2))
    wait(lambda: page.answers[0].study is form)
    assert page.answers[0].pair is form.pairwise[2]
    assert page.verdict.text().startswith("c − b (3 b, 3 c)")
    assert page.question.text() == "Form (size and shape)."
    assert (page.first.text(), page.second.text()) == ("b", "c")
    assert page.chosen.pair == 2
    page.form.every.setChecked(False)
    request = shape.question
    tests = {pair.title: StoredTest(0.01, 999, pair.distance) for pair in shape.pairwise}
    overview = window.inspector.explore.pages[0]
    overview.kept.show_answers(
        [StoredAnswer(request, False, tests)]
    )  # a double click on a stored answer goes there
    overview.kept.itemActivated.emit(overview.kept.topLevelItem(0).child(1), 0)
    assert page.form.request.between == request.between
    wait(lambda: page.answers[0].pair is page.all.own[0].pairwise[1])
    assert page.verdict.text().startswith("c − a")


def test_other_questions_asked_of_the_same_result_are_counted(compare, bean_project, window):
    page = compare(bean_project, "slim", "wide")
    assert page.others.text() == ""
    page = compare(bean_project, "slim", "wide", "Size, and shape without it")
    assert page.others.text() == "p is not corrected for 1 other question asked in this session."


def test_pairs_of_subjects_are_compared_as_the_command_line_does(explore, bean_project, window, wait):
    from homolog.comparison.ask import ask
    from homolog.comparison.question import Question
    from homolog.comparison.sample import Sample

    page, session = explore(bean_project, "groups"), window.workspace.session
    seen, changed = {"slim": 0, "wide": 0}, {}
    for member in session.study.members:
        group = member.subject.group
        columns = {"patient": f"p{seen[group]}", "weight": f"{member.name}"}
        changed[member.name] = replace(member, subject=replace(member.subject, columns=columns))
        seen[group] += 1
    session.edit("Table", session.study.with_members(changed))
    offered = [page.form.pairing.itemText(at) for at in range(page.form.pairing.count())]
    assert offered == ["Subjects are not paired", "Paired by patient"]
    page.form.pairing.setCurrentIndex(1)
    page.form.pairing.activated.emit(1)
    page.form.alignment.setCurrentText("Form: size and shape together")
    assert not page.form.adjust.isVisible()  # pairs are compared without covariates
    window.commands["explore.test"].trigger()
    wait(lambda: bool(page.answers), seconds=300)
    answer, result = page.answers[0], page.answers[0].shape.result
    labels = tuple(member.subject.group for member in session.study.members)
    columns = tuple(changed[name].subject.columns for name in result.names)
    request = Question(kind="pairs", between=("slim", "wide"), pairs="patient", alignment="form")
    expected = ask(Sample.of(replace(result, groups=labels, columns=columns)), request).overall
    assert answer.pair.p_adjusted == expected.p_adjusted
    np.testing.assert_array_equal(answer.pair.p_fwe, expected.p_fwe)
    assert not page.form.complete.isVisible()  # nothing is missing
    first = next(iter(changed.values()))
    unweighed = replace(first, subject=replace(first.subject, columns={"patient": "p0"}))
    session.edit("Weight", session.study.with_members({first.name: unweighed}))
    assert page.form.complete.isVisible()
    window.commands["edit.undo"].trigger()
    assert page.verdict.text().startswith("wide − slim (5 pairs)")
    assert dict(page.numbers.texts)["Subjects"] == "5 pairs"
    second = np.array(labels)[answer.subjects] == "wide"
    assert answer.places[second].mean() > answer.places[~second].mean()
    session.edit(
        "Table",
        session.study.with_members(
            {name: replace(item, subject=replace(item.subject, columns={})) for name, item in changed.items()}
        ),
    )
    assert not page.form.pairing.isVisible()
    assert page.stale.isVisible()


def test_too_few_subjects_are_said_and_nothing_breaks(explore, finished, window, errors, wait):
    page = explore(finished, "groups")
    session = window.workspace.session
    for names, group in ((("a", "b"), "x"), (("c", "d"), "y")):
        session.select(names)
        session.set_group(group)
    window.commands["explore.test"].trigger()
    wait(lambda: bool(errors))
    assert "degrees of freedom" in str(errors[0][1])
    assert not page.answers


def test_the_button_that_asked_keeps_the_focus_and_no_other_part_of_the_window_gets_it(
    explore, bean_project, window, wait
):
    page = explore(bean_project, "groups")
    window.activateWindow()
    page.go.setFocus()
    page.go.click()
    wait(lambda: page.progress.isVisible())
    assert window.focusWidget() is page
    wait(lambda: bool(page.answers) and not window.workspace.session.job.is_busy)
    assert window.focusWidget() is page.go


def test_a_test_can_be_cancelled(explore, bean_project, window, wait):
    page = explore(bean_project, "groups")
    window.commands["explore.test"].trigger()
    wait(lambda: page.progress.isVisible())
    window.commands["run.cancel"].trigger()
    wait(lambda: not window.workspace.session.job.is_busy)
    assert not page.answers
    assert page.go.isVisible()


def walls(answer):
    """Return which vertices are on the inner wall: their normals point to the cavity's long axis."""
    shape = answer.shape
    centred = shape.mean.vertices - shape.mean.vertices.mean(axis=0)
    _, _, axes = np.linalg.svd(centred, full_matrices=False)
    across = centred - np.outer(centred @ axes[0], axes[0])
    return (across * shape.mean_normals).sum(axis=1) < 0.0


def test_ventricles_with_thick_walls_expand_and_widened_ones_move_outward(compare, ventricles):
    (thick,) = compare(ventricles, "NOR", "HCM").answers
    outward = thick.difference.outward
    assert (outward > 0.0).mean() > 0.6
    assert outward.mean() > 0.3
    page = compare(ventricles, "NOR", "DCM")
    (wide,) = page.answers
    inner = walls(wide)
    assert wide.difference.outward[inner].mean() < -0.5  # the cavity's wall goes away from its axis
    assert wide.difference.outward[~inner].mean() > 0.5
    assert {item for item, _ in page.numbers.texts} >= {"Hotelling's T²", "Mahalanobis D", "Size"}
