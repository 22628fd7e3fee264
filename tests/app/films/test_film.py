"""Frames: what moves, stays whole and is said."""

import numpy as np
import pytest

from homolog.errors import InputError
from homolog_app.exports.film import Film
from homolog_app.exports.motion import Motion
from homolog_app.exports.settings import SIGHTS, FilmSettings, PictureSettings, camera_direction, camera_view

SMALL = {"width": 480, "height": 320}
BARE = {"caption": False, "scale_bar": False, "colours": "plain"}


def border(page):
    return np.concatenate([page[0], page[-1], page[:, 0], page[:, -1]])[..., :3].astype(int)


@pytest.mark.parametrize("background", ["light", "dark"])
@pytest.mark.parametrize("turntable", [False, True])
def test_nothing_touches_the_border_at_any_moment(bulging, background, turntable):
    settings = FilmSettings(**SMALL, background=background, seconds=0.4, turntable=turntable)
    film = Film([bulging], ["oblique", "left"], settings, turntable=turntable)
    paper = 255 if background == "light" else 24
    for index in range(settings.frames):
        page = film.moment(index, settings)
        assert page.shape == (320, 480, 4)
        assert np.abs(border(page) - paper).max() <= 6
        assert (np.abs(page[..., :3].astype(int) - paper).max(axis=-1) > 40).mean() > 0.05


def test_a_loop_ends_where_it_began_and_a_single_way_at_the_other_end(bulging):
    there_and_back = FilmSettings(**SMALL, seconds=0.8)
    film = Film([bulging], ["anterior"], there_and_back)
    first, last = film.moment(0, there_and_back), film.moment(there_and_back.frames - 1, there_and_back)
    np.testing.assert_array_equal(first, film.draw(0.0))
    one_way = there_and_back.model_copy(update={"loop": False})
    end = film.moment(one_way.frames - 1, one_way)
    np.testing.assert_array_equal(end, film.draw(1.0))

    def difference(page):
        return np.abs(page.astype(int) - first).mean()

    assert difference(last) < 0.2 * difference(end)


def test_a_whole_turn_shows_the_other_side_halfway_and_comes_back(ellipsoid):
    lopsided = Motion(ellipsoid, np.zeros_like(ellipsoid.vertices), 0.0, 0.0, lambda _: "Mean shape")
    settings = FilmSettings(**SMALL, **BARE, turntable=True)
    film = Film([lopsided], ["anterior"], settings, turntable=True)
    front, side, back = (film.draw(0.0, turn)[..., :3].min(axis=-1) < 250 for turn in (0.0, np.pi / 2, np.pi))
    assert 1.4 < front.sum() / side.sum() < 1.6  # 30 mm wide against 20 mm deep
    assert np.abs(front.sum() / back.sum() - 1.0) < 0.02


def test_the_scale_bar_is_as_long_as_it_says(bulging):
    film = Film(
        [bulging],
        ["anterior"],
        PictureSettings(width=640, height=480, caption=False, colours="plain", directions=False),
    )
    page = film.draw(0.5)[..., :3].max(axis=-1)
    shape = page[: 480 - 60].min(axis=0) < 240
    bar = (page[450:] < 60).sum(axis=1).max()
    assert bar * 30.0 / np.count_nonzero(shape) == pytest.approx(5.0, rel=0.03)


def test_the_caption_says_what_is_shown_and_changes_as_it_moves(bulging):
    with_words = Film([bulging], ["anterior"], PictureSettings(**SMALL, scale_bar=False, colours="plain"))
    lines = [with_words.draw(share)[-26:, 60:-60, :3].astype(int) for share in (0.0, 0.25, 1.0)]
    for line in lines:
        assert line.min() < 60
        assert line.max() == 255
        assert 0.02 < (line.max(axis=-1) < 128).mean() < 0.3
    assert np.abs(lines[0] - lines[1]).max() > 150
    assert np.abs(lines[1] - lines[2]).max() > 150


def test_expansion_is_blue_and_contraction_yellow_beside_a_scale(bulging):
    film = Film([bulging], ["anterior"], PictureSettings(**SMALL))
    low, high = (film.draw(share)[:200, 60:340, :3].astype(int) for share in (0.0, 1.0))
    assert np.percentile(high[..., 2] - high[..., 0], 99.0) > 60
    assert np.percentile(low[..., 0] - low[..., 2], 99.0) > 60


@pytest.mark.parametrize(("motions", "sights"), [(1, 3), (3, 1), (2, 2), (1, 8)])
def test_every_picture_of_a_grid_is_there(bulging, motions, sights):
    film = Film(
        [bulging] * motions, SIGHTS[:sights], PictureSettings(width=960, height=640, directions=False)
    )
    page = film.draw(1.0)[..., :3].min(axis=-1)
    assert len(film.boxes) == motions * sights
    for box in film.boxes:
        part = page[box.y : box.y + box.height, box.x : box.x + box.width]
        assert (part < 245).mean() > 0.1
        assert not (part[[0, -1]] < 200).any()
        assert not (part[:, [0, -1]] < 200).any()


def test_a_transparent_picture_has_no_paper_and_soft_edges(bulging):
    settings = PictureSettings(**SMALL, **BARE)
    clear = Film([bulging], ["left"], settings, transparent=True).draw(0.7)
    paper = Film([bulging], ["left"], settings).draw(0.7)
    assert clear[0, 0, 3] == 0
    edge = (clear[..., 3] > 0) & (clear[..., 3] < 255)
    assert 100 < np.count_nonzero(edge) < 5000
    opacity = clear[..., 3:] / 255.0
    laid = clear[..., :3] * opacity + 255.0 * (1.0 - opacity)
    assert np.abs(laid - paper[..., :3]).max() < 2.0


def test_a_page_too_small_for_its_pictures_is_refused(bulging):
    with pytest.raises(InputError, match=r"480 x 320 pixels .* 160 pictures"):
        Film([bulging] * 20, SIGHTS, PictureSettings(width=480, height=320))


def test_directions_stand_around_the_shape_and_turn_with_it(bulging):
    settings = {**SMALL, **BARE}
    plain, named = (
        Film([bulging], ["anterior"], PictureSettings(**settings, directions=shown))
        for shown in (False, True)
    )
    film = Film([bulging], ["anterior"], PictureSettings(**settings), turntable=True)
    film.draw(0.5)
    assert [text.get_text() for text in film.letters[0]] == ["R", "L", "I", "S"]
    film.draw(0.5, np.pi / 2.0)
    assert sorted(text.get_text() for text in film.letters[0][:2]) == ["A", "P"]
    (inner,), (outer,) = named.boxes, plain.boxes
    assert inner.width < outer.width


def test_a_camera_is_a_view_of_its_own(ellipsoid, bulging):
    sight = camera_direction((0.0, -250.0, 0.0), (0.0, 0.0, 1.0))
    assert sight == "camera:0,-1,0,0,0,1"
    settings = PictureSettings(**SMALL)
    own, known = (Film([bulging], [view], settings).draw(1.0) for view in (sight, "anterior"))
    np.testing.assert_array_equal(own, known)


@pytest.mark.parametrize(
    "word", ["anterior", "camera:1,0,0", "camera:0,0,1,0,0,2", "camera:nan,0,1,0,1,0", "0,0,1,0,1,0"]
)
def test_what_makes_no_picture_is_no_camera(word):
    assert camera_view(word) is None
