"""Make the manual's pictures from the real window, the sample hearts and the coffee beans.

    python docs/images/manual/make.py

Needs a display (Xvfb will do) and takes some minutes.
"""

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from checking import keep_checking
from controls import KEY, controls_of, open_page
from exploring import keep_exploring
from exporting import keep_exporting
from PySide6.QtWidgets import QWidget
from sample_hearts import keep_hearts, keep_scan

HERE = Path(__file__).parent
SIZE = (1280, 800)
SECOND, MOST = 1.0, 600.0


def main() -> None:
    """Go through the four steps and keep a picture of each."""
    from homolog.settings import OptimizeSettings
    from homolog_app.window.palette import CommandPalette
    from homolog_app.window.start import make_application, make_window

    app = make_application()
    with tempfile.TemporaryDirectory(prefix="homolog-") as folder:
        window = make_window(app, Path(folder))
        window.workspace.preferences.ask_on_close = False
        window.resize(*SIZE)
        window.show()

        session, work, order = window.workspace.session, window.workspace.work, window.commands

        def until(condition: Callable[[], object]) -> None:
            end = time.monotonic() + MOST
            while not condition():
                if time.monotonic() > end:
                    raise TimeoutError(f"waited {MOST:g} s in vain for {condition}")
                app.processEvents()
                time.sleep(0.005)

        def rest(seconds: float = SECOND) -> None:
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                app.processEvents()
                time.sleep(0.005)

        def keep(name: str, widget: QWidget = window) -> None:
            rest()
            picture = widget.grab().scaledToWidth(min(SIZE[0], widget.width())).toImage()
            if widget is window and session.is_open:
                page = open_page(window)
                picture.setText(
                    KEY, "\n".join([type(page).__name__, *sorted(controls_of(page, primary=True))])
                )
            picture.save(str(HERE / f"{name}.png"))

        keep("start")
        window.load_views()
        keep_scan(window, until, keep)
        keep_hearts(window, until, keep)
        order["file.sample"].trigger()
        until(lambda: len(session.surveys) == 10)
        order["view.grid9"].trigger()
        window.tour.card.end.click()
        session.select(["bean_02", "bean_04"])
        session.set_group("wide")
        keep("cohort")
        window.workspace.session.show_step("groom")
        order["run.groom"].trigger()
        until(lambda: not work.session.job.is_busy)
        keep("groom")
        order["view.slice"].trigger()
        keep("slices")
        order["view.slice"].trigger()
        window.workspace.edit_settings("optimize", "particles", OptimizeSettings(particles=256))
        window.workspace.session.show_step("correspond")
        order["run.start"].trigger()
        until(lambda: work.session.job.run is None or not window.docks.curves.is_empty)
        rest(5.0)
        keep("run")
        until(lambda: not work.session.job.is_busy)
        window.workspace.edit_settings("optimize", "particles", OptimizeSettings(particles=512))
        keep("further")
        window.workspace.edit_settings("optimize", "particles", OptimizeSettings(particles=256))
        window.workspace.session.show_step("explore")
        order["explore.modes"].trigger()
        order["view.head"].trigger()
        keep("explore")
        keep_exploring(window, until, keep)
        keep_checking(window, until, keep)
        keep_exporting(window, until, keep)
        window.workspace.theme.choose("dark")
        keep("dark")
        window.workspace.theme.choose("light")
        palette = CommandPalette(window, order)
        palette.query.setText("view")
        palette.show()
        keep("palette", palette)
        palette.close()
        window.close()


if __name__ == "__main__":
    main()
