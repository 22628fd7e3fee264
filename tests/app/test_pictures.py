"""The pictures' numbers; how they look is for the eye."""

import subprocess
import sys

import numpy as np
import pytest
from matplotlib.image import imread
from skimage.measure import marching_cubes

from homolog.errors import InputError
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.clipping import Clip
from homolog_app.pictures import (
    DARK,
    VIEWS,
    ModeSurfaces,
    correspondence_colours,
    draw_differences,
    draw_modes,
    draw_particles,
    draw_subjects,
    outward_displacement,
    three_quarter_view,
    write_picture,
)
from homolog_app.pictures.colours import diverging_colours, diverging_table
from homolog_app.pictures.displacement import common_limit
from homolog_app.pictures.render import Renderer, render
from homolog_app.pictures.solids import balls, surface
from homolog_app.pictures.views import View, frame_around

GREY = np.array([0.8, 0.8, 0.8])


@pytest.fixture(scope="module")
def ball():
    """A sphere of radius 10 mm around (1, 2, 3)."""
    grid = np.stack(np.meshgrid(*[np.arange(-12.0, 13.0)] * 3, indexing="ij"), axis=-1)
    vertices, faces, _, _ = marching_cubes(
        np.linalg.norm(grid - 0.3, axis=-1) - 10.0, 0.0, gradient_direction="ascent"
    )
    mesh = TriangleMesh(vertices - 12.3 + [1.0, 2.0, 3.0], faces)
    return mesh if mesh.volume > 0 else TriangleMesh(mesh.vertices, mesh.faces[:, ::-1])


@pytest.fixture(scope="module")
def model(ball):
    """Mode 1 blows the ball up, mode 2 shifts it."""
    normals = ball.vertex_normals
    shift = np.broadcast_to([0.0, 0.0, 0.5], normals.shape)
    return ModeSurfaces(ball, np.stack([normals, shift]), np.array([0.8, 0.2]))


def test_a_sphere_is_drawn_as_a_disc_of_its_size_in_the_middle(ball):
    for view in VIEWS.values():
        frame = frame_around([ball.vertices], view)
        image = render([surface(ball, GREY)], frame, 200)
        disc = image[..., 3].sum() * (frame.width / 200) ** 2
        np.testing.assert_allclose(disc, np.pi * 100.0, rtol=0.01)
        rows, columns = np.nonzero(image[..., 3] > 0.5)
        np.testing.assert_allclose(
            [rows.mean(), columns.mean()], np.array(image.shape[:2]) / 2.0 - 0.5, atol=1.0
        )


def test_nothing_is_clipped_whatever_the_view(ball):
    stretched = TriangleMesh(ball.vertices * [1.0, 2.5, 0.4], ball.faces)
    for toward in np.random.default_rng(0).normal(size=(5, 3)):
        view = View(tuple(toward), (0.1, 0.2, 0.9))
        image = render([surface(stretched, GREY)], frame_around([stretched.vertices], view), 120)
        border = np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])
        assert border[:, 3].max() == 0.0
        assert image[..., 3].mean() > 0.3


def test_a_ball_in_front_hides_the_one_behind(ball):
    red, blue = np.eye(3)[[0, 2]]
    view = VIEWS["superior"]
    pair = [balls(np.array([[0.0, 0.0, 5.0]]), 1.0, red), balls(np.array([[0.0, 0.0, -5.0]]), 1.0, blue)]
    image = render(pair, frame_around([pair[0].vertices, pair[1].vertices], view), 61)
    assert image[30, 30, 0] > 0.5
    assert image[30, 30, 2] < 0.2


def test_the_left_of_the_patient_is_on_the_right_of_an_anterior_view():
    right, up, back = VIEWS["anterior"].axes
    np.testing.assert_allclose(
        [right, up, back], [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]], atol=1e-12
    )


def test_hollows_are_darker_than_the_open_surface(ball):
    flat_cavity = TriangleMesh(ball.vertices * [1.0, 1.0, 0.2], ball.faces[:, ::-1])
    np.testing.assert_allclose(surface(ball, GREY).colours, 0.8, atol=1e-6)
    assert surface(flat_cavity, GREY).colours.mean() < 0.6


def test_the_three_quarter_view_shows_the_broad_side_where_things_happen():
    points = np.random.default_rng(0).normal(size=(500, 3)) * [9.0, 5.0, 2.0]
    for side in (-1.0, 1.0):
        weights = np.where(points[:, 2] * side > 0.0, 1.0, 0.1)
        toward = np.array(three_quarter_view(points, weights).toward)
        assert np.abs(toward).argmax() == 2
        assert toward[2] * side > 0.0
    assert three_quarter_view(points).toward[2] > 0.0


def test_the_diverging_table_runs_from_yellow_over_white_to_blue():
    table = diverging_table()
    assert table.shape == (256, 3)
    assert table[0, :2].min() > 2.0 * table[0, 2]
    assert table[-1, 2] > 1.5 * table[-1, :2].max()
    np.testing.assert_allclose(table[127:129], 0.96, atol=0.01)
    luminance = table @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(luminance[:128]) >= -0.005).all()
    assert (np.diff(luminance[128:]) <= 0.005).all()


def test_expansion_is_blue_and_contraction_yellow_up_to_the_limit():
    colours = diverging_colours(np.array([-9.0, -2.0, 0.0, 2.0, 9.0]), 2.0)
    np.testing.assert_allclose(colours[0], colours[1])
    np.testing.assert_allclose(colours[3], colours[4])
    assert colours[4, 2] > colours[4, 0]
    assert colours[0, 0] > colours[0, 2]
    np.testing.assert_allclose(colours[2], 0.96, atol=0.01)


def test_outward_displacement_is_along_the_normal_only(ball):
    grown = (ball.vertices - [1.0, 2.0, 3.0]) * 0.1
    np.testing.assert_allclose(outward_displacement(ball, grown), 1.0, atol=0.02)
    around = np.cross(ball.vertices - [1.0, 2.0, 3.0], [0.0, 0.0, 0.1])
    np.testing.assert_allclose(outward_displacement(ball, around), 0.0, atol=0.1)


@pytest.mark.parametrize(
    ("reach", "limit"), [(0.97, 1.0), (1.4, 1.5), (0.023, 0.03), (73.0, 80.0), (0.0, 1.0)]
)
def test_colour_limits_are_round_and_hold_nearly_all(reach, limit):
    np.testing.assert_allclose(common_limit([np.linspace(-reach, reach, 5)]), limit)


def test_colours_by_correspondence_tell_particles_apart_and_follow_them():
    particles = np.random.default_rng(3).normal(size=(200, 3)) * [3.0, 2.0, 1.0]
    colours = correspondence_colours(particles)
    assert len(np.unique(colours, axis=0)) == 200
    np.testing.assert_allclose(correspondence_colours(5.0 + 2.0 * particles), colours)
    order = np.random.default_rng(4).permutation(200)
    np.testing.assert_allclose(correspondence_colours(particles[order]), colours[order])


def test_what_was_moved_looks_like_what_was_made_there(ball):
    frame = frame_around([ball.vertices * 1.2], VIEWS["left"])
    moved = surface(TriangleMesh(ball.vertices * [1.0, 0.6, 1.1], ball.faces), np.array([0.9, 0.3, 0.1]))
    renderer = Renderer([surface(ball, GREY)])
    before = renderer.draw(frame, 90)
    renderer.move(moved.vertices, moved.normals, moved.colours)
    np.testing.assert_allclose(renderer.draw(frame, 90), render([moved], frame, 90), atol=1e-6)
    assert np.abs(renderer.draw(frame, 90) - before).max() > 0.5


def test_edges_are_smooth_and_a_fold_in_front_of_its_own_surface_too(ball):
    far = TriangleMesh(ball.vertices * 2.0 - [0.0, 60.0, 0.0], ball.faces)
    solids = [surface(ball, np.zeros(3)), surface(far, np.ones(3))]
    image = render(solids, frame_around([far.vertices, ball.vertices], VIEWS["posterior"]), 150)
    rim = image[..., 3]
    assert np.count_nonzero((rim > 0.1) & (rim < 0.9)) > 200
    inner = image[40:110, 40:110, 0]
    assert np.count_nonzero((inner > 0.15) & (inner < 0.7)) > 60


def _pixels(figure):
    figure.canvas.draw()
    return np.asarray(figure.canvas.buffer_rgba())[..., :3] / 255.0


def test_every_text_lies_on_the_page_and_none_on_another(model):
    figure = draw_modes(
        {"original method": model, "proposed method": model}, modes=[0, 1], title="Both", width=260
    )
    _pixels(figure)
    page = figure.bbox
    words = [
        text for text in figure.findobj(lambda item: hasattr(item, "get_text")) if text.get_text().strip()
    ]
    boxes = [text.get_window_extent() for text in words if text.get_visible()]
    assert len(boxes) > 20
    for index, box in enumerate(boxes):
        assert page.x0 <= box.x0 < box.x1 <= page.x1, words[index].get_text()
        assert page.y0 <= box.y0 < box.y1 <= page.y1, words[index].get_text()
        assert not any(box.overlaps(other) for other in boxes[:index]), words[index].get_text()


def test_a_growing_mode_is_blue_at_its_upper_end_and_yellow_at_its_lower(model):
    page = _pixels(draw_modes({"": model}, modes=[0], width=240))
    blueness = page[..., 2] - page[..., 0]
    third = page.shape[1] // 4
    assert np.percentile(blueness[:, :third], 1.0) < -0.3
    assert np.percentile(blueness[:, 2 * third : 3 * third], 99.0) > 0.3


def test_modes_tell_their_share_and_the_scale_is_symmetric(model):
    figure = draw_modes({"": model}, modes=[0, 1], width=200)
    _pixels(figure)
    words = {text.get_text() for text in figure.findobj(lambda item: hasattr(item, "get_text"))}
    assert {"−2 SD", "+2 SD", "mean (mode 1: 80.0 %)", "mean (mode 2: 20.0 %)", "mode 1", "mode 2"} <= words
    assert {"+2", "+1", "0", "−1", "−2", "expansion\n(outward, mm)", "contraction\n(inward, mm)"} <= words


def test_the_subjects_come_in_pages_with_their_names(ball):
    particles = np.stack([ball.vertices[::9]] * 5)
    pages = list(
        draw_subjects([f"subject {k}" for k in range(5)], [ball] * 5, particles, columns=2, rows=1, width=90)
    )
    assert len(pages) == 3
    words = {text.get_text() for text in pages[2].findobj(lambda item: hasattr(item, "get_text"))}
    assert {"subject 4", "Subjects (3 of 3)"} <= words


def test_the_dark_theme_has_a_dark_page_and_light_words(ball):
    figure = draw_particles(ball, ball.vertices[::9], title="Mean", theme=DARK, width=120)
    assert _pixels(figure)[0, 0].max() < 0.2
    assert min(figure.texts[0].get_color()) > 0.8


def test_differences_use_one_scale_for_all_rows_and_views(ball):
    moves = {"weak": (ball, 0.1 * ball.vertex_normals), "strong": (ball, ball.vertex_normals)}
    page = _pixels(draw_differences(moves, views=[VIEWS["left"]], width=200))
    blueness = (page[..., 2] - page[..., 0])[:, : page.shape[1] // 2]
    half = page.shape[0] // 2
    assert 0.02 < np.percentile(blueness[:half], 99.0) < 0.3
    assert np.percentile(blueness[half:], 99.0) > 0.4


@pytest.mark.parametrize("suffix", [".png", ".pdf", ".svg"])
def test_pictures_are_written_as_raster_and_as_vectors(ball, tmp_path, suffix):
    path = tmp_path / f"mean{suffix}"
    write_picture(draw_particles(ball, ball.vertices[::9], width=100), path)
    assert path.stat().st_size > 5000
    if suffix == ".png":
        assert imread(path).shape[2] == 4
    write_picture(draw_particles(ball, ball.vertices[::9], width=100), tmp_path / f"again{suffix}")
    assert (tmp_path / f"again{suffix}").read_bytes() == path.read_bytes()


def test_texts_of_vector_graphics_stay_texts(ball, tmp_path):
    write_picture(draw_particles(ball, ball.vertices[::9], title="A title", width=60), tmp_path / "mean.svg")
    assert ">A title</text>" in (tmp_path / "mean.svg").read_text("utf-8")


def test_a_folder_that_cannot_be_made_is_an_input_error(ball, tmp_path):
    (tmp_path / "no").touch()
    with pytest.raises(InputError, match="can't be written"):
        write_picture(draw_particles(ball, ball.vertices[::9], width=60), tmp_path / "no" / "mean.png")


def test_pictures_load_neither_qt_nor_vtk():
    check = "import sys, homolog_app.pictures; print({'PySide6', 'vtkmodules', 'pyvista'} & set(sys.modules))"
    done = subprocess.run(
        [sys.executable, "-c", check],
        env={"PYTHONPATH": ":".join(sys.path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == "set()"


def cut_of(plane, ball, **chosen):
    clip = Clip(plane=plane, **chosen)
    low, high = ball.vertices.min(axis=0), ball.vertices.max(axis=0)
    return clip.cut(tuple(np.stack([low, high], axis=1).ravel()), -VIEWS["superior"].axes[2])


@pytest.mark.parametrize("plane", ["axial", "view"])
def test_a_hollow_ball_cut_in_the_middle_shows_its_wall_and_its_cavity(ball, plane):
    centre = ball.vertices.mean(axis=0)
    inside = TriangleMesh(centre + 0.6 * (ball.vertices - centre), ball.faces[:, ::-1])
    solids = [surface(ball, [0, 0, 1]), surface(inside, [0, 1, 0])]
    frame = frame_around([ball.vertices], VIEWS["superior"])
    image = render(solids, frame, 200)
    assert image[100, 100, 2] > image[100, 100, 1]
    image = Renderer(solids).draw(frame, 200, cut_of(plane, ball), (1, 0, 0))
    most = image[..., :3].argmax(axis=2)
    each = [((most == colour) * image[..., 3]).sum() * (frame.width / 200) ** 2 for colour in range(3)]
    np.testing.assert_allclose(each, [np.pi * 64.0, np.pi * 36.0, 0.0], atol=6.0)
    assert most[100, 100] == 1


def test_a_plane_beside_the_ball_leaves_all_or_nothing(ball):
    frame = frame_around([ball.vertices], VIEWS["anterior"])
    whole = render([surface(ball, GREY)], frame, 60)
    renderer = Renderer([surface(ball, GREY)])
    np.testing.assert_array_equal(renderer.draw(frame, 60, cut_of("sagittal", ball, position=0.0)), whole)
    away = renderer.draw(frame, 60, cut_of("sagittal", ball, position=0.0, flipped=True))
    assert away[..., 3].max() == 0.0
    half = renderer.draw(frame, 60, cut_of("sagittal", ball, flipped=True))
    np.testing.assert_allclose(half[..., 3].sum(), whole[..., 3].sum() / 2.0, rtol=0.02)
    assert half[:, :28, 3].sum() > 0.9 * half[..., 3].sum()  # the patient's right is at the left
