"""Memory of a run with and without a budget, and whether its particles are the same.

    python tests/benchmarks/memory.py FOLDER --shapes 200 --particles 64 --memory none 1

Ellipsoids are groomed and optimized (a short schedule) in a process of its own for each budget. Prints a
table in Markdown: peak resident memory in all and without mapped files, the size of those files, processor
seconds, and whether all particles are those of the first row, bit for bit. Linux only.
"""

import argparse
import subprocess
import sys
import time
from pathlib import Path

import psutil
from kill import contents, write_cohort

SETTINGS = (
    "--device cpu --workers 1 --alignment center --mesh-edge 1 --split-iterations 20 --anneal-iterations 60 "
    "--settle-iterations 40 --no-figures --progress json"
)


def watched(running: psutil.Popen) -> tuple[float, float, float, float]:
    """Return the most memory [GB] in all, anonymous and of files, and the processor seconds of a process."""
    peaks, seconds = [0.0, 0.0, 0.0], 0.0
    status = Path(f"/proc/{running.pid}/status")
    while running.poll() is None:
        try:
            lines = dict(line.split(":", 1) for line in status.read_text().splitlines())
            times = running.cpu_times()
            maps = Path(f"/proc/{running.pid}/maps").read_text().splitlines()
        except (KeyError, OSError, psutil.Error):
            break  # it has just ended
        parts = [1024e-9 * int(lines[name].split()[0]) for name in ("VmRSS", "RssAnon") if name in lines]
        parts.append(1e-9 * sum(span(line.split()[0]) for line in maps if line.endswith("(deleted)")))
        peaks = [max(pair) for pair in zip(peaks, parts, strict=False)] if len(parts) == 3 else peaks
        seconds = times.user + times.system + times.children_user + times.children_system
        time.sleep(0.1)
    if running.wait() != 0:
        sys.exit(running.returncode)
    return peaks[0], peaks[1], peaks[2], seconds


def span(addresses: str) -> int:
    first, _, last = addresses.partition("-")
    return int(last, 16) - int(first, 16)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--shapes", type=int, default=200)
    parser.add_argument("--particles", type=int, default=64)
    parser.add_argument("--memory", nargs="+", default=["none", "1"], metavar="GB")
    options = parser.parse_args()
    scans = options.folder / f"ellipsoids{options.shapes}"
    if not scans.exists():
        options.folder.mkdir(parents=True, exist_ok=True)
        write_cohort(scans, options.shapes)
    first = None
    print("| --memory GB | peak GB | without mapped files | mapped files GB | processor s | same particles |")
    print("|---|---|---|---|---|---|")
    for budget in options.memory:
        project = options.folder / f"memory-{options.shapes}-{options.particles}-{budget}"
        limit = [] if budget == "none" else ["--memory", budget]
        running = psutil.Popen(
            [
                sys.executable,
                "-m",
                "homolog_app",
                "run",
                str(scans),
                "--out",
                str(project),
                *SETTINGS.split(),
                "--particles",
                str(options.particles),
                *limit,
            ],
            stdout=subprocess.DEVNULL,
        )
        most, own, files, seconds = watched(running)
        result = contents(project)
        first = first or result
        same = "yes" if result == first else "NO"
        print(f"| {budget} | {most:.2f} | {own:.2f} | {files:.2f} | {seconds:.0f} | {same} |", flush=True)


if __name__ == "__main__":
    main()
