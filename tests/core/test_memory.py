"""Memory of the process."""

import subprocess
import sys

import pytest

PROGRAM = """
import numpy as np
from homolog.memory import large_arrays_apart, resident_memory

np.ones(4_000_000)  # freed at once, which raises the size from which arrays are returned
kept, freed = [], []
with large_arrays_apart():
    for _ in range(20):
        freed.append(np.ones(400_000))
        kept.append(np.ones(1_000))
before = resident_memory()
freed.clear()
print(before - resident_memory())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the C library of Linux keeps freed memory")
def test_freed_arrays_leave_no_gaps_between_small_ones():
    """In a process of its own, as gaps of earlier tests could hold the arrays."""
    run = subprocess.run([sys.executable, "-c", PROGRAM], check=True, stdout=subprocess.PIPE, text=True)
    assert int(run.stdout) > 55e6
