"""How late the window handles events while a run goes on and is drawn.

    python tests/benchmarks/window_latency.py [--shapes 10 --particles 1024 --views 9 --seconds 60]

A thread posts an event every 20 ms; what counts is the time until the window's thread handles it. Prints a
row for docs/window.md. Needs a display (Xvfb will do).
"""

import argparse
import tempfile
import threading
import time
from pathlib import Path

import numpy as np


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shapes", type=int, default=10)
    parser.add_argument("--particles", type=int, default=1024)
    parser.add_argument("--views", type=int, default=9)
    parser.add_argument("--seconds", type=float, default=60.0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        measure(options, Path(folder))


def measure(options: argparse.Namespace, folder: Path) -> None:
    from homolog.beans.files import write_beans
    from homolog.beans.generate import draw_beans
    from homolog.settings import OptimizeSettings
    from homolog_app.window.start import make_application, make_window

    app = make_application()
    (folder / "home").mkdir()
    write_beans(folder / "beans", draw_beans(options.shapes), 5)
    window = make_window(app, folder / "home")
    window.workspace.preferences.ask_on_close = False
    window.show()
    window.load_views()
    app.garbage_collector.settle()  # as `start` does

    def until(condition) -> None:
        while not condition():
            app.processEvents()
            time.sleep(0.001)

    work = window.workspace.work
    window.projects.open_paths([folder / "beans"])
    until(lambda: len(window.workspace.session.surveys) == options.shapes)
    window.workspace.edit_settings("optimize", "particles", OptimizeSettings(particles=options.particles))
    window.commands["run.groom"].trigger()
    until(lambda: not work.session.job.is_busy)
    window.commands[f"view.grid{options.views}"].trigger()
    window.workspace.session.show_step("correspond")
    window.commands["run.start"].trigger()
    until(lambda: work.session.job.run is None or work.session.job.run.frame is not None)
    late, frames = watch(app, window, options.seconds)
    began = time.perf_counter()
    window.commands["run.cancel"].trigger()
    until(lambda: not work.session.job.is_busy)
    idle = time.perf_counter() - began
    p50, p99 = np.percentile(late, (50, 99))
    print("| views | shapes x particles | median late ms | p99 | most | frames/s | draw ms | cancel s |")
    print(
        f"| {options.views} | {options.shapes} x {options.particles} | {p50:.0f} | {p99:.0f} "
        f"| {max(late):.0f} | {frames / options.seconds:.1f} | {window.views.stage.scene.plot.draw_ms:.0f} "
        f"| {idle:.2f} |"
    )
    window.close()


def watch(app, window, seconds: float) -> tuple[list[float], int]:
    """Return the lateness of each event [ms] and the number of frames drawn."""
    from PySide6.QtCore import QCoreApplication, QEvent, QObject

    late: list[float] = []
    kind = QEvent.Type(QEvent.registerEventType())

    class Posted(QEvent):
        def __init__(self) -> None:
            super().__init__(kind)
            self.at = time.perf_counter()

    class Receiver(QObject):
        def event(self, event: QEvent) -> bool:
            if isinstance(event, Posted):
                late.append(1000.0 * (time.perf_counter() - event.at))
                return True
            return super().event(event)

    receiver, stop = Receiver(), threading.Event()

    def post() -> None:
        while not stop.wait(0.02):
            QCoreApplication.postEvent(receiver, Posted())

    thread = threading.Thread(target=post)
    thread.start()
    job, last, frames = window.workspace.session.job.run, None, 0
    end = time.monotonic() + seconds
    while time.monotonic() < end and window.workspace.session.job.run is job:
        app.processEvents()
        shown = window.views.run.frame
        frames += shown is not last
        last = shown
        time.sleep(0.001)
    stop.set()
    thread.join()
    app.processEvents()
    return late, frames


if __name__ == "__main__":
    main()
