"""Clicks in the views."""

import numpy as np
import pytest
from PySide6.QtCore import QPointF

pytestmark = pytest.mark.window


@pytest.fixture
def scene(explored):
    explored.commands["view.grid1"].trigger()
    explored.commands["view.front"].trigger()
    scene = explored.views.stage.scene
    scene.picture()
    return scene


def screen_place(scene, point):
    """Return where a point is seen in the first view, in pixels of the widget."""
    renderer = scene.grid.cells[0].renderer
    renderer.SetWorldPoint(*point, 1.0)
    renderer.WorldToDisplay()
    x, y, _ = renderer.GetDisplayPoint()
    ratio = scene.devicePixelRatioF()
    return QPointF(x / ratio, scene.plot.height() - 1 - y / ratio)


def test_a_click_on_a_particle_names_it_and_its_subject(explored, scene):
    result = explored.workspace.session.result.result
    nearest = int(result.world[0][:, 1].argmin())  # seen from the front, where y is smallest
    picks = []
    scene.picker.picked.connect(picks.append)
    scene.picker.pick_at(screen_place(scene, result.world[0][nearest]))
    assert [(pick.name, pick.particle) for pick in picks] == [(result.names[0], nearest)]
    assert np.linalg.norm(picks[0].place - result.world[0][nearest]) < 1.0


def test_a_click_beside_the_shape_meets_nothing(scene):
    picks = []
    scene.picker.picked.connect(picks.append)
    scene.picker.pick_at(QPointF(3, 3))
    assert picks == []


def test_a_drag_is_no_click(scene, qtbot):
    from PySide6.QtCore import Qt

    picks = []
    scene.picker.picked.connect(picks.append)
    middle = scene.plot.rect().center()
    qtbot.mousePress(scene.plot, Qt.MouseButton.LeftButton, pos=middle)
    qtbot.mouseRelease(scene.plot, Qt.MouseButton.LeftButton, pos=middle + middle / 8)
    assert picks == []
    qtbot.mouseClick(scene.plot, Qt.MouseButton.LeftButton, pos=middle)
    assert len(picks) == 1


def test_going_to_a_place_puts_it_into_the_middle_of_its_view(explored, scene):
    result = explored.workspace.session.result.result
    point = result.world[2][5]
    away = point - result.world[2].mean(axis=0)
    scene.go_to(result.names[2], point, away / np.linalg.norm(away))
    assert [content.name for content in scene.shown] == [result.names[2]]
    seen, middle = screen_place(scene, point), scene.plot.rect().center()
    assert abs(seen.x() - middle.x()) < 3
    assert abs(seen.y() - middle.y()) < 3


def test_a_close_up_follows_its_place_while_the_surface_moves_and_ends_a_cut_that_hides_it(explored, wait):
    explored.commands["explore.modes"].trigger()
    page, scene = explored.inspector.explore.page, explored.views.stage.scene
    wait(lambda: page.chosen is not None)
    (content,) = scene.shown
    vertex = int(np.abs(page.fitted.shape.moved(np.array([2.0]))).sum(axis=1).argmax())
    explored.commands["view.clip"].trigger()
    normal = content.groomed.vertex_normals[vertex]
    place = content.groomed.vertices[vertex]
    explored.views.stage.clip.flip.setChecked(bool(place[2] < content.groomed.vertices[:, 2].mean()))
    explored.views.stage.clip.position.setValue(100)
    assert scene.grid.display.clip is not None
    scene.go_to(content.name, place, normal)
    assert scene.grid.display.clip is None
    assert not explored.views.stage.clip.isVisible()
    assert scene.canvas.cameras[0].at == pytest.approx(place, abs=1e-6)
    for value in (-2.0, 2.0):
        page.sliders.show_value(0, value)
        (moved,) = scene.shown
        assert scene.canvas.cameras[0].at == pytest.approx(moved.groomed.vertices[vertex], abs=1e-3)
