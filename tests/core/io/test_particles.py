import numpy as np
import pytest

from homolog.errors import InputError
from homolog.io.particles import read_particles, write_particles


def test_particles_come_back_bit_for_bit(tmp_path):
    points = np.random.default_rng(1).normal(scale=100.0, size=(64, 3))
    points[0] = [1.0 / 3.0, -1e-17, 5e-324]
    write_particles(tmp_path / "a.particles", points)
    assert np.array_equal(read_particles(tmp_path / "a.particles"), points)


def test_a_file_is_one_point_a_line_without_header(tmp_path):
    write_particles(tmp_path / "a.particles", np.array([[1.0, 2.5, -3.0], [0.0, 0.1, 1e300]]))
    assert (tmp_path / "a.particles").read_text() == "1.0 2.5 -3.0\n0.0 0.1 1e+300\n"


def test_empty_lines_and_a_mark_of_the_encoding_are_passed_over(tmp_path):
    (tmp_path / "a.particles").write_text("\ufeff\n1 2 3\n\n  \n4 5 6\r\n\n", encoding="utf-8")
    assert read_particles(tmp_path / "a.particles").tolist() == [[1, 2, 3], [4, 5, 6]]


def test_reading_stops_at_the_first_line_that_is_no_number(tmp_path):
    (tmp_path / "a.particles").write_text("1 2 3\n4 5 6\n# end\n7 8 9\n")
    assert read_particles(tmp_path / "a.particles").tolist() == [[1, 2, 3], [4, 5, 6]]


@pytest.mark.parametrize(
    "text",
    [
        "1.5,2,-3\n4,5,6e0\n",
        "1.5, 2, -3\n4, 5, 6\n",
        "1,5 2,0 -3,0\n4,0 5,0 6,0\n",
        "1.5;2;-3\n4;5;6\n",
        "1,5;2,0;-3,0\n4,0;5,0;6,0\n",
        "x,y,z\n1.5,2,-3\n4,5,6\n",
    ],
)
def test_commas_stand_between_numbers_or_for_their_points(tmp_path, text):
    (tmp_path / "a.wpts").write_text(text)
    assert read_particles(tmp_path / "a.wpts").tolist() == [[1.5, 2, -3], [4, 5, 6]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,2\n", "line 1"),
        ("", "contains no particles"),
        ("x y z\n", "contains no particles"),
        ("1 2 3\n4 5\n", "line 2"),
        ("1 2 3 4\n", "line 1"),
        ("1 2 nan\n", "not finite"),
        ("1 2 abc\n", "line 1"),
        ("1 2 3\n1 2 \n", "line 2"),
        ("1 2 3\n1 2 3_0\n", "line 2"),
    ],
)
def test_a_bad_file_is_refused_with_its_name_and_line(tmp_path, text, message):
    path = tmp_path / "bad.particles"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read_particles(path)
    assert str(path) in str(caught.value)


def test_bytes_that_are_no_text_and_missing_files_are_input_errors(tmp_path):
    (tmp_path / "a.particles").write_bytes(b"\xff\xfe\x00")
    for name in ("a.particles", "missing.particles"):
        with pytest.raises(InputError, match=name):
            read_particles(tmp_path / name)
