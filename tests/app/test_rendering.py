"""Shapes in 3-D, drawn off screen."""

import os
import signal
from multiprocessing import active_children

import numpy as np
import pytest

from homolog.errors import InputError
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.rendering.camera import VIEWS, Clip, View, frame_around, three_quarter_view
from homolog_app.rendering.draw import draw, with_opengl
from homolog_app.rendering.rays import shaded
from homolog_app.rendering.scene import Balls, Scene, Surface, surface

GREY = np.array([0.8, 0.8, 0.8])


def test_a_sphere_is_drawn_as_a_disc_of_its_size_in_the_middle(ball):
    for view in VIEWS.values():
        frame = frame_around([ball.vertices], view)
        image = draw(Scene((surface(ball, GREY),)), frame, 200)
        disc = (image[..., 3] / 255.0).sum() * (frame.width / 200) ** 2
        np.testing.assert_allclose(disc, np.pi * 100.0, rtol=0.01)
        rows, columns = np.nonzero(image[..., 3] > 127)
        np.testing.assert_allclose(
            [rows.mean(), columns.mean()], np.array(image.shape[:2]) / 2.0 - 0.5, atol=1.0
        )


def test_the_inside_of_an_open_surface_is_drawn(ball):
    view = three_quarter_view(ball.vertices)
    frame = frame_around([ball.vertices], view)
    away = ball.vertices[ball.faces].mean(axis=1) @ view.axes[2] < 0.0
    bowl = TriangleMesh(ball.vertices, np.ascontiguousarray(ball.faces[away]))
    whole, open_ = (draw(Scene((surface(mesh, GREY),)), frame, 100)[..., 3] > 127 for mesh in (ball, bowl))
    assert np.count_nonzero(open_) > 0.95 * np.count_nonzero(whole)


def test_nothing_is_clipped_whatever_the_view(ball):
    stretched = TriangleMesh(ball.vertices * [1.0, 2.5, 0.4], ball.faces)
    for toward in np.random.default_rng(0).normal(size=(5, 3)):
        view = View(tuple(toward), (0.1, 0.2, 0.9))
        image = draw(Scene((surface(stretched, GREY),)), frame_around([stretched.vertices], view), 120)
        border = np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])
        assert border[:, 3].max() == 0
        assert (image[..., 3] > 127).mean() > 0.3


def test_a_ball_in_front_hides_the_one_behind():
    places = np.array([[0.0, 0.0, 5.0], [0.0, 0.0, -5.0]])
    pair = Balls(places, 1.0, np.array([[255, 0, 0], [0, 0, 255]], np.uint8))
    image = draw(Scene((), pair), frame_around([places], VIEWS["superior"], border=1.0), 61)
    assert image[30, 30, 0] > 127
    assert image[30, 30, 2] < 50
    assert np.count_nonzero(image[30, :, 3]) == pytest.approx(60, abs=2)


def test_balls_are_hidden_by_a_surface_before_them_and_whole_in_a_cut():
    """One ball stands before a small wall, one behind it."""
    corners = np.array([[-3.0, -3.0, 0.0], [3.0, -3.0, 0.0], [3.0, 3.0, 0.0], [-3.0, 3.0, 0.0]])
    wall = surface(TriangleMesh(corners, np.array([[0, 1, 2], [0, 2, 3]])), GREY)
    balls = Balls(np.array([[0.0, 0.0, 4.0], [0.0, 0.0, -4.0]]), 2.0, np.array([0, 0, 255], np.uint8))
    frame = frame_around([np.array([[-3.0, -3.0, -6.0], [3.0, 3.0, 6.0]])], VIEWS["superior"])
    whole = draw(Scene((wall,), balls), frame, 60).astype(int)
    behind = draw(Scene((wall,), Balls(balls.centres[1:], 2.0, balls.colours)), frame, 60).astype(int)
    assert whole[30, 30, 2] > 2 * whole[30, 30, 0]
    assert behind[30, 30, 0] == behind[30, 30, 2]
    cut = np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 4.0])
    crossing = draw(Scene((wall,), balls, cut=cut, cap=(255, 0, 0)), frame, 60).astype(int)
    np.testing.assert_array_equal(crossing[30, 30], whole[30, 30])


def test_hollows_are_darker_than_the_open_surface(ball):
    flat_cavity = TriangleMesh(ball.vertices * [1.0, 1.0, 0.2], ball.faces[:, ::-1])
    np.testing.assert_allclose(shaded(ball, GREY).colours, 204, atol=1)
    assert shaded(flat_cavity, GREY).colours.mean() < 153


def test_what_was_moved_looks_like_what_was_made_there(ball):
    frame = frame_around([ball.vertices * 1.2], VIEWS["left"])
    moved = surface(TriangleMesh(ball.vertices * [1.0, 0.6, 1.1], ball.faces), np.array([0.9, 0.3, 0.1]))
    part = Surface(moved.vertices, moved.normals, moved.faces[:-1], moved.colours)
    before = draw(Scene((surface(ball, GREY),)), frame, 90).astype(int)
    after = draw(Scene((moved,)), frame, 90)
    assert np.abs(after - before).max() > 120
    draw(Scene((part,)), frame, 90)
    np.testing.assert_allclose(draw(Scene((moved,)), frame, 90), after, atol=1)


def test_edges_are_smooth_and_a_fold_in_front_of_its_own_surface_too(ball):
    far = TriangleMesh(ball.vertices * 2.0 - [0.0, 60.0, 0.0], ball.faces)
    scene = Scene((surface(ball, np.zeros(3)), surface(far, np.ones(3))))
    image = draw(scene, frame_around([far.vertices, ball.vertices], VIEWS["posterior"]), 150) / 255.0
    rim = image[..., 3]
    assert np.count_nonzero((rim > 0.1) & (rim < 0.9)) > 200
    inner = image[40:110, 40:110, 0]
    assert np.count_nonzero((inner > 0.15) & (inner < 0.7)) > 60


def cut_of(plane, ball, **chosen):
    clip = Clip(plane=plane, **chosen)
    low, high = ball.vertices.min(axis=0), ball.vertices.max(axis=0)
    return clip.cut(tuple(np.stack([low, high], axis=1).ravel()), -VIEWS["superior"].axes[2])


@pytest.mark.parametrize("plane", ["axial", "view"])
def test_a_hollow_ball_cut_in_the_middle_shows_its_wall_and_its_cavity(ball, plane):
    centre = ball.vertices.mean(axis=0)
    inside = TriangleMesh(centre + 0.6 * (ball.vertices - centre), ball.faces[:, ::-1])
    count = len(ball.vertices)
    wall = TriangleMesh(
        np.concatenate([ball.vertices, inside.vertices]), np.concatenate([ball.faces, inside.faces + count])
    )
    colours = np.repeat([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]], count, axis=0)
    frame = frame_around([ball.vertices], VIEWS["superior"])
    image = draw(Scene((surface(wall, colours),)), frame, 200)
    assert image[100, 100, 2] > image[100, 100, 1]
    cut = Scene((surface(wall, colours),), cut=cut_of(plane, ball), cap=(255, 0, 0))
    image = draw(cut, frame, 200)
    most = image[..., :3].argmax(axis=2)
    each = [
        ((most == colour) * image[..., 3] / 255.0).sum() * (frame.width / 200) ** 2 for colour in range(3)
    ]
    np.testing.assert_allclose(each, [np.pi * 64.0, np.pi * 36.0, 0.0], atol=6.0)
    assert most[100, 100] == 1


def test_a_plane_beside_the_ball_leaves_all_or_nothing(ball):
    frame = frame_around([ball.vertices], VIEWS["anterior"])

    def cut_at(**chosen):
        return draw(Scene((surface(ball, GREY),), cut=cut_of("sagittal", ball, **chosen)), frame, 60)

    whole = draw(Scene((surface(ball, GREY),)), frame, 60)
    np.testing.assert_array_equal(cut_at(position=0.0), whole)
    assert cut_at(position=0.0, flipped=True)[..., 3].max() == 0
    half = cut_at(flipped=True)[..., 3] / 255.0
    np.testing.assert_allclose(half.sum(), whole[..., 3].sum() / 510.0, rtol=0.02)
    assert half[:, :28].sum() > 0.9 * half.sum()  # the patient's right is at the left


def test_a_graphics_driver_that_ends_its_process_is_an_input_error(monkeypatch):
    monkeypatch.setattr("homolog_app.rendering.draw.begin", os.abort)
    with pytest.raises(InputError, match="install a graphics driver"):
        with_opengl(len, "abc")


def test_a_graphics_driver_that_hangs_is_ended(monkeypatch):
    others = set(active_children())
    monkeypatch.setattr("homolog_app.rendering.draw.begin", signal.pause)
    monkeypatch.setattr("homolog_app.rendering.draw.PATIENCE_S", 2.0)
    with pytest.raises(InputError, match="install a graphics driver"):
        with_opengl(len, "abc")
    assert set(active_children()) <= others


def test_balls_leave_half_of_the_surface_free_and_keep_their_size_within_bounds():
    from homolog_app.rendering.scene import ball_radius

    cube = (0.0, 100.0, -50.0, 50.0, 10.0, 110.0)
    assert ball_radius(cube, 1024) == pytest.approx(0.42 * 100.0 / 32.0)
    assert ball_radius(cube, 4096) == pytest.approx(ball_radius(cube, 1024) / 2.0)
    assert ball_radius(cube, 1) == pytest.approx(3.5)
    assert ball_radius(cube, 10**6) == pytest.approx(0.6)
