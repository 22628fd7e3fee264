"""The command table, and that everything in it can be ordered."""

from collections import Counter
from importlib.resources import files

import numpy as np
import pytest

from homolog_app.window.actions import matches, ranked
from homolog_app.window.commands import COMMANDS, MENUS


def test_no_two_commands_share_an_id_or_a_shortcut():
    for values in (
        [command.id for command in COMMANDS],
        [command.shortcut for command in COMMANDS if command.shortcut],
    ):
        assert not [value for value, count in Counter(values).items() if count > 1]


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.id)
def test_every_command_has_a_menu_a_sentence_of_help_and_an_icon_that_exists(command):
    assert command.menu.split("/")[0] in MENUS
    assert command.help.endswith(".")
    assert command.help[0].isupper()
    assert not command.icon or (files("homolog_resources") / "icons" / f"{command.icon}.svg").is_file()


def test_the_palette_finds_a_command_by_any_of_its_words():
    screenshot = next(command for command in COMMANDS if command.id == "view.screenshot")
    assert matches("pict VIEW", screenshot)
    assert not matches("picture of a cat", screenshot)


def test_the_palette_lists_titles_that_begin_with_what_was_typed_first():
    assert ranked("fit")[0].id == "view.reset"
    titles = [command.title for command in ranked("view")]
    assert titles.index("Fit to view") < titles.index("Cohort")


@pytest.mark.window
def test_keys_are_those_of_the_platform_where_it_has_a_convention(window):
    from PySide6.QtGui import QKeySequence

    assert window.commands["help.shortcuts"].shortcut() == QKeySequence("F1")
    standard = QKeySequence.keyBindings(QKeySequence.StandardKey.Redo)
    assert window.commands["edit.redo"].shortcuts() == standard


@pytest.mark.window
def test_every_command_has_a_handler_a_tool_tip_and_a_key_in_its_menu(window):
    from PySide6.QtGui import QKeySequence
    from PySide6.QtWidgets import QMenu

    for command in COMMANDS:
        action = window.commands[command.id]
        assert action.receivers("2triggered(bool)") > 0, command.id
        assert action.toolTip()
    for menu in window.menuBar().findChildren(QMenu):  # each entry has a letter of its own
        keys = [QKeySequence.mnemonic(entry.text()) for entry in menu.actions() if not entry.isSeparator()]
        assert not any(key.isEmpty() for key in keys), [entry.text() for entry in menu.actions()]
        assert len(set(keys)) == len(keys), [entry.text() for entry in menu.actions()]


@pytest.mark.window
def test_shortcuts_are_the_same_on_the_sheet_as_in_the_menu(window):
    from PySide6.QtWidgets import QLabel

    from homolog_app.window.actions import ShortcutSheet

    sheet = ShortcutSheet(window)
    text = {label.text() for label in sheet.findChildren(QLabel)}
    sheet.close()
    for command in COMMANDS:
        if command.shortcut:
            assert window.commands[command.id].shortcut().toString() in text


@pytest.mark.window
def test_without_a_study_only_commands_that_need_none_are_possible(window):
    possible = {command.id for command in COMMANDS if window.commands[command.id].isEnabled()}
    assert {"file.new", "file.open", "file.sample", "help.palette"} <= possible
    assert not {"run.start", "run.groom", "edit.group", "view.screenshot", "file.save"} & possible


@pytest.mark.window
def test_the_palette_lists_what_is_possible_and_runs_it(window):
    from homolog_app.window.actions import CommandPalette

    palette = CommandPalette(window, window.commands)
    palette.show()
    assert palette.focusWidget() is palette.query  # what is typed goes there
    palette.query.setText("light dark")
    assert palette.list.topLevelItemCount() == 1
    for query, reason in (("place the particles", "Not now"), ("no such command", "")):
        palette.query.setText(query)  # what is not possible now is dimmed, and says why
        first = palette.list.topLevelItem(0)
        assert first.isDisabled()
        assert reason in first.toolTip(0)
        palette.query.returnPressed.emit()
        assert palette.chosen is None
    palette.query.setText("light dark")
    palette.query.returnPressed.emit()
    assert palette.chosen is window.commands["view.theme"]
    palette.close()


@pytest.mark.window
def test_energies_of_one_iteration_are_no_curve(window, plots):
    from homolog_app.window.run_particles import EnergyCurves

    curves = EnergyCurves(window.workspace.theme)
    curves.resize(900, 200)

    def picture(rows):
        curves.show_rows(rows)
        curves.show()
        return curves.grab().toImage()

    assert picture([[5, 1, 1, 1], [5, 2, 2, 2]]) == picture([])
    assert picture([[0, 1, 1, 1], [1, 2, 2, 2]]) != picture([])
    curves.close()


@pytest.mark.window
def test_energies_that_repeat_the_last_evaluation_are_no_step_of_the_curve(window):
    curves = window.docks.curves
    curves.show_rows([[20, 1.0, 2.0, 3.0], [24, 1.0, 2.0, 3.0]], is_live=True)
    assert curves.is_empty
    curves.show_rows([[20, 1.0, 2.0, 3.0], [24, 1.0, 2.0, 3.0], [40, 1.0, 2.0, 4.0]], is_live=True)
    assert not curves.is_empty


@pytest.mark.window
def test_energies_of_a_run_in_progress_are_painted_without_matplotlib(window, plots):
    from homolog_app.window.run_particles import EnergyCurves

    curves = EnergyCurves(window.workspace.theme)
    curves.resize(900, 200)
    curves.show()
    rows = np.random.default_rng(0).random((100, 4))
    rows[:, 0] = np.arange(100)
    pictures = []
    for count in (80, 90):
        curves.show_rows(rows[:count], is_live=True)
        pictures.append(curves.grab().toImage())
    assert pictures[0] != pictures[1]
    assert curves.canvas is None
    curves.show_rows(rows)
    assert curves.canvas is not None
    assert curves.canvas.isVisible()
    curves.close()


@pytest.mark.window
def test_a_command_that_is_impossible_says_why_and_whether_a_computation_is_the_cause(beans, wait):
    from threading import Event

    def reason(name):
        return beans.commands[name].toolTip().splitlines()[-1]

    def impossible():
        return {command.id for command in COMMANDS if not beans.commands[command.id].isEnabled()}

    assert {"run.start", "edit.redo"} <= impossible()
    assert all(reason(name).startswith("Not now: ") for name in impossible())
    own = reason("edit.redo")
    end = Event()
    beans.workspace.work.compute("test", lambda tick: end.wait(), "waiting", lambda _: None)
    assert reason("edit.include") == reason("edit.redo") == reason("file.open") != own
    end.set()
    wait(lambda: not beans.workspace.session.job.is_busy)
    assert "edit.include" not in impossible()
    assert reason("edit.redo") == own


@pytest.mark.window
def test_a_tool_without_a_text_says_its_name_when_the_pointer_is_on_it(window, qapp, wait):
    from PySide6.QtCore import QPointF
    from PySide6.QtGui import QEnterEvent
    from PySide6.QtWidgets import QToolTip

    from homolog_app.window.commands import command

    tool = window.commands.button("view.clip", window)
    tool.show()
    here = QPointF(tool.rect().center())
    qapp.sendEvent(tool, QEnterEvent(here, here, here))
    wait(QToolTip.isVisible, 5.0)
    assert QToolTip.text().startswith(command("view.clip").title)
    QToolTip.hideText()


@pytest.mark.window
def test_a_plot_fills_its_place_though_it_is_painted_before_it_knows_its_size(window, monkeypatch):
    from homolog_app.window.explore.plot_canvas import PlotCanvas
    from homolog_app.window.run_particles import EnergyCurves

    curves = EnergyCurves(window.workspace.theme)
    curves.show_rows([[k, 1.0, 2.0, 3.0 + k] for k in range(5)])
    curves.resize(500, 220)
    curves.show()
    canvas = curves.canvas
    canvas.grab()
    monkeypatch.setattr(PlotCanvas, "resizeEvent", lambda *_: None)
    curves.resize(800, 300)
    canvas.grab()
    assert canvas.figure.bbox.size.tolist() == [canvas.width(), canvas.height()]
    curves.close()
    curves.deleteLater()


@pytest.mark.window
def test_texts_of_plots_grow_with_the_font_of_the_system(window, plots, qapp):
    from PySide6.QtGui import QFont, QFontInfo

    from homolog_app.window.run_particles import EnergyCurves

    def height():
        curves = EnergyCurves(window.workspace.theme)
        curves.resize(900, 400)
        curves.show_rows(np.array([[1.0, 3.0, 2.0, 1.0], [2.0, 2.0, 1.0, 0.5]]))
        curves.show()
        curves.grab()
        size = curves.canvas.figure.axes[0].xaxis.label.get_window_extent().height
        curves.close()
        return size

    before, font = height(), qapp.font()
    larger = QFont(font)
    larger.setPixelSize(2 * QFontInfo(font).pixelSize())
    qapp.setFont(larger)
    try:
        assert height() == pytest.approx(2.0 * before, rel=0.1)
    finally:
        qapp.setFont(font)


@pytest.mark.window
@pytest.mark.own_window
def test_with_a_large_font_every_step_fits_a_small_screen(make_window, qapp, ellipsoids, wait):
    from PySide6.QtGui import QFont

    font, larger = qapp.font(), QFont(qapp.font())
    larger.setPixelSize(19)
    qapp.setFont(larger)
    try:
        window = make_window()
        window.projects.open_paths([ellipsoids])
        wait(lambda: len(window.workspace.session.surveys) == 4)
        window.resize(1280, 800)
        bar = window.views.stage.bar
        plots = [page.plots for page in window.inspector.explore.pages if page.plots is not None]
        wait(lambda: window.minimumSizeHint().width() <= 1280)
        assert all(part.minimumSizeHint().width() <= bar.minimumSizeHint().width() for part in plots)
        assert len(plots) == 4
        assert bar.opacity.isHidden()
        assert bar.percent.isVisible()
        window.resize(1900, 800)
        wait(bar.opacity.isVisible)
    finally:
        qapp.setFont(font)


@pytest.mark.window
def test_texts_of_a_small_plot_keep_the_usual_size_with_a_large_font(window, plots, qapp):
    from PySide6.QtGui import QFont

    from homolog_app.window.explore.plot_canvas import figure_of
    from homolog_app.window.run_particles import EnergyCurves

    curves = EnergyCurves(window.workspace.theme)
    curves.setMinimumSize(1, 1)
    curves.show_rows(np.array([[1.0, 3.0, 2.0, 1.0], [2.0, 2.0, 1.0, 0.5]]))

    def dpi(*size):
        curves.resize(*size)
        return size[0] / figure_of(curves).get_size_inches()[0]

    usual, font = dpi(900, 400), qapp.font()
    larger = QFont(font)
    larger.setPixelSize(24)
    qapp.setFont(larger)
    try:
        small, middle, large = dpi(220, 140), dpi(900, 240), dpi(900, 400)
    finally:
        qapp.setFont(font)
    assert small == pytest.approx(usual)
    assert 1.2 * usual < middle < large
