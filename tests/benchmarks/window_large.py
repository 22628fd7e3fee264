"""Processor seconds of the window until a large project is open and its pages are turned.

    python tests/benchmarks/window_large.py PROJECT [--picture FILE.png]

PROJECT is, for example, one that large_project.py makes. Needs a display (Xvfb will do).
"""

import argparse
import cProfile
import pstats
import tempfile
import time
from pathlib import Path

TURNS = 3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("project", type=Path)
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--profile", action="store_true", help="print the functions that take longest")
    options = parser.parse_args()
    began = time.process_time()
    from homolog_app.window.start import make_application, make_window

    app = make_application()
    home = Path(tempfile.mkdtemp())
    window = make_window(app, home)
    window.workspace.preferences.ask_on_close = False
    window.show()
    window.load_views()
    session, profile = window.workspace.session, cProfile.Profile()

    def step(what: str, condition) -> None:
        nonlocal began
        while not condition():
            app.processEvents()
            time.sleep(0.001)
        app.processEvents()
        now = time.process_time()
        print(f"| {what} | {now - began:.1f} |", flush=True)
        began = now

    print("| step | processor s |\n|---|---|")
    step("window, empty", lambda: True)
    if options.profile:
        profile.enable()
    window.projects.open_paths([options.project])
    step("subjects listed", lambda: len(session.study.members) > 0)
    step("result shown", lambda: session.result is not None)
    scene = window.views.stage.scene
    window.commands["view.grid16"].trigger()
    step("sixteen views", lambda: len(scene.shown) == 16)
    for _ in range(TURNS):
        scene.turn_page(1)
        app.processEvents()
    step(f"{TURNS} pages turned", lambda: True)
    if options.picture:
        window.grab().save(str(options.picture))
    profile.disable()
    if options.profile:
        pstats.Stats(profile).sort_stats("cumulative").print_stats(45)
    window.close()


if __name__ == "__main__":
    main()
