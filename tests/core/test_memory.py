"""Memory of the process."""

import sys

import numpy as np
import pytest

from homolog.memory import large_arrays_apart, resident_memory


@pytest.mark.skipif(sys.platform != "linux", reason="the C library of Linux keeps freed memory")
def test_freed_arrays_leave_no_gaps_between_small_ones():
    np.ones(4_000_000)  # freed at once, which raises the size from which arrays are returned
    kept, freed = [], []
    with large_arrays_apart():
        for _ in range(20):
            freed.append(np.ones(400_000))
            kept.append(np.ones(1_000))
    before = resident_memory()
    freed.clear()
    assert before - resident_memory() > 55e6
    assert len(kept) == 20
