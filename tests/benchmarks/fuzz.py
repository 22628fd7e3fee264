"""Every reader, with files that were changed at random.

    python tests/benchmarks/fuzz.py [--examples 2000] [--seed 0] [--only cohort.csv ...]
    python tests/benchmarks/fuzz.py --engine atheris --seconds 60 [--only ...]

Each reader is tried in a process of its own. Whatever is neither read nor refused by an `InputError`, takes
more than five seconds or a gigabyte, writes outside its folder, runs code or ends the process is told, and
its file kept in the folder that is named then. Prints a row a reader for docs/reliability.md. Atheris
(``pip install atheris``) is guided by the program's branches; it knows the readers written in Python only.
"""

import argparse
import os
import random
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

LARGEST = 2**30  # bytes that a reader may ask for beyond what the process has
FUZZ = Path(__file__).parents[1] / "fuzz"
sys.path.insert(0, str(FUZZ))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--examples", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+")
    parser.add_argument("--engine", choices=["random", "atheris"], default="random")
    parser.add_argument("--seconds", type=int, default=60, help="for each reader, of atheris")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        (follow_branches if options.engine == "atheris" else change_at_random)(options)
        return
    from targets import NATIVE, TARGETS

    names = options.only or [*TARGETS, *(NATIVE if options.engine == "random" else ())]
    kept = Path(tempfile.mkdtemp(prefix="homolog-fuzz-"))
    print("| reader | tries | read | refused | slowest CPU s | memory MB | bad |")
    print("|---|---|---|---|---|---|---|", flush=True)
    bad = [name for name in names if not one_reader(name, kept)]
    print(f"bad: {', '.join(bad)}; their files are in {kept}" if bad else "none bad")
    sys.exit(bool(bad))


def one_reader(name: str, kept: Path) -> bool:
    """Try a reader in a process of its own; return whether nothing bad happened."""
    command = [sys.executable, __file__, *sys.argv[1:], "--child", name]
    around = os.environ | {"HOMOLOG_FUZZ_KEPT": str(kept)}
    ended = subprocess.run(command, env=around, capture_output=True, text=True, check=False)
    rows = [line for line in ended.stdout.splitlines() if line.startswith("|")]
    print(rows[-1] if rows else f"| {name} | exit code {ended.returncode} | | | | | 1 |", flush=True)
    if ended.returncode != 0:
        print(ended.stdout[-2000:], ended.stderr[-4000:], flush=True)
    return ended.returncode == 0


def prepared(name: str) -> tuple[object, Path, bytes]:
    """Return a reader, a folder for it, and the good file's content."""
    from targets import NATIVE, TARGETS

    target = (TARGETS | NATIVE)[name]
    folder = Path(tempfile.mkdtemp(prefix="fuzz-", dir="/dev/shm" if Path("/dev/shm").is_dir() else None))
    target.good(folder)
    return target, folder, (folder / target.file).read_bytes()


def change_at_random(options: argparse.Namespace) -> None:
    """Try one reader with changed files."""
    from harness import attempt, mutated

    target, folder, good = prepared(options.child)
    if attempt(target, folder, good) != "read":
        raise RuntimeError("the good file is refused")
    last = Path(os.environ["HOMOLOG_FUZZ_KEPT"]) / options.child.replace("/", "_")
    seen, slowest, before = Counter(), 0.0, most_memory()
    resource.setrlimit(resource.RLIMIT_AS, (mapped() + LARGEST, resource.RLIM_INFINITY))
    for number in range(options.examples):
        content = mutated(good, random.Random(f"{options.seed} {number}"))
        last.write_bytes(content)  # what ends the process can be looked at
        began = time.process_time()
        seen[attempt(target, folder, content)] += 1
        slowest = max(slowest, time.process_time() - began)
    last.unlink()
    total, memory = sum(seen.values()), (most_memory() - before) / 2**20
    counts = f"{total} | {seen['read']} | {seen['refused']}"
    print(f"| {options.child} | {counts} | {slowest:.2f} | {memory:.0f} | 0 |")


def most_memory() -> int:
    """Return the most memory that this process has had [bytes]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def mapped() -> int:
    """Return how much memory this process has asked for [bytes]."""
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


def follow_branches(options: argparse.Namespace) -> None:
    """Let atheris try one reader."""
    import atheris

    with atheris.instrument_imports(include=["homolog", "homolog_app", "json", "csv", "openpyxl"]):
        from harness import attempt

        target, folder, good = prepared(options.child)
    seen, slowest = Counter(), 0.0

    def try_one(content: bytes) -> None:
        nonlocal slowest
        began = time.process_time()
        seen[attempt(target, folder, content)] += 1
        slowest = max(slowest, time.process_time() - began)
        if time.monotonic() > end:
            total = sum(seen.values())
            row = f"| {options.child} | {total} | {seen['read']} | {seen['refused']} | {slowest:.2f} | | 0 |"
            print(row, flush=True)
            os._exit(0)

    corpus = Path(tempfile.mkdtemp())
    (corpus / "good").write_bytes(good)
    end = time.monotonic() + options.seconds
    kept = f"-artifact_prefix={os.environ['HOMOLOG_FUZZ_KEPT']}/{options.child.replace('/', '_')}-"
    atheris.Setup([sys.argv[0], kept, "-timeout=20", "-rss_limit_mb=4096", str(corpus)], try_one)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
