"""What all pages of Explore have in common."""

import pytest

from homolog_app.window.explore.controls import Pace
from homolog_app.window.rail import steps_of

pytestmark = pytest.mark.window


def test_tabs_say_which_page_is_open_and_keys_turn_them(explore, finished, window):
    page = explore(finished, "modes")
    tabs = window.inspector.explore.tabs
    assert tabs.tabText(tabs.currentIndex()) == page.title == "Modes"
    window.commands["explore.measure"].trigger()
    assert tabs.tabText(tabs.currentIndex()) == "Measure"
    assert window.inspector.explore.page.isVisible()


def test_a_new_result_is_fitted_again_and_nothing_of_the_old_one_is_shown(explore, finished, window, wait):
    from dataclasses import replace

    explore(finished, "modes")
    session, fitted = window.workspace.session, window.inspector.explore.fitted
    before = fitted.shape
    session.result = replace(session.result)
    session.result_changed.emit()
    assert fitted.shape is None
    wait(lambda: fitted.shape is not None)
    assert fitted.shape is not before


def test_a_cancelled_fit_is_begun_again_by_a_button_or_when_a_page_is_opened(explore, finished, window, wait):
    explore(finished, "modes")
    session, work = window.workspace.session, window.workspace.work
    from dataclasses import replace

    session.result = replace(session.result)
    session.result_changed.emit()
    work.cancel()
    wait(lambda: not work.session.job.is_busy)
    fitted = window.inspector.explore.fitted
    if fitted.shape is None:  # it may have been faster than the wish to end it
        assert window.inspector.explore.fit.isVisible()
        window.inspector.explore.fit.click()
        wait(lambda: window.workspace.session.job.is_busy or fitted.shape is not None)
        work.cancel()
        wait(lambda: not work.session.job.is_busy)
        window.inspector.explore.tabs.setCurrentIndex(0)
        window.commands["explore.modes"].trigger()
    wait(lambda: fitted.shape is not None)
    assert not window.inspector.explore.fit.isVisible()


def test_the_steps_are_seen_once_a_study_is_open_and_the_energies_where_they_belong(explored):
    energies = explored.docks.curves
    assert explored.rail.isVisible()
    seen = {}
    for page in explored.inspector.explore.pages:
        explored.inspector.explore.open_page(page)
        seen[page.title] = energies.isVisible()
    assert seen.pop("Overview")
    assert not any(seen.values())
    explored.commands["file.close"].trigger()
    assert not explored.rail.isVisible()


def test_another_setting_takes_the_tick_of_its_step_and_dims_no_result(explore, finished, window):
    explore(finished, "modes")
    session, explored = window.workspace.session, window.inspector.explore

    def dimmed():
        effects = [page.graphicsEffect() for page in explored.pages]
        return {
            page.title
            for page, effect in zip(explored.pages, effects, strict=True)
            if effect is not None and effect.isEnabled()
        }

    assert not dimmed()
    assert steps_of(session)["correspond"].done
    groom = session.study.settings.groom
    changed = groom.model_copy(update={"smoothing": groom.smoothing + 1.0})
    session.edit_settings("Smoothing", session.study.settings.model_copy(update={"groom": changed}))
    assert not explored.outdated.isVisible()  # the result is still that of its own settings
    assert not dimmed()
    assert not steps_of(session)["correspond"].done
    session.undo.undo()
    assert steps_of(session)["correspond"].done


@pytest.mark.parametrize(("drawing_ms", "interval"), [(1.0, 33), (100.0, 200), (250.0, 500)])
def test_whatever_is_played_waits_twice_as_long_as_a_picture_takes(
    explore, finished, window, wait, monkeypatch, drawing_ms, interval
):
    page = explore(finished, "modes")
    page.fitted.draw_ms = drawing_ms
    monkeypatch.setattr(window.views.stage.scene.plot, "draw_ms", drawing_ms)
    timers = [timer for owner in (page.player, window.views.run) for timer in owner.findChildren(Pace)]
    assert len(timers) == 3  # of a mode, of a run in progress, and of a recorded one
    for timer in timers:
        timer.timeout.emit()
        assert timer.interval() == interval
