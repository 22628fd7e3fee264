"""The form made from a settings model."""

import pytest

from homolog.parameters import parameters
from homolog.settings import Alignment, GroomSettings, OptimizeSettings
from homolog_app.exports.settings import ReportSettings
from homolog_app.rendering.text import duration, parse_number

pytestmark = pytest.mark.window


@pytest.fixture
def form(qapp):
    from homolog_app.window.form import SettingsForm

    made = SettingsForm(GroomSettings)
    made.show_values(GroomSettings())
    made.edits = []
    made.edited.connect(lambda name, value: made.edits.append((name, value)))
    yield made
    made.deleteLater()


def editor(form, name):
    from PySide6.QtWidgets import QWidget

    return next(widget for widget in form.findChildren(QWidget) if widget.accessibleName() == name)


def type_into(form, name, text):
    line = editor(form, name)
    line.setText(text)
    line.textEdited.emit(text)


@pytest.mark.parametrize("text", ["1.5", "1,5", " 1,5 "])
def test_both_decimal_signs_are_understood(form, text):
    type_into(form, "smoothing", text)
    assert form.edits == [("smoothing", GroomSettings(smoothing=1.5))]


@pytest.mark.parametrize("text", ["7", "-1", "much", "1_0", ""])
def test_what_is_out_of_bounds_or_no_number_changes_nothing_and_says_so(form, text):
    from PySide6.QtWidgets import QLabel

    type_into(form, "smoothing", text)
    assert not form.edits
    assert any("0 to 5" in label.text() for label in form.findChildren(QLabel, "Problem"))


def test_what_is_wrong_with_a_text_is_said_until_it_is_mended(qapp):
    from homolog_app.window.form import SettingsForm

    made = SettingsForm(ReportSettings)
    marks = []
    made.marked.connect(lambda: marks.append(made.problem))
    type_into(made, "places", "septal/lateral basal")
    assert made.problem.startswith("Places: must be two names for each axis")
    type_into(made, "places", "")
    assert [bool(mark) for mark in marks] == [True, False]
    made.deleteLater()


def test_the_setting_that_has_the_focus_shows_its_help_and_bounds(qapp):
    from PySide6.QtCore import QEvent
    from PySide6.QtGui import QFocusEvent

    from homolog_app.window.form import SettingsForm

    made = SettingsForm(OptimizeSettings)
    for parameter in parameters(OptimizeSettings):
        qapp.sendEvent(editor(made, parameter.label), QFocusEvent(QEvent.Type.FocusIn))
        assert parameter.help in made.help.text()
        if parameter.kind is int and parameter.name == "particles":
            assert parameter.bounds in made.help.text()
    made.deleteLater()


def test_the_help_of_a_setting_ends_when_pointer_and_focus_have_left(form, qapp):
    from PySide6.QtCore import QEvent, QPointF, Qt
    from PySide6.QtGui import QEnterEvent, QFocusEvent

    neutral, smoothing, spacing = form.help.text(), editor(form, "smoothing"), editor(form, "spacing")
    qapp.sendEvent(smoothing, QFocusEvent(QEvent.Type.FocusIn))
    focused = form.help.text()
    here = QPointF()
    qapp.sendEvent(spacing.parentWidget(), QEnterEvent(here, here, here))
    assert form.help.text() not in (neutral, focused)
    qapp.sendEvent(spacing.parentWidget(), QEvent(QEvent.Type.Leave))
    qapp.sendEvent(smoothing, QFocusEvent(QEvent.Type.FocusOut, Qt.FocusReason.PopupFocusReason))
    assert form.help.text() == focused
    qapp.sendEvent(smoothing, QFocusEvent(QEvent.Type.FocusOut, Qt.FocusReason.TabFocusReason))
    assert form.help.text() == neutral


def test_an_empty_field_leaves_the_value_to_the_program(form):
    type_into(form, "spacing", "0,8")
    type_into(form, "spacing", "")
    assert [value.spacing for _, value in form.edits] == [0.8, None]


def test_a_choice_is_reported_as_the_models_value(form):
    choice = editor(form, "alignment")
    choice.setCurrentIndex(choice.findData("axes"))
    choice.activated.emit(choice.currentIndex())
    assert form.edits[-1][1].alignment is Alignment.AXES


@pytest.mark.parametrize("model", [GroomSettings, OptimizeSettings])
def test_every_setting_has_an_editor_with_its_help(qapp, model):
    from PySide6.QtWidgets import QWidget

    from homolog_app.window.form import SettingsForm

    made = SettingsForm(model)
    described = {widget.accessibleName(): widget.toolTip() for widget in made.findChildren(QWidget)}
    for parameter in parameters(model):
        assert parameter.help in described[parameter.label]
    made.deleteLater()


def test_the_wheel_changes_no_value_of_a_panel_that_it_scrolls(qapp):
    from PySide6.QtCore import QPoint, QPointF, Qt
    from PySide6.QtGui import QWheelEvent

    from homolog_app.window.widgets import Panel, choice

    panel, box = Panel("Step", "Do this."), choice("Colour", {"red": 1, "green": 2, "blue": 3})
    panel.body.addWidget(box)
    panel.show()
    at = QPointF(box.rect().center())
    wheel = QWheelEvent(
        at,
        box.mapToGlobal(at),
        QPoint(),
        QPoint(0, -120),
        Qt.MouseButton.NoButton,
        Qt.KeyboardModifier.NoModifier,
        Qt.ScrollPhase.NoScrollPhase,
        False,
    )
    qapp.sendEvent(box, wheel)
    assert box.currentData() == 1
    assert not wheel.isAccepted()  # so that Qt goes on to the area that scrolls
    panel.close()


def test_numbers_have_a_point_or_a_comma_and_nothing_else():
    assert parse_number("−2,5") == -2.5
    with pytest.raises(ValueError, match="could not"):
        parse_number("1.000,5")


def test_times_are_no_more_exact_than_they_are_known():
    assert [duration(item) for item in (2, 43, 200, 9000)] == [
        "about 5 s",
        "about 45 s",
        "about 3 min",
        "about 2.5 h",
    ]
