"""Whether the window stays whole: random lives, and half an hour of playing.

    python tests/benchmarks/window_life.py lives [--count 50 --seed 1]
    python tests/benchmarks/window_life.py play [--minutes 30]

`lives` opens a window on four beans again and again, gives random orders (start, pause, cancel, views, close
in mid-run, reopen) and counts what is left after each: threads, timers, widgets, VTK objects, open files,
memory. `play` plays a finished run and turns the views all the time. Both print rows for docs/window.md and
need a display (Xvfb will do).
"""

import argparse
import gc
import os
import random
import tempfile
import threading
import time
from pathlib import Path

ORDERS = (
    "run.start",
    "run.pause",
    "run.cancel",
    "run.resume",
    "run.groom",
    "view.next",
    "view.grid1",
    "view.grid9",
    "view.raw",
    "view.groomed",
    "view.particles",
    "edit.undo",
    "edit.redo",
    "view.slice",
    "view.theme",
    "run.play",
    "view.front",
    "view.reset",
)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("lives", "play"))
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=30.0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        (lives if options.what == "lives" else play)(options, Path(folder))


def lives(options: argparse.Namespace, folder: Path) -> None:
    """Live and die many times."""
    app, project = prepare(folder)
    orders = random.Random(options.seed)
    print("| lives | threads | timers | widgets | VTK objects | open files | memory MB |")
    print("|---|---|---|---|---|---|---|")
    first: list[int] = []
    for life in range(options.count + 1):
        window, until = open_window(app, folder, project)
        for _ in range(orders.randrange(2, 12)):
            possible = [name for name in ORDERS if window.commands[name].isEnabled()]
            window.commands[orders.choice(possible)].trigger()
            end = time.monotonic() + orders.random() * 0.6
            until(lambda end=end: time.monotonic() > end)
        close(app, window)
        del window, until
        left = remains(app)
        first = first or left
        if life % 10 == 0:
            print(f"| {life} | {' | '.join(str(item) for item in left)} |", flush=True)
    grown = [now - then for now, then in zip(left, first, strict=True)]
    print(f"after {options.count} lives more than after one: {grown[:-1]}, memory {grown[-1]:+d} MB")


def play(options: argparse.Namespace, folder: Path) -> None:
    """Play a finished run and turn the views."""
    app, project = prepare(folder)
    window, until = open_window(app, folder, project)
    until(lambda: len(window.workspace.session.surveys) == 4)
    for order in ("run.groom", "run.start"):
        window.commands[order].trigger()
        until(lambda: not window.workspace.session.job.is_busy)
    if window.workspace.session.result is None:
        raise SystemExit("the run came to no result")
    window.workspace.session.show_step("explore")
    print("| minutes | memory MB | moments shown |")
    print("|---|---|---|")
    begin, shown, views, after = time.monotonic(), 0, ("front", "left", "corner", "head"), []
    while (passed := time.monotonic() - begin) < 60 * options.minutes:
        if not window.views.run.is_playing:
            window.commands["run.play"].trigger()
            window.commands[f"view.{views[shown % 4]}"].trigger()
            shown += 1
        app.processEvents()
        time.sleep(0.005)
        if passed > 60 * len(after):
            after.append(memory())
            if len(after) % 3 == 1:
                print(f"| {passed / 60:.0f} | {after[-1]} | {shown} |", flush=True)
    base = after[min(2, len(after) - 1)]
    growth = 100 * (after[-1] / base - 1)
    print(f"memory after {passed / 60:.0f} minutes: {after[-1]} MB, {growth:+.1f} % since minute 2")
    close(app, window)


def prepare(folder: Path) -> tuple:
    """Make the application and a saved project of four groomed beans."""
    from homolog.beans.files import write_beans
    from homolog.beans.generate import draw_beans
    from homolog.settings import OptimizeSettings
    from homolog_app.window.start import make_application

    app = make_application()
    write_beans(folder / "beans", draw_beans(4), 5)
    window, until = open_window(app, folder, folder / "beans")
    until(lambda: len(window.workspace.session.surveys) == 4)
    small = OptimizeSettings(particles=64, split_iterations=10, anneal_iterations=100, settle_iterations=100)
    window.workspace.edit_settings("optimize", "particles", small)
    window.commands["run.groom"].trigger()
    until(lambda: not window.workspace.session.job.is_busy)
    window.projects.save_to(folder / "project")
    until(lambda: not window.workspace.session.job.is_busy)
    close(app, window)
    return app, folder / "project"


def open_window(app, folder: Path, path: Path) -> tuple:
    from homolog_app.window.start import make_window

    (folder / "home").mkdir(exist_ok=True)
    window = make_window(app, folder / "home")
    window.workspace.preferences.ask_on_close = False
    window.show()
    window.load_views()

    def until(condition) -> None:
        while not condition():
            app.processEvents()
            time.sleep(0.002)

    window.projects.open_paths([path])
    until(lambda: window.views is not None and window.workspace.session.is_open)
    return window, until


def close(app, window) -> None:
    from PySide6.QtCore import QEvent

    window.close()
    window.deleteLater()
    for _ in range(5):
        app.processEvents()
        app.sendPostedEvents(None, QEvent.Type.DeferredDelete)


def remains(app) -> list[int]:
    """Count threads, running timers, widgets, VTK objects, open files, and memory [MB]."""
    from PySide6.QtCore import QTimer
    from shiboken6 import isValid
    from vtkmodules.vtkCommonCore import vtkObjectBase

    gc.collect()
    alive = gc.get_objects()
    timers = sum(isinstance(item, QTimer) and isValid(item) and item.isActive() for item in alive)
    vtk = sum(isinstance(item, vtkObjectBase) for item in alive)
    files = len(os.listdir("/proc/self/fd"))
    return [threading.active_count(), timers, len(app.allWidgets()), vtk, files, memory()]


def memory() -> int:
    """Return the resident memory of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") // 1_000_000


if __name__ == "__main__":
    main()
