"""The views: letters, colours, pages, pictures."""

import itertools
import shutil
from dataclasses import replace

import numpy as np
import pytest

from homolog.geometry import transform_points
from homolog_app.rendering.camera import round_length
from homolog_app.rendering.colours import colours_by_place
from homolog_app.rendering.content import Content, Numbers, ViewContents
from homolog_app.rendering.grid import Grid, drawn
from homolog_app.rendering.opengl import pixels_of
from homolog_app.rendering.text import direction_letters, edge_letters
from homolog_app.rendering.view_texts import Caption, NumberLabels, ScaleBar, Strip, text_box
from homolog_app.scenes.subjects import moment_of

pytestmark = pytest.mark.own_window  # views keep layout and camera


@pytest.mark.parametrize(
    ("direction", "letters"),
    [
        ((1, 0, 0), "L"),
        ((-1, 0, 0), "R"),
        ((0, 1, 0), "P"),
        ((0, -1, 0), "A"),
        ((0, 0, 1), "S"),
        ((0, 0, -1), "I"),
        ((0.8, -0.6, 0), "LA"),
        ((0.98, 0.17, 0), "L"),
    ],
)
def test_directions_are_named_as_in_radiology(direction, letters):
    assert direction_letters(np.array(direction, dtype=float)) == letters


def test_seen_from_the_front_the_patients_right_is_at_the_left_and_the_head_on_top():
    assert edge_letters(np.eye(3), np.array([1.0, 0, 0]), np.array([0, 0, 1.0])) == ("R", "L", "I", "S")


def test_a_subject_that_alignment_turned_over_has_its_own_letters():
    turned = np.diag([-2.0, -2.0, 2.0, 1.0])
    content = Content("x", None, None, None, turned)
    letters = edge_letters(content.patient_axes, np.array([1.0, 0, 0]), np.array([0, 0, 1.0]))
    assert letters == ("L", "R", "I", "S")


def test_views_that_a_larger_layout_adds_look_from_where_the_first_one_does():
    from vtkmodules.vtkRenderingCore import vtkRenderWindow

    grid = Grid(vtkRenderWindow())
    grid.cameras.turn("head")
    for linked, layout in ((True, 4), (False, 9)):
        grid.cameras.link(linked)
        grid.display = grid.display.changed(layout=layout)
        grid.place_cells()
        cameras = [cell.renderer.GetActiveCamera() for cell in grid.cells]
        assert len(cameras) == layout
        assert {camera.GetViewUp() for camera in cameras} == {cameras[0].GetViewUp()}
        assert len(set(cameras)) == (1 if linked else layout)


def test_texts_keep_their_size_where_the_window_scales_them_by_the_screen(ball):
    from vtkmodules.vtkRenderingCore import vtkRenderWindow

    window = vtkRenderWindow()
    window.SetOffScreenRendering(True)
    window.SetSize(400, 300)
    grid, heights = Grid(window), []
    grid.take(ViewContents([Content("heart_01", None, ball, None, np.eye(4))]))
    grid.show_page(0)
    for dpi in (72, 144):
        window.SetDPI(dpi)
        window.Render()
        size = [0.0, 0.0]
        grid.cells[0].texts.caption.caption.GetSize(grid.cells[0].renderer, size)
        heights.append(size[1])
    grid.close()
    window.Finalize()
    assert heights[1] == heights[0]


def _numbered(places, inset=(0.0, 0.0, 0.0, 0.0), size=(400, 300)):
    """Return the numbers 0, 1, … that are seen, by the middle of each, and the lower edge of their strip."""
    from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow

    window, renderer = vtkRenderWindow(), vtkRenderer()
    window.SetOffScreenRendering(True)
    window.SetSize(*size)
    window.AddRenderer(renderer)
    renderer.GetActiveCamera().ParallelProjectionOn()  # one unit is half of the height
    strip, labels = Strip(renderer), NumberLabels(renderer)
    places = np.array(places, dtype=np.float64)
    colours = np.zeros((len(places), 3), np.uint8)
    labels.show(Numbers(np.arange(len(places)), places, colours, 0.1), 12)
    window.Render()
    strip.face(2, 12)
    labels.face(np.array([1.0, 0.0, 0.0]), strip, np.array(inset))
    seen = {
        int(prop.GetInput()): text_box(renderer, prop)
        for prop in renderer.GetViewProps()
        if hasattr(prop, "GetInput") and prop.GetVisibility()
    }
    window.Finalize()
    return seen, strip.bottom


def test_numbers_stand_side_by_side_in_the_strip_in_the_order_of_their_points():
    seen, bottom = _numbered([[0.5, 0.0, 0.0], [0.0, 0.3, 0.0], [0.2, -0.5, 0.0], [-1.3, 0.0, 0.0]])
    assert sorted(seen, key=lambda number: seen[number][0]) == [3, 1, 2, 0]
    assert all(box[1] >= bottom and box[0] >= 0.0 and box[2] <= 400.0 for box in seen.values())
    boxes = sorted(seen.values(), key=lambda box: box[0])
    assert all(left[2] < right[0] for left, right in itertools.pairwise(boxes))


@pytest.mark.parametrize(
    "place",
    [[0.0, 0.97, 0.0], [0.0, 1.2, 0.0], [1.5, 0.0, 0.0], [1.1, -0.9, 0.0]],
    ids=["under the strip", "above the view", "beside the view", "under the inset"],
)
def test_a_point_that_is_not_seen_has_no_number(place):
    seen, _ = _numbered([place, [0.0, 0.0, 0.0]], inset=(0.75, 0.0, 1.0, 0.25))
    assert list(seen) == [1]


def test_the_leader_of_a_point_passes_beside_a_point_above_it():
    seen, bottom = _numbered([[0.0, 0.4, 0.0], [0.02, -0.4, 0.0]])
    upper, lower = seen[0], seen[1]
    places = np.array([[200.0, 150.0 + 0.4 * 150.0], [200.0 + 0.02 * 150.0, 150.0 - 0.4 * 150.0]])
    middle = (lower[0] + lower[2]) / 2.0
    share = (places[0, 1] - places[1, 1]) / (bottom - places[1, 1])
    across = places[1, 0] + share * (middle - places[1, 0])
    assert abs(across - places[0, 0]) > 0.83 * 0.1 * 150.0  # the radius of the ring
    assert (upper[0] + upper[2]) / 2.0 == pytest.approx(200.0, abs=1.0)


def test_numbers_for_which_a_strip_is_too_narrow_are_left_out():
    seen, _ = _numbered(np.zeros((30, 3)), size=(200, 300))
    assert list(seen) == list(range(len(seen)))
    assert 3 < len(seen) < 20


@pytest.mark.parametrize(("zoom", "numbered"), [(1.0, False), (5.0, False), (1.0, True), (5.0, True)])
def test_no_text_lies_on_a_shape(ball, zoom, numbered):
    from vtkmodules.vtkRenderingCore import vtkRenderWindow

    window = vtkRenderWindow()
    window.SetOffScreenRendering(True)
    window.SetSize(400, 300)
    colours = np.full((len(ball.vertices), 3), (200, 0, 0), np.uint8)
    numbers = Numbers(np.array([7]), ball.vertices[:1], np.array([[0, 0, 200]], np.uint8), 0.1)
    content = Content(
        "heart_01", None, ball, None, np.eye(4), colours=colours, numbers=numbers if numbered else None
    )
    grid = Grid(window)
    grid.take(ViewContents([content]))
    grid.show_page(0)
    grid.cameras.turn("front")
    grid.fit(400, 300)
    grid.cameras.each[0].Zoom(zoom)
    window.Render()
    renderer = grid.cells[0].renderer
    texts = [
        text_box(renderer, prop)
        for prop in renderer.GetViewProps()
        if hasattr(prop, "GetTextProperty")
        and prop.GetVisibility()
        and prop.GetTextProperty().GetOpacity()
        and prop.GetInput()
    ]
    picture = pixels_of(window)[::-1].astype(int)  # rows from below, as boxes are
    grid.close()
    window.Finalize()
    red = (picture[..., 0] - picture[..., 2] > 60) & (picture[..., 1] < 60)
    assert red.sum() > 5000
    assert any(box[1] > 250 for box in texts)
    for left, low, right, high in np.rint(texts).astype(int):
        assert not red[max(low, 0) : high, max(left, 0) : right].any()


@pytest.mark.parametrize(("height", "has_room"), [(40, False), (200, True)])
def test_in_a_flat_view_the_name_stands_alone(height, has_room):
    import pyvista as pv

    plotter = pv.Plotter(off_screen=True, window_size=(150, height))
    caption, bar = Caption(plotter.renderer), ScaleBar(plotter.renderer)
    caption.show(["heart_01", "infarct"], 12, small=True, letters=True)
    bar.show(True, 12)
    plotter.render_window.Render()
    caption.face(np.eye(3), np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]), in_strip=False, taken=0.0)
    bar.face()
    shown = [
        actor.GetInput()
        for actor in plotter.renderer.GetViewProps()
        if isinstance(actor, pv.Text) and actor.GetVisibility()
    ]
    plotter.close()
    assert caption.caption.GetInput() in shown
    assert ("R" in shown) is ("L" in shown) is has_room
    assert any(text.endswith("mm") for text in shown) is has_room


def test_a_letter_that_would_lie_on_a_shape_is_left_out():
    import pyvista as pv

    plotter = pv.Plotter(off_screen=True, window_size=(300, 200))
    caption = Caption(plotter.renderer)
    caption.show(["heart_01"], 12, small=False, letters=True)
    plotter.render_window.Render()
    caption.face(np.eye(3), np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]), in_strip=False, taken=0.0)
    for places, hidden in (([[0.5, 0.03], [0.3, 0.5]], {"I"}), ([[0.5, 0.5]], set())):
        caption.leave_free(np.array(places), np.array(places))
        letters = [actor for actor in plotter.renderer.GetViewProps() if actor.GetInput() in "RLSI"]
        assert {actor.GetInput() for actor in letters if not actor.GetTextProperty().GetOpacity()} == hidden
    plotter.close()


def test_neighbours_have_alike_colours_and_opposite_places_do_not():
    angle = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    ring = np.column_stack([3 * np.cos(angle), 2 * np.sin(angle), np.zeros(200)])
    colours = colours_by_place(ring).astype(float)
    beside = np.linalg.norm(colours - np.roll(colours, 1, axis=0), axis=1)
    opposite = np.linalg.norm(colours - np.roll(colours, 100, axis=0), axis=1)
    assert beside.max() < 0.25 * opposite.min()


def pixels(image):
    from PySide6.QtGui import QImage

    image = image.convertToFormat(QImage.Format.Format_RGBA8888)
    flat = np.frombuffer(image.constBits(), dtype=np.uint8)
    return flat.reshape(image.height(), image.bytesPerLine() // 4, 4)[:, : image.width()].copy()


@pytest.mark.window
class TestViews:
    def test_a_line_inside_a_shape_is_seen_through_it_only_if_that_is_wanted(self, beans):
        scene = beans.views.stage.scene
        beans.commands["view.grid1"].trigger()
        content = scene.shown[0]
        middle = (content.raw.vertices @ content.alignment[:3, :3].T + content.alignment[:3, 3]).mean(axis=0)
        line = (middle + np.array([[-3.0, 0.0, 0.0], [3.0, 0.0, 0.0]]))[None]
        without, within, through = (
            drawn(ViewContents([replace(content, **marks)], 1), scene.canvas).astype(int)
            for marks in ({}, {"lines": line}, {"lines": line, "through": True})
        )
        np.testing.assert_array_equal(within, without)
        darker = (through - without)[..., :3].sum(axis=2) < -30
        assert 50 < darker.sum() < 0.01 * darker.size

    def test_every_layout_shows_its_number_of_subjects_and_pages_through_the_rest(self, beans):
        scene = beans.views.stage.scene
        for command, count, pages in (("view.grid1", 1, 4), ("view.grid4", 4, 1), ("view.grid16", 16, 1)):
            beans.commands[command].trigger()
            assert (scene.grid.display.layout, scene.grid.pages) == (count, pages)
        beans.commands["view.grid1"].trigger()
        beans.commands["view.next"].trigger()
        assert [content.name for content in scene.shown] == ["b"]
        beans.workspace.session.select(["d"])
        assert [content.name for content in scene.shown] == ["d"]
        assert not beans.commands["view.next"].isEnabled()

    def test_a_picture_can_be_larger_than_the_screen_and_transparent(self, beans):
        scene = beans.views.stage.scene
        first, two = scene.picture(1), scene.picture(2, transparent=True)
        assert (two.width(), two.height()) == (2 * first.width(), 2 * first.height())
        assert pixels(first)[..., 3].min() == 255
        alpha = pixels(two)[..., 3]
        assert alpha.min() == 0
        assert alpha.max() == 255

    def test_the_surface_is_seen_and_can_be_hidden(self, beans, wait):
        scene = beans.views.stage.scene
        wait(lambda: len(scene.shown) == 4 and all(content.raw is not None for content in scene.shown))
        before = pixels(scene.picture())
        beans.commands["view.raw"].trigger()
        after = pixels(scene.picture())
        assert (before != after).any(axis=-1).mean() > 0.05

    def test_particles_have_the_same_colour_on_every_shape(self, explored):
        scene = explored.views.stage.scene
        explored.commands["view.groomed"].trigger()
        explored.commands["view.grid1"].trigger()
        seen = []
        for page in range(2):
            scene.show_page(page)
            seen.append({tuple(item) for item in pixels(scene.picture())[::2, ::2, :3].reshape(-1, 3)})
        assert len(seen[0] & seen[1]) > 20

    def test_particles_of_a_moment_lie_on_the_surfaces_of_the_result(self, explored):
        loaded = explored.workspace.session.result
        frame, final = loaded.frames[-1], loaded.result
        turn = np.diag([-1.0, -1.0, 1.0, 1.0])  # the run had other alignments at that moment
        then = replace(frame, particles=frame.particles @ turn[:3, :3], alignments=turn @ frame.alignments)
        shown, _ = moment_of(replace(loaded, frames=(then, frame)), 0)
        now = transform_points(np.linalg.inv(frame.alignments), frame.particles)
        assert np.allclose(list(shown.values()), transform_points(final.alignments, now), atol=1e-3)

    def test_a_few_views_at_a_time_are_drawn_if_drawing_is_slow(self, explored, wait):
        scene, frames = explored.views.stage.scene, explored.workspace.session.result.frames
        names = explored.workspace.session.result.result.names
        first, last = (dict(zip(names, frame.particles, strict=True)) for frame in (frames[-2], frames[-1]))
        scene.show_particles(first)
        scene.picture()
        scene.plot.last_ms, scene.share = 1000.0, 1
        drawn = []
        for cell in scene.grid.cells[:4]:
            cell.renderer.AddObserver("StartEvent", lambda *_, cell=cell: drawn.append(cell))
        scene.show_particles(last, live=True)
        scene.refine_timer.stop()
        wait(lambda: drawn)
        assert len(set(drawn)) == 1
        scene.plot.update()
        wait(lambda: len(set(drawn)) == 4)

    def test_the_scheme_changes_the_background_of_the_views(self, beans):
        before = pixels(beans.views.stage.scene.picture())[40, 40, :3].mean()
        beans.commands["view.theme"].trigger()
        after = pixels(beans.views.stage.scene.picture())[40, 40, :3].mean()
        assert abs(before - after) > 100


@pytest.mark.window
def test_slices_go_from_subject_to_subject_and_switch_off_what_they_do_not_show(groomed):
    commands, footer = groomed.commands, groomed.views.stage.footer
    groomed.workspace.session.select(["a"])
    commands["view.slice"].trigger()
    assert footer.page.text() == "1 of 4"
    commands["view.next"].trigger()
    assert groomed.workspace.session.selection == ("b",)
    assert footer.page.text() == "2 of 4"
    for name in ("grid4", "link", "front"):
        assert not commands[f"view.{name}"].isEnabled(), name
        assert "Not now: " in commands[f"view.{name}"].toolTip()
    commands["view.slice"].trigger()
    assert commands["view.grid4"].isEnabled()
    assert commands["view.front"].isEnabled()
    groomed.workspace.session.toggle_included()
    assert footer.page.text().endswith("of 3")


@pytest.mark.window
def test_surfaces_that_are_asked_for_take_the_place_of_slices(groomed):
    commands, stage = groomed.commands, groomed.views.stage
    for name in ("groomed", "raw"):
        commands["view.slice"].trigger()
        assert groomed.views.shows_slices
        commands[f"view.{name}"].trigger()
        assert not groomed.views.shows_slices
        assert commands[f"view.{name}"].isChecked()
        assert stage.scene.isVisible()


@pytest.mark.window
def test_slices_can_be_saved_as_a_picture(groomed, monkeypatch, tmp_path, errors):
    from PySide6.QtGui import QImage

    where = tmp_path / "slice.png"
    monkeypatch.setattr("PySide6.QtWidgets.QFileDialog.getSaveFileName", lambda *_: (str(where), ""))
    groomed.commands["view.slice"].trigger()
    groomed.commands["view.screenshot"].trigger()
    assert QImage(str(where)).size() == 2 * groomed.views.stage.slices.size()
    where = tmp_path / "no" / "folder.png"
    groomed.commands["view.screenshot"].trigger()
    assert "can't be written" in str(errors[0][1])


@pytest.mark.window
def test_a_page_of_larger_shapes_is_seen_whole_and_the_one_before_as_large_as_then(groomed):
    scene = groomed.views.stage.scene
    groomed.commands["view.grid1"].trigger()
    groomed.commands["view.reset"].trigger()
    camera = scene.grid.cells[0].renderer.GetActiveCamera()
    fitting = []
    for page in range(scene.grid.pages):
        scene.show_page(page)
        scene.fit()
        fitting.append(camera.GetParallelScale())
    scene.show_page(0)
    scene.fit()
    seen = [camera.GetParallelScale()]
    for step in [1] * (scene.grid.pages - 1) + [-1] * (scene.grid.pages - 1):
        scene.turn_page(step)
        seen.append(camera.GetParallelScale())
    assert seen[: scene.grid.pages] == pytest.approx(np.maximum.accumulate(fitting))
    assert seen[scene.grid.pages :] == pytest.approx([seen[scene.grid.pages - 1]] * (scene.grid.pages - 1))
    assert len(set(fitting)) > 1, "shapes of one size show nothing"


@pytest.mark.window
@pytest.mark.parametrize("count", [1, 4, 9, 16])
def test_shapes_leave_room_for_the_texts_of_their_views(groomed, count):
    groomed.workspace.session.show_step("groom")
    groomed.commands[f"view.grid{count}"].trigger()
    scene = groomed.views.stage.scene
    scene.fit()
    grid, side = scene.grid, round(count**0.5)
    wide, high = scene.plot.width() / side, scene.plot.height() / side
    (camera,) = grid.cameras.each
    a_pixel = 2.0 * camera.GetParallelScale() / high
    points = np.concatenate([cell.points for cell in grid.cells[:count]]) @ grid.cells[0].axes.T
    across, along, _ = np.ptp(points, axis=0) / a_pixel
    texts = {1: 16, 4: 15, 9: 13, 16: 12}[count]
    assert (high - along) / 2.0 >= 1.2 * texts
    assert (wide - across) / 2.0 >= 1.2 * texts
    assert max(across / wide, along / high) > 0.6


def test_wide_shapes_stand_below_captions_and_narrow_ones_beside_them():
    from homolog_app.rendering.grid import ViewMargins

    margins = ViewMargins(width=360.0, height=300.0, beside=24.0, above=26.0, caption=80.0, below=44.0)
    for across, rim in ((20.0, 26.0), (50.0, 44.0)):
        along = 40.0
        a_pixel = 2.0 * margins.scale(across, along) / margins.height
        assert (margins.height - 2.0 * along / a_pixel) / 2.0 == pytest.approx(rim)


def test_another_project_is_seen_from_the_usual_side(explored, tmp_path, wait):
    camera = explored.views.stage.scene.grid.cells[0].renderer.GetActiveCamera()
    usual = camera.GetDirectionOfProjection()
    explored.commands["view.head"].trigger()
    assert camera.GetDirectionOfProjection() != pytest.approx(usual)
    shutil.copytree(tmp_path / "copy", tmp_path / "another")
    explored.projects.open_paths([tmp_path / "another"])
    wait(
        lambda: (
            explored.workspace.session.folder == tmp_path / "another" and explored.workspace.session.result
        )
    )
    assert camera.GetDirectionOfProjection() == pytest.approx(usual)


@pytest.mark.window
def test_whole_shapes_stay_whole_when_the_window_is_made_narrow_unless_they_were_zoomed(groomed, wait):
    scene = groomed.views.stage.scene
    groomed.commands["view.grid1"].trigger()
    groomed.commands["view.reset"].trigger()
    camera = scene.grid.cells[0].renderer.GetActiveCamera()
    seen = camera.GetParallelScale()
    groomed.resize(900, 1100)
    wait(lambda: camera.GetParallelScale() > 1.1 * seen, what="for the shape to fit again")
    camera.Zoom(2.0)
    zoomed = camera.GetParallelScale()
    groomed.resize(1440, 900)
    wait(lambda: scene.plot.width() > 800)
    assert camera.GetParallelScale() == zoomed


@pytest.mark.window
def test_the_page_of_subjects_is_open_again_after_shapes_of_the_model(explore, finished, window):
    explore(finished, "modes")
    tabs = window.inspector.explore.tabs
    tabs.setCurrentIndex(0)
    window.commands["view.grid1"].trigger()
    window.commands["view.next"].trigger()
    window.commands["explore.modes"].trigger()
    assert window.views.stage.scene.grid.page == 0
    tabs.setCurrentIndex(0)
    assert [content.name for content in window.views.stage.scene.shown] == ["b"]


@pytest.mark.window
def test_a_shape_that_grows_along_a_mode_stays_whole_and_in_its_place(explore, finished, window):
    explore(finished, "modes")
    scene = window.views.stage.scene
    camera = scene.grid.cells[0].renderer.GetActiveCamera()
    scene.fit()
    middle, seen = camera.GetFocalPoint(), camera.GetParallelScale()
    camera.SetParallelScale(0.5 * seen)  # as if the shapes had been half as large when they were fitted
    scene.fitted = scene.looks
    scene.display(scene.displayed)
    assert camera.GetFocalPoint() == middle
    assert camera.GetParallelScale() > 0.8 * seen
    camera.Zoom(2.0)  # by the user
    zoomed = camera.GetParallelScale()
    scene.display(scene.displayed)
    assert camera.GetParallelScale() == zoomed


@pytest.mark.window
def test_scale_bar_and_directions_can_be_hidden_and_are_in_pictures(beans):
    scene, commands = beans.views.stage.scene, beans.commands
    commands["view.grid1"].trigger()
    both = pixels(scene.picture())
    seen = {}
    for name in ("scale_bar", "letters"):
        commands[f"view.{name}"].trigger()
        assert not getattr(scene.canvas, name)
        changed = np.argwhere((pixels(scene.picture()) != both).any(axis=-1))
        seen[name] = changed.mean(axis=0) / both.shape[:2]
        commands[f"view.{name}"].trigger()
    assert seen["scale_bar"][0] > 0.85
    assert seen["scale_bar"][1] < 0.25
    np.testing.assert_allclose(seen["letters"], 0.5, atol=0.25)


@pytest.mark.parametrize(
    ("most", "length"), [(1.0, 1.0), (9.9, 5.0), (0.35, 0.2), (100.0, 100.0), (47.0, 20.0)]
)
def test_scale_bars_are_1_2_or_5(most, length):
    assert round_length(most) == pytest.approx(length)
