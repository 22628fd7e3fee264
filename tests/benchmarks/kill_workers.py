"""Workers, schedulers and programs killed, and disks filled, while subjects are groomed and fitted.

    python tests/benchmarks/kill_workers.py [--tries 20 --seed 0] [--only "scheduler"]

A cohort of ellipsoids is run once with a core set. Each try runs a copy of the project again (half of the
subjects groomed anew) and does harm at a random moment of a phase. A run that ended is resumed with another
executor and number of workers (one process, three processes, two Dask workers), killed again at a random
moment, and resumed with a third. Every file of the result is compared with the undisturbed run's. Phases
take turns, until each kind of harm has its tries. Prints a table for docs/reliability.md: how many runs
finished in spite of it, how many ended with a message, how many resumed runs were killed, results that
differ, projects that could not be read, and processes left over. Full disks are file size limits. Linux
only; needs distributed.
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
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import psutil
from distributed import Client
from kill import contents, follow, is_readable, start, write_cohort

from homolog.files.project import ProjectFolder

SETTINGS = (
    "--device cpu --alignment center --particles 16 --core-set 3 --mesh-edge 3 --split-iterations 20 "
    "--anneal-iterations 60 --settle-iterations 40 --workers 2"
)
PHASES = ("grooming", "optimizing", "fitting", "writing")
CASES = [
    ("program, processes", PHASES),
    ("worker, processes", ("grooming", "fitting")),
    ("full disk, processes", PHASES),
    ("program, Dask", PHASES),
    ("worker, Dask", ("grooming", "fitting")),
    ("scheduler, Dask", ("grooming", "fitting")),
]


@dataclass(frozen=True)
class Try:
    """How one try went: ``finished``, ``message`` or ``killed``, or else what went wrong."""

    ended: str
    killed_again: bool
    readable: bool
    equal: bool
    left_over: int


class Cluster:
    """A scheduler and two workers, of which those that were killed are started again."""

    def __init__(self) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{port}"
        scheduler = [sys.executable, "-m", "dask", "scheduler", "--host", "127.0.0.1", "--port", str(port)]
        worker = [sys.executable, "-m", "homolog_app", "worker", self.address]
        self._commands = [[*scheduler, "--no-dashboard"], worker, worker]
        self.parts: list[subprocess.Popen[bytes]] = []

    def start(self) -> None:
        """Start what does not run, and wait for both workers."""
        if self.parts and all(part.poll() is None for part in self.parts):
            return
        if self.parts and self.parts[0].poll() is not None:
            self.end()  # workers of a lost scheduler end too, some time
        if not self.parts:
            self.parts = [self._started(self._commands[0])]
        with Client(self.address, timeout=300, set_as_default=False) as client:
            running = [part for part in self.parts if part.poll() is None]
            self.parts = running + [self._started(command) for command in self._commands[len(running) :]]
            client.wait_for_workers(2, timeout=300)

    def end(self) -> None:
        """Kill all, with the processes that workers have started."""
        for part in self.parts:
            with suppress(psutil.Error):
                for child in psutil.Process(part.pid).children(recursive=True):
                    child.kill()
            part.kill()
            part.wait()
        self.parts = []

    @staticmethod
    def _started(command: list[str]) -> subprocess.Popen[bytes]:
        return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def harm(case: str, running: subprocess.Popen[str], cluster: Cluster | None) -> None:
    """Kill or fill what the case says."""
    if case.startswith("program"):
        running.kill()
    elif case.startswith("full disk"):
        psutil.Process(running.pid).rlimit(resource.RLIMIT_FSIZE, (500, 500))
    elif cluster is not None:
        cluster.parts[0].kill() if case.startswith("scheduler") else random.choice(cluster.parts[1:]).kill()
    else:
        children = psutil.Process(running.pid).children(recursive=True)
        workers = [child for child in children if "spawn_main" in " ".join(child.cmdline())]
        if workers:
            random.choice(workers).kill()


def run_harmed(
    project: ProjectFolder, case: str, phase: str, span: float, cluster: Cluster | None
) -> tuple[int, str, set[psutil.Process]] | None:
    """Run a project and do harm in a phase; return code, messages, and processes that the program had."""
    running = start(project.folder, *([] if cluster is None else ["--cluster", cluster.address]))
    children: set[psutil.Process] = set()
    assert running.stdout is not None
    assert running.stderr is not None
    os.set_blocking(running.stdout.fileno(), False)
    at, done = None, False
    while running.poll() is None:
        for line in running.stdout:
            if json.loads(line).get("phase") == phase and at is None:
                at = time.monotonic() + random.uniform(0.0, 0.3 * span)
        if at is not None and not done and time.monotonic() >= at:
            children = family(running)
            with suppress(psutil.Error):
                harm(case, running, cluster)
                done = True
        time.sleep(0.002)
    return (running.returncode, running.stderr.read(), children) if done else None


def family(process: subprocess.Popen[str]) -> set[psutil.Process]:
    """Return the processes that a program has started."""
    with suppress(psutil.Error):
        return set(psutil.Process(process.pid).children(recursive=True))
    return set()


def left_over(children: set[psutil.Process]) -> int:
    """Return how many processes of an ended program still run after 3 s."""
    _, alive = psutil.wait_procs(children, timeout=3.0)
    return sum(item.is_running() and item.status() != psutil.STATUS_ZOMBIE for item in alive)


def resume(project: ProjectFolder, cluster: Cluster, whole_s: float) -> tuple[bool, int]:
    """Resume a run in one way, kill it, and resume it in another; whether it was killed, processes left."""
    ways = [("none", "1"), ("none", "3"), (cluster.address, "2")]
    (first, some), (second, others) = random.sample(ways, 2)
    cluster.start()
    resumed = start(project.folder, "--resume", "--cluster", first, "--workers", some)
    wait_until = time.monotonic() + random.uniform(0.5, whole_s)
    children: set[psutil.Process] = set()
    while resumed.poll() is None and time.monotonic() < wait_until:
        children |= family(resumed)
        time.sleep(0.05)
    resumed.kill()
    resumed.communicate()
    remaining = left_over(children)
    if not project.read().unfinished:
        return False, remaining
    dict(follow(start(project.folder, "--resume", "--cluster", second, "--workers", others)))
    return True, remaining


def one_try(
    whole: Path,
    project: ProjectFolder,
    case: str,
    phase: str,
    spans: dict[str, float],
    cluster: Cluster,
) -> Try | None:
    """Do harm in a phase and see what is left; None if the phase was over before."""
    shutil.rmtree(project.folder, ignore_errors=True)
    shutil.copytree(whole, project.folder)
    for archive in sorted(project.groomed.glob("*.npz"))[::2]:
        archive.unlink()
    used = cluster if "Dask" in case else None
    if used is not None:
        used.start()
    harmed = run_harmed(project, case, phase, spans[phase], used)
    if harmed is None:
        return None
    code, message, children = harmed
    ended = {0: "finished", -signal.SIGKILL: "killed"}.get(code, "message")
    if ended == "message" and ("Traceback" in message or "homolog: " not in message):
        ended = f"ended badly: {message[-300:]}"
    remaining, readable, again = left_over(children), is_readable(project), False
    if project.read().unfinished:
        again, more = resume(project, cluster, sum(spans.values()))
        remaining += more
    return Try(ended, again, readable, contents(project.folder) == contents(whole), remaining)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tries", type=int, default=20, help="of each kind of harm")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="cases with this word")
    options = parser.parse_args()
    random.seed(options.seed)
    rows: dict[tuple[str, str], list[Try]] = defaultdict(list)
    cluster, chosen = Cluster(), [item for item in CASES if options.only in item[0]]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_cohort(folder / "scans", 6)
        began = time.monotonic()
        spans = dict(follow(start(folder / "scans", "--out", folder / "whole", *SETTINGS.split())))
        print(f"undisturbed: {time.monotonic() - began:.0f} s; phases from", spans, flush=True)
        try:
            for number in range(options.tries):
                for case, phases in chosen:
                    phase = phases[number % len(phases)]
                    went = one_try(
                        folder / "whole", ProjectFolder(folder / "harmed"), case, phase, spans, cluster
                    )
                    print(case, phase, went, flush=True)
                    rows[case, phase] += [] if went is None else [went]
        finally:
            cluster.end()
    print(
        "| harm | while | tries | finished | message | killed again | unreadable | unlike | processes left |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for (case, phase), tries in rows.items():
        ends = [item.ended for item in tries]
        numbers = [
            len(tries), ends.count("finished"), ends.count("message"),
            sum(item.killed_again for item in tries), sum(not item.readable for item in tries),
            sum(not item.equal for item in tries),
            sum(item.left_over for item in tries),
        ]  # fmt: skip
        print(f"| {case} | {phase} |", " | ".join(map(str, numbers)), "|")
    every = [item for tries in rows.values() for item in tries]
    sys.exit(any(item.ended.startswith("ended badly") or not item.equal for item in every))


if __name__ == "__main__":
    main()
