"""Kinds of faults, stages of a run, and tries with their table; the processes of a program."""

import json
from collections import defaultdict
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import psutil

RUN = ("grooming", "tables", "optimizing", "fitting", "passes", "writing", "pictures")
STAGES = (*RUN, "statistics")
SHARED = ("grooming", "fitting", "passes")
CASES = {
    "kill -9": STAGES, "SIGTERM": STAGES, "full disk": STAGES, "worker killed": SHARED,
    "kill -9, Dask": SHARED, "SIGTERM, Dask": SHARED, "full disk, Dask": SHARED,
    "worker killed, Dask": SHARED, "scheduler killed, Dask": SHARED,
}  # fmt: skip


@dataclass(frozen=True)
class Try:
    """How one try went: ``finished``, ``message`` or ``killed``, or else what went wrong."""

    ended: str
    readable: bool
    equal: bool
    left_over: int
    litter: int


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
            ways.count("finished"), ways.count("message"), sum(not item.readable for item in tries),
            sum(not item.equal for item in tries), sum(item.left_over for item in tries),
            sum(item.litter for item in tries),
        ]  # fmt: skip
        print(f"| {kind} |", " | ".join(map(str, [*counts, *numbers])), "|")
