"""What a project shows when it is opened again."""

import shutil

import pytest

pytestmark = pytest.mark.window


@pytest.fixture
def answered(bean_project, tmp_path):
    """Return a project in which the answer to a question about its groups is stored."""
    from homolog.comparison.question import Question
    from homolog.comparison.stored import Provenance, folder_of, write_question
    from homolog.io.project import ProjectFolder

    folder = tmp_path / "stored" / "answered"
    shutil.copytree(bean_project, folder)
    request = Question(between=("wide", "slim"), alignment="form")
    write_question(request, folder_of(ProjectFolder(folder), request), Provenance())
    return folder


def test_groups_shows_the_stored_answer_when_it_is_first_opened(answered, explore, window, wait):
    page = explore(answered, "groups")
    wait(lambda: bool(page.answers), seconds=300)
    assert (page.form.first.currentText(), page.form.second.currentText()) == ("wide", "slim")
    assert page.is_current
    page.answers, page.all = [], None
    window.commands["explore.modes"].trigger()
    window.commands["explore.groups"].trigger()
    assert not window.workspace.session.job.is_busy  # once: a cancelled comparison is not asked again
