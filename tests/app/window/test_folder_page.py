"""The page that asks what a folder means."""

import shutil

import pytest

from homolog_app.window.folder_page import FolderPage

pytestmark = pytest.mark.window


@pytest.fixture
def folder(ellipsoids, tmp_path):
    """Return a folder of four shapes in two folders, with a table beside them."""
    for file in sorted(ellipsoids.iterdir()):
        for kind in ("masks", "old"):
            (tmp_path / "data" / kind).mkdir(parents=True, exist_ok=True)
            shutil.copy(file, tmp_path / "data" / kind / file.name)
    names = [file.name.partition(".")[0] for file in sorted(ellipsoids.iterdir())]
    rows = [f"{name},{group}" for name, group in zip(names, "xxyy", strict=True)]
    (tmp_path / "data" / "subjects.csv").write_text("\n".join(["id,group", *rows]))
    return tmp_path / "data"


def page_of(window):
    (page,) = window.findChildren(FolderPage)
    return page


def choose(page, beginning):
    row = next(
        row for row in range(page.choices.count()) if page.choices.item(row).text().startswith(beginning)
    )
    page.choices.setCurrentRow(row)


def test_a_folder_in_no_known_layout_asks_with_its_patterns_and_shows_what_each_gives(window, folder, wait):
    window.projects.open_paths([folder])
    page = page_of(window)
    assert not window.workspace.session.is_open
    choose(page, "masks/{subject}")
    wait(lambda: all(not picture.pixmap().isNull() for picture, _ in page.shapes[:4]))
    assert page.preview.rowCount() == 4
    assert page.tables.currentText() == "subjects.csv"
    page.accept_button.click()
    members = window.workspace.session.study.members
    assert [member.subject.path.parent.name for member in members] == ["masks"] * 4
    assert [member.subject.group for member in members] == ["x", "x", "y", "y"]


def test_a_pattern_may_be_typed_and_one_that_fits_nothing_can_not_be_opened(window, folder, wait):
    window.projects.open_paths([folder])
    page = page_of(window)
    page.pattern.setText("none/{subject}.nrrd")
    page.pattern.textEdited.emit(page.pattern.text())
    wait(lambda: not page.accept_button.isEnabled())
    assert "no file fits" in page.message.text()
    page.pattern.setText("{time}/{subject}.*")
    page.pattern.textEdited.emit(page.pattern.text())
    wait(page.accept_button.isEnabled)
    assert page.preview.rowCount() == 8
    page.reject()
    assert not window.workspace.session.is_open


def test_the_cohort_of_a_pattern_is_written_as_a_table(window, folder, monkeypatch):
    from homolog.cohort import read_cohort

    window.projects.open_paths([folder])
    page = page_of(window)
    choose(page, "old/{subject}")
    monkeypatch.setattr(window.workspace.files, "new", lambda *_: folder / "cohort.csv")
    page.save_button.click()
    page.reject()
    assert [subject.group for subject in read_cohort(folder).subjects] == ["x", "x", "y", "y"]


def test_a_table_beside_a_known_folder_is_offered(window, folder, monkeypatch):
    questions = []
    monkeypatch.setattr(
        "homolog_app.window.project_controller.ask", lambda _, title, *__: questions.append(title) or "Import"
    )
    window.projects.open_paths([folder / "masks"])
    assert questions == ["Import subjects.csv?"]
    assert window.workspace.session.study.groups == ["x", "y"]


def test_the_dialog_for_a_table_begins_in_the_folder_of_the_files_or_the_one_above(
    window, folder, monkeypatch
):
    places = []
    monkeypatch.setattr("homolog_app.window.project_controller.ask", lambda *_: "Cancel")
    monkeypatch.setattr(window.workspace.files, "file", lambda _, __, ___, near: places.append(near))
    window.projects.open_paths([folder / "masks"])
    window.commands["file.import"].trigger()
    assert places == [folder]
