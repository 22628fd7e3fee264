"""Workers, schedulers and programs killed, and disks filled, while subjects are groomed and fitted.

    python tests/benchmarks/kill_workers.py [--tries 3 --seed 0] [--only "scheduler"]

A cohort of ellipsoids is run once with a core set. Each try runs a copy of the project again (half of the
subjects groomed anew), does harm at a random moment of a phase, resumes the run if it ended, and compares
every file of the result with the undisturbed run's. Prints a table for docs/reliability.md: how many runs
finished in spite of it, how many ended with a message, results that differ, projects that could not be read,
and processes left over. Full disks are file size limits. Linux only; needs distributed.
"""

import argparse
import json
import os
import random
import resource
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import psutil
from kill import contents, follow, is_readable, start, write_cohort

from homolog.files.project import ProjectFolder

SETTINGS = (
    "--device cpu --alignment center --particles 32 --core-set 4 --mesh-edge 2 --split-iterations 20 "
    "--anneal-iterations 60 --settle-iterations 40 --workers 2"
)
PHASES = ("grooming", "optimizing", "fitting", "writing")
CASES = [
    ("program, processes", PHASES),
    ("worker, processes", ("grooming", "fitting")),
    ("full disk, processes", PHASES),
    ("program, Dask", ("grooming", "fitting")),
    ("worker, Dask", ("grooming", "fitting")),
    ("scheduler, Dask", ("grooming", "fitting")),
]


@dataclass(frozen=True)
class Try:
    """How one try went: ``finished``, ``message`` or ``killed``, or else what went wrong."""

    ended: str
    readable: bool
    equal: bool
    left_over: int


@contextmanager
def cluster() -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Give the address of a scheduler, and the processes of it and of two workers."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    scheduler = [sys.executable, "-m", "dask", "scheduler", "--host", "127.0.0.1", "--port", str(port)]
    parts = [subprocess.Popen([*scheduler, "--no-dashboard"], **quiet)]
    parts += [
        subprocess.Popen([sys.executable, "-m", "homolog_app", "worker", address], **quiet) for _ in range(2)
    ]
    time.sleep(8.0)
    try:
        yield address, parts
    finally:
        for part in parts:
            part.kill()
            part.wait()


def harm(case: str, running: subprocess.Popen[str], parts: list[subprocess.Popen[bytes]]) -> None:
    """Kill or fill what the case says."""
    if case.startswith("program"):
        running.kill()
    elif case.startswith("full disk"):
        psutil.Process(running.pid).rlimit(resource.RLIMIT_FSIZE, (500, 500))
    elif case.startswith("scheduler"):
        parts[0].kill()
    elif parts:
        random.choice(parts[1:]).kill()
    else:
        children = psutil.Process(running.pid).children(recursive=True)
        workers = [child for child in children if "spawn_main" in " ".join(child.cmdline())]
        if workers:
            random.choice(workers).kill()


def one_try(whole: Path, project: ProjectFolder, case: str, phase: str, span: float) -> Try | None:
    """Do harm in a phase and see what is left; None if the phase was over before."""
    shutil.rmtree(project.folder, ignore_errors=True)
    shutil.copytree(whole, project.folder)
    for archive in sorted(project.groomed.glob("*.npz"))[::2]:
        archive.unlink()
    with cluster() if "Dask" in case else no_cluster() as (address, parts):
        running = start(project.folder, *(["--cluster", address] if address else []))
        children: set[psutil.Process] = set()
        assert running.stdout is not None
        os.set_blocking(running.stdout.fileno(), False)
        at, done = None, False
        while running.poll() is None:
            for line in running.stdout:
                if json.loads(line).get("phase") == phase and at is None:
                    at = time.monotonic() + random.uniform(0.0, 0.3 * span)
            if at is not None and not done and time.monotonic() >= at:
                with suppress(psutil.Error):
                    children = set(psutil.Process(running.pid).children(recursive=True))
                    harm(case, running, parts)
                    done = True
            time.sleep(0.002)
        assert running.stderr is not None
        message = running.stderr.read()
    if not done:
        return None
    ended = {0: "finished", -signal.SIGKILL: "killed"}.get(running.returncode, "message")
    if ended == "message" and ("Traceback" in message or "homolog: " not in message):
        ended = f"ended badly: {message[-300:]}"
    time.sleep(3.0)
    left_over = sum(child.is_running() and child.status() != psutil.STATUS_ZOMBIE for child in children)
    readable = is_readable(project)
    if project.read().unfinished:
        with cluster() if "Dask" in case else no_cluster() as (address, _):
            again = start(project.folder, "--resume", *(["--cluster", address] if address else []))
            dict(follow(again))
    return Try(ended, readable, contents(project.folder) == contents(whole), left_over)


@contextmanager
def no_cluster() -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    yield "", []


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tries", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="cases with this word")
    options = parser.parse_args()
    random.seed(options.seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_cohort(folder / "scans", 8)
        began = time.monotonic()
        spans = dict(follow(start(folder / "scans", "--out", folder / "whole", *SETTINGS.split())))
        print(f"undisturbed: {time.monotonic() - began:.0f} s; phases from", spans, flush=True)
        rows: dict[tuple[str, str], list[Try]] = defaultdict(list)
        for _ in range(options.tries):
            for case, phases in CASES:
                for phase in phases if options.only in case else ():
                    went = one_try(
                        folder / "whole", ProjectFolder(folder / "harmed"), case, phase, spans[phase]
                    )
                    print(case, phase, went, flush=True)
                    rows[case, phase] += [] if went is None else [went]
    print("| harm | while | tries | finished all the same | message | unreadable | unlike | processes left |")
    print("|---|---|---|---|---|---|---|---|")
    for (case, phase), tries in rows.items():
        ends = [item.ended for item in tries]
        numbers = [
            len(tries), ends.count("finished"), ends.count("message"),
            sum(not item.readable for item in tries), sum(not item.equal for item in tries),
            sum(item.left_over for item in tries),
        ]  # fmt: skip
        print(f"| {case} | {phase} |", " | ".join(map(str, numbers)), "|")
    every = [item for tries in rows.values() for item in tries]
    sys.exit(any(item.ended.startswith("ended badly") or not item.equal for item in every))


if __name__ == "__main__":
    main()
