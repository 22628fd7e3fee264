"""Random label maps and meshes through grooming.

    python tests/benchmarks/random_anatomy.py [--tries 300] [--seed 0] [--kind both] [--only shells ...]
    python tests/benchmarks/random_anatomy.py --again FAMILY SEED

Each is written to a file and groomed with default settings. It ends as a groomed subject that passes every
check (closed, manifold, one piece, one genus for fine and coarse mesh, vertices on the zero level, volume of
the field), or is refused with a reason. Anything else is bad: another exception, a fault, more than 60 s of
processor time.
Prints a row a family for docs/reliability.md, the reasons, and every bad one with its seed.
"""

import argparse
import os
import re
import sys
import tempfile
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "anatomy"))

from trial import Trial, attempt

from anatomy import LABEL_MAPS, MESHES


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--tries", type=int, default=300, help="of each kind")
    parser.add_argument("--seed", type=int, default=0, help="of the first; the next ones follow")
    parser.add_argument("--kind", choices=["label maps", "meshes", "both"], default="both")
    parser.add_argument("--only", nargs="+", choices=[*LABEL_MAPS, *MESHES], help="families")
    parser.add_argument("--most", type=float, help="size of the largest [voxels or vertices]")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--again", nargs=2, metavar=("FAMILY", "SEED"), help="one of them, again")
    options = parser.parse_args()
    if options.again:
        print(one(options.again[0], int(options.again[1]), options.most))
        return
    wanted: list[tuple[str, int]] = []
    for kind, families in (("label maps", LABEL_MAPS), ("meshes", MESHES)):
        names = [name for name in families if not options.only or name in options.only]
        if names and options.kind in (kind, "both"):
            wanted += [(names[n % len(names)], options.seed + n) for n in range(options.tries)]
    done = tried(wanted, options.most, options.processes)
    print_tables(done)
    sys.exit(any(trial.outcome == "bad" for trial in done))


def one(family: str, seed: int, most: float | None) -> Trial:
    with tempfile.TemporaryDirectory(prefix="homolog-anatomy-") as folder:
        return attempt(family, seed, Path(folder), most)


def tried(wanted: list[tuple[str, int]], most: float | None, processes: int) -> list[Trial]:
    """Try all; where a process dies, what was under way is tried again, each in a process of its own."""
    done: list[Trial] = []
    with ProcessPoolExecutor(processes) as pool:
        futures = {pool.submit(one, *each, most): each for each in wanted}
        lost = []
        for future in as_completed(futures):
            try:
                done.append(future.result())
            except BrokenProcessPool:
                lost.append(futures[future])
                continue
            if done[-1].outcome == "bad":
                print(f"bad: {done[-1]}", file=sys.stderr, flush=True)
    for each in lost:
        with ProcessPoolExecutor(1) as pool:
            try:
                done.append(pool.submit(one, *each, most).result())
            except BrokenProcessPool:
                kind = "label map" if each[0] in LABEL_MAPS else "mesh"
                done.append(Trial(kind, *each, "bad", "the process died", float("nan")))
    return done


def print_tables(done: list[Trial]) -> None:
    print("| kind | family | tries | groomed | refused | bad | CPU s, median | CPU s, most |")
    print("|---|---|---|---|---|---|---|---|")
    for families in (LABEL_MAPS, MESHES):
        for family in families:
            print_row(family, [trial for trial in done if trial.family == family])
    print_row("all", done)
    print("\n| of | refused because | tries |\n|---|---|---|")
    reasons = Counter(
        (trial.kind, re.sub(r"[\d.]+(e-?\d+)?", "N", trial.reason))
        for trial in done
        if trial.outcome == "refused"
    )
    for (kind, reason), count in reasons.most_common():
        print(f"| {kind} | {reason} | {count} |")
    for trial in sorted((trial for trial in done if trial.outcome == "bad"), key=lambda item: item.reason):
        print(f'bad: --again "{trial.family}" {trial.seed}: {trial.reason}')


def print_row(family: str, trials: list[Trial]) -> None:
    if trials:
        counts = Counter(trial.outcome for trial in trials)
        seconds = sorted(trial.cpu_s for trial in trials)
        kind = trials[0].kind if family != "all" else ""
        print(
            f"| {kind} | {family} | {len(trials)} | {counts['groomed']} | {counts['refused']} "
            f"| {counts['bad']} | {seconds[len(seconds) // 2]:.2g} | {seconds[-1]:.2g} |"
        )


if __name__ == "__main__":
    main()
