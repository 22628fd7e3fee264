"""Random label maps and meshes through grooming.

    python tests/benchmarks/random_anatomy.py --from 400000 --to 402000 --workers 16 --minutes 6 --out FILE
    python tests/benchmarks/random_anatomy.py --summary FILE ...
    python tests/benchmarks/random_anatomy.py --again FAMILY SEED

Each seed makes a label map and a mesh, which are written to files and groomed with default settings. A case
ends groomed, as a subject that passes every check (closed, manifold, one piece, one genus for fine and coarse
mesh, vertices on the zero level, volume of the field), or refused with a reason. Anything else is a fault:
slow (more than 60 s of processor time, stopped after 120 at the latest) or bad (another exception, a failed
check, a crash, more than 6 GB). A line of JSON a case is added to FILE. Cases that are in it already are left
out: the same command goes on. The summary is a row a family for docs/reliability.md, the reasons, and every
fault with its seed.
"""

import argparse
import json
import math
import os
import re
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from dataclasses import asdict
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["CUDA_VISIBLE_DEVICES"] = ""  # grooming runs on the CPU
sys.path.insert(0, str(Path(__file__).parents[1] / "anatomy"))

from trial import SLOWEST_S, Trial, attempt

from anatomy import LABEL_MAPS, MESHES

KINDS = {"label map": list(LABEL_MAPS), "mesh": list(MESHES)}
STOPPED_S = 120  # of processor time
LONGEST_S = 1800  # by the clock, for what waits without end; a busy machine is slow
MEMORY = 6 * 2**30  # bytes
Case = tuple[str, int]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--from", dest="first", type=int, default=0, metavar="SEED")
    parser.add_argument("--to", type=int, default=100, metavar="SEED", help="the last is the one before")
    parser.add_argument("--kind", choices=[*KINDS, "both"], default="both")
    parser.add_argument("--only", nargs="+", choices=[*LABEL_MAPS, *MESHES], help="families")
    parser.add_argument("--most", type=float, help="size of the largest [voxels or vertices]")
    parser.add_argument("--workers", type=int, default=1, help="processes, of one thread each")
    parser.add_argument(
        "--minutes",
        type=float,
        default=math.inf,
        help="no case is begun later; the last ends up to 3 min after",
    )
    parser.add_argument("--out", type=Path, help="file to add lines to; a temporary one if not given")
    parser.add_argument("--summary", nargs="+", type=Path, metavar="FILE", help="only print what files hold")
    parser.add_argument("--again", nargs=2, metavar=("FAMILY", "SEED"), help="one of them, again")
    options = parser.parse_args()
    if options.again:
        print(first((options.again[0], int(options.again[1])), options.most))
        return
    if not options.summary:
        out = options.out or Path(tempfile.mkstemp(prefix="anatomy-", suffix=".jsonl")[1])
        done = {(trial.family, trial.seed) for trial in read([out])}
        wanted = []
        for seed in range(options.first, options.to):
            for kind, families in KINDS.items():
                names = [name for name in families if not options.only or name in options.only]
                if names and options.kind in (kind, "both"):
                    wanted.append((names[seed % len(names)], seed))
        wanted = [case for case in wanted if case not in done]
        left = run_series(wanted, out, options)
        print(f"{len(done) + len(wanted) - left} cases in {out}, {left} left")
    trials = read(options.summary or [out])
    print_tables(trials)
    sys.exit(any(trial.outcome in ("bad", "slow") for trial in trials))


def first(case: Case, most: float | None) -> Trial:
    with tempfile.TemporaryDirectory(prefix="homolog-anatomy-") as folder:
        return attempt(*case, Path(folder), most)


def run_series(wanted: list[Case], out: Path, options: argparse.Namespace) -> int:
    """Try cases, each in a process of its own, and return how many were not begun."""
    end = time.monotonic() + 60.0 * options.minutes
    for family in (*LABEL_MAPS, *MESHES):  # kernels are compiled once, and loaded before processes fork
        attempt(family, 0, Path(tempfile.gettempdir()), 200.0, edges=12, nodes=40)
    waiting, running = wanted[::-1], dict[int, Case]()
    while running or (waiting and time.monotonic() < end):
        if waiting and len(running) < options.workers and time.monotonic() < end:
            case = waiting.pop()
            running[begun(case, out, options.most)] = case
            continue
        pid, status, usage = os.wait4(-1, 0)
        case = running.pop(pid)
        if status:
            seconds = usage.ru_utime + usage.ru_stime
            slow = seconds > SLOWEST_S
            reason = f"stopped after {seconds:.0f} s" if slow else f"the process ended with {status}"
            add(out, Trial(kind_of(case[0]), *case, "slow" if slow else "bad", reason, seconds))
    return len(waiting)


def begun(case: Case, out: Path, most: float | None) -> int:
    """Try a case in a new process, within limits, and return the process's number."""
    sys.stdout.flush()
    if pid := os.fork():
        return pid
    try:
        resource.setrlimit(resource.RLIMIT_CPU, (STOPPED_S, STOPPED_S + 5))
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
        signal.alarm(LONGEST_S)
        add(out, first(case, most))
        os._exit(0)
    except BaseException:  # noqa: BLE001 - the parent process must not go on twice
        traceback.print_exc()
    os._exit(1)


def kind_of(family: str) -> str:
    return "label map" if family in LABEL_MAPS else "mesh"


def add(out: Path, trial: Trial) -> None:
    """Add a line to a file that several processes write to."""
    line = (json.dumps(asdict(trial)) + "\n").encode()
    file = os.open(out, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
    os.write(file, line)
    os.close(file)


def read(files: list[Path]) -> list[Trial]:
    lines = [line for file in files if file.exists() for line in file.read_text().splitlines()]
    trials = [Trial(**json.loads(line)) for line in lines]
    return list({(trial.family, trial.seed): trial for trial in trials}.values())


def print_tables(done: list[Trial]) -> None:
    print("| kind | family | tries | groomed | refused | slow | bad | CPU s, median | CPU s, most |")
    print("|---|---|---|---|---|---|---|---|---|")
    for kind, families in KINDS.items():
        for family in families:
            print_row(kind, family, [trial for trial in done if trial.family == family])
        print_row(kind, "all", [trial for trial in done if trial.kind == kind])
    print("\n| of | refused because | tries |\n|---|---|---|")
    reasons = Counter(
        (trial.kind, re.sub(r"[\d.]+(e-?\d+)?", "N", trial.reason))
        for trial in done
        if trial.outcome == "refused"
    )
    for (kind, reason), count in reasons.most_common():
        print(f"| {kind} | {reason} | {count} |")
    faults = [trial for trial in done if trial.outcome in ("bad", "slow")]
    for trial in sorted(faults, key=lambda item: (item.outcome, item.reason)):
        print(f'{trial.outcome}: --again "{trial.family}" {trial.seed}: {trial.reason}')


def print_row(kind: str, family: str, trials: list[Trial]) -> None:
    if trials:
        counts = Counter(trial.outcome for trial in trials)
        seconds = sorted(trial.cpu_s for trial in trials)
        numbers = " | ".join(str(counts[outcome]) for outcome in ("groomed", "refused", "slow", "bad"))
        times = f"{seconds[len(seconds) // 2]:.2g} | {seconds[-1]:.2g}"
        print(f"| {kind} | {family} | {len(trials)} | {numbers} | {times} |")


if __name__ == "__main__":
    main()
