"""Films as files, decoded again."""

import numpy as np
import pytest
from PIL import Image

from homolog.errors import Cancelled, InputError
from homolog_app.exports.film import Film
from homolog_app.exports.pictures import write_film, write_still
from homolog_app.exports.settings import FilmSettings

SETTINGS = FilmSettings(width=480, height=320, seconds=1.0, fps=20)


@pytest.fixture
def draw(bulging):
    film = Film([bulging], ["anterior"], SETTINGS)
    return lambda index: film.moment(index, SETTINGS)


@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
def test_a_film_decodes_to_what_was_drawn(draw, tmp_path, decode, suffix):
    path = tmp_path / f"mode{suffix}"
    write_film(path, draw, SETTINGS.frames, SETTINGS.fps)
    facts, frames = decode(path)
    assert frames.shape == (20, 320, 480, 3)
    assert "480x320" in facts
    assert " 20 fps" in facts
    assert "Duration: 00:00:01.00" in facts
    for index in (0, 7, 19):
        difference = np.abs(frames[index] - draw(index)[..., :3]).mean()
        assert difference < 3.0, index
    assert [item.name for item in tmp_path.iterdir()] == [path.name]
    if suffix == ".mp4":
        assert "h264" in facts
        assert "yuv420p" in facts


def test_the_same_film_is_the_same_file(draw, tmp_path):
    for name in ("a.mp4", "b.mp4"):
        write_film(tmp_path / name, draw, 5, 25)
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()


def test_a_series_is_a_folder_of_numbered_pictures(draw, tmp_path):
    write_film(tmp_path / "series", draw, 12, 25)
    names = sorted(path.name for path in (tmp_path / "series").iterdir())
    assert names == [f"{number:02d}.png" for number in range(1, 13)]
    stored = np.asarray(Image.open(tmp_path / "series" / "05.png"))
    np.testing.assert_array_equal(stored, draw(4)[..., :3])
    with pytest.raises(InputError, match="already exists"):
        write_film(tmp_path / "series", draw, 12, 25)


@pytest.mark.parametrize("name", ["film.mp4", "film.gif", "film"])
def test_a_cancelled_film_leaves_what_was_there_and_nothing_else(draw, tmp_path, name):
    def tick(fraction, message):
        if fraction > 0.3:
            raise Cancelled

    path = tmp_path / name
    if path.suffix:
        path.write_bytes(b"before")
    with pytest.raises(Cancelled):
        write_film(path, draw, 10, 25, tick)
    assert [item.name for item in tmp_path.iterdir()] == ([name] if path.suffix else [])
    assert not path.suffix or path.read_bytes() == b"before"


def test_other_kinds_of_files_are_refused(draw, tmp_path):
    with pytest.raises(InputError, match=r"use \.mp4 or \.gif"):
        write_film(tmp_path / "film.avi", draw, 2, 25)
    with pytest.raises(InputError, match=r"written as \.png"):
        write_still(tmp_path / "still.jpg", draw(0))


def test_a_still_is_stored_as_it_was_drawn(draw, tmp_path):
    write_still(tmp_path / "still.png", draw(3))
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "still.png")), draw(3)[..., :3])
