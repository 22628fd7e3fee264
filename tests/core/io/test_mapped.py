import time

import numpy as np
import pytest

from homolog.io.mapped import MappedArrays, mapped_within
from homolog.memory import in_memory, resident_memory


@pytest.fixture
def arrays(tmp_path):
    made = MappedArrays(tmp_path, budget=2**50)
    yield made
    made.close()


def test_arrays_keep_values_kind_and_shape(arrays):
    given = [np.arange(6.0).reshape(2, 3), np.array([], np.uint16), np.arange(5, dtype=np.uint16)[::2]]
    placed = [arrays(array) for array in given]
    arrays.release_pages()
    for array, place in zip(given, placed, strict=True):
        assert (place.dtype, place.shape, place.tolist()) == (array.dtype, array.shape, array.tolist())


def test_pages_given_back_are_no_memory_of_the_process(arrays):
    placed = arrays(np.ones(2**23))
    before = resident_memory()
    arrays.release_pages()
    assert before - resident_memory() > 0.9 * placed.nbytes
    assert placed.sum() == len(placed)


def test_pages_are_given_back_beyond_the_budget(tmp_path):
    with mapped_within(tmp_path, 0.1) as store:
        ones = np.ones(2**23)
        before = resident_memory()
        placed = store(ones)
        ends = time.monotonic() + 10.0
        while resident_memory() - before > 0.1 * placed.nbytes:
            assert time.monotonic() < ends
            time.sleep(0.005)


def test_files_have_no_name_and_no_budget_means_memory(tmp_path):
    array = np.ones(3)
    with mapped_within(tmp_path, 1.0) as store:
        assert store(array) is not array
        assert list(tmp_path.iterdir()) == []
    with mapped_within(tmp_path, None) as store:
        assert store is in_memory
