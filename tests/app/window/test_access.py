"""For those without a mouse, colours or eyes: every dialog, panel and page is walked and measured."""

import importlib
import pkgutil
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from accessibility import Walk
from PIL import Image

import homolog_app.window

pytestmark = pytest.mark.window

TALL = 2400  # pixels: nothing has to be scrolled to


def two_labels(path):
    """Write a file with two labels."""
    import SimpleITK

    values = np.zeros((16, 16, 16), np.uint8)
    values[3:8, 3:13, 3:13], values[8:13, 3:13, 3:13] = 1, 2
    SimpleITK.WriteImage(SimpleITK.GetImageFromArray(values), path)
    return path


def program_widgets():
    """Return every class of widgets that the window's modules define."""
    from PySide6.QtWidgets import QWidget

    for module in pkgutil.walk_packages(homolog_app.window.__path__, "homolog_app.window."):
        importlib.import_module(module.name)
    result, kinds = set(), [QWidget]
    while kinds:
        below = kinds.pop().__subclasses__()
        kinds += below
        result |= {kind for kind in below if kind.__module__.startswith("homolog_app.window")}
    return result


@pytest.fixture
def walk(window, monkeypatch):
    """Return what looks at places of the window; dialogs that wait for an answer are looked at and left."""
    from PySide6.QtWidgets import QDialog, QFileDialog, QInputDialog, QMessageBox

    from homolog_app.window.export.process import Preview

    walk = Walk(window)
    window.setUpdatesEnabled(False)  # places are rendered when they are looked at, and not before
    monkeypatch.setattr(Preview, "want", lambda *_: None)  # a process draws it for seconds

    def answer(dialog):
        dialog.show()
        question = dialog.text() if isinstance(dialog, QMessageBox) else dialog.windowTitle()
        walk.look_once(question or type(dialog).__name__, dialog)
        dialog.reject()
        return QDialog.DialogCode.Rejected

    def choose(parent, title, text, items, *_):
        dialog = QInputDialog(parent)
        dialog.setWindowTitle(title)
        dialog.setLabelText(text)
        dialog.setComboBoxItems(items)
        answer(dialog)
        return "", False

    for kind in (QDialog, QMessageBox):
        monkeypatch.setattr(kind, "exec", answer)
    monkeypatch.setattr(QInputDialog, "getItem", choose)
    for name in ("getExistingDirectory", "getSaveFileName", "getOpenFileName", "getOpenFileNames"):
        nothing = "" if name == "getExistingDirectory" else ("", "")
        monkeypatch.setattr(QFileDialog, name, lambda *_, nothing=nothing, **__: nothing)  # the system's own
    return walk


@pytest.fixture
def look(walk, window, qapp):
    """Return a function that looks at a part of the window with everything unfolded and nothing scrolled."""
    from PySide6.QtWidgets import QPushButton

    def look_at(where, root, once=False):
        for button in root.findChildren(QPushButton):
            if button.isCheckable() and "▸" in button.text():
                button.click()
        root.window().resize(root.window().width(), TALL)
        for _ in range(3):
            qapp.processEvents()
        assert root.isVisible(), where
        (walk.look_once if once else walk.look)(where, root)

    return look_at


@pytest.fixture
def look_through(look, walk):
    """Return a function that looks through places in one scheme, then in the other.

    Places are functions that show one and yield a name and a widget; what comes after the yield leaves it.
    """

    def through(places):
        for changes in (True, False):
            for name, root in places():
                look(name, root, once=True)
            if changes:
                walk.change_scheme()

    return through


@pytest.fixture
def order(look_through, window, qapp):
    """Return a function that orders commands and looks at the dialogs that come of them, all at once.

    An order is the name of a command, or a function. All are given again in the other scheme, for the dialogs
    that wait for an answer.
    """
    from PySide6.QtWidgets import QDialog

    def give(orders):
        for item in orders:
            if callable(item):
                item()
            elif window.commands[item].isEnabled():
                window.commands[item].trigger()
            qapp.processEvents()
        return [dialog for dialog in window.findChildren(QDialog) if dialog.isVisible()]

    def ordered(*orders):
        dialogs = give(orders)
        look_through(lambda: [(dialog.windowTitle(), dialog) for dialog in dialogs])
        for dialog in [*dialogs, *give(orders)]:
            dialog.close()

    return ordered


def test_every_dialog_panel_and_page_can_be_used_by_key_is_named_and_can_be_read(
    window, walk, look, look_through, order, bean_project, tmp_path, wait, quick
):
    from PySide6.QtWidgets import QWidget

    from homolog.comparison.stored import StoredAnswer, StoredTest
    from homolog.errors import InputError
    from homolog.inspection import Word
    from homolog_app.window.commands import COMMANDS
    from homolog_app.window.dialogs import ask
    from homolog_app.window.explore.groups_page import GroupsPage
    from homolog_app.window.explore.measure_page import MeasurePage
    from homolog_app.window.explore.patient_page import PatientPage
    from homolog_app.window.explore.plot import EnlargedPlot
    from homolog_app.window.folder_page import FolderPage

    def rest():
        wait(lambda: not work.session.job.is_busy, seconds=120)

    commands, workspace, panels = window.commands, window.workspace, window.inspector
    session, work, scene = workspace.session, workspace.work, window.views.stage.scene
    window.views.stage.scene.hide()  # drawing it as tall takes long
    look("start", window)
    window.projects.open_paths([two_labels(tmp_path / "two.nrrd")])
    wait(lambda: session.surveys)
    look("labels", panels)
    picker = panels.cohort.labels
    picker.choice.setCurrentIndex(picker.choice.count() - 1)
    picker.choice.activated.emit(picker.choice.currentIndex())
    wait(lambda: all(survey.groom.structures for survey in session.surveys.values()))
    look("several structures", window)
    window.projects.leave()
    for name in ("a/1", "a/2", "b/3", "b/4"):
        (tmp_path / "folders" / name).parent.mkdir(parents=True, exist_ok=True)
        two_labels(tmp_path / "folders" / f"{name}.nrrd")
    window.projects.open_paths([tmp_path / "folders"])
    folder_page = window.findChild(FolderPage)
    look("folder", folder_page)
    folder_page.reject()

    shutil.copytree(bean_project, tmp_path / "beans")
    window.projects.open_paths([tmp_path / "beans"])
    wait(lambda: session.result is not None and window.workspace.session.step == "explore")
    rest()
    walk.seen |= {kind for widget in [scene, *scene.findChildren(QWidget)] for kind in type(widget).__mro__}

    def steps():
        for step in ("cohort", "groom", "correspond", "explore"):
            commands[f"view.{step}"].trigger()
            wait(lambda step=step: step != "groom" or panels.groom.triage.isVisible())
            yield step, panels

    def around():
        window.docks.show_or_hide_log()
        commands["help.tour"].trigger()
        commands["view.clip"].trigger()
        yield "around the views", window
        commands["view.clip"].trigger()
        window.docks.show_or_hide_log()
        commands["view.slice"].trigger()
        yield "slices", window.views.stage.slices
        commands["view.slice"].trigger()
        commands["view.explore"].trigger()
        yield "energies", window.docks.curves
        rows = [(20, -2.0, 0.5, 0.1), (40, -2.1, 0.4, 0.1)]
        window.docks.curves.show_rows(rows, is_live=True)
        yield "energies of a run", window.docks.curves
        window.docks.curves.show_rows(rows)

    def doubtful():
        verdict = replace(
            session.result.verdict, word=Word.DOUBTFUL, cause="Half is noise.", remedy="Add subjects."
        )
        session.result = replace(session.result, verdict=verdict)
        session.result_changed.emit()
        yield "a doubtful model", panels.explore

    def pages():
        for page in panels.explore.pages:
            panels.explore.open_page(page)
            if page is not panels.explore.pages[0]:
                wait(lambda: panels.explore.fitted.shape is not None)
            rest()
            yield page.title, page
            if page.plots is not None:
                yield f"plots of {page.title}", page.plots
            if isinstance(page, PatientPage):
                page.answer.show()  # as with a patient
                rest()
                yield "a patient", page
                page.answer.hide()
            if isinstance(page, MeasurePage):
                page.charts.setCurrentIndex(1)
                yield "measures by group", page.charts
                enlarged = EnlargedPlot(page.charts.each[1])
                enlarged.show()
                yield "a plot enlarged", enlarged
                enlarged.close()
                page.kind.setCurrentText("Scatter plot")
                page.choose_plots()
                yield "two measures", page
                yield "one measure against another", page.charts

    for places in (steps, around, pages, doubtful):
        look_through(places)
    page = panels.explore.page_of(GroupsPage)
    panels.explore.open_page(page)
    page.form.alignment.setCurrentIndex(page.form.alignment.findData(None))  # form and shape: several results
    for question in ("group", "size (as a number)"):
        page.form.column.setCurrentText(question)
        page.form.column.activated.emit(page.form.column.currentIndex())
        commands["explore.test"].trigger()
        rest()
        look(question, page)
        page.by_seed.show_sentences(["p from 0.01 to 0.02 over 2 seeds."], page.reveal)
        look(f"{question} with other seeds", page)
    page.form.builder.show()  # as with further columns
    look("a formula", page)
    page.form.builder.hide()
    overview, answered = panels.explore.pages[0], page.answers[0].study.question
    panels.explore.open_page(overview)
    overview.kept.show_answers([StoredAnswer(answered, False, {"slim": StoredTest(0.01, 999, None)})])
    look("stored answers", overview)
    panels.explore.open_page(page)

    order(
        *(command.id for command in COMMANDS if command.title.endswith("…") or command.menu == "Help"),
        lambda: window.help.show_error("run", InputError("a.nrrd: is empty; choose another file")),
        "view.corner",
        lambda: ask(window, "Leave?", "Something is not saved.", ("Save", "Cancel")),
    )

    commands["view.correspond"].trigger()
    workspace.edit_settings("optimize", "particles", quick(200, anneal=80))
    look("more particles", panels)
    commands["run.more"].trigger()
    wait(lambda: work.session.job.run is not None and work.session.job.run.frame is not None)
    commands["run.pause"].trigger()
    wait(lambda: work.session.job.run.status.paused)
    look("a run", panels)
    order("view.screenshot")
    commands["run.cancel"].trigger()
    rest()
    look("a run that was cancelled", panels)

    print(*sorted(walk.faults), sep="\n")
    assert not walk.faults
    unseen = program_widgets() - walk.seen
    assert not unseen, "the walk lacks a place where these can be seen"


@pytest.mark.own_window
def test_the_pictures_of_the_manual_show_the_present_controls_of_each_page(window, monkeypatch):
    folder = Path(__file__).parents[3] / "docs" / "images" / "manual"
    monkeypatch.syspath_prepend(str(folder))
    from controls import KEY, controls_of, recorded

    inspector = window.inspector
    panels = (inspector.cohort, inspector.groom, inspector.correspond, *inspector.explore.pages)
    present = {type(panel).__name__: controls_of(panel, primary=False) for panel in panels}
    seen = set()
    for path in sorted(folder.glob("*.png")):
        with Image.open(path) as picture:
            page, controls = recorded(picture.text.get(KEY, ""))
        if page:
            assert present[page] <= controls, f"{path.name} is stale: run {folder / 'make.py'}"
            seen.add(page)
    assert seen == set(present)
