"""What a file means depends on the page on which it is dropped, and nothing is ignored in silence."""

import pytest
from PySide6.QtCore import QPoint

pytestmark = pytest.mark.window
AT = QPoint(9, 9)


@pytest.fixture
def said(explored):
    texts = []
    explored.workspace.session.noticed.connect(texts.append)
    yield texts
    explored.workspace.session.noticed.disconnect(texts.append)


def test_each_page_takes_shapes_and_projects_for_what_it_is_for(explored, ellipsoids, finished):
    shape, project = [ellipsoids / "a.nrrd"], [finished]
    seen = {}
    for page in ("Overview", "Modes", "Groups", "Measure", "Check", "Patient"):
        explored.workspace.session.show_page(page, "explore")
        seen[page] = [list(explored.drops.meanings(paths, AT)) for paths in (shape, project)]
    explored.workspace.session.show_step("cohort")
    seen["cohort"] = [list(explored.drops.meanings(paths, AT)) for paths in (shape, project)]
    either, opened = ["Patient", "Another subject"], ["Open study"]
    compared = ["Compare with study", *opened]
    assert seen == {
        "Overview": [either, opened],
        "Modes": [either, compared],
        "Groups": [either, compared],
        "Measure": [either, opened],
        "Check": [either, opened],
        "Patient": [[""], opened],
        "cohort": [["Another subject"], opened],
    }


def test_a_table_of_values_is_imported_and_one_of_files_adds_subjects(explored, tmp_path, monkeypatch):
    monkeypatch.setattr("homolog_app.window.project_controller.ask", lambda *_: "Import")
    values, files = tmp_path / "values.csv", tmp_path / "files.csv"
    values.write_text("name,age\na,41\nb,52\n")
    files.write_text("name,path\nz,z.nrrd\n")
    explored.workspace.session.show_page("Groups", "explore")
    explored.drops.take([values], AT)
    assert explored.workspace.session.study.members[0].subject.columns["age"] == "41"
    assert list(explored.drops.meanings([files], AT)) == ["Another subject"]


def test_landmarks_belong_to_the_subject_of_their_name(explored, said, tmp_path):
    for name in ("a", "nobody"):
        explored.drops.take([tmp_path / f"{name}.mrk.json"], AT)
    session = explored.workspace.session
    assert session.study.members[0].subject.landmarks == tmp_path / "a.mrk.json"
    assert len(said) == 2
    assert "nobody" in said[1]


def test_added_subjects_are_shown_and_those_that_are_listed_are_named(explored, said, ellipsoids, tmp_path):
    import shutil

    session = explored.workspace.session
    explored.drops.meanings([ellipsoids / "a.nrrd"], AT)["Another subject"]()
    assert len(said) == 1
    shutil.copy(ellipsoids / "a.nrrd", tmp_path / "e.nrrd")
    explored.drops.meanings([tmp_path / "e.nrrd"], AT)["Another subject"]()
    assert (session.step, session.selection) == ("cohort", ("e",))


def test_files_that_are_none_of_this_are_refused_with_their_name(explored, errors, said, tmp_path):
    explored.workspace.session.show_page("Overview", "explore")
    for name in ("notes.pdf", "reference.npz"):
        (tmp_path / name).write_bytes(b"nothing")
        explored.drops.take([tmp_path / name], AT)
    assert ["notes.pdf" in str(errors[0][1]), "reference.npz" in str(errors[1][1])] == [True, True]
