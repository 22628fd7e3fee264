"""Several programs at once that all find the compute kernels not yet compiled.

    python tests/benchmarks/cold_start.py [--programs 4 --rounds 5]

Each round starts that many short runs together with one empty kernel cache. Prints a row for
docs/reliability.md; a program that ends badly is told with its exit code and last words.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

_SETTINGS = (
    "--device cpu --workers 1 --particles 32 --split-iterations 5 --anneal-iterations 10 "
    "--settle-iterations 10 --mesh-edge 2 --progress none --no-figures"
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--programs", type=int, default=4)
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    began, bad = time.monotonic(), 0
    for number in range(options.rounds):
        with tempfile.TemporaryDirectory() as folder:
            bad += one_round(Path(folder), options.programs)
        print(f"round {number + 1}: {bad} of {(number + 1) * options.programs} ended badly", flush=True)
    print("| programs at once | rounds | ended badly | seconds |")
    print(f"| {options.programs} | {options.rounds} | {bad} | {time.monotonic() - began:.0f} |")
    sys.exit(bad > 0)


def one_round(folder: Path, programs: int) -> int:
    """Start programs together on their own projects; return how many did not end well."""
    write_cohort(folder / "scans")
    around = os.environ | {"WARP_CACHE_PATH": str(folder / "cache"), "PYTHONFAULTHANDLER": "1"}
    started = [
        subprocess.Popen(
            [
                sys.executable,
                "-m",
                "homolog_app",
                "run",
                str(folder / "scans"),
                "--out",
                str(folder / f"project{index}"),
                *_SETTINGS.split(),
            ],
            env=around,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        for index in range(programs)
    ]
    bad = 0
    for item in started:
        message = item.communicate()[1]
        if item.returncode != 0:
            bad += 1
            print(f"exit code {item.returncode}: {message[-2000:]}", flush=True)
    return bad


def write_cohort(folder: Path) -> None:
    """Write three ellipsoids."""
    import SimpleITK

    folder.mkdir()
    grid = np.stack(np.meshgrid(*[np.arange(-11.0, 12.0)] * 3, indexing="ij"))
    for name, axes in (("a", (9, 7, 6)), ("b", (10, 7, 5)), ("c", (8, 7.5, 6))):
        inside = (np.square(grid) / np.square(axes)[:, None, None, None]).sum(axis=0) <= 1.0
        SimpleITK.WriteImage(SimpleITK.GetImageFromArray(inside.astype(np.uint8)), folder / f"{name}.nrrd")


if __name__ == "__main__":
    main()
