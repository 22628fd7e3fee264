"""Runs killed at random moments, and what is left of them.

    python tests/benchmarks/kill.py [--tries 24 --seed 0]
    python tests/benchmarks/kill.py --long [--tries 6]

A cohort of ellipsoids is run once without disturbance. Then each try runs a copy of the project again in a
process of its own, kills it (SIGKILL) at a random moment of a phase, looks whether the last result can still
be read and how old the newest saved state is, resumes the run and compares every file of its result. Prints a
row a try and a table for docs/reliability.md. The long runs take minutes and are killed when their geodesic
distances have taken more than 2 s, or their optimization more than 30 s.
"""

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from homolog.errors import InputError
from homolog.io.project import ProjectFolder
from homolog.io.results import read_result

PHASES = ("reading", "grooming", "aligning", "geodesics", "splitting", "optimizing", "modeling", "writing")
LATE_S = {"optimizing": 30.0, "geodesics": 2.0}  # of the long runs: when they are killed at the earliest
_COMMON = "--device cpu --workers 1 --alignment center"
_SETTINGS = (
    f"{_COMMON} --particles 128 --mesh-edge 2 --split-iterations 40 --anneal-iterations 200 "
    "--settle-iterations 60"
)
_LONG_SETTINGS = (
    f"{_COMMON} --particles 512 --mesh-edge 0.45 --split-iterations 20 --anneal-iterations 900 "
    "--settle-iterations 60"
)


@dataclass(frozen=True)
class Try:
    """How one try went."""

    phase: str
    readable: bool
    lost_s: float
    equal: bool


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tries", type=int, default=24)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--long", action="store_true", help="kill later than 30 s after a phase began")
    options = parser.parse_args()
    random.seed(options.seed)
    settings, phases = (_LONG_SETTINGS, tuple(LATE_S)) if options.long else (_SETTINGS, PHASES)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_cohort(folder / "scans", 8 if options.long else 4)
        began = time.monotonic()
        spans = dict(follow(start(folder / "scans", "--out", folder / "whole", *settings.split())))
        print(f"undisturbed: {time.monotonic() - began:.0f} s; phases from", spans, flush=True)
        tries = []
        for number in range(options.tries):
            phase = phases[number % len(phases)]
            first = one_try(folder, phase, spans, LATE_S[phase] if options.long else 0.0)
            print(f"try {number + 1}: {first}", flush=True)
            if first.phase != "ended":  # before it could be killed
                tries.append(first)
    print("| killed while | tries | project unreadable | lost at most s | resumed, unlike the whole run |")
    print("|---|---|---|---|---|")
    for phase in (*Counter(item.phase for item in tries), "all"):
        rows = [item for item in tries if phase in (item.phase, "all")]
        bad, unlike = sum(not row.readable for row in rows), sum(not row.equal for row in rows)
        print(f"| {phase} | {len(rows)} | {bad} | {max(first.lost_s for first in rows):.1f} | {unlike} |")
    sys.exit(not all(item.readable and item.equal and item.lost_s <= 30.0 for item in tries))


def start(source: Path, *how: object) -> subprocess.Popen[str]:
    """Start a run of a cohort or project."""
    arguments = [source, *how, "--progress", "json", "--no-figures"]
    return subprocess.Popen(
        [sys.executable, "-m", "homolog_app", "run", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def follow(running: subprocess.Popen[str]) -> Iterator[tuple[str, float]]:
    """Yield each phase that a run enters, and how long it took once the next begins [s]."""
    assert running.stdout is not None
    phase, since = "", time.monotonic()
    for line in running.stdout:
        entered = json.loads(line).get("phase") or "ended"
        if entered != phase:
            if phase:
                yield phase, time.monotonic() - since
            phase, since = entered, time.monotonic()
    assert running.stderr is not None
    if running.wait() != 0:
        raise RuntimeError(running.stderr.read())


def one_try(folder: Path, phase: str, spans: dict[str, float], after: float) -> Try:
    """Kill a new run of the finished project in a phase, so many seconds after it began, and resume it."""
    project, whole = ProjectFolder(folder / "killed"), contents(folder / "whole")
    shutil.rmtree(project.folder, ignore_errors=True)
    shutil.copytree(folder / "whole", project.folder)
    if phase in ("reading", "grooming"):
        for archive in list(project.groomed.glob("*.npz"))[::2]:
            archive.unlink()
    began = time.time()
    reached, killed_at = kill_in(start(project.folder), phase, (after, max(0.5 * spans[phase], after)))
    kept = (project.checkpoint, *project.groomed.glob("*.npz"), *project.geodesics.glob("[!.]*.npz"))
    saved = [item.stat().st_mtime for item in kept if item.is_file()]
    lost = killed_at - max(item for item in (*saved, began) if item <= killed_at)
    readable = is_readable(project)
    dict(follow(start(project.folder, *(["--resume"] if project.read().unfinished else []))))
    return Try(reached, readable, lost, contents(project.folder) == whole)


def kill_in(running: subprocess.Popen[str], phase: str, span: tuple[float, float]) -> tuple[str, float]:
    """Kill a run at a random moment of a phase; return where it was and the time of day."""
    assert running.stdout is not None
    os.set_blocking(running.stdout.fileno(), False)
    reached, at = "", None
    while running.poll() is None:
        for line in running.stdout:
            reached = json.loads(line).get("phase") or "ended"
            if reached == phase and at is None:
                at = time.monotonic() + random.uniform(*span)
        if at is not None and time.monotonic() >= at:
            running.send_signal(signal.SIGKILL)
            break
        time.sleep(0.001)
    running.wait()
    return reached, time.time()


def is_readable(project: ProjectFolder) -> bool:
    """Return whether the project can be opened and shows its last result."""
    try:
        read_result(project)
    except InputError as error:
        print(error)
        return False
    return True


def contents(folder: Path) -> dict[str, bytes]:
    """Return every file of a result by name; without the record, which tells the time of day."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and (path.parent.name in ("particles", "model") or path.name == "energies.csv")
    }


def write_cohort(folder: Path, count: int) -> None:
    """Write some ellipsoids."""
    import SimpleITK

    folder.mkdir()
    grid = np.stack(np.meshgrid(*[np.arange(-19.0, 20.0)] * 3, indexing="ij"))
    for number in range(count):
        axes = np.array([15.0, 12.0, 10.0]) + random.Random(number).random() * np.array([2.0, -2.0, 3.0])
        inside = (np.square(grid) / np.square(axes)[:, None, None, None]).sum(axis=0) <= 1.0
        image = SimpleITK.GetImageFromArray(inside.astype(np.uint8))
        SimpleITK.WriteImage(image, folder / f"shape{number}.nrrd")


if __name__ == "__main__":
    main()
