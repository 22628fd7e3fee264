"""Values set by hand: beside sliders, the ends of the colour scale, the reference group."""

import numpy as np
import pytest

from homolog_app.scenes.shapes import outward_sign
from homolog_app.scenes.states import ModesView
from homolog_app.window.stage import RangeDialog

pytestmark = pytest.mark.window


@pytest.fixture
def modes(explored, wait):
    explored.commands["explore.modes"].trigger()
    wait(lambda: explored.inspector.explore.fitted.shape is not None)
    return explored.inspector.explore.page


def test_a_value_can_be_typed_beside_a_slider(modes):
    row = modes.sliders.rows[0]
    for text, value, shown in (
        ("1,5", 1.5, "+1.50"),
        ("-9", -3.0, "−3.00"),
        ("nonsense", -3.0, "−3.00"),
        ("nan", -3.0, "−3.00"),
    ):
        row.typed.setText(text)
        row.typed.editingFinished.emit()
        assert modes.sliders.values[0] == value
        assert row.typed.text() == shown


def test_percent_of_a_slider_can_be_typed(explored):
    bar = explored.views.stage.clip
    for text, place in (("37", 0.37), ("250", 1.0), ("nothing", 1.0)):
        bar.percent.setText(text)
        bar.percent.editingFinished.emit()
        assert bar.clip.position == place
    bar.position.setValue(0)
    assert bar.percent.text() == "0"


def test_the_range_of_colours_is_set_by_hand_and_automatic_again(explored, modes, wait):
    bar, command = explored.views.stage.scene.bar, explored.commands["view.range"]
    automatic = bar.scale.high
    assert command.isEnabled()
    command.trigger()
    dialog = explored.findChild(RangeDialog)
    dialog.high.setText("0.25")
    dialog.high.textEdited.emit("0.25")
    dialog.apply.click()
    assert (bar.scale.low, bar.scale.high) == (-0.25, 0.25)
    assert "by hand" in bar.scale.note
    assert modes.chosen.colour_range == (-0.25, 0.25)
    dialog.symmetric.setChecked(False)
    dialog.low.setText("1")
    dialog.apply.click()
    assert not dialog.problem.isHidden()
    assert bar.scale.high == 0.25
    dialog.automatic.click()
    assert bar.scale.high == automatic
    dialog.close()
    explored.workspace.session.show_step("correspond")
    assert not command.isEnabled()


@pytest.mark.parametrize("range_", [(1.0, 1.0), (2.0, -2.0), (0.0, float("inf"))])
def test_a_range_that_is_none_is_refused(range_):
    with pytest.raises(ValueError, match="colour_range"):
        ModesView(colour_range=range_)


def test_a_control_group_is_the_reference_and_groups_can_be_swapped(explored):
    session, form = explored.workspace.session, explored.inspector.explore.pages[2].form
    for names, group in ((["a", "b"], "HCM"), (["c", "d"], "NOR")):
        session.select(names)
        session.set_group(group)
    assert form.between == ("NOR", "HCM")
    form.swap.click()
    assert form.between == ("HCM", "NOR")


def test_the_inner_wall_of_a_hollow_shape_faces_its_middle():
    outer = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    vertices, normals = np.concatenate([outer, 0.5 * outer]), np.concatenate([outer, -outer])
    np.testing.assert_array_equal(outward_sign(vertices, normals), np.repeat([1.0, -1.0], 6))


def test_colours_can_be_positive_away_from_the_middle(explored, modes):
    scene, command = explored.views.stage.scene, explored.commands["view.from_middle"]
    modes.sliders.show_value(0, 2.0)
    before, text = scene.shown[0].colours, scene.bar.scale.high_label
    assert text == "out of the tissue"
    command.trigger()
    assert scene.bar.scale.high_label == "away from the centre"
    assert modes.chosen.from_middle
    np.testing.assert_array_equal(scene.shown[0].colours, before)  # an ellipsoid has no inner wall
    command.trigger()
    assert scene.bar.scale.high_label == text
