"""How long the window's thread is kept busy by each click, while nothing else or a run goes on.

    python tests/benchmarks/window_clicks.py PROJECT [--run]

Goes through all steps, pages of Explore, layouts and switches of the views twice and prints, slowest first,
the processor time of the window's thread until the click and all that followed from it was handled. That
depends little on how busy the machine is, unlike the time on the clock. Needs a display (Xvfb will do).
"""

import argparse
import tempfile
import time
from pathlib import Path

_CLICKS = (
    "view.cohort",
    "view.groom",
    "view.correspond",
    "view.explore",
    "explore.modes",
    "explore.groups",
    "explore.measure",
    "explore.check",
    "explore.patient",
    "explore.modes",
    "view.grid4",
    "view.grid9",
    "view.grid16",
    "view.grid1",
    "view.clip",
    "view.clip",
    "view.corner",
    "view.cohort",
    "view.grid16",
    "view.grid9",
    "view.grid4",
    "view.slice",
    "view.slice",
    "view.clip",
    "view.clip",
    "view.theme",
    "view.theme",
    "view.log",
    "view.log",
)
_SHOWN = 12


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("project", type=Path)
    parser.add_argument("--run", action="store_true", help="place the particles again meanwhile")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as home:
        rows = measure(options.project, Path(home), run=options.run)
    print("| click | first time, CPU ms | again, CPU ms |")
    print("|---|---|---|")
    for name, first, again in sorted(rows, key=lambda row: -row[2])[:_SHOWN]:
        print(f"| {name} | {first:.0f} | {again:.0f} |")


def measure(project: Path, home: Path, *, run: bool) -> list[tuple[str, float, float]]:
    from homolog_app.window.start import make_application, make_window

    app = make_application()
    window = make_window(app, home)
    window.workspace.preferences.ask_on_close = False
    window.show()
    window.load_views()
    app.garbage_collector.settle()  # as `start` does

    def settle(condition=lambda: True, least: float = 0.3) -> None:
        end = time.monotonic() + least
        while time.monotonic() < end or not condition():
            app.processEvents()
            time.sleep(0.005)

    work, session = window.workspace.work, window.workspace.session
    window.projects.open_paths([project])
    settle(lambda: session.result is not None and not work.session.job.is_busy)
    window.commands["explore.modes"].trigger()
    settle(lambda: window.inspector.explore.fitted.shape is not None and not work.session.job.is_busy)
    if run:
        window.commands["run.start"].trigger()
        settle(lambda: work.session.job.run is None or work.session.job.run.frame is not None)
    spent: dict[str, list[float]] = {}
    for turn in range(2):
        counts: dict[str, int] = {}
        for click in _CLICKS:
            counts[click] = counts.get(click, 0) + 1
            began = time.thread_time()
            window.commands[click].trigger()
            app.processEvents()
            row = spent.setdefault(f"{click} ({counts[click]})", [])
            row.append(1000.0 * (time.thread_time() - began))
            settle(lambda: run or not work.session.job.is_busy)
            assert len(row) == turn + 1
    if run:
        window.commands["run.cancel"].trigger()
        settle(lambda: not work.session.job.is_busy)
    window.close()
    return [(name, first, again) for name, (first, again) in spent.items()]


if __name__ == "__main__":
    main()
