"""Studies on disk and in the hand: undo, tables, saving, moving, dropping, reporting."""

import logging
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from homolog.cohort import read_cohort
from homolog.errors import InputError, user_message
from homolog_app.cli import main
from homolog_app.rendering.text import millilitres
from homolog_app.window.widgets import ActionButton

HEAVY = ("warp", "SimpleITK", "pyvista", "pyvistaqt", "vtkmodules", "matplotlib", "skimage")


def test_the_window_opens_before_anything_heavy_is_imported():
    code = "import sys, homolog_app.window.start; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert not set(HEAVY) & set(loaded.split())


def test_file_dialogs_begin_where_the_last_file_was_or_next_to_the_project(tmp_path, monkeypatch):
    from PySide6.QtWidgets import QFileDialog

    from homolog_app.window.workspace import FileDialogs, Preferences

    asked = []

    def choose(path):
        def answer(_parent, _title, begin, *_):
            asked.append(begin)
            return (str(path), "") if path else ("", "")

        return answer

    for folder in ("data", "studies"):
        (tmp_path / folder).mkdir()
    preferences = Preferences(tmp_path / "preferences.ini")
    monkeypatch.setattr(QFileDialog, "getOpenFileName", choose(tmp_path / "data" / "a.nrrd"))
    monkeypatch.setattr(QFileDialog, "getSaveFileName", choose(None))
    dialogs = FileDialogs(preferences)
    assert dialogs.file(None, "Open", "") == tmp_path / "data" / "a.nrrd"
    assert dialogs.new(None, "Save", "table.csv") is None
    assert asked[-1] == str(tmp_path / "data" / "table.csv")
    preferences.remember(tmp_path / "studies" / "one")
    FileDialogs(Preferences(tmp_path / "preferences.ini")).new(None, "Save", "table.csv")
    assert asked[-1] == str(tmp_path / "studies" / "table.csv")
    preferences.forget()
    dialogs.new(None, "Save", "table.csv")
    assert not asked[-1].startswith(str(tmp_path))


@pytest.mark.window
def test_undo_stops_at_the_folder_that_was_opened(beans, ellipsoids):
    session = beans.workspace.session
    session.undo.setIndex(0)
    opened = session.study
    assert len(opened.members) == 4
    assert not beans.commands["edit.undo"].isEnabled()
    session.select(["a"])
    beans.commands["edit.include"].trigger()
    beans.commands["edit.undo"].trigger()
    assert session.study == opened
    assert session.is_open
    beans.commands["edit.remove"].trigger()
    beans.projects.open_paths([next(ellipsoids.glob("a.*"))])
    assert session.undo.undoText() == "Add subjects"


@pytest.mark.window
def test_typing_a_number_is_one_edit(beans):
    session = beans.workspace.session
    before = session.study
    for smoothing in (0.2, 0.25, 0.255):
        groom = session.study.settings.groom.model_copy(update={"smoothing": smoothing})
        beans.workspace.edit_settings("groom", "smoothing", groom)
    beans.commands["edit.undo"].trigger()
    assert session.study == before


@pytest.mark.window
def test_ticks_groups_and_covariates_are_edited_in_the_table(beans):
    from PySide6.QtCore import Qt

    session, model = beans.workspace.session, beans.inspector.cohort.model
    model.setData(model.index(1, 0), Qt.CheckState.Unchecked.value, Qt.ItemDataRole.CheckStateRole)
    model.setData(model.index(2, 1), "HCM")
    assert [member.included for member in session.study.members] == [True, False, True, True]
    assert session.study.members[2].subject.group == "HCM"
    assert model.index(0, 2).data() == millilitres(session.surveys["a"].volume_ml)


@pytest.mark.window
def test_enter_goes_on_to_the_group_of_the_next_subject(beans, wait):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest
    from PySide6.QtWidgets import QLineEdit

    table, session = beans.inspector.cohort.table, beans.workspace.session
    cell = table.model().index(1, 1)
    table.setCurrentIndex(cell)
    table.edit(cell)
    for at, group in ((1, "sick"), (2, "well"), (3, "sick")):
        wait(lambda at=at: table.indexWidget(table.model().index(at, 1)) is not None)
        editor = table.indexWidget(table.model().index(at, 1))
        assert isinstance(editor, QLineEdit)
        QTest.keyClicks(editor, group)
        QTest.keyClick(editor, Qt.Key.Key_Return)
        wait(lambda at=at, group=group: session.study.members[at].subject.group == group)
    assert table.state() == table.State.NoState


@pytest.mark.window
def test_the_question_for_a_group_begins_with_the_present_one(beans, monkeypatch):
    session, offered = beans.workspace.session, []

    def answer(parent, title, text, groups, now):
        offered.append(groups[now])
        return "new", True

    monkeypatch.setattr("PySide6.QtWidgets.QInputDialog.getItem", answer)
    for name, group in (("a", "ill"), ("b", "well")):
        session.select([name])
        session.set_group(group)
    beans.commands["edit.group"].trigger()
    assert offered == ["well"]
    assert session.study.members[1].subject.group == "new"


@pytest.mark.window
def test_the_table_is_sorted_by_number_and_filtered_by_any_column(beans):
    from PySide6.QtCore import Qt

    panel, surveys = beans.inspector.cohort, beans.workspace.session.surveys
    panel.table.sortByColumn(2, Qt.SortOrder.DescendingOrder)
    names = [panel.rows.index(row, 0).data() for row in range(4)]
    assert names == sorted(surveys, key=lambda name: -surveys[name].volume_ml)
    beans.workspace.session.select(["c"])
    beans.workspace.session.set_group("special")
    panel.filter.setText("SPEC")
    assert [panel.rows.index(row, 0).data() for row in range(panel.rows.rowCount())] == ["c"]


@pytest.mark.window
def test_an_exported_table_is_read_as_the_same_cohort(beans, tmp_path):
    session = beans.workspace.session
    session.select(["b"])
    session.set_group("NOR")
    member = session.study.members[0]
    aged = replace(member, subject=replace(member.subject, columns={"age": "61"}))
    session.edit("age", session.study.with_members({"a": aged}))
    beans.projects.export_table(tmp_path / "out" / "table.csv")
    again = read_cohort(tmp_path / "out" / "table.csv").subjects
    assert [(item.name, item.group) for item in again] == [
        ("a", None),
        ("b", "NOR"),
        ("c", None),
        ("d", None),
    ]
    assert [item.path.resolve() for item in again] == [item.subject.path for item in session.study.members]
    assert again[0].columns["age"] == "61"
    beans.projects.save_to(tmp_path / "study")
    same = tmp_path / "out" / "same.csv"
    arguments = ["export", "cohort", str(tmp_path / "study"), "--out", str(same), "--progress", "none"]
    assert main(arguments) == 0
    assert same.read_bytes() == (tmp_path / "out" / "table.csv").read_bytes()


@pytest.mark.window
def test_a_project_that_was_moved_is_found_whole_and_its_files_are_located(
    explored, close, make_window, ellipsoids, monkeypatch, tmp_path, wait, errors
):
    monkeypatch.setattr("homolog_app.window.project_controller.ask", lambda *given: given[3][0])
    monkeypatch.setattr("PySide6.QtWidgets.QFileDialog.getExistingDirectory", lambda *_: str(ellipsoids))
    session = explored.workspace.session
    session.select(["d"])
    explored.commands["edit.include"].trigger()
    explored.commands["view.grid1"].trigger()
    explored.commands["explore.measure"].trigger()
    explored.commands["view.head"].trigger()
    explored.commands["view.letters"].trigger()
    explored.views.stage.bar.opacity.setValue(50)
    wait(lambda: explored.commands["file.save"].isEnabled() and not explored.workspace.session.job.is_busy)
    explored.commands["file.save"].trigger()
    close(explored)
    shutil.move(tmp_path / "copy", tmp_path / "elsewhere" / "moved")

    window = make_window()
    window.projects.open_paths([tmp_path / "elsewhere" / "moved"])
    wait(lambda: window.workspace.session.result is not None)
    assert not errors
    assert [member.included for member in window.workspace.session.study.members] == [True, True, True, False]
    assert window.workspace.session.selection == ("d",)
    assert window.views.stage.scene.grid.display.layout == 1
    assert window.inspector.explore.page.title == "Measure"
    canvas = window.views.stage.scene.canvas
    assert canvas.cameras[0].eye[2] > canvas.cameras[0].at[2] + canvas.cameras[0].height / 2.0
    assert (canvas.opacity, canvas.letters, canvas.scale_bar) == (0.5, False, True)
    assert not window.commands["view.letters"].isChecked()
    assert all(member.subject.path.parent == ellipsoids for member in window.workspace.session.study.members)
    assert not errors


@pytest.mark.window
def test_a_project_is_not_saved_over_other_files(beans, tmp_path, errors):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").touch()
    beans.projects.save_to(tmp_path / "full")
    (error,) = [error for _, error in errors]
    assert isinstance(error, InputError)
    assert "not empty" in str(error)
    assert beans.workspace.is_changed


@pytest.mark.window
def test_a_folder_dropped_on_the_window_is_listed(window, ellipsoids):
    from PySide6.QtCore import QMimeData, QPointF, Qt, QUrl
    from PySide6.QtGui import QDropEvent

    data = QMimeData()
    data.setUrls([QUrl.fromLocalFile(str(ellipsoids))])
    none = Qt.KeyboardModifier.NoModifier
    drop = QDropEvent(QPointF(9, 9), Qt.DropAction.CopyAction, data, Qt.MouseButton.LeftButton, none)
    window.dropEvent(drop)
    assert [member.name for member in window.workspace.session.study.members] == ["a", "b", "c", "d"]


@pytest.mark.window
def test_what_is_dropped_and_can_not_be_used_is_not_ignored_in_silence(beans, wait):
    from threading import Event

    from PySide6.QtCore import QMimeData, QPointF, Qt, QUrl
    from PySide6.QtGui import QDropEvent

    said, end = [], Event()
    beans.workspace.session.noticed.connect(said.append)

    def drop(**content):
        data = QMimeData()
        data.setUrls([QUrl.fromLocalFile(str(path)) for path in content.get("paths", ())])
        data.setText(content.get("text", ""))
        none = Qt.KeyboardModifier.NoModifier
        copy, left = Qt.DropAction.CopyAction, Qt.MouseButton.LeftButton
        beans.dropEvent(QDropEvent(QPointF(9, 9), copy, data, left, none))

    drop(text="a text")
    beans.workspace.work.compute("test", lambda tick: end.wait(), "waiting", lambda _: None)
    drop(paths=["/a.nrrd"])
    end.set()
    wait(lambda: not beans.workspace.session.job.is_busy)
    assert said == [
        "Drop files or folders of this machine",
        "Something is being computed; wait for it or cancel it, then drop this again",
    ]


@pytest.mark.window
def test_a_run_shows_its_particles_whatever_was_open(groomed, wait):
    session, commands = groomed.workspace.session, groomed.commands
    session.show_step("groom")
    commands["view.slice"].trigger()
    commands["view.clip"].trigger()
    groomed.views.stage.scene.change(particles=False)
    commands["run.start"].trigger()
    wait(lambda: session.job.run is not None or session.result is not None)
    display = groomed.views.stage.scene.grid.display
    assert session.step == "correspond"
    assert not commands["view.slice"].isChecked()
    assert display.particles
    assert display.clip is None
    commands["run.cancel"].trigger()
    wait(lambda: not session.job.is_busy)


@pytest.mark.window
def test_the_label_picker_comes_up_where_files_hold_several_labels(window, tmp_path, wait):
    import numpy as np
    import SimpleITK

    values = np.zeros((20, 20, 20), dtype=np.uint8)
    values[4:9, 4:9, 4:9], values[11:17, 11:17, 11:17] = 2, 5
    for name in "xy":
        SimpleITK.WriteImage(SimpleITK.GetImageFromArray(values), tmp_path / f"{name}.nrrd")
    window.projects.open_paths([tmp_path / "x.nrrd", tmp_path / "y.nrrd"])
    session, picker = window.workspace.session, window.inspector.cohort.labels
    wait(lambda: len(session.surveys) == 2)
    assert picker.isVisibleTo(window)
    picker.choice.setCurrentIndex(picker.choice.findData(5))
    picker.choice.activated.emit(picker.choice.currentIndex())
    assert session.study.settings.groom.label == 5
    wait(lambda: all(survey.groom.label == 5 for survey in session.surveys.values()))
    assert session.surveys["x"].volume_ml == pytest.approx(0.216)


@pytest.mark.window
def test_the_problem_report_names_no_subject_file_or_group(beans):
    from homolog_app.window.dialogs import problem_report

    session = beans.workspace.session
    session.edit(
        "names",
        session.study.with_members(
            {
                "a": replace(
                    session.study.members[0],
                    subject=replace(session.study.members[0].subject, name="Erika Muster"),
                )
            }
        ),
    )
    session.select(["Erika Muster"])
    session.set_group("rare disease")
    logging.getLogger("homolog_app").warning("Erika Muster: %s failed", session.study.members[0].subject.path)
    text = problem_report(session, beans.workspace.memory, "Traceback of Erika Muster")
    assert "Erika" not in text
    assert "rare disease" not in text
    assert str(session.study.members[0].subject.path.parent) not in text
    assert "SUBJECT-1" in text
    assert "numpy" in text


@pytest.mark.window
def test_an_error_says_what_to_do_and_folds_its_details(window):
    from PySide6.QtWidgets import QLabel

    from homolog_app.window.dialogs import ErrorDialog

    window.help.show_error("groom", InputError("a: holds no voxel"))
    dialog = window.findChild(ErrorDialog)
    arguments = [label.text() for label in dialog.findChildren(QLabel)]
    assert "Grooming stopped" in arguments
    assert "a: holds no voxel" in arguments
    assert not dialog.details.isVisibleTo(dialog)
    dialog.close()


@pytest.mark.window
def test_what_the_system_refuses_is_said_with_the_file(window, errors, monkeypatch, tmp_path):
    def refuse(path):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr("homolog_app.window.study.read_cohort", refuse)
    window.projects.open_paths([tmp_path])
    ((_, error),) = errors
    assert user_message(error).startswith(f"{tmp_path}: Permission denied; ")


@pytest.mark.window
def test_none_keeps_its_references_while_the_window_is_painted(window, qapp):
    before = sys.getrefcount(None)
    for number in range(200):
        window.status.work.setText(str(number))
        window.views.stage.scene.plot.repaint()
        qapp.processEvents()
    assert sys.getrefcount(None) > before - 100


@pytest.mark.window
def test_closing_asks_about_unsaved_edits_and_obeys(beans, close, monkeypatch, tmp_path):
    answers, questions = iter(["Cancel", "Save"]), []
    monkeypatch.setattr(
        "homolog_app.window.project_controller.ask",
        lambda *given: questions.append(given[3][0]) or next(answers),
    )
    monkeypatch.setattr(
        "PySide6.QtWidgets.QFileDialog.getSaveFileName",
        lambda *_: (str(tmp_path / "kept"), ""),
    )
    beans.workspace.preferences.ask_on_close = True
    beans.close()
    assert beans.isVisible()
    close(beans)
    assert questions == ["Save"] * 2
    assert (tmp_path / "kept" / "project.json").is_file()


@pytest.mark.window
def test_the_question_whether_to_stop_is_closed_when_the_work_has_ended(window, monkeypatch, wait):
    from PySide6.QtWidgets import QMessageBox

    from homolog_app.window.dialogs import ask

    monkeypatch.undo()  # the box is to be shown
    shown = []

    def settled():
        boxes = window.findChildren(QMessageBox)
        shown.extend(box.defaultButton().text() for box in boxes)
        return bool(shown)

    assert ask(window, "Stop?", "It goes on.", ("Stop", "Keep working"), 1, settled) == ""
    assert shown[0] == "Keep working"


@pytest.mark.window
def test_work_that_is_to_be_stopped_is_stopped_before_the_next_question(groomed, monkeypatch, wait):
    questions = []

    def answer(_parent, _title, _details, answers, *_):
        questions.append(answers[0])
        return "Stop" if "Stop" in answers else "Cancel"

    monkeypatch.setattr("homolog_app.window.project_controller.ask", answer)
    groomed.workspace.preferences.ask_on_close = True
    groomed.commands["run.start"].trigger()
    wait(lambda: groomed.workspace.session.job.run is not None)
    groomed.close()
    assert questions == ["Stop", "Save"]
    wait(lambda: not groomed.workspace.session.job.is_busy)
    assert groomed.workspace.session.result is None
    groomed.workspace.preferences.ask_on_close = False


@pytest.mark.own_window
@pytest.mark.window
def test_sizes_of_window_and_panels_and_the_open_page_come_back(explored, close, make_window, tmp_path, wait):
    from PySide6.QtCore import Qt
    from PySide6.QtWidgets import QDockWidget

    def panel(window, name="Inspector"):
        return window.findChild(QDockWidget, name)

    explored.resize(1500, 850)
    explored.resizeDocks([panel(explored)], [520], Qt.Orientation.Horizontal)
    explored.commands["explore.modes"].trigger()
    explored.resizeDocks([panel(explored, "Plots")], [333], Qt.Orientation.Vertical)
    wait(lambda: panel(explored).width() == 520 and panel(explored, "Plots").height() == 333)
    close(explored)
    window = make_window()
    assert window.size().toTuple() == (1500, 850)
    window.projects.open_paths([tmp_path / "copy"])
    wait(lambda: window.inspector.explore.page.title == "Modes")
    wait(lambda: panel(window).width() == 520 and panel(window, "Plots").height() == 333, seconds=5)


@pytest.mark.window
def test_names_take_the_width_that_is_free(beans, wait):
    from PySide6.QtCore import Qt
    from PySide6.QtWidgets import QDockWidget

    from homolog_app.window.cohort_model import NAME

    beans.resize(1440, 900)  # as the program opens
    beans.resizeDocks([beans.findChild(QDockWidget, "Inspector")], [452], Qt.Orientation.Horizontal)
    panel, session = beans.inspector.cohort, beans.workspace.session
    long = "acdc_patient_001_myo"
    first = session.study.members[0]
    named = replace(first, subject=replace(first.subject, name=long))
    session.edit("name", replace(session.study, members=(named, *session.study.members[1:])))
    wait(lambda: len(session.surveys) == 5)
    assert panel.table.columnWidth(NAME) >= panel.table.sizeHintForColumn(NAME)


@pytest.mark.window
def test_enter_closes_an_error_and_does_not_unfold_it(window, wait):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    from homolog_app.window.dialogs import ErrorDialog

    dialog = ErrorDialog(window, window.workspace.theme, "Title", "Words", "Details", print)
    ended = []
    dialog.finished.connect(ended.append)
    dialog.open()
    QTest.keyClick(dialog.focusWidget() or dialog, Qt.Key.Key_Return)
    assert ended
    assert dialog.details.isHidden()


@pytest.mark.window
def test_the_subject_that_an_error_names_can_be_shown_or_left_out(groomed, wait):
    from PySide6.QtWidgets import QPushButton

    from homolog_app.window.dialogs import ErrorDialog

    path = next(item.subject.path for item in groomed.workspace.session.study.members if item.name == "c")

    def pressed(text, named="c"):
        groomed.help.show_error("run", InputError(f"{named}: its surface is open; close it"))
        (dialog,) = groomed.findChildren(ErrorDialog)
        next(button for button in dialog.findChildren(QPushButton) if button.text() == text).click()
        wait(lambda: not groomed.findChildren(ErrorDialog))

    groomed.workspace.session.show_step("correspond")
    pressed("Show c", named=path)
    assert groomed.workspace.session.step == "cohort"
    assert groomed.workspace.session.selection == ("c",)
    pressed("Exclude it and continue")
    assert [member.name for member in groomed.workspace.session.study.included] == ["a", "b", "d"]
    wait(lambda: groomed.workspace.session.result is not None)
    assert groomed.workspace.session.result.result.names == ("a", "b", "d")


@pytest.mark.window
def test_one_subject_is_too_few_and_the_cohort_page_says_so(window, ellipsoids):
    window.projects.open_paths([ellipsoids / "a.nrrd"])
    panel = window.inspector.cohort
    assert not panel.proceed.isEnabled()
    assert panel.count.text() == "1 of 1 subject included · two or more are needed"


@pytest.mark.window
def test_notes_of_few_subjects_notes_of_most_and_other_subjects_are_three_lists(groomed):
    panel, session = groomed.inspector.groom, groomed.workspace.session
    triage, table = panel.triage, panel.triage.table
    notes = {"a": ("1 piece came loose",), "b": ("2 pieces came loose", "was rotated by 90°")}
    for name, own in notes.items():
        item = session.groomed[name]
        report = replace(item.subject.report, notes=own)
        session.add_groomed({name: replace(item, subject=replace(item.subject, report=report))})

    def rows(place):
        triage.heads[place].click()
        return [[table.item(row, column).text() for column in (0, 1)] for row in range(table.rowCount())]

    assert [head.text() for head in triage.heads] == ["Look at · 1", "Whole cohort · 1", "Fine · 3"]
    assert rows(1) == [["2 subjects", "1 to 2 pieces came loose"]]
    assert rows(2) == [["a", ""], ["c", ""], ["d", ""]]
    assert rows(0) == [["b", "was rotated by 90°"]]
    table.setCurrentCell(0, 0)
    assert session.selection == ("b",)
    assert "Was rotated by 90°" in panel.report.text()
    assert set(groomed.inspector.cohort.model.triage.look) == {"b"}


@pytest.mark.window
def test_a_cure_grooms_its_subject_alone_and_can_be_undone(groomed, wait):
    session, cures = groomed.workspace.session, groomed.inspector.groom.cures
    before = dict(session.groomed)
    session.show_step("groom")
    session.select(["b"])
    cures.mirror.click()
    assert not session.is_groomed
    wait(lambda: not session.job.is_busy)
    assert session.is_groomed
    assert session.own_grooming("b").mirrored
    assert np.linalg.det(session.groomed["b"].alignment[:3, :3]) < 0.0
    assert "mirrored, as its table says" in session.groomed["b"].subject.report.notes
    assert all(session.groomed[name].subject is before[name].subject for name in "acd")
    session.undo.undo()
    assert not session.is_groomed
    assert not cures.mirror.isChecked()


@pytest.mark.window
def test_buttons_can_be_pressed_only_when_their_command_can(groomed, wait):
    go, again = groomed.inspector.groom.go, groomed.inspector.groom.cures.again
    groomed.workspace.session.select(["a"])
    assert go.isEnabled()
    assert again.isEnabled()
    groomed.commands["run.start"].trigger()
    assert not go.isEnabled()
    assert not again.isEnabled()
    assert "Not now" in go.toolTip()
    groomed.commands["run.cancel"].trigger()
    wait(lambda: not groomed.workspace.session.job.is_busy)
    assert go.isEnabled()


@pytest.mark.window
def test_stored_answers_are_listed_those_of_an_earlier_result_apart_and_one_is_primary(explored, wait):
    from homolog.comparison.question import Question
    from homolog.comparison.stored import Provenance, folder_of, stored_answers, write_question
    from homolog.io.project import OUT_OF_DATE

    page, project = explored.inspector.explore.pages[0], explored.workspace.project
    assert page.kept_title.isHidden()
    requests = [Question(between=("a", "b")), Question(between=("a", "c"))]
    for request in requests:
        write_question(request, folder_of(project, request), Provenance())
    (folder_of(project, requests[1]) / OUT_OF_DATE).touch()
    page.enter()
    assert page.kept.texts == [(requests[0].title, "", "")]
    effect = "mahalanobis_d_corrected"
    heads = f"comparison,p_permutation_corrected,permutations,{effect},{effect}_low_90,{effect}_high_90"
    table = f"{heads}\nb - a,0.034,999,1.5,0.52,2.5\n"
    (folder_of(project, requests[0]) / "tests.csv").write_text(table, encoding="utf-8")
    page.enter()
    assert page.kept.texts[1] == ("b − a", "1.50 (0.52 to 2.50)", "0.034")
    assert page.kept.isVisible()
    assert requests[1].title in page.outdated.text()
    assert requests[0].title not in page.outdated.text()
    assert not page.primary.isEnabled()
    page.kept.setCurrentItem(page.kept.topLevelItem(0).child(0))
    page.primary.click()
    wait(lambda: page.kept.texts[0][0] == f"{requests[0].title} (primary)")
    assert stored_answers(project)[0][0].is_primary


@pytest.mark.window
def test_a_result_of_another_cohort_says_so_on_every_page_and_a_typed_setting_leaves_it_valid(explored):
    session, text = explored.workspace.session, explored.inspector.explore.outdated
    assert text.text() == ""
    session.select(["b"])
    explored.commands["edit.include"].trigger()
    assert "b is excluded in Cohort" in text.text()
    explored.commands["edit.undo"].trigger()
    assert text.text() == ""
    groom = session.study.settings.groom.model_copy(update={"smoothing": 2.0})
    explored.workspace.edit_settings("groom", "smoothing", groom)
    assert text.text() == ""
    assert explored.inspector.correspond.go.property("primary") == "true"  # run again


@pytest.mark.window
def test_closing_in_mid_run_asks_first(groomed, monkeypatch, wait):
    questions = []
    monkeypatch.setattr(
        "homolog_app.window.project_controller.ask",
        lambda *given: questions.append(given[3][0]) or given[3][-1],
    )
    groomed.workspace.preferences.ask_on_close = True
    groomed.commands["run.start"].trigger()
    wait(lambda: groomed.workspace.session.job.run is not None)
    groomed.close()
    assert questions == ["Stop"]
    assert groomed.isVisible()
    assert groomed.workspace.session.job.is_busy
    groomed.workspace.preferences.ask_on_close = False


@pytest.mark.window
@pytest.mark.parametrize("answer", ["Import", "Cancel"])
def test_a_table_is_imported_once_its_preview_is_accepted(beans, tmp_path, monkeypatch, answer):
    questions = []

    def ask(parent, title, text, answers):
        questions.append(text)
        return answer

    monkeypatch.setattr("homolog_app.window.project_controller.ask", ask)
    table = tmp_path / "subjects.csv"
    table.write_text("id;group;age\na;case;61\nb;control;48\nx;case;1\n", encoding="utf-8")
    beans.projects.import_table(table)
    groups = [member.subject.group for member in beans.workspace.session.study.members]
    assert groups == (["case", "control", None, None] if answer == "Import" else [None] * 4)
    assert "2 of 4" in questions[0]
    assert "x" in questions[0].splitlines()[-1]


@pytest.mark.window
def test_the_start_page_shows_how_far_a_sample_is_and_can_cancel_it(window, monkeypatch, wait):
    import time

    def make(_sample, _folder, tick):
        while True:
            tick(0.5, "writing")
            time.sleep(0.01)

    monkeypatch.setattr("homolog_app.window.start_page.Sample.make", make)
    page, card = window.start_page, window.start_page.findChild(ActionButton)
    assert card.isEnabled()
    window.commands["file.sample_hearts"].trigger()
    wait(lambda: page.progress.isVisible() and page.progress.bar.value() == 500)
    assert not card.isEnabled()
    page.progress.cancel.click()
    wait(lambda: not window.workspace.session.job.is_busy)
    assert page.progress.isHidden()
    assert card.isEnabled()


@pytest.mark.window
def test_what_no_page_shows_the_progress_of_is_shown_in_the_status_bar(explored, wait):
    import time

    def work(tick):
        while True:
            tick(0.25, "counting")
            time.sleep(0.01)

    bar, cancel = explored.status.bar, explored.status.cancel
    assert bar.isHidden()
    explored.workspace.work.compute("reference", work, "counting", lambda _: None)
    wait(lambda: bar.isVisible() and bar.value() == 250)
    cancel.click()
    wait(lambda: not explored.workspace.session.job.is_busy)
    assert bar.isHidden()


@pytest.mark.window
def test_the_selection_is_still_marked_after_columns_were_imported(beans, tmp_path, monkeypatch):
    monkeypatch.setattr("homolog_app.window.project_controller.ask", lambda *given: given[3][0])
    (tmp_path / "ages.csv").write_text("name,age\na,50\nb,60\n", encoding="utf-8")
    beans.workspace.session.select(["b"])
    beans.projects.import_table(tmp_path / "ages.csv")
    panel = beans.inspector.cohort
    (row,) = panel.table.selectionModel().selectedRows()
    assert row.data() == "b"


@pytest.mark.window
def test_what_cannot_be_opened_is_no_unexpected_error(window, tmp_path, wait):
    from homolog_app.window.dialogs import ErrorDialog

    def title():
        (dialog,) = window.findChildren(ErrorDialog)
        text = dialog.windowTitle()
        dialog.accept()
        wait(lambda: not window.findChildren(ErrorDialog))
        return text

    (tmp_path / "empty").mkdir()
    window.projects.open_paths([tmp_path / "empty"])
    refused = title()
    window.help.show_error("", ValueError("a bug"))
    assert title() != refused
    window.help.show_error("anything", InputError("a file: can't be read"))
    assert title() != refused


@pytest.mark.window
def test_a_subject_that_cannot_be_used_says_why_in_its_tooltip(window, ellipsoids, tmp_path, wait):
    from PySide6.QtCore import Qt

    from homolog_app.window.cohort_model import STATUS

    shutil.copytree(ellipsoids, tmp_path / "cohort")
    (tmp_path / "cohort" / "z.nrrd").write_bytes(b"nothing")
    window.projects.open_paths([tmp_path / "cohort"])
    wait(lambda: len(window.workspace.session.surveys) == 5)
    model = window.inspector.cohort.model
    index = model.index(4, STATUS)
    assert window.workspace.session.surveys["z"].problem in index.data(Qt.ItemDataRole.ToolTipRole)
    assert len(index.data()) < 12  # has room in its column


def test_many_recent_projects_do_not_make_the_window_taller(window, tmp_path, qapp):
    page = window.start_page
    page.show_recent([])
    qapp.processEvents()
    lowest, height = window.minimumSizeHint().height(), page.sizeHint().height()
    page.show_recent([tmp_path / f"project {number}" for number in range(10)])
    qapp.processEvents()
    assert page.sizeHint().height() > height + 100
    assert window.minimumSizeHint().height() == lowest
