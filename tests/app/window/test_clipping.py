"""Shapes cut open in the views."""

from dataclasses import replace

import numpy as np
import pytest

from homolog_app.rendering.camera import CameraState, Clip
from homolog_app.rendering.colours import LIGHT_SCHEME, rgb
from homolog_app.rendering.content import Content, ViewContents
from homolog_app.rendering.grid import drawn
from homolog_app.scenes.states import Snapshot, SubjectsView

pytestmark = [pytest.mark.window, pytest.mark.own_window]

CUT = np.array(rgb(LIGHT_SCHEME.cut)) * 255.0


def shell():
    """Return a ball of radius 10 mm with a cavity of radius 6 mm as one content."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersSources import vtkSphereSource

    from homolog.surfaces.mesh import TriangleMesh

    source = vtkSphereSource()
    source.SetThetaResolution(60)
    source.SetPhiResolution(60)
    source.SetRadius(10.0)
    source.Update()
    points = vtk_to_numpy(source.GetOutput().GetPoints().GetData()).astype(float)
    faces = vtk_to_numpy(source.GetOutput().GetPolys().GetConnectivityArray()).reshape(-1, 3)
    both = TriangleMesh(
        np.concatenate([points, 0.6 * points]), np.concatenate([faces, faces[:, ::-1] + len(points)])
    )
    return Content("shell", None, both, None, np.eye(4))


def from_above(canvas, clip):
    camera = CameraState(at=(0, 0, 0), eye=(0, 0, 50), up=(0, -1, 0), height=24.0)
    return canvas.model_copy(
        update={
            "width": 300,
            "height": 300,
            "ratio": 1.0,
            "layout": 1,
            "cameras": (camera,),
            "clip": clip,
            "scheme": "light",
            "particles": True,
        }
    )


def areas(picture):
    """Return the area of the cut surface and of the whole shape [mm²]."""
    millimetres = (24.0 / 300) ** 2
    shape = (np.abs(picture[..., :3].astype(float) - picture[5, 5, :3]).max(axis=2) > 8) & (
        np.hypot(*np.mgrid[-150:150, -150:150]) < 140
    )
    cap = np.abs(picture[..., :3] - CUT).max(axis=2) < 8
    return cap.sum() * millimetres, shape.sum() * millimetres


@pytest.mark.parametrize("plane", ["axial", "view"])
def test_a_hollow_shape_shows_its_wall_where_it_is_cut(beans, plane):
    canvas = beans.views.stage.scene.canvas
    whole = drawn(ViewContents([shell()]), from_above(canvas, None))
    assert areas(whole)[0] == 0.0
    half = drawn(ViewContents([shell()]), from_above(canvas, Clip(plane=plane)))
    np.testing.assert_allclose(areas(half), [np.pi * (100 - 36), np.pi * 100], rtol=0.03)
    below = drawn(ViewContents([shell()]), from_above(canvas, Clip(plane=plane, flipped=True)))
    assert areas(below)[0] < 2.0  # seen from outside


def test_a_free_plane_is_that_through_a_point_and_keeps_the_side_of_its_normal(beans):
    normal, box = np.array([0.0, 0.6, -0.8]), (-10.0, 10.0) * 3
    clip = Clip.free(normal, np.array([0.0, 3.0, -4.0]), box)
    kept, origin = clip.cut(box, np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(kept, normal)
    assert (origin - [0.0, 3.0, -4.0]) @ normal == pytest.approx(0.0, abs=1e-9)
    canvas = beans.views.stage.scene.canvas
    half = Clip.free(np.array([0.0, 0.0, -1.0]), np.zeros(3), box)
    picture = drawn(ViewContents([shell()]), from_above(canvas, half))
    np.testing.assert_allclose(areas(picture), [np.pi * (100 - 36), np.pi * 100], rtol=0.03)


def test_planes_of_the_shapes_own_axes_remove_the_side_of_the_viewer_and_are_turned_by_their_handle(beans):
    scene, bar, commands = beans.views.stage.scene, beans.views.stage.clip, beans.commands
    commands["view.grid1"].trigger()
    scene.look("front")
    commands["view.clip"].trigger()
    axes, ahead = scene.principal_axes, scene.grid.cells[0].axes[2]
    vertices = scene.grid.cells[0].vertices
    assert np.ptp(vertices @ axes[0]) > np.ptp(vertices @ axes[2])
    for title, axis in (("Across the long axis", 0), ("Along it, broad section", 2)):
        bar.plane.setCurrentText(title)
        kept, _ = scene.grid.display.clip.cut(scene.grid.bounds, ahead)
        assert abs(kept @ axes[axis]) == pytest.approx(1.0)
        assert kept @ ahead > -1e-6
    turned = np.array([0.6, 0.8, 0.0])
    scene.handle.plane.SetNormal(*turned)
    scene.handle.widget.InvokeEvent("InteractionEvent")
    assert bar.plane.currentText() == "By hand"
    np.testing.assert_allclose(scene.canvas.clip.normal, turned, atol=1e-6)
    bar.flip.click()
    np.testing.assert_allclose(scene.grid.display.clip.cut(scene.grid.bounds, ahead)[0], -turned, atol=1e-6)


def test_particles_on_the_removed_side_are_not_drawn(beans):
    canvas, content = beans.views.stage.scene.canvas, shell()
    particle = {"shell": np.array([[0.0, 0.0, 10.0]])}
    tints = np.array([[255, 0, 255]], np.uint8)
    shown = ViewContents([content], particles=particle, tints=tints)
    seen = [
        (
            np.abs(drawn(shown, from_above(canvas, clip))[..., :3].astype(int) - tints[0]).max(axis=2) < 120
        ).sum()
        for clip in (None, Clip(), Clip(flipped=True))
    ]
    assert seen[0] > 20
    assert seen[1] == 0
    assert seen[2] == seen[0]


def test_the_plane_of_the_window_is_that_of_a_picture_made_again(beans, wait):
    scene, commands = beans.views.stage.scene, beans.commands
    commands["view.grid1"].trigger()
    before = scene.picture()
    commands["view.clip"].trigger()
    bar = beans.views.stage.clip
    assert bar.isVisible()
    bar.plane.setCurrentIndex(1)
    bar.position.setValue(80)
    wait(lambda: scene.canvas.clip.box is not None)
    clip = scene.canvas.clip
    assert (clip.plane, clip.position, clip.flipped) == ("coronal", 0.4, False)
    assert scene.picture() != before
    messages = Snapshot(view=SubjectsView(), canvas=scene.canvas).as_json
    assert Snapshot.model_validate_json(messages).canvas.clip == clip


def test_the_plane_stays_from_page_to_page_and_goes_with_the_command(explored):
    commands, stage = explored.commands, explored.views.stage
    commands["view.clip"].trigger()
    explored.workspace.session.show_step("correspond")
    assert stage.scene.canvas.clip is not None
    commands["view.slice"].trigger()
    assert not stage.clip.isVisible()
    commands["view.slice"].trigger()
    assert stage.clip.isVisible()
    commands["view.clip"].trigger()
    assert stage.scene.canvas.clip is None
    assert not stage.clip.isVisible()


def test_the_cut_surface_is_no_place_of_a_shape(beans, wait):
    from PySide6.QtCore import QPointF

    scene, stage = beans.views.stage.scene, beans.views.stage
    beans.commands["view.grid1"].trigger()
    content = replace(shell(), name="solid")
    solid = content.groomed
    half = len(solid.faces) // 2
    from homolog.surfaces.mesh import TriangleMesh

    scene.display(
        ViewContents([replace(content, groomed=TriangleMesh(solid.vertices[:3482], solid.faces[:half]))], 1)
    )
    scene.look("head")
    picks = []
    scene.picker.picked.connect(picks.append)
    middle = QPointF(scene.plot.width() / 2, scene.plot.height() / 2)
    scene.picker.pick_at(middle)
    assert [pick.name for pick in picks] == ["solid"]
    stage.clip.position.setValue(100)
    beans.commands["view.clip"].trigger()
    scene.picture()
    scene.plot.ren_win.Render()
    scene.picker.pick_at(middle)
    assert len(picks) == 1
