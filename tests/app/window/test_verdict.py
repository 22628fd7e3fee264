"""The verdict in the window, and the question before a model that is not usable is analysed."""

from dataclasses import replace

import pytest

from homolog.inspection import Word

pytestmark = pytest.mark.window


@pytest.fixture
def unusable(explore, bean_project, window):
    """Return the page *Groups* of a result that is said to be not usable."""
    page = explore(bean_project, "groups")
    session = window.workspace.session
    verdict = replace(session.result.verdict, word=Word.UNUSABLE, cause="All noise.", remedy="Add subjects.")
    session.result = replace(session.result, verdict=verdict)
    session.result_changed.emit()
    return page


def test_the_verdict_stands_on_the_overview_and_a_bad_one_above_every_page(explore, bean_project, window):
    page = explore(bean_project, "groups")
    panel, session = window.inspector.explore, window.workspace.session
    assert session.result.verdict.word is not Word.UNUSABLE
    session.result = replace(session.result, verdict=replace(session.result.verdict, word=Word.SOUND))
    session.result_changed.emit()
    assert not panel.verdict.isVisible()
    session.show_page("Overview", "explore")
    assert panel.page.verdict.text().startswith("Sound. ")
    bad = replace(session.result.verdict, word=Word.DOUBTFUL, cause="Half is noise.", remedy="Add subjects.")
    session.result = replace(session.result, verdict=bad)
    session.result_changed.emit()
    for title in ("Overview", "Modes", "Groups"):
        session.show_page(title, "explore")
        assert panel.verdict.isVisible()
    assert panel.verdict.text.text() == "This model is doubtful. Half is noise. Add subjects."
    assert page.isVisible()


def test_groups_of_a_model_that_is_not_usable_are_compared_after_one_deliberate_click(
    unusable, window, wait, monkeypatch
):
    asked = []
    answers = ["Cancel", "Use it anyway"]

    def ask(_window, title, details, *_):
        asked.append((title, details))
        return answers[len(asked) - 1]

    monkeypatch.setattr("homolog_app.window.explore.verdict_bar.ask", ask)
    wait(lambda: window.inspector.explore.fitted.shape is not None)
    window.commands["explore.test"].trigger()
    assert not window.workspace.session.job.is_busy
    assert asked[0][0] == "This model is not usable."
    assert "All noise. Add subjects." in asked[0][1]
    for _ in range(2):  # the second time without a question
        window.commands["explore.test"].trigger()
        wait(lambda: bool(unusable.answers) and not window.workspace.session.job.is_busy)
    assert len(asked) == 2
