"""Undo and redo: every edit of a study, by its menu's name, from wherever the keyboard is."""

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QWidget

pytestmark = pytest.mark.window

NAME, GROUP = 0, 1  # columns of the table of subjects
_UNTICKED = (Qt.CheckState.Unchecked.value, Qt.ItemDataRole.CheckStateRole)


def test_every_edit_is_named_undone_and_made_again(beans, wait, tmp_path, monkeypatch):
    session, commands = beans.workspace.session, beans.commands
    table = tmp_path / "table.csv"
    table.write_text("name,group,age\na,left,50\nb,right,60\nc,right,70\nd,left,80\n", encoding="utf-8")
    monkeypatch.setattr("homolog_app.window.project_controller.ask", lambda *_, **__: "Import")
    model, file = beans.inspector.cohort.model, session.study.members[1].subject.path
    edits = {
        "Undo Import table": lambda: beans.projects.import_table(table),
        "Undo Set group": lambda: session.set_group("left"),
        "Undo Group of a": lambda: model.setData(model.index(0, GROUP), "right"),
        "Undo age of a": lambda: model.setData(model.index(0, model.columnCount() - 1), "51"),
        "Undo Exclude a": lambda: model.setData(model.index(0, NAME), *_UNTICKED),
        "Undo Include subjects": commands["edit.include"].trigger,
        "Undo Set scan": lambda: beans.views.scans.give("a", table),
        "Undo Device": lambda: beans.inspector.correspond.resource_edited.emit("device", "cpu"),
        "Undo Workers": lambda: _type(beans, wait, "groom", "workers", "2"),
        "Undo Memory": lambda: _type(beans, wait, "correspond", "memory", "4"),
        "Undo Smoothing": lambda: _type(beans, wait, "groom", "smoothing", "2"),
        "Undo Particles": lambda: _type(beans, wait, "correspond", "particles", "64"),
        "Undo Remove subjects": commands["edit.remove"].trigger,
        "Undo Add subjects": lambda: beans.projects.open_paths([file]),
    }
    session.undo.clear()  # edits of one setting in a row are one
    session.select(["a", "b"])
    states = [session.study]
    for name, edit in edits.items():
        edit()
        assert commands["edit.undo"].text().replace("&", "") == name
        assert session.study != states[-1]
        states.append(session.study)
    for before in reversed(states[:-1]):
        commands["edit.undo"].trigger()
        assert session.study == before
    assert commands["edit.redo"].text().replace("&", "") == "Redo Import table"
    for after in states[1:]:
        commands["edit.redo"].trigger()
        assert session.study == after


@pytest.mark.parametrize(
    ("panel", "name", "text"), [("groom", "smoothing", "2"), ("correspond", "particles", "64")]
)
def test_undo_in_the_field_that_was_typed_in_undoes_the_setting(beans, wait, panel, name, text):
    session = beans.workspace.session
    session.undo.clear()  # edits of one setting in a row are one
    before, editor = session.study, _editor(beans, panel, name)
    shown = editor.text()
    _type(beans, wait, panel, name, text)
    assert session.study != before
    QTest.keyClick(editor, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    assert session.study == before
    assert editor.text() == shown


def _editor(window, panel, name):
    panel = getattr(window.inspector, panel)
    return next(each for each in panel.findChildren(QWidget) if each.accessibleName() == name)


def _type(window, wait, panel, name, text):
    editor = _editor(window, panel, name)
    window.workspace.session.show_step(panel)
    getattr(window.inspector, panel).form.unfold.setChecked(True)
    window.activateWindow()
    editor.setFocus()
    wait(editor.hasFocus)
    editor.selectAll()
    QTest.keyClicks(editor, text)
    QTest.keyClick(editor, Qt.Key.Key_Return)
