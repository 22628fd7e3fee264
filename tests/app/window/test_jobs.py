"""Jobs as the window shows them."""

import threading

import pytest

pytestmark = pytest.mark.window


def test_a_job_that_waits_for_background_work_is_shown_at_once(window, wait):
    work, released, done = window.workspace.work, threading.Event(), []
    wait(lambda: work.runner.job is None)
    work.compute("prepare", lambda _: released.wait(30.0), "preparing", lambda _: None)
    work.compute("sample", lambda _: "sample", "writing the sample", done.append)
    assert window.start_page.progress.isVisible()
    assert window.start_page.progress.message.text() == "Writing the sample"
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
