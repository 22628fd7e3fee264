"""The modes of a run that has not finished."""

import pytest

pytestmark = pytest.mark.window


@pytest.fixture
def paused(groomed, wait, quick):
    """Return a window whose run is held with a preliminary model."""
    window, work = groomed, groomed.workspace.work
    settings = quick().model_copy(update={"anneal_iterations": 400})
    window.workspace.edit_settings("optimize", "anneal_iterations", settings)
    window.workspace.session.show_step("correspond")
    window.commands["run.start"].trigger()
    wait(lambda: work.session.preliminary is not None, 200.0)
    window.commands["run.pause"].trigger()
    wait(lambda: window.inspector.explore.fitted.preliminary is not None, 200.0)
    return window


def test_the_modes_of_a_run_can_be_looked_at_and_say_that_they_are_preliminary(paused):
    explore = paused.inspector.explore
    assert paused.commands["explore.modes"].isEnabled()
    assert paused.views.stage.footer.ready.isVisible()
    assert not paused.commands["explore.groups"].isEnabled()
    paused.views.stage.footer.ready.click()
    assert explore.page.title == "Modes"
    assert [explore.tabs.isTabEnabled(index) for index in range(5)] == [False, True, False, False, False]
    assert explore.page.mark.isVisible()
    assert "32 of 32 particles" in explore.page.mark.text()
    before = paused.views.stage.scene.shown[0].groomed.vertices.copy()
    explore.page.sliders.show_value(0, 2.0)
    (content,) = paused.views.stage.scene.shown
    assert "preliminary" in content.note
    assert abs(content.groomed.vertices - before).max() > 0.1
    paused.commands["run.play"].trigger()
    assert explore.page.player.is_playing
    assert paused.views.snapshot is None


def test_the_finished_model_takes_the_place_of_the_preliminary_one_and_the_sliders_stay(paused, wait):
    paused.commands["view.explore"].trigger()
    page = paused.inspector.explore.page
    page.sliders.show_value(0, 1.5)
    paused.commands["run.pause"].trigger()
    wait(lambda: page.fitted.shape is not None, 200.0)
    assert page.fitted.preliminary is None
    assert not page.mark.isVisible()
    assert page.sliders.values[0] == 1.5
    assert page.fitted.shape.result is paused.workspace.session.result.result
    assert paused.inspector.explore.tabs.isTabEnabled(0)


def test_a_cancelled_run_leaves_its_preliminary_model_until_another_study_is_opened(paused, wait):
    paused.commands["view.explore"].trigger()
    page = paused.inspector.explore.page
    paused.commands["run.cancel"].trigger()
    wait(lambda: not paused.workspace.session.job.is_busy)
    assert page.mark.isVisible()
    assert "cancelled" in page.mark.text()
    assert page.sliders.model is page.fitted.preliminary.shape
    paused.projects.begin()
    assert page.fitted.preliminary is None
    assert page.sliders.model is None
    assert not paused.commands["explore.modes"].isEnabled()
