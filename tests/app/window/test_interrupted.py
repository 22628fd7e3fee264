"""How far an unfinished run got."""

import os

import numpy as np

from homolog.io.arrays import write_arrays
from homolog_app.window.study_files import interrupted_text


def test_an_unfinished_run_says_how_far_it_got(tmp_path):
    path = tmp_path / "checkpoint.npz"
    stored = {"means": np.zeros((64, 3), np.float32), "iteration": 120, "fraction": 0.688}
    write_arrays(path, stored)
    assert "69 %, with 64 of 256 particles" in interrupted_text(path, 256)
    write_arrays(path, stored | {"means": np.zeros((128, 3), np.float32)})
    os.utime(path, ns=(1, 1))
    assert "128 of 256 particles" in interrupted_text(path, 256)


def test_a_checkpoint_of_an_earlier_version_tells_its_iterations(tmp_path):
    path = tmp_path / "checkpoint.npz"
    write_arrays(path, {"means": np.zeros((64, 3), np.float32), "iteration": 120})
    assert "120 iterations, with 64 of 256 particles" in interrupted_text(path, 256)


def test_a_damaged_checkpoint_is_said_to_be_unreadable(tmp_path):
    path = tmp_path / "checkpoint.npz"
    path.write_bytes(b"nothing")
    assert "can't be read" in interrupted_text(path, 256)
    assert "can't be read" in interrupted_text(tmp_path / "none.npz", 256)
