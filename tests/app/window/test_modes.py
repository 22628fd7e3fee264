"""The Modes page on the real window: what varies, seen and measured on the shapes that are shown."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

pytestmark = pytest.mark.window


@pytest.fixture
def page(explore, bean_project):
    return explore(bean_project, "modes")


@pytest.fixture
def scene(window):
    return window.views.stage.scene


def slot(vertices, body=(40.0, 30.0, 20.0)):
    """Return where the slot's middle is along y, and how wide it is there [mm]."""
    carved = (np.square(vertices / body).sum(axis=1) < 0.9) & (np.abs(vertices[:, 0]) < 14.0)
    across = vertices[carved, 1]
    low, high = np.percentile(across, (2, 98))
    return (low + high) / 2.0, high - low


def shape(scene):
    return scene.shown[-1].groomed.vertices


def move(page, mode, value):
    page.sliders.show_values([])
    page.sliders.show_value(mode, value)


def test_the_first_mode_of_the_beans_moves_the_slot_and_the_second_changes_its_width(page, scene):
    ends = {}
    for mode in (0, 1):
        for value in (-1.5, 1.5):
            move(page, mode, value)
            ends[mode, value] = slot(shape(scene))
    moved = [abs(ends[mode, 1.5][0] - ends[mode, -1.5][0]) for mode in (0, 1)]
    widened = [abs(ends[mode, 1.5][1] - ends[mode, -1.5][1]) for mode in (0, 1)]
    assert moved[0] > 12.0 > 4.0 > moved[1]
    assert widened[1] > 3.0
    assert widened[1] > 2.0 * widened[0]


def test_the_modes_follow_the_truth_of_the_beans(page):
    from homolog.beans.generate import draw_beans

    beans, scores = draw_beans(10), page.fitted.shape.model.scores_
    position, width = (np.array([getattr(bean, name) for bean in beans]) for name in ("position", "width"))
    assert abs(np.corrcoef(scores[:, 0], position)[0, 1]) > 0.99
    assert abs(np.corrcoef(scores[:, 1], width)[0, 1]) > 0.9


def test_there_are_as_many_sliders_as_modes_above_chance_and_more_on_demand(page):
    kept = page.fitted.shape.parallel.n_retained
    assert len(page.sliders.values) == max(1, kept)
    page.sliders.more.click()
    assert len(page.sliders.values) == max(1, kept) + 3


def test_tab_goes_through_the_sliders_in_their_order_from_the_top_of_the_page(page, window):
    page.sliders.choose(1)
    page.sliders.choose(0)
    parts = [part for row in page.sliders.rows[:2] for part in (row.name, row.slider, row.typed)]
    window.commands["explore.modes"].trigger()
    window.focusNextChild()
    assert window.focusWidget() is parts[0]
    order, widget = [], parts[0]
    while widget is not page.sliders.more:
        order.append(widget)
        widget = widget.nextInFocusChain()
    assert [widget for widget in order if widget in parts] == parts
    assert not any(page.player.isAncestorOf(widget) for widget in order)


def test_space_is_left_to_the_button_that_has_the_focus(page, window, qapp):
    from PySide6.QtCore import QEvent, Qt
    from PySide6.QtGui import QKeyEvent

    def is_kept(widget):
        event = QKeyEvent(QEvent.Type.ShortcutOverride, Qt.Key.Key_Space, Qt.KeyboardModifier.NoModifier)
        event.ignore()
        qapp.sendEvent(widget, event)
        return event.isAccepted()

    assert is_kept(page.arrows)
    assert is_kept(window.rail.buttons["cohort"])
    window.commands["explore.modes"].trigger()
    assert not is_kept(window.focusWidget())
    assert not page.arrows.focusPolicy() & Qt.FocusPolicy.ClickFocus


def test_a_mode_says_how_far_it_moves_the_particles(page):
    from PySide6.QtWidgets import QLabel

    model = page.fitted.shape.model
    moved = model.instance(np.array([1.0])) - model.mean_
    rms = np.sqrt(np.square(moved).sum(axis=1).mean())
    texts = [label.text() for label in page.sliders.findChildren(QLabel)]
    assert any(f"{rms:.3g} mm at 1 SD" in text for text in texts)


def test_the_cross_goes_back_to_the_mean_with_another_model(page, window):
    page.sliders.show_value(0, 1.5)
    assert page.charts.scatter.mark != (0.0, 0.0)
    window.projects.begin()
    assert page.charts.scatter.mark == (0.0, 0.0)


def test_sliders_combine_and_mean_shape_puts_them_back(page, scene, window):
    model = page.fitted.shape
    page.sliders.show_value(0, 1.0)
    page.sliders.show_value(1, -2.0)
    expected = model.mean.vertices + model.moved(np.array([1.0, -2.0]))
    np.testing.assert_allclose(shape(scene), expected, atol=1e-4)
    window.commands["explore.mean"].trigger()
    np.testing.assert_allclose(shape(scene), model.mean.vertices, atol=1e-4)


def test_the_surface_follows_the_particles_of_the_model(page):
    from scipy.spatial import KDTree

    model = page.fitted.shape
    for mode in (0, 1):
        deviations = np.eye(2)[mode]
        particles = model.model.instance(deviations)
        vertices = model.mean.vertices + model.moved(deviations)
        gaps, _ = KDTree(vertices).query(particles)
        assert gaps.max() < model.mean.mean_edge


def test_normals_computed_for_shading_are_those_of_the_surface(page, scene):
    page.sliders.show_value(0, 1.5)
    content = scene.shown[-1]
    np.testing.assert_allclose(content.normals, content.groomed.vertex_normals, atol=1e-3)


def test_colours_are_blue_where_the_shape_moves_outward_and_yellow_where_inward(page, scene):
    page.sliders.show_value(0, 2.0)
    content, model = scene.shown[-1], page.fitted.shape
    outward = model.outward(model.moved(page.sliders.values))
    red, blue = (content.colours[:, channel].astype(int) for channel in (0, 2))
    limit = scene.bar.scale.high
    assert scene.bar.scale.low == -limit
    assert (blue - red)[outward > 0.3 * limit].min() > 30
    assert (red - blue)[outward < -0.3 * limit].min() > 30
    page.colours.setChecked(False)
    assert scene.shown[-1].colours is None
    assert not scene.bar.isVisible()


def test_arrows_lie_outside_of_the_surface_and_point_where_it_goes(page, scene):
    page.sliders.show_value(0, 2.0)
    assert scene.shown[-1].arrows is None
    page.arrows.setChecked(True)
    arrows, model = scene.shown[-1].arrows, page.fitted.shape
    ways = model.moved(page.sliders.values)[model.arrows_at]
    lengths = np.linalg.norm(ways, axis=1)
    assert ((arrows.vectors * ways).sum(axis=1) >= 0.99 * lengths**2).all()
    assert np.linalg.norm(arrows.vectors, axis=1).max() > 0.0


def test_a_subject_is_shown_beside_its_reconstruction(page, scene, window):
    page.who.setCurrentText("bean_04")
    page.who.activated.emit(page.who.currentIndex())
    own, built = scene.shown
    assert own.name == "bean_04"
    assert window.workspace.session.selection == ("bean_04",)
    model = page.fitted.shape
    index = model.result.names.index("bean_04")
    scores = model.model.scores_[index] / model.model.standard_deviations_
    np.testing.assert_allclose(page.sliders.values, scores[: len(page.sliders.values)], atol=0.006)
    assert "mm from its particles" in built.note


def test_playing_moves_the_chosen_mode_until_it_is_held(page, window, wait, monkeypatch):
    clock = itertools.count(step=0.05)
    steady = SimpleNamespace(perf_counter=lambda: next(clock))  # however long a picture takes
    monkeypatch.setattr("homolog_app.window.explore.controls.time", steady)
    seen = set()
    page.sliders.moved.connect(lambda: seen.add(round(page.sliders.values[0], 2)))
    window.commands["run.play"].trigger()
    assert page.player.is_playing
    wait(lambda: min(seen, default=0.0) < -0.3 < 0.3 < max(seen), what="for a swing to both sides")
    window.commands["run.play"].trigger()
    assert not page.player.is_playing
    paused = page.sliders.values[0]
    seen.clear()
    window.commands["run.play"].trigger()
    wait(lambda: bool(seen))
    assert min(abs(value - paused) for value in seen) < 1.0  # not from the mean again
    window.commands["run.play"].trigger()


def test_without_loop_it_ends_at_the_mean_by_itself(page, window, wait):
    page.player.loop.setChecked(False)
    page.player.speed.setCurrentIndex(2)
    window.commands["run.play"].trigger()
    wait(lambda: not page.player.is_playing)
    assert page.sliders.values[0] == 0.0


def test_leaving_the_page_stops_playing_and_shows_the_subjects_again(page, window, scene):
    window.commands["run.play"].trigger()
    window.inspector.explore.tabs.setCurrentIndex(0)
    assert not page.player.is_playing
    assert [content.name for content in scene.shown] == ["bean_01", "bean_02", "bean_03", "bean_04"]
    assert not scene.bar.isVisible()


def test_a_click_in_the_scatter_selects_the_subject_everywhere(page, window, pixel):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    scatter, model = page.charts.scatter, page.fitted.shape
    scores = model.model.scores_ / model.model.standard_deviations_
    at = pixel(scatter.canvas, scores[6, 0], scores[6, 1])
    QTest.mouseClick(scatter.canvas, Qt.MouseButton.LeftButton, pos=at)
    assert window.workspace.session.selection == (model.result.names[6],)
    QTest.keyClick(scatter, Qt.Key.Key_Right)
    assert window.workspace.session.selection == (model.result.names[7],)


def test_a_click_on_the_label_of_an_axis_offers_the_modes(page, plots, qapp):
    from PySide6.QtCore import QPoint, Qt
    from PySide6.QtTest import QTest
    from PySide6.QtWidgets import QMenu

    scatter = page.charts.scatter
    canvas = scatter.canvas
    canvas.grab()
    box = canvas.figure.axes[0].yaxis.label.get_window_extent()
    x, y = (value / canvas.device_pixel_ratio for value in ((box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2))
    QTest.mouseClick(canvas, Qt.MouseButton.LeftButton, pos=QPoint(round(x), round(canvas.height() - y)))
    menu = qapp.activePopupWidget()
    assert isinstance(menu, QMenu)
    assert [entry.isChecked() for entry in menu.actions()][:3] == [False, True, False]
    menu.actions()[2].trigger()
    menu.close()
    shape = page.fitted.shape.model
    np.testing.assert_allclose(scatter.points, (shape.scores_ / shape.standard_deviations_)[:, [0, 2]])
    assert page.chosen.axes == (0, 2)


def test_a_drag_in_the_scatter_morphs_the_shape(page, qapp, pixel):
    from PySide6.QtCore import QPoint, Qt
    from PySide6.QtTest import QTest

    scatter = page.charts.scatter.canvas
    start, end = pixel(scatter, 0.0, 0.0), pixel(scatter, 1.5, -1.0)
    QTest.mousePress(scatter, Qt.MouseButton.LeftButton, pos=start)
    QTest.mouseMove(scatter, start + QPoint(9, 3))
    QTest.mouseMove(scatter, end)
    qapp.processEvents()
    QTest.mouseRelease(scatter, Qt.MouseButton.LeftButton, pos=end)
    np.testing.assert_allclose(page.sliders.values[:2], (1.5, -1.0), atol=0.1)


def test_what_moves_in_the_scatter_is_drawn_over_subjects_that_stay(page, plots, qapp, monkeypatch):
    scatter = page.charts.scatter
    scatter.canvas.grab()
    monkeypatch.setattr(scatter, "draw", lambda figure: pytest.fail("the subjects were drawn anew"))
    before = scatter.canvas.grab().toImage()
    page.sliders.show_value(0, 2.0)
    away = scatter.canvas.grab().toImage()
    page.sliders.show_value(0, 0.0)
    assert away != before
    assert scatter.canvas.grab().toImage() == before


def test_another_run_stands_beside_with_modes_that_go_the_same_way(page, scene, bean_project, wait):
    page.fitted.compare_with(bean_project)
    wait(lambda: page.fitted.other is not None)
    page.sliders.show_value(0, 1.0)
    mine, other = scene.shown
    np.testing.assert_allclose(mine.groomed.vertices, other.groomed.vertices, atol=1e-3)
    page.choose_layout(9)
    assert scene.grid.columns == 6
    assert len(scene.shown) == 12
    page.compare.leave.click()
    assert page.fitted.other is None
    assert len(scene.shown) == 9


@pytest.mark.own_window
def test_the_layout_buttons_show_steps_along_modes_and_never_do_nothing(page, scene, window):
    model = page.fitted.shape
    assert window.commands["view.grid1"].isChecked()
    for count, columns in ((4, 2), (9, 3), (16, 4)):
        window.commands[f"view.grid{count}"].trigger()
        assert (scene.grid.columns, len(scene.shown)) == (columns, count)
        assert page.views.currentData() == count
    steps = model.moves[0].reshape(-1, 3)
    for content, amount in zip(scene.shown[:4], (-2.0, -1.0, 1.0, 2.0), strict=True):
        np.testing.assert_allclose(content.groomed.vertices, model.mean.vertices + amount * steps, atol=1e-3)
        assert content.name == f"mode 1: {amount:+.0f} SD".replace("-", "−")
    window.commands["explore.measure"].trigger()
    assert window.commands["view.grid1"].isChecked()
    for count in (4, 9, 16):
        command = window.commands[f"view.grid{count}"]
        assert not command.isEnabled()
        assert "Not now:" in command.toolTip()
    window.inspector.explore.tabs.setCurrentIndex(0)
    assert window.commands["view.grid4"].isChecked()
    assert window.commands["view.grid9"].isEnabled()


def test_a_folder_that_is_no_project_is_refused_by_name(page, window, tmp_path, errors, monkeypatch):
    monkeypatch.setattr(
        "PySide6.QtWidgets.QFileDialog.getExistingDirectory", lambda *_: str(tmp_path / "nothing")
    )
    window.commands["explore.compare"].trigger()
    ((_, error),) = errors
    assert "nothing" in str(error)
    assert page.fitted.other is None


def test_the_frame_holds_the_shapes_at_the_ends_of_the_sliders_from_the_start(page, scene):
    scene.fit()
    scale = scene.canvas.cameras[0].height
    for value in (-3.0, 3.0):
        page.sliders.show_value(0, value)
        assert scene.canvas.cameras[0].height == scale
