"""Processor seconds until a command or the window answers, with the imports that cost most.

    python tests/benchmarks/start_up.py [--imports 12]

Prints a table: `homolog --help`, `homolog info`, the first progress of `homolog run`, the window until it
handles events, its views, and the first shape of a dropped folder; then each command's costliest imports.
The window needs a display (Xvfb will do).
"""

import argparse
import os
import re
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

PROGRAM = [sys.executable, "-m", "homolog_app"]
SETTINGS = "--particles 32 --split-iterations 5 --anneal-iterations 5 --settle-iterations 5 --no-figures"

WINDOW = """
import sys, time
from pathlib import Path
from homolog_app.window import start
app = start.make_application()
home = Path(sys.argv[1]); home.mkdir()
window = start.make_window(app, home)
window.show()
app.processEvents()
print("window handles events", time.process_time(), flush=True)
start._load_views_soon(window)
def until(condition):
    while not condition():
        app.processEvents()
        time.sleep(0.001)
until(lambda: window.views is not None)
app.garbage_collector.settle()
ready = time.process_time()
print("3-D views loaded", ready, flush=True)
window.projects.open_paths([Path(sys.argv[2])])
until(lambda: window.workspace.session.surveys)
print("first shape of a dropped folder, from the drop", time.process_time() - ready, flush=True)
window.workspace.preferences.ask_on_close = False
window.close()
"""


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--imports", type=int, default=12, help="imports to list for each command")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        measure(Path(folder), options.imports)


def measure(folder, imports):
    write_cohort(folder / "scans")
    project = folder / "project"
    run = ["run", str(folder / "scans"), "--out", str(project), *SETTINGS.split()]
    subprocess.run([*PROGRAM, *run, "--progress", "none"], check=True, capture_output=True)
    rows = [
        ("homolog --help", of_command(["--help"])),
        ("homolog info", of_command(["info", str(project)])),
        ("first progress of homolog run", until_line([*run, "--restart", "--progress", "json"], "starting")),
        ("first step of homolog run", until_line([*run, "--restart", "--progress", "json"], "reading")),
        *of_window(folder),
    ]
    print("| | processor s |\n|---|---|")
    for name, seconds in rows:
        print(f"| {name} | {seconds:.2f} |", flush=True)
    for command in (["--help"], ["info", str(project)], run):
        print(f"\nimports of homolog {command[0]}, milliseconds without those that they import:")
        for milliseconds, name in costliest_imports(command, imports):
            print(f"{milliseconds:8.1f}  {name}")


def of_command(arguments):
    """Return the processor seconds of a whole command."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([*PROGRAM, *arguments], check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def until_line(arguments, word):
    """Return the processor seconds of a command until it prints a line with a word."""
    with subprocess.Popen(
        [*PROGRAM, *arguments], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as program:
        for line in program.stdout:
            if word in line:
                fields = Path(f"/proc/{program.pid}/stat").read_text().rpartition(")")[2].split()
                break
        program.kill()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def of_window(folder):
    """Return the processor seconds of the window's start, by what it reaches."""
    command = [sys.executable, "-c", WINDOW, folder / "home", folder / "scans"]
    printed = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    return [(name, float(seconds)) for name, _, seconds in (x.rpartition(" ") for x in printed.splitlines())]


def costliest_imports(arguments, count):
    """Return milliseconds and names of a command's costliest imports."""
    program = [sys.executable, "-X", "importtime", "-m", "homolog_app", *arguments]
    printed = subprocess.run(program, check=True, capture_output=True, text=True).stderr
    result = re.findall(r"import time:\s+(\d+) \|\s+\d+ \|\s+(\S+)", printed)
    return sorted(((int(microseconds) / 1000.0, name) for microseconds, name in result), reverse=True)[:count]


def write_cohort(folder):
    """Write three ellipsoids."""
    import SimpleITK

    folder.mkdir()
    grid = np.stack(np.meshgrid(*[np.arange(-31.0, 32.0)] * 3, indexing="ij"))
    for name, axes in (("a", (27, 21, 18)), ("b", (30, 21, 15)), ("c", (24, 22.5, 18))):
        inside = (np.square(grid) / np.square(axes)[:, None, None, None]).sum(axis=0) <= 1.0
        SimpleITK.WriteImage(SimpleITK.GetImageFromArray(inside.astype(np.uint8)), folder / f"{name}.nrrd")


if __name__ == "__main__":
    main()
