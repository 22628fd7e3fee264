import pickle

import numpy as np
import pytest

from homolog.errors import InputError
from homolog.io.arrays import read_arrays, write_arrays


def test_arrays_numbers_and_texts_come_back(tmp_path):
    path = tmp_path / "a.npz"
    write_arrays(path, {"points": np.eye(3), "count": 3, "name": "Ä"})
    stored = read_arrays(path)
    assert np.array_equal(stored["points"], np.eye(3))
    assert not stored["points"].flags.writeable
    assert (stored["count"].item(), str(stored["name"])) == (3, "Ä")


def test_objects_are_neither_written_nor_read(tmp_path):
    with pytest.raises(ValueError, match="allow_pickle"):
        write_arrays(tmp_path / "a.npz", {"object": np.array([{}], dtype=object)})
    assert list(tmp_path.iterdir()) == []
    np.savez(tmp_path / "b.npz", object=np.array([{}], dtype=object))
    with pytest.raises(InputError, match="damaged"):
        read_arrays(tmp_path / "b.npz")


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 nonsense", pickle.dumps({"a": 1}), b"\x93NUMPY"])
def test_a_damaged_file_is_refused(tmp_path, content):
    path = tmp_path / "a.npz"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"cut off|damaged"):
        read_arrays(path)


def test_a_lone_array_is_refused(tmp_path):
    path = tmp_path / "a.npz"
    with path.open("wb") as stream:
        np.save(stream, np.eye(3))
    with pytest.raises(InputError, match=r"cut off|damaged"):
        read_arrays(path)


def test_a_file_cut_short_is_refused(tmp_path):
    path = tmp_path / "a.npz"
    write_arrays(path, {"points": np.random.default_rng(0).normal(size=(1000, 3))})
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(InputError, match=r"cut off|damaged"):
        read_arrays(path)
