"""Cutting in the views of Groom: a plane with a handle, a brush, undo, and carrying to the others."""

import numpy as np
import pytest
from PySide6.QtCore import QEvent, QPointF, Qt
from PySide6.QtGui import QMouseEvent
from PySide6.QtWidgets import QApplication

from homolog.io.constraints import parse_cuts
from homolog.surfaces.clipping import Ball, Plane
from homolog_app.window.cutting import CutTool

pytestmark = pytest.mark.window


@pytest.fixture
def page(groomed):
    session = groomed.workspace.session
    session.show_step("groom")
    groomed.commands["view.grid4"].trigger()
    session.select(["a"])
    return groomed


def cuts(window, name="a"):
    study = window.workspace.session.study
    text = next(item for item in study.included if item.name == name).columns.get("cut", "")
    return parse_cuts(text, name)


def content(window, name="a"):
    return next(item for item in window.views.stage.scene.shown if item.name == name)


def mouse(window, kind, place):
    plot = window.views.stage.scene.plot
    buttons = Qt.MouseButton.NoButton if kind == QEvent.Type.MouseButtonRelease else Qt.MouseButton.LeftButton
    button = Qt.MouseButton.NoButton if kind == QEvent.Type.MouseMove else Qt.MouseButton.LeftButton
    at = plot.mapToGlobal(place)
    event = QMouseEvent(kind, place, at, button, buttons, Qt.KeyboardModifier.NoModifier)
    QApplication.sendEvent(plot, event)


def paint(window, wait, steps=4):
    """Drag the brush over the middle of the first view."""
    plot = window.views.stage.scene.plot
    at = QPointF(plot.width() / 4, plot.height() / 4)
    mouse(window, QEvent.Type.MouseButtonPress, at)
    for step in range(1, steps):
        mouse(window, QEvent.Type.MouseMove, at + QPointF(0, 12 * step))
    mouse(window, QEvent.Type.MouseButtonRelease, at)


def test_a_plane_is_placed_turned_and_undone_and_the_removed_part_is_shown_faded(page, wait):
    session, box = page.workspace.session, page.inspector.groom.cuts
    tool = page.views.stage.scene.findChild(CutTool)
    before = session.undo.count()
    box.tools["plane"].click()
    (plane,) = cuts(page)
    groomed = session.groomed["a"]
    axis = np.linalg.svd(groomed.subject.mesh.vertices - groomed.subject.mesh.vertices.mean(axis=0))[2][0]
    assert abs(plane.direction @ axis) > 0.99
    assert tool.handle.widget.GetEnabled()
    shown = content(page)
    assert shown.faded
    assert plane.heights(shown.groomed.vertices).min() > -1e-6
    assert plane.heights(shown.raw.vertices).max() < 1e-6
    turned = np.array([0.6, 0.8, 0.0])
    for part in (0.5, 1.0):
        tool.handle.plane.SetNormal(*((1.0 - part) * plane.direction + part * turned))
        tool.handle.widget.InvokeEvent("InteractionEvent")
    tool.handle.widget.InvokeEvent("EndInteractionEvent")
    np.testing.assert_allclose(cuts(page)[0].direction, turned, atol=1e-4)
    assert session.undo.count() == before + 2
    assert not session.is_groomed
    session.undo.undo()
    np.testing.assert_allclose(cuts(page)[0].direction, plane.direction, atol=1e-4)
    session.undo.undo()
    assert cuts(page) == ()
    assert not content(page).faded
    assert not tool.handle.widget.GetEnabled()
    session.undo.redo()
    assert len(cuts(page)) == 1


def test_a_tool_brings_the_selected_subject_into_view(page):
    page.commands["view.grid1"].trigger()
    page.workspace.session.select(["c"])
    page.views.stage.scene.show_page(0)
    page.inspector.groom.cuts.tools["plane"].click()
    assert content(page, "c").faded
    assert page.views.stage.scene.findChild(CutTool).handle.widget.GetEnabled()


def test_the_plane_keeps_a_length_along_the_long_axis(page):
    box = page.inspector.groom.cuts
    box.tools["plane"].click()
    box.keep.entered.emit(5.0)
    (plane,) = cuts(page)
    heights = plane.heights(page.workspace.session.groomed["a"].subject.mesh.vertices)
    assert heights.max() == pytest.approx(5.0, abs=0.01)


def test_a_stroke_of_the_brush_is_one_step_of_undo_and_can_be_put_back(page, wait):
    session, box = page.workspace.session, page.inspector.groom.cuts
    before = session.undo.count()
    box.tools["brush"].click()
    paint(page, wait)
    balls = cuts(page)
    assert len(balls) > 1
    assert all(isinstance(ball, Ball) and not ball.keeps for ball in balls)
    assert session.undo.count() == before + 1
    whole = session.groomed["a"].subject.mesh
    shown = content(page)
    assert shown.groomed.area < 0.99 * whole.area
    assert shown.groomed.area + shown.raw.area == pytest.approx(whole.area, rel=0.02)
    box.tools["back"].click()
    paint(page, wait)
    assert content(page).groomed.area > 0.99 * whole.area
    session.undo.undo()
    assert len(cuts(page)) == len(balls)


def test_cuts_are_carried_to_the_others_groomed_and_removed(page, wait):
    session, box = page.workspace.session, page.inspector.groom.cuts
    box.tools["plane"].click()
    box.tools["brush"].click()
    paint(page, wait, 1)
    page.commands["edit.carry"].trigger()
    wait(lambda: not session.job.is_busy)
    kinds = {name: [type(cut) for cut in cuts(page, name)] for name in "abcd"}
    assert all(kind == [Plane, Ball] for kind in kinds.values())
    session.undo.undo()
    assert cuts(page, "b") == ()
    session.undo.redo()
    page.commands["run.groom"].trigger()
    wait(lambda: not session.job.is_busy)
    assert session.is_groomed
    for name in "abcd":
        assert session.groomed[name].subject.report.rims >= 1
        assert content(page, name).faded
    session.select(list("abcd"))
    page.commands["edit.uncut"].trigger()
    assert all(cuts(page, name) == () for name in "abcd")
    assert not session.is_groomed
