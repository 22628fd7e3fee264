"""Models of other programs, opened in the window."""

import shutil

import pytest

pytestmark = pytest.mark.window


@pytest.fixture
def exported(finished_run, tmp_path):
    """Return the finished run as a ShapeWorks project."""
    from homolog.io.shapeworks_export import write_shapeworks

    return write_shapeworks(finished_run, tmp_path / "out")


def test_a_shapeworks_project_is_imported_and_shown(window, exported, tmp_path, wait):
    window.projects.import_model(exported, tmp_path / "project")
    session = window.workspace.session
    wait(lambda: session.result is not None and len(session.surveys) == 4)
    assert [member.name for member in session.study.included] == ["a", "b", "c", "d"]
    assert len(session.result.particles["a"]) == 48
    assert session.result.summary.endswith("imported from the ShapeWorks project project.swproj")
    assert window.workspace.session.step == "explore"


def test_a_folder_of_particles_is_imported_and_shown(window, exported, tmp_path, wait):
    bare = tmp_path / "bare"
    bare.mkdir()
    for path in exported.parent.glob("*_particles/*_world.particles"):
        shutil.copy(path, bare)
    window.projects.import_model(bare, tmp_path / "project")
    session = window.workspace.session
    wait(lambda: session.result is not None and len(session.surveys) == 4)
    assert [member.name for member in session.study.included] == ["a", "b", "c", "d"]
    assert set(session.result.surfaces) == {"a", "b", "c", "d"}
    assert "without a surface" in session.surveys["a"].problem
