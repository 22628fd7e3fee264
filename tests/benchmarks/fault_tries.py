"""Kinds of faults, stages of a run, tries with their table; processes of programs and clusters."""

import json
import socket
import subprocess
import sys
from collections import defaultdict
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import psutil
from distributed import Client

RUN = ("grooming", "tables", "optimizing", "fitting", "passes", "writing", "pictures")
STAGES = (*RUN, "statistics")
SHARED = ("grooming", "fitting", "passes")
CASES = {
    "kill -9": STAGES,
    "SIGTERM": STAGES,
    "full disk": STAGES,
    "worker killed": SHARED,
    "kill -9, Dask": SHARED,
    "SIGTERM, Dask": SHARED,
    "full disk, Dask": SHARED,
    "worker killed, Dask": SHARED,
    "scheduler killed, Dask": SHARED,
}


@dataclass(frozen=True)
class Try:
    """How one try went: ``finished``, ``message`` or ``killed``, or else what went wrong."""

    ended: str
    readable: bool
    equal: bool
    left_over: int
    litter: int


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


def family(pid: int) -> set[psutil.Process]:
    """Return the processes that a program has started."""
    with suppress(psutil.Error):
        return set(psutil.Process(pid).children(recursive=True))
    return set()


def left_over(children: set[psutil.Process]) -> int:
    """Return how many processes of an ended program still run after a minute; print them."""
    _, alive = psutil.wait_procs(children, timeout=60.0)
    left = [item for item in alive if item.is_running() and item.status() != psutil.STATUS_ZOMBIE]
    for item in left:
        with suppress(psutil.Error):
            print("left:", item.pid, item.status(), item.cmdline(), flush=True)
    return len(left)


def is_worker(process: psutil.Process) -> bool:
    """Return whether a process grooms or fits: the server of processes has forked it."""
    with suppress(psutil.Error):
        parent = process.parent()
        return parent is not None and "forkserver" in " ".join(parent.cmdline())
    return False


def read_log(path: Path) -> dict[tuple[str, str], list[Try]]:
    """Return the tries of earlier calls by kind and stage."""
    rows: dict[tuple[str, str], list[Try]] = defaultdict(list)
    if path.is_file():
        for item in map(json.loads, path.read_text().splitlines()):
            rows[item.pop("kind"), item.pop("stage")].append(Try(**item))
    return rows


def print_table(rows: dict[tuple[str, str], list[Try]]) -> None:
    """Print numbers of tries by kind and stage, and how those of each kind went."""
    ends = ["finished", "message", "unreadable", "unlike", "processes left", "folders left"]
    heads = ["fault", *STAGES, *ends]
    print("|", " | ".join(heads), "|")
    print("|" + "---|" * len(heads))
    for kind in CASES:
        tries = [item for stage in STAGES for item in rows.get((kind, stage), [])]
        counts = [len(rows[kind, stage]) if (kind, stage) in rows else "–" for stage in STAGES]
        ways = [item.ended for item in tries]
        numbers = [
            ways.count("finished"),
            ways.count("message"),
            sum(not item.readable for item in tries),
            sum(not item.equal for item in tries),
            sum(item.left_over for item in tries),
            sum(item.litter for item in tries),
        ]
        print(f"| {kind} |", " | ".join(map(str, [*counts, *numbers])), "|")
