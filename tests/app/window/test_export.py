"""Exports from the window: the same command in a child process."""

import shlex

import pytest
from filelock import FileLock, Timeout
from pydantic import ValidationError

from homolog.io.project import ProjectFolder
from homolog.io.report_details import read_details
from homolog_app.exports.settings import CutSettings
from homolog_app.rendering.camera import Clip, ClipPlane

pytestmark = pytest.mark.window


@pytest.fixture
def dialog_with_preview(qapp, finished):
    """Return a function that opens the dialog of an export of a finished project."""
    from PySide6.QtWidgets import QWidget

    from homolog_app.window.export.choosers import KINDS
    from homolog_app.window.export.dialog import ExportDialog, Exported

    parent, opened = QWidget(), []
    what = Exported(finished, "study", finished.parent, 3, 1, {"group": ["A", "A", "B", "B"]})

    def open_(name):
        opened.append(ExportDialog(parent, KINDS[name], what))
        opened[-1].show()
        return opened[-1]

    yield open_
    for dialog in opened:
        dialog.close()
    parent.deleteLater()


@pytest.fixture
def dialog(dialog_with_preview, monkeypatch):
    """Return the function that opens a dialog, without the process that draws its preview for seconds."""
    from homolog_app.window.export.process import Preview

    monkeypatch.setattr(Preview, "want", lambda *_: None)
    return dialog_with_preview


def small(dialog, **changes):
    """Make an export small and quick."""
    dialog.edit("", dialog.settings.model_copy(update={"width": 480, "height": 320, **changes}))


def export(dialog, wait):
    ended = []
    dialog.finished_export.connect(ended.append)
    dialog.go.click()
    wait(lambda: ended, what=dialog.note.text())
    return ended[0]


def test_a_film_is_the_same_file_as_the_command_line_makes(dialog, wait, tmp_path, decode):
    from homolog_app.cli import main

    film = dialog("film")
    small(film, fps=5, seconds=1.0)
    film.place.setText(str(tmp_path / "film.mp4"))
    seen = []
    film.child.progressed.connect(lambda fraction, _: seen.append(fraction))
    assert export(film, wait) == "done", film.note.text()
    facts, frames = decode(tmp_path / "film.mp4")
    assert frames.shape == (5, 320, 480, 3)
    assert "h264" in facts
    assert seen[-1] == 1.0
    arguments = shlex.split(film.line.text())
    assert arguments[0] == "homolog"
    assert main([word.replace("film.mp4", "again.mp4") for word in arguments[1:]]) == 0
    assert (tmp_path / "again.mp4").read_bytes() == (tmp_path / "film.mp4").read_bytes()
    assert film.show_.isVisible()


def test_a_cancelled_film_leaves_nothing(dialog, wait, tmp_path, qapp):
    film = dialog("film")
    small(film, fps=60, seconds=60.0)
    (tmp_path / "films").mkdir()
    film.place.setText(str(tmp_path / "films" / "film.mp4"))
    ended = []
    film.finished_export.connect(ended.append)
    film.go.click()
    wait(lambda: film.bar.value() > 50)
    assert list((tmp_path / "films").iterdir())
    assert film.close_.text() == "Cancel"
    film.close_.click()
    wait(lambda: ended)
    assert ended == ["cancelled"]
    assert not list((tmp_path / "films").iterdir())
    assert film.go.isEnabled()


def test_the_report_is_written_into_the_project_which_is_held_again_after(explored, wait):
    from PySide6.QtTest import QTest
    from PySide6.QtWidgets import QLineEdit

    from homolog_app.window.export.dialog import ExportDialog

    explored.commands["export.report"].trigger()
    (report,) = explored.findChildren(ExportDialog)
    (structure,) = (box for box in report.findChildren(QLineEdit) if box.accessibleName() == "structure")
    QTest.keyClicks(structure, "left femur")
    assert "'--structure=left femur'" in report.line.text()
    assert export(report, wait) == "done", report.note.text()
    folder = explored.workspace.project.folder
    assert read_details(ProjectFolder(folder)).structure == "left femur"
    assert "left femur" in (folder / "report" / "report.html").read_text(encoding="utf-8")
    with pytest.raises(Timeout):  # as for other programs
        FileLock(folder / ".lock", timeout=0).acquire()
    report.close()


def test_closing_the_window_asks_about_an_export_and_ends_it(explored, wait, close, tmp_path, monkeypatch):
    from homolog_app.window.export.dialog import ExportDialog
    from homolog_app.window.export.process import Preview

    monkeypatch.setattr(Preview, "want", lambda *_: None)
    explored.commands["export.film"].trigger()
    (film,) = explored.findChildren(ExportDialog)
    small(film, fps=60, seconds=600.0)
    (tmp_path / "films").mkdir()
    film.place.setText(str(tmp_path / "films" / "film.gif"))
    film.go.click()
    wait(lambda: list((tmp_path / "films").iterdir()))
    explored.workspace.preferences.ask_on_close = True
    monkeypatch.setattr("homolog_app.window.export.controller.ask", lambda *_: "Keep exporting")
    assert not explored.close()
    assert film.child.is_running
    monkeypatch.setattr("homolog_app.window.export.controller.ask", lambda *_: "Stop")
    close(explored)
    assert not list((tmp_path / "films").iterdir())


def test_the_first_frame_is_previewed(dialog_with_preview, wait):
    film = dialog_with_preview("film")
    wait(lambda: not film.preview.pixmap().isNull(), what=film.preview.text())
    assert film.preview.pixmap().width() > 200


@pytest.mark.parametrize(
    ("name", "made"),
    [
        ("still", "out.png"),
        ("plot", "out.svg"),
        ("meshes", "out/mean.vtp"),
        ("table", "out/scores.csv"),
        ("particles", "out/a_world.particles"),
        ("shapeworks", "out/study.swproj"),
        ("markups", "out/a.mrk.json"),
        ("morphometrics", "out/particles.tps"),
    ],
)
def test_the_command_line_that_is_shown_writes_what_the_dialog_says(dialog, tmp_path, name, made):
    from homolog_app.cli import main

    opened = dialog(name)
    if name == "still":
        small(opened)
    opened.place.setText(str(tmp_path / made.split("/")[0]))
    assert opened.go.isEnabled(), opened.note.text()
    assert main([*shlex.split(opened.line.text())[1:], "--progress", "none"]) == 0
    assert (tmp_path / made).is_file()


def test_the_menu_opens_each_export_with_the_project_and_its_groups(explored):
    from homolog_app.window.export.choosers import KINDS
    from homolog_app.window.export.dialog import ExportDialog

    for name in KINDS:
        explored.commands[f"export.{name}"].trigger()
    opened = explored.findChildren(ExportDialog)
    assert [dialog.kind.name for dialog in opened] == list(KINDS)
    for dialog in opened:
        assert str(explored.workspace.project.folder) in dialog.line.text()
        dialog.close()


def test_films_and_pictures_are_seen_and_cut_as_the_views_are(explored):
    from homolog_app.window.export.dialog import ExportDialog

    explored.commands["view.left"].trigger()
    explored.commands["view.clip"].trigger()
    for name in ("film", "still"):
        explored.commands[f"export.{name}"].trigger()
        (dialog,) = [widget for widget in explored.findChildren(ExportDialog) if widget.isVisible()]
        arguments = shlex.split(dialog.line.text())
        assert arguments[arguments.index("--view") + 1] == "camera:1,0,0,0,0,1"
        assert "--clip=axial" in arguments
        dialog.close()


def test_an_edit_of_the_main_settings_outlives_one_of_the_others(dialog):
    from PySide6.QtWidgets import QCheckBox, QSpinBox

    still = dialog("still")
    (width,) = [box for box in still.findChildren(QSpinBox) if box.accessibleName() == "width"]
    width.setValue(1920)
    (caption,) = [box for box in still.findChildren(QCheckBox) if box.accessibleName() == "caption"]
    caption.click()
    assert (still.settings.width, still.settings.caption) == (1920, False)


def test_groups_given_after_the_run_are_exported_once_they_are_saved(explored, tmp_path):
    from homolog_app.cli import main
    from homolog_app.window.export.dialog import ExportDialog

    def opened():
        explored.commands["export.particles"].trigger()
        (dialog,) = [widget for widget in explored.findChildren(ExportDialog) if widget.isVisible()]
        what, _ = dialog.exported, dialog.close()
        return what

    assert opened().caution == ""
    for names, group in ((["a", "c"], "thin"), (["b", "d"], "thick")):
        explored.workspace.session.select(names)
        explored.workspace.session.set_group(group)
    assert opened().columns["group"] == ["thin", "thick"] * 2
    assert opened().caution == "Unsaved edits are exported only after the project is saved."
    explored.projects.save()
    assert opened().caution == ""
    project, out = str(explored.workspace.project.folder), str(tmp_path / "still.png")
    arguments = ["--group", "group", "thin", "thick", "--width", "480", "--height", "320"]
    assert main(["export", "still", project, *arguments, "--out", out, "--progress", "none"]) == 0


def test_what_is_wrong_is_said_and_nothing_can_be_started(dialog, tmp_path):
    film = dialog("film")
    (tmp_path / "mine.txt").write_text("")
    for text, message in (
        ("", "Choose where"),
        ("film.avi", "must end in .mp4, .gif"),
        (str(tmp_path), "already exists"),
    ):
        film.place.setText(text)
        assert message in film.note.text()
        assert not film.go.isEnabled()
    film.place.setText(str(tmp_path / "film.gif"))
    assert film.go.isEnabled()
    for modes in ("", "0", "1 1", "99", "one"):
        film.chooser.modes.setText(modes)
        assert "Name each mode once" in film.note.text(), modes
    film.chooser.modes.setText("1, 2")
    assert "--mode 1 2" in film.line.text()
    film.chooser.views["oblique"].setChecked(False)
    assert "direction" in film.note.text()
    film.chooser.views["left"].setChecked(True)
    assert "--view left" in film.line.text()
    assert film.go.isEnabled()


def test_no_report_is_written_with_names_of_places_that_are_refused(dialog):
    from PySide6.QtWidgets import QLineEdit

    report = dialog("report")
    (places,) = [line for line in report.findChildren(QLineEdit) if line.accessibleName() == "places"]
    for text, allowed in (("left/right", False), ("left/right front/back top/bottom", True), ("", True)):
        places.setText(text)
        places.textEdited.emit(text)
        assert report.go.isEnabled() is allowed
        assert ("Places" in report.note.text()) is not allowed


def test_a_fault_is_told_in_the_dialog(dialog, wait, tmp_path):
    table = dialog("table")
    (tmp_path / "file").write_text("")
    table.place.setText(str(tmp_path / "file" / "tables"))
    assert export(table, wait) == "failed"
    assert "can't be written" in table.note.text()
    assert table.note.objectName() == "Problem"


def test_what_would_stand_still_or_compare_nothing_is_not_started(dialog):
    from homolog_app.exports.settings import Plot

    film, plot = dialog("film"), dialog("plot")
    film.chooser.what.setCurrentIndex(film.chooser.what.findData("mean"))
    assert "does not move" in film.note.text()
    film.edit("", film.settings.model_copy(update={"turntable": True}))
    assert film.go.isEnabled()
    plot.edit("", plot.settings.model_copy(update={"kind": Plot.DIFFERENCE}))
    assert "Choose two groups" in plot.note.text()


def test_groups_are_offered_where_there_are_any(qapp):
    from homolog_app.window.export.choosers import GroupChooser, group_columns

    columns = {"group": list("AABBCC"), "age": list("123456"), "site": ["x"] * 6, "sex": ["m", "f", ""] * 2}
    assert group_columns(columns) == {"group": ["A", "B", "C"], "sex": ["f", "m"]}
    assert group_columns({"group": list("AAA") + 3 * ["control"]}) == {"group": ["control", "A"]}
    chooser = GroupChooser(columns, optional=True)
    assert chooser.arguments() == []
    chooser.column.setCurrentIndex(1)
    chooser.second.setCurrentIndex(2)
    assert chooser.arguments() == ["--group", "group", "A", "C"]
    chooser.second.setCurrentIndex(0)
    assert chooser.problem
    chooser.deleteLater()


@pytest.mark.parametrize("name", ["film", "still", "plot", "meshes", "table", "report"])
def test_every_control_has_a_name_and_can_be_reached_by_keys(dialog, name):
    from PySide6.QtCore import Qt
    from PySide6.QtWidgets import QAbstractButton, QAbstractSpinBox, QComboBox, QLineEdit

    opened = dialog(name)
    for kind in (QAbstractButton, QComboBox, QLineEdit, QAbstractSpinBox):
        for widget in opened.findChildren(kind):
            if widget.objectName().startswith("qt_"):
                continue  # a part of a spin box
            assert widget.accessibleName() or widget.text(), widget
            assert widget.focusPolicy() & Qt.FocusPolicy.TabFocus, widget


def test_pictures_and_films_cut_where_the_window_does_also_by_a_free_plane(tmp_path):
    from homolog_app.window.export.choosers import KINDS, first_settings

    clip = Clip(plane=ClipPlane.FREE, position=0.3, flipped=True, normal=(0.6, 0.0, -0.8))
    for name in ("still", "film"):
        settings = first_settings(KINDS[name], tmp_path, clip)
        assert settings.cutting == clip
    with pytest.raises(ValidationError, match="three numbers"):
        CutSettings(clip_normal="0 0")
