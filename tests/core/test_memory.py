"""Memory of the process."""

import subprocess
import sys

import pytest

from homolog.memory import free_memory

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


def test_free_memory_obeys_the_limit_of_a_container(tmp_path, monkeypatch):
    own = tmp_path / "slurm" / "job_7"
    own.mkdir(parents=True)
    for name, text in {
        "memory.max": "max",
        "memory.current": "0",
        "memory.stat": "anon 9\ninactive_file 0",
    }.items():
        (own / name).write_text(text)
    for name, text in {
        "memory.max": "3000",
        "memory.current": "1800",
        "memory.stat": "anon 1000\ninactive_file 500",
    }.items():
        (own.parent / name).write_text(text)
    (tmp_path / "own").write_text("3:cpuset:/\n0::/slurm/job_7\n")
    monkeypatch.setattr("homolog.memory._GROUPS", tmp_path / "own")
    files = (tmp_path, "memory.max", "memory.current", "inactive_file")
    monkeypatch.setattr("homolog.memory._GROUP_FILES", {"": files})
    assert free_memory() == 3000 - 1800 + 500
