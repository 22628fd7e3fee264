"""Make the manual's pictures from the real window, the sample hearts and the coffee beans.

    python docs/images/manual/make.py [PICTURE ...]

Needs a display (Xvfb will do). All take some minutes. A study that no named picture shows is left out.
"""

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from checking import keep_checking
from controls import KEY, controls_of, open_page
from exploring import keep_exploring
from exporting import keep_exporting
from PySide6.QtWidgets import QWidget
from sample_hearts import keep_hearts, keep_scan

if TYPE_CHECKING:
    from homolog_app.window.main_window import MainWindow

HERE = Path(__file__).parent
OF_SCAN, OF_HEARTS = {"scan"}, {"tour", "cut", "groups", "thickness", "patient"}
SIZE = (1280, 800)
SECOND, PART, MOST = 1.0, 0.65, 1800.0


def main(wanted: set[str]) -> None:
    """Go through the four steps and keep a picture of each, or those that are wanted if any are."""
    from homolog_app.window.start import make_application, make_window

    app = make_application()
    with tempfile.TemporaryDirectory(prefix="homolog-") as folder:
        window = make_window(app, Path(folder))
        window.workspace.preferences.ask_on_close = False
        window.resize(*SIZE)
        window.show()

        session, made = window.workspace.session, set[str]()

        def until(condition: Callable[[], object]) -> None:
            end = time.monotonic() + MOST
            while not condition():
                if time.monotonic() > end:
                    raise TimeoutError(f"waited {MOST:g} s in vain for {condition}")
                app.processEvents()
                time.sleep(0.005)

        def keep(name: str, widget: QWidget = window) -> None:
            if wanted and name not in wanted:
                return
            made.add(name)
            end = time.monotonic() + SECOND
            until(lambda: time.monotonic() > end)
            picture = widget.grab().scaledToWidth(min(SIZE[0], widget.width())).toImage()
            if widget is window and session.is_open:
                page = open_page(window)
                picture.setText(
                    KEY, "\n".join([type(page).__name__, *sorted(controls_of(page, primary=True))])
                )
            picture.save(str(HERE / f"{name}.png"))

        keep("start")
        window.load_views()
        if not wanted or wanted & OF_SCAN:
            keep_scan(window, until, keep)
        if not wanted or wanted & OF_HEARTS:
            keep_hearts(window, until, keep)
        if not wanted or wanted - OF_SCAN - OF_HEARTS - {"start"}:
            keep_beans(window, until, keep)
        window.close()
    if wanted - made:
        raise SystemExit(f"no such picture: {', '.join(sorted(wanted - made))}")


def keep_beans(
    window: "MainWindow", until: Callable[[Callable[[], object]], None], keep: Callable[..., None]
) -> None:
    """Go through the four steps with the coffee beans."""
    from homolog.settings import OptimizeSettings
    from homolog_app.window.actions import CommandPalette

    workspace, order = window.workspace, window.commands
    session = workspace.session
    order["file.sample"].trigger()
    until(lambda: len(session.surveys) == 10)
    order["view.grid9"].trigger()
    window.tour.card.end.click()
    session.select(["bean_02", "bean_04"])
    session.set_group("wide")
    keep("cohort")
    session.show_step("groom")
    order["run.groom"].trigger()
    until(lambda: not session.job.is_busy)
    keep("groom")
    order["view.slice"].trigger()
    keep("slices")
    order["view.slice"].trigger()
    workspace.edit_settings("optimize", "particles", OptimizeSettings(particles=256))
    session.show_step("correspond")
    order["run.start"].trigger()
    until(lambda: session.job.status is not None)
    until(lambda: session.job.status is None or session.job.status.fraction > PART)
    until(lambda: session.job.status is None or not window.docks.curves.is_empty)
    keep("run")
    until(lambda: not session.job.is_busy)
    workspace.edit_settings("optimize", "particles", OptimizeSettings(particles=512))
    keep("further")
    workspace.edit_settings("optimize", "particles", OptimizeSettings(particles=256))
    session.show_step("explore")
    order["explore.modes"].trigger()
    order["view.head"].trigger()
    keep("explore")
    keep_exploring(window, until, keep)
    keep_checking(window, until, keep)
    keep_exporting(window, until, keep)
    workspace.theme.choose("dark")
    keep("dark")
    workspace.theme.choose("light")
    palette = CommandPalette(window, order)
    palette.query.setText("view")
    palette.show()
    keep("palette", palette)
    palette.close()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Make the manual's pictures.")
    parser.add_argument("pictures", nargs="*", metavar="PICTURE", help="default: all")
    main(set(parser.parse_args().pictures))
