"""Files of geometric morphometrics, read back by their rules."""

import numpy as np
import pytest

from homolog.io.morphometrics import write_morphometrics

NAMES = ["heart 1", "heart 2"]
POINTS = np.arange(24, dtype=float).reshape(2, 4, 3) / 7.0


@pytest.fixture
def folder(tmp_path):
    write_morphometrics(tmp_path, NAMES, POINTS, ["HCM", "normal heart"])
    return tmp_path


def numbers(lines):
    return np.array([[float(value) for value in line.split()] for line in lines])


def test_tps_has_a_block_for_each_subject(folder):
    lines = (folder / "particles.tps").read_text().splitlines()
    for name, shape, block in zip(NAMES, POINTS, (lines[:6], lines[6:]), strict=True):
        assert (block[0], block[-1]) == ("LM3=4", f"ID={name}")
        np.testing.assert_array_equal(numbers(block[1:-1]), shape)


def test_nts_has_a_row_for_each_subject(folder):
    comment, head, names, *rows = (folder / "particles.nts").read_text().splitlines()
    assert comment.startswith('"')
    assert (head, names.split()) == ("1 2L 12 0 DIM=3", ["heart_1", "heart_2"])
    np.testing.assert_array_equal(numbers(rows).reshape(POINTS.shape), POINTS)


def test_morphologika_has_sections(folder):
    text = (folder / "particles_morphologika.txt").read_text()
    parts = dict(part.split("]\n", 1) for part in text.split("[")[1:])
    assert [parts[key].split() for key in ("individuals", "landmarks", "dimensions")] == [["2"], ["4"], ["3"]]
    assert (parts["names"].splitlines(), parts["labelvalues"].split()) == (NAMES, ["HCM", "normal_heart"])
    points = [line for line in parts["rawpoints"].splitlines() if not line.startswith("'")]
    np.testing.assert_array_equal(numbers(points).reshape(POINTS.shape), POINTS)


def test_morphologika_has_no_labels_where_a_subject_has_no_group(tmp_path):
    write_morphometrics(tmp_path, NAMES, POINTS, ["HCM", None])
    assert "label" not in (tmp_path / "particles_morphologika.txt").read_text()
