"""A project saved after grooming is groomed when it is opened again."""

import json
import shutil

import numpy as np
import pytest

pytestmark = pytest.mark.window


@pytest.fixture
def saved(groomed, close, tmp_path):
    """Return a folder saved after grooming, and what was groomed; its window is closed."""
    groomed.projects.save_to(tmp_path / "study")
    before = groomed.workspace.session.groomed
    close(groomed)
    return tmp_path / "study", before


def test_nothing_is_to_be_groomed_again(saved, make_window, wait, tmp_path):
    folder, before = saved
    window = make_window(tmp_path / "other home")
    window.projects.open_paths([folder])
    session = window.workspace.session
    wait(lambda: session.is_groomed, what="for what was groomed before")
    assert window.commands["run.start"].isEnabled()
    for name, item in before.items():
        np.testing.assert_array_equal(session.groomed[name].alignment, item.alignment)
        np.testing.assert_array_equal(session.groomed[name].subject.mesh.vertices, item.subject.mesh.vertices)
    rougher = session.study.settings.groom.model_copy(update={"smoothing": 0.0})
    window.workspace.edit_settings("groom", "smoothing", rougher)
    assert not session.is_groomed
    window.commands["edit.undo"].trigger()
    assert session.is_groomed


def test_a_file_that_has_changed_since_is_not_taken_for_groomed(saved, make_window, wait, tmp_path):
    folder, _ = saved
    record = json.loads((folder / "project.json").read_text())
    copies = tmp_path / "copies"
    copies.mkdir()
    for subject in record["subjects"]:
        path = (folder / subject["path"]).resolve()
        shutil.copy(path, copies / path.name)
        subject["path"] = str(copies / path.name)
    first, second = (item["path"] for item in record["subjects"][:2])
    shutil.copy(second, first)
    (folder / "project.json").write_text(json.dumps(record))
    window = make_window(tmp_path / "other home")
    window.projects.open_paths([folder])
    work = window.workspace.work
    wait(
        lambda: len(window.workspace.session.surveys) == 4 and work.to_restore is None,
        what="for the look at groomed/",
    )
    assert not window.workspace.session.groomed
