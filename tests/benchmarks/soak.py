"""Many runs in one process: memory, threads, files and compute modules must stay as they are.

    python tests/benchmarks/soak.py [--runs 200 --shapes 10 --particles 64]

Coffee beans are groomed once; each run reads the files, takes the groomed surfaces from the project, and
makes tables, particles, model and result anew, as a window does that is open for a long day. Prints a row
every tenth run and a verdict: flat is what grows by less than a hundredth between run 20 and the end.
"""

import argparse
import ctypes
import gc
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil
import warp as wp

from homolog.beans.files import write_beans
from homolog.beans.generate import draw_beans
from homolog.cohort import read_cohort
from homolog.files.project import Project
from homolog.run import Run
from homolog.settings import OptimizeSettings, RunSettings

COLUMNS = ("memory MB", "threads", "files", "modules", "objects")
_SHORT = {"anneal_iterations": 100, "settle_iterations": 60}
_WARM = 20


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--shapes", type=int, default=10)
    parser.add_argument("--particles", type=int, default=64)
    parser.add_argument("--trim", action="store_true", help="give freed memory back first (glibc only)")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        rows = soak(Path(name), options)
    warm, last = (np.median(part, axis=0) for part in (rows[_WARM : _WARM + 10], rows[-10:]))
    growth = last / warm - 1.0
    print("| | " + " | ".join(COLUMNS) + " |")
    print(f"| runs {_WARM + 1}-{_WARM + 10} | " + " | ".join(f"{one:.0f}" for one in warm) + " |")
    print("| last ten | " + " | ".join(f"{one:.0f}" for one in last) + " |")
    print("| growth % | " + " | ".join(f"{100 * one:.2f}" for one in growth) + " |")
    print("flat" if (growth < 0.01).all() else "NOT flat")
    sys.exit(bool((growth >= 0.01).any()))


def soak(folder: Path, options: argparse.Namespace) -> np.ndarray:
    """Do the runs; return what was in use after each, (runs, columns)."""
    write_beans(folder / "beans", draw_beans(options.shapes), 5)
    cohort = read_cohort(folder / "beans")
    settings = RunSettings(optimize=OptimizeSettings(particles=options.particles, **_SHORT), device="cpu")
    project, rows, began = Project(folder / "project"), [], time.process_time()
    libc = ctypes.CDLL("libc.so.6") if options.trim else None
    print("| run | CPU s | " + " | ".join(COLUMNS) + " |")
    for number in range(1, options.runs + 1):
        Run(project, cohort, settings).execute()
        rows.append(in_use(libc))
        if number in (1, options.runs) or number % 10 == 0:
            seconds = time.process_time() - began
            print(f"| {number} | {seconds:.0f} | " + " | ".join(map(str, rows[-1])) + " |", flush=True)
    return np.array(rows, dtype=float)


def in_use(libc: ctypes.CDLL | None) -> tuple[int, ...]:
    """Return what this process has in use now, after giving back what is free if a library is given."""
    gc.collect()
    if libc is not None:
        libc.malloc_trim(0)
    process = psutil.Process()
    modules = sum(len(module.execs) for module in wp._src.context.user_modules.values())
    memory = process.memory_info().rss // 2**20
    return memory, process.num_threads(), process.num_fds(), modules, len(gc.get_objects())


if __name__ == "__main__":
    main()
