"""More particles, and new subjects, on a finished result."""

import shutil

import numpy as np
import pytest

pytestmark = pytest.mark.window


def ask_for(window, particles):
    optimize = window.workspace.session.study.settings.optimize
    window.workspace.edit_settings(
        "optimize", "particles", optimize.model_copy(update={"particles": particles})
    )


def test_particles_are_added_to_the_result(explored, wait):
    session, panel = explored.workspace.session, explored.inspector.correspond
    command = explored.commands["run.more"]
    assert not command.isEnabled()
    assert "more than 32 particles" in panel.further.text()
    ask_for(explored, 48)
    assert panel.more.text() == "Add 16 particles"
    before = session.result.result.local
    command.trigger()
    wait(lambda: not explored.workspace.session.job.is_busy)
    after = session.result.result.local
    assert after.shape[1] == 48
    moved = np.linalg.norm(after[:, :32] - before, axis=2)
    assert np.median(moved) < 2.5, "they were placed anew"
    assert not command.isEnabled()


def test_new_subjects_are_fitted_and_the_others_keep_their_particles(explored, ellipsoids, wait, tmp_path):
    session, panel = explored.workspace.session, explored.inspector.correspond
    before = session.result.result.local
    first = next(ellipsoids.glob("a.*"))
    new = tmp_path / f"newcomer{''.join(first.suffixes)}"
    shutil.copy(next(ellipsoids.glob("b.*")), new)
    explored.projects.open_paths([new])
    assert panel.fit.text() == "Fit 1 new subject"
    assert "newcomer gets" in panel.further.text()
    explored.commands["run.fit"].trigger()
    wait(lambda: not explored.workspace.session.job.is_busy)
    result = session.result.result
    assert result.names[-1] == "newcomer"
    np.testing.assert_allclose(result.local[:-1], before, atol=1e-9)
    gap = np.linalg.norm(result.local[-1] - result.local[1], axis=1)
    assert gap.mean() < 1.0  # it is the same shape as b


def test_a_run_with_new_subjects_asks_whether_they_be_fitted(
    explored, ellipsoids, wait, tmp_path, monkeypatch
):
    session = explored.workspace.session
    before, asked = session.result.result, []

    def ask(_, question, details, answers):
        asked.append((question, details))
        return answers[-1 if len(asked) == 1 else 0]

    monkeypatch.setattr("homolog_app.window.project_controller.ask", ask)
    first = next(ellipsoids.glob("b.*"))
    explored.projects.open_paths([shutil.copy(first, tmp_path / f"newcomer{''.join(first.suffixes)}")])
    explored.commands["run.start"].trigger()
    assert not session.job.is_busy, "it was cancelled"
    assert "newcomer gets the result's particles" in asked[0][1]
    explored.commands["run.start"].trigger()
    wait(lambda: not session.job.is_busy)
    assert session.result.result.names == (*before.names, "newcomer")
    np.testing.assert_allclose(session.result.result.local[:-1], before.local, atol=1e-9)


def test_why_it_is_not_possible_is_said_where_the_button_is(explored, wait):
    panel, session = explored.inspector.correspond, explored.workspace.session
    session.select(["b"])
    session.toggle_included()
    assert panel.further.text().startswith("b of the result")
    assert "Not now:" in panel.more.toolTip()
    explored.commands["edit.undo"].trigger()
    groom = session.study.settings.groom.model_copy(update={"smoothing": 0.0})
    explored.workspace.edit_settings("groom", "smoothing", groom)
    assert "grooming settings differ" in panel.further.text()
    assert not panel.more.isEnabled()
    assert not panel.fit.isEnabled()


def test_a_cancelled_addition_leaves_the_result_and_offers_no_particles_to_keep(explored, wait):
    before = explored.workspace.session.result
    ask_for(explored, 512)
    explored.commands["run.more"].trigger()
    wait(
        lambda: (
            explored.workspace.session.job.run is not None
            and explored.workspace.session.job.run.frame is not None
        )
    )
    explored.commands["run.cancel"].trigger()
    wait(lambda: not explored.workspace.session.job.is_busy)
    assert explored.workspace.session.result is before
    assert not explored.commands["run.keep"].isEnabled()


def test_a_run_is_undone_and_the_result_before_it_is_saved(explored, wait):
    from homolog.io.project import ProjectFolder
    from homolog.io.results import read_result

    session, commands = explored.workspace.session, explored.commands
    before, project = session.result, ProjectFolder(session.folder)
    ask_for(explored, 48)
    commands["run.more"].trigger()
    wait(lambda: not explored.workspace.session.job.is_busy)
    after = session.result
    assert after.result.local.shape[1] == 48
    commands["edit.undo"].trigger()
    assert session.result is before
    assert not commands["run.more"].isEnabled()  # it would begin with the particles of the folder
    assert read_result(project).local.shape[1] == 48
    commands["file.save"].trigger()
    wait(lambda: session.is_result_written and not explored.workspace.session.job.is_busy)
    np.testing.assert_array_equal(read_result(project).local, before.result.local)
    assert project.read().settings.optimize.particles == 48
    assert commands["run.more"].isEnabled()
    commands["edit.redo"].trigger()
    assert session.result is after
