"""The verdict of benchmarks/soak.py: what grows is told, what goes up and down is not."""

import ctypes
import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

SOAK = Path(__file__).parents[1] / "benchmarks" / "soak.py"


@pytest.fixture(scope="module")
def soak():
    """Return the benchmark as a module."""
    if sys.platform != "linux" or not hasattr(ctypes.CDLL("libc.so.6"), "mallinfo2"):
        pytest.skip("what is in use is counted by glibc 2.33 or newer")
    spec = importlib.util.spec_from_file_location("soak", SOAK)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def rows(soak):
    """Return what 200 runs without a leak may have in use: ± 4 MB from run to run, and a step at run 28."""
    chance = np.random.default_rng(1)
    rows = np.tile([440.0, 45.1, 700_000, 248_060, 3, 7, 16], (200, 1))
    rows[:, 0] += chance.uniform(-4.0, 4.0, len(rows))
    rows[:28, 0] -= 2.0
    rows[:, 1] += chance.uniform(-0.05, 0.05, len(rows))
    return rows


def test_what_goes_up_and_down_is_flat(soak, rows):
    lines, flat = soak.verdict(rows)
    assert (lines[-1], flat) == ("flat", True)


@pytest.mark.parametrize("runs", [60, 200])
@pytest.mark.parametrize(
    ("column", "a_run"), [("in use MB", 0.1), ("Python blocks", 400), ("Python objects", 150), ("files", 0.1)]
)
def test_a_small_leak_is_told_by_name_even_of_sixty_runs(soak, rows, column, a_run, runs):
    rows[:, soak.COLUMNS.index(column)] += a_run * np.arange(len(rows))
    lines, flat = soak.verdict(rows[:runs])
    assert (lines[-1], flat) == (f"NOT flat: {column}", False)


def test_a_leak_of_mapped_memory_is_told(soak, rows):
    rows[:, 0] += 0.1 * np.arange(len(rows))
    assert soak.verdict(rows)[0][-1] == "NOT flat: memory MB"


def test_what_leaks_is_counted_to_the_byte(soak):
    before, kept = soak.in_use(trim=False), []
    for _ in range(30):
        kept.append(bytearray(100_000))  # the C library's
        kept += [str(number) * 20 for number in range(1000, 1500)]  # Python's own
    leaked = dict(zip(soak.COLUMNS, np.subtract(soak.in_use(trim=False), before), strict=True))
    assert leaked["in use MB"] == pytest.approx(30 * 100_000 / 2**20, abs=0.3)
    assert leaked["Python blocks"] == pytest.approx(30 * 500, abs=500)
