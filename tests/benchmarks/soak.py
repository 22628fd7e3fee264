"""Many runs in one process: memory, threads, files and compute modules must stay as they are.

    python tests/benchmarks/soak.py [--runs 200 --shapes 10 --particles 64] [--trim]

Coffee beans are groomed once; each run reads the files, takes the groomed surfaces from the project, and
makes tables, particles, model and result anew, as a window does that is open for a long day. Prints a row
every tenth run and a verdict: flat is what grows by less than a hundredth from runs 21-30 to the last ten.

*In use* is what the C library has given out and not got back, to the byte: a leak of 100 kB a run is 40 %
of it after 200 runs. *Memory* is what the system counts for the process; beyond what is in use that holds
freed memory in whatever state the library left it, which goes up and down by 10 MB from run to run where
threads have arenas of their own (their tops are never given back). ``--trim`` starts the process with one
arena and gives back what is free before measuring. All this is glibc's, 2.33 or newer.
"""

import argparse
import ctypes
import gc
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import psutil
import warp as wp

from homolog.beans.files import write_beans
from homolog.beans.generate import draw_beans
from homolog.cohort import read_cohort
from homolog.io.project import ProjectFolder
from homolog.run import Run
from homolog.settings import OptimizeSettings, RunSettings

COLUMNS = ("memory MB", "in use MB", "Python blocks", "Python objects", "threads", "files", "modules")
MOST = 0.01  # that anything may grow
_SHORT = {"anneal_iterations": 100, "settle_iterations": 60}
_WARM, _TEN = 20, 10
_ONE_ARENA = {"MALLOC_ARENA_MAX": "1"}


_COUNTS = (
    "arena",
    "ordblks",
    "smblks",
    "hblks",
    "hblkhd",
    "usmblks",
    "fsmblks",
    "uordblks",
    "fordblks",
    "keepcost",
)


class _Malloc(ctypes.Structure):
    """What glibc's mallinfo2 returns."""

    _fields_ = [(name, ctypes.c_size_t) for name in _COUNTS]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--shapes", type=int, default=10)
    parser.add_argument("--particles", type=int, default=64)
    parser.add_argument("--trim", action="store_true", help="one arena, and freed memory given back first")
    options = parser.parse_args()
    if (
        options.trim and not _ONE_ARENA.items() <= os.environ.items()
    ):  # the library reads it once, at its start
        os.execve(sys.executable, [sys.executable, *sys.argv], os.environ | _ONE_ARENA)
    with tempfile.TemporaryDirectory() as name:
        rows = soak(Path(name), options)
    lines, flat = verdict(rows)
    print("\n".join(lines))
    sys.exit(not flat)


def verdict(rows: np.ndarray) -> tuple[list[str], bool]:
    """Return the lines that tell what grew, from what was in use after each run, and whether all is flat."""
    if len(rows) < _WARM + 2 * _TEN:
        raise SystemExit(f"a verdict needs {_WARM + 2 * _TEN} runs or more")
    warm, last = (np.median(part, axis=0) for part in (rows[_WARM : _WARM + _TEN], rows[-_TEN:]))
    growth = last / warm - 1.0
    lines = [
        row_of("", COLUMNS),
        row_of(f"runs {_WARM + 1}-{_WARM + _TEN}", [f"{item:.1f}" for item in warm]),
        row_of("last ten", [f"{item:.1f}" for item in last]),
        row_of("growth %", [f"{100 * item:.2f}" for item in growth]),
    ]
    grown = [name for name, item in zip(COLUMNS, growth, strict=True) if item >= MOST]
    return [*lines, f"NOT flat: {', '.join(grown)}" if grown else "flat"], not grown


def settle_names() -> None:
    """Bring the interpreter's table of interned strings to the size at which it stays.

    Each run has it take up some hundred strings that are dropped again. When all places of the table were
    used once it is laid anew, with room for three times what is in it: a step of 1.8 MB, after 190 runs.
    """
    for number in range(200_000):
        sys.intern(f"a string that is dropped at once {number}")


def soak(folder: Path, options: argparse.Namespace) -> np.ndarray:
    """Do the runs; return what was in use after each, (runs, columns)."""
    write_beans(folder / "beans", draw_beans(options.shapes), 5)
    cohort = read_cohort(folder / "beans")
    settings = RunSettings(optimize=OptimizeSettings(particles=options.particles, **_SHORT), device="cpu")
    settle_names()
    project, began = ProjectFolder(folder / "project"), time.process_time()
    rows = np.empty((options.runs, len(COLUMNS)))  # what is noted takes no further memory
    print(row_of("run", ("CPU s", *COLUMNS)))
    for number in range(1, options.runs + 1):
        Run(project, cohort, settings).execute()
        rows[number - 1] = now = in_use(options.trim)
        if number in (1, options.runs) or number % 10 == 0:
            seconds = time.process_time() - began
            print(row_of(number, (f"{seconds:.0f}", *now)), flush=True)
    return rows


def in_use(trim: bool) -> tuple[float, ...]:
    """Return what this process has in use now, by `COLUMNS`."""
    gc.collect()
    libc = ctypes.CDLL("libc.so.6")
    libc.mallinfo2.restype = _Malloc
    if trim:
        libc.malloc_trim(0)
    process, given = psutil.Process(), libc.mallinfo2()
    return (
        round(process.memory_info().rss / 2**20, 1),
        round((given.uordblks + given.hblkhd) / 2**20, 2),
        sys.getallocatedblocks(),
        len(gc.get_objects()),
        process.num_threads(),
        process.num_fds(),
        sum(len(module.execs) for module in wp._src.context.user_modules.values()),
    )


def row_of(head: object, cells: Sequence[object]) -> str:
    return f"| {head} | {' | '.join(map(str, cells))} |"


if __name__ == "__main__":
    main()
