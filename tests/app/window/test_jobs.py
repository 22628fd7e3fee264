"""Jobs as the window shows them."""

import shutil
import threading

import pytest

pytestmark = pytest.mark.window


def test_a_job_that_waits_for_background_work_is_shown_at_once(window, wait):
    work, released, done = window.workspace.work, threading.Event(), []
    wait(lambda: work.runner.job is None)
    work.compute("prepare", lambda _: released.wait(30.0), "preparing", lambda _: None)
    work.compute("sample", lambda _: "sample", "writing the sample", done.append)
    assert window.start_page.progress.isVisible()
    assert window.start_page.progress.message.text() == "Preparing"  # what it waits for
    released.set()
    wait(lambda: done == ["sample"])
    assert not window.start_page.progress.isVisible()


def test_a_run_is_offered_first_when_settings_have_changed_since(explored):
    panel, session = explored.inspector.correspond, explored.workspace.session
    is_primary = [[button.property("primary") for button in (panel.go, panel.proceed)]]
    particles = session.study.settings.optimize.model_copy(update={"particles": 64})
    explored.workspace.edit_settings("optimize", "particles", particles)
    is_primary.append([button.property("primary") for button in (panel.go, panel.proceed)])
    assert is_primary == [["false", "true"], ["true", "false"]]


def test_a_job_has_one_progress_bar_on_its_page_and_at_most_one_elsewhere(explored, wait):
    from PySide6.QtWidgets import QProgressBar

    from homolog_app.window.session import PAGE_OF_JOB

    session, work, seen = explored.workspace.session, explored.workspace.work, {}
    on_rail = {"groom": "groom", "run": "correspond"}
    for kind in (*on_rail, "groups", "seeds", "mend", "patient", "model", "study"):
        wait(lambda: work.runner.job is None)  # a page's own request would replace one that waits
        stopped = threading.Event()
        work.compute(kind, lambda _, stopped=stopped: stopped.wait(30.0), "counting", lambda _: None)
        wait(lambda: session.job.status is not None)
        places = (PAGE_OF_JOB.get(kind, "Overview"), on_rail.get(kind, "explore")), ("Overview", "explore")
        seen[kind] = []
        for page, step in places:
            session.show_page(page, step)
            seen[kind].append(sum(bar.isVisible() for bar in explored.findChildren(QProgressBar)))
        stopped.set()
    wait(lambda: not session.job.is_busy)
    assert seen == {kind: [1, 0 if kind in on_rail else 1] for kind in seen}


def test_a_project_that_is_being_opened_can_be_groomed_only_when_its_result_is_there(
    window, finished, tmp_path, wait
):
    shutil.copytree(finished, tmp_path / "copy")
    window.projects.open_paths([tmp_path / "copy"])
    session, commands = window.workspace.session, window.commands
    for command in ("run.groom", "run.start"):
        assert not commands[command].isEnabled()
        commands[command].trigger()
    wait(lambda: session.result is not None and not session.job.is_busy)
    result = session.result
    commands["run.groom"].trigger()  # perhaps while groomed shapes are still looked for
    wait(lambda: not session.job.is_busy)
    assert session.is_groomed
    assert session.result is result


def test_progress_never_runs_backwards(explored, wait):
    session, work, seen, released = explored.workspace.session, explored.workspace.work, [], threading.Event()

    def steps(tick):
        for fraction in (0.2, 0.6, 0.1, 0.7):
            tick(fraction, f"step {fraction}")
            wanted = len(seen)
            while len(seen) == wanted and not released.is_set():
                released.wait(0.005)

    def note():
        if session.job.status is not None:
            seen.append((session.job.status.fraction, session.job.status.message))

    wait(lambda: work.runner.job is None)
    session.job_progressed.connect(note)
    session.job_changed.connect(note)
    work.compute("study", steps, "counting", lambda _: released.set())
    wait(released.is_set)
    assert [fraction for fraction, _ in seen] == sorted(fraction for fraction, _ in seen)
    assert (0.6, "step 0.1") in seen


def test_plots_fold_away_and_come_back(explored, wait):
    explored.commands["explore.modes"].trigger()
    page = explored.inspector.explore.page
    wait(page.plots.isVisible)
    explored.commands["view.plots"].trigger()
    assert not page.plots.isVisible()
    explored.commands["explore.measure"].trigger()
    assert not explored.inspector.explore.page.plots.isVisible()
    explored.commands["view.plots"].trigger()
    assert explored.inspector.explore.page.plots.isVisible()


def test_enter_presses_the_button_that_has_the_focus(explored):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    button = explored.rail.buttons["cohort"]
    explored.activateWindow()
    button.setFocus()
    QTest.keyClick(button, Qt.Key.Key_Return)
    assert explored.workspace.session.step == "cohort"


def test_enter_opens_the_box_that_has_the_focus(explored, wait):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    explored.commands["explore.modes"].trigger()
    box = explored.inspector.explore.page.views
    wait(box.isEnabled)
    explored.activateWindow()
    box.setFocus()
    QTest.keyClick(box, Qt.Key.Key_Return)
    assert box.view().isVisible()
    box.hidePopup()


def test_shapes_have_half_of_a_small_window_when_plots_are_folded(explored, wait):
    explored.resize(1440, 900)
    explored.commands["explore.modes"].trigger()
    explored.commands["view.plots"].trigger()
    explored.resize(1280, 800)
    shapes = explored.views.stage.scene.plot

    def share():
        return shapes.width() * shapes.height() / (1280 * 800)

    wait(lambda: share() >= 0.5, 10, f"{share():.2f}")
    explored.commands["view.plots"].trigger()
