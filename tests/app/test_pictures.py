"""The pictures' numbers; how they look is for the eye."""

import subprocess
import sys

import numpy as np
import pytest
from matplotlib.image import imread
from PIL import Image

from homolog.errors import InputError
from homolog_app.pictures import (
    DARK,
    VIEWS,
    ModeSurfaces,
    colours_by_place,
    draw_differences,
    draw_modes,
    draw_particles,
    draw_subjects,
    three_quarter_view,
    write_picture,
)
from homolog_app.pictures.png import png_of
from homolog_app.rendering.colours import (
    common_limit,
    diverging_colours,
    diverging_table,
    outward_displacement,
)


@pytest.fixture(scope="module")
def model(ball):
    """Mode 1 blows the ball up, mode 2 shifts it."""
    normals = ball.vertex_normals
    shift = np.broadcast_to([0.0, 0.0, 0.5], normals.shape)
    return ModeSurfaces(ball, np.stack([normals, shift]), np.array([0.8, 0.2]))


def test_the_left_of_the_patient_is_on_the_right_of_an_anterior_view():
    right, up, back = VIEWS["anterior"].axes
    np.testing.assert_allclose(
        [right, up, back], [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]], atol=1e-12
    )


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
    colours = colours_by_place(particles)
    assert len(np.unique(colours, axis=0)) > 190
    np.testing.assert_allclose(colours_by_place(5.0 + 2.0 * particles), colours, atol=1)
    order = np.random.default_rng(4).permutation(200)
    np.testing.assert_allclose(colours_by_place(particles[order]), colours[order], atol=1)


def _pixels(figure):
    figure.canvas.draw()
    return np.asarray(figure.canvas.buffer_rgba())[..., :3] / 255.0


def test_every_text_lies_on_the_page_and_none_on_another(model):
    figure = draw_modes(
        {"original method": model, "proposed method": model}, modes=[0, 1], title="Both", width=260
    )
    _pixels(figure)
    page = figure.bbox
    arguments = [
        text for text in figure.findobj(lambda item: hasattr(item, "get_text")) if text.get_text().strip()
    ]
    boxes = [text.get_window_extent() for text in arguments if text.get_visible()]
    assert len(boxes) > 20
    for index, box in enumerate(boxes):
        assert page.x0 <= box.x0 < box.x1 <= page.x1, arguments[index].get_text()
        assert page.y0 <= box.y0 < box.y1 <= page.y1, arguments[index].get_text()
        assert not any(box.overlaps(other) for other in boxes[:index]), arguments[index].get_text()


def test_a_growing_mode_is_blue_at_its_upper_end_and_yellow_at_its_lower(model):
    page = _pixels(draw_modes({"": model}, modes=[0], width=240))
    blueness = page[..., 2] - page[..., 0]
    third = page.shape[1] // 4
    assert np.percentile(blueness[:, :third], 1.0) < -0.3
    assert np.percentile(blueness[:, 2 * third : 3 * third], 99.0) > 0.3


def test_modes_tell_their_share_and_the_scale_is_symmetric(model):
    figure = draw_modes({"": model}, modes=[0, 1], width=200)
    _pixels(figure)
    texts = {text.get_text() for text in figure.findobj(lambda item: hasattr(item, "get_text"))}
    assert {"−2 SD", "+2 SD", "mean (mode 1: 80.0 %)", "mean (mode 2: 20.0 %)", "mode 1", "mode 2"} <= texts
    assert {"+2", "+1", "0", "−1", "−2", "out of the tissue\n(mm)", "into the tissue\n(mm)"} <= texts


def test_the_subjects_come_in_pages_with_their_names(ball):
    particles = np.stack([ball.vertices[::9]] * 5)
    pages = list(
        draw_subjects([f"subject {k}" for k in range(5)], [ball] * 5, particles, columns=2, rows=1, width=90)
    )
    assert len(pages) == 3
    texts = {text.get_text() for text in pages[2].findobj(lambda item: hasattr(item, "get_text"))}
    assert {"subject 4", "Subjects (3 of 3)"} <= texts


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


def test_what_is_not_significant_is_pale(ball):
    moves = {"": (ball, ball.vertex_normals)}
    pale = {"": ball.vertices[:, 2] < 0.0}
    page = _pixels(draw_differences(moves, pale=pale, views=[VIEWS["left"]], width=200))
    part = page[:, page.shape[1] // 4 : page.shape[1] // 3]
    blueness = (part[..., 2] - part[..., 0]).mean(axis=1)
    top, bottom = np.array_split(blueness, 2)
    assert top.max() > bottom.max() + 0.2


@pytest.mark.parametrize("suffix", [".png", ".pdf", ".svg"])
def test_pictures_are_written_as_raster_and_as_vectors(ball, tmp_path, suffix):
    path = tmp_path / f"mean{suffix}"
    write_picture(draw_particles(ball, ball.vertices[::9], width=100), path)
    assert path.stat().st_size > 5000
    if suffix == ".png":
        assert imread(path).shape[2] == 3
    write_picture(draw_particles(ball, ball.vertices[::9], width=100), tmp_path / f"again{suffix}")
    assert (tmp_path / f"again{suffix}").read_bytes() == path.read_bytes()


@pytest.mark.parametrize("opacity", [255, 40])
def test_a_png_file_contains_the_pixels_and_their_size(tmp_path, opacity):
    pixels = np.random.default_rng(0).integers(0, 256, (7, 5, 4), dtype=np.uint8)
    pixels[..., 3] = 255
    pixels[2:4, 1, 3] = opacity
    (tmp_path / "a.png").write_bytes(png_of(pixels, 200.0))
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.mode == ("RGB" if opacity == 255 else "RGBA")
        assert picture.info["dpi"] == pytest.approx((200.0, 200.0), abs=0.1)
        np.testing.assert_array_equal(np.asarray(picture.convert("RGBA")), pixels)


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
