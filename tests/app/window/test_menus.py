"""Menus of views and plots, and plots in their own windows."""

from xml.etree import ElementTree

import pytest

pytestmark = [pytest.mark.window, pytest.mark.usefixtures("plots")]


@pytest.fixture
def modes(explored, wait):
    explored.commands["explore.modes"].trigger()
    wait(lambda: explored.inspector.explore.fitted.shape is not None)
    return explored.inspector.explore.page


def click(qapp, widget, at, button, modifiers=None):
    from PySide6.QtCore import QPoint, Qt
    from PySide6.QtTest import QTest

    QTest.mouseClick(
        widget, button, modifiers or Qt.KeyboardModifier.NoModifier, QPoint(round(at.x()), round(at.y()))
    )
    qapp.processEvents()


def test_a_right_click_on_a_subject_offers_to_show_it_alone(explored, qapp, wait):
    from PySide6.QtCore import QPointF, Qt
    from PySide6.QtWidgets import QMenu

    scene = explored.views.stage.scene
    plot = scene.plot
    lower_right = QPointF(0.75 * plot.width(), 0.75 * plot.height())
    click(qapp, plot, lower_right, Qt.MouseButton.RightButton)
    wait(lambda: qapp.activePopupWidget() is not None)
    menu = qapp.activePopupWidget()
    assert isinstance(menu, QMenu)
    actions = {action.text().replace("&", ""): action for action in menu.actions()}
    assert "Select d" in actions
    assert {"Look from", "Cut away", "Copy picture"} <= set(actions)
    actions["Show only this subject"].trigger()
    menu.close()
    assert [content.name for content in scene.shown] == ["d"]
    assert scene.grid.display.layout == 1


def test_a_right_click_on_a_row_of_the_cohort_offers_what_can_be_done_with_it(beans, qapp, wait):
    from PySide6.QtCore import QPoint
    from PySide6.QtGui import QContextMenuEvent
    from PySide6.QtWidgets import QMenu

    table, session = beans.inspector.cohort.table, beans.workspace.session
    session.select(["b"])
    place = QPoint(20, 20)
    at = table.viewport().mapToGlobal(place)
    qapp.postEvent(table.viewport(), QContextMenuEvent(QContextMenuEvent.Reason.Mouse, place, at))
    wait(lambda: qapp.activePopupWidget() is not None)
    menu = qapp.activePopupWidget()
    assert isinstance(menu, QMenu)
    actions = {action.text().replace("&", ""): action for action in menu.actions()}
    menu.close()
    actions["Include or exclude"].trigger()
    assert [member.name for member in session.study.included] == ["a", "c", "d"]


def test_plots_are_saved_with_their_texts(modes, tmp_path):
    from PySide6.QtGui import QImage

    from homolog.errors import InputError
    from homolog_app.window.explore.plot import save_plot

    plot = modes.charts.scatter
    save_plot(plot, tmp_path / "scores.svg")
    root = ElementTree.parse(tmp_path / "scores.svg").getroot()
    texts = {text.text for text in root.iter("{http://www.w3.org/2000/svg}text")}
    assert "Subjects" in texts
    assert any("SD" in text for text in texts if text)
    save_plot(plot, tmp_path / "scores.png")
    assert QImage(str(tmp_path / "scores.png")).width() > 2 * plot.width()
    for path in (tmp_path / "scores.png" / "again.png", tmp_path / "scores.txt"):  # a file is no folder
        with pytest.raises(InputError, match="can't be written"):
            save_plot(plot, path)


def test_a_plot_opens_in_its_own_window_and_names_and_ellipses_are_switched_on(modes, qapp, wait):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    from homolog_app.window.explore.plot import EnlargedPlot, plot_menu, plot_picture

    plot = modes.charts.scatter
    QTest.mouseDClick(plot.canvas, Qt.MouseButton.LeftButton)
    dialog = plot.window().findChild(EnlargedPlot)
    assert dialog.canvas.width() > plot.width()
    before = plot_picture(plot)
    for action in plot_menu(plot).actions():
        if action.isCheckable():
            action.trigger()
    assert set(plot.options.values()) == {True}
    assert plot_picture(plot) != before
    dialog.close()


def test_a_click_with_ctrl_adds_to_the_selection(explored, modes, qapp, pixel):
    from PySide6.QtCore import Qt

    plot, session = modes.charts.scatter, explored.workspace.session
    session.select([])
    for name, selected in (("a", ("a",)), ("b", ("a", "b")), ("a", ("b",))):
        at = pixel(plot.canvas, *plot.points[plot.names.index(name)])
        click(qapp, plot.canvas, at, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.ControlModifier)
        assert session.selection == selected
