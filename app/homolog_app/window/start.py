"""Start of the application: surface format, logging, exception hooks, window, then the heavy imports."""

import faulthandler
import importlib
import logging
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType

from PySide6.QtCore import QEvent, QStandardPaths, QTimer
from PySide6.QtGui import QSurfaceFormat
from PySide6.QtWidgets import QApplication

from homolog_app.cli.options import handling
from homolog_app.window.dialogs import LogMemory
from homolog_app.window.main_window import MainWindow
from homolog_app.window.runner import GarbageCollector
from homolog_app.window.theme import Theme, application_icon
from homolog_app.window.workspace import Preferences, Workspace

__all__ = ["Application", "discard", "interrupt_closes", "make_application", "make_window", "start"]

_log = logging.getLogger("homolog_app")
_LOOK_MS = 50


def start(paths: list[str]) -> int:
    """Open the window with files or a project, and return when it is closed."""
    app = make_application()
    home = Path(QStandardPaths.writableLocation(QStandardPaths.StandardLocation.AppDataLocation))
    home.mkdir(parents=True, exist_ok=True)
    faults = (home / "crash.log").open("w", encoding="utf-8")
    faulthandler.enable(faults)
    window = make_window(app, home)
    _catch_exceptions(window)
    window.show()

    def go_on() -> None:
        app.garbage_collector.settle()
        if paths:
            window.projects.open_paths([Path(path).resolve() for path in paths])
        else:
            window.projects.offer_recovery()

    window.views_ready.connect(go_on)
    _load_views_soon(window)
    with interrupt_closes(window):
        code = app.exec()
    computes = window.workspace.work.runner.is_alive
    discard(window)
    faulthandler.disable()
    faults.close()
    if computes:  # files are replaced whole, so that a computation can end anywhere; Python's end would wait
        logging.shutdown()
        sys.stdout.flush()
        os._exit(code)
    return code


class Application(QApplication):
    """The process's application, which collects Python's garbage in its thread."""

    def __init__(self) -> None:
        super().__init__(["homolog"])
        self.garbage_collector = GarbageCollector(self)


def discard(window: MainWindow) -> None:
    """Delete a closed window with all that is in it, while the application is whole."""
    window.deleteLater()
    QApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)


def make_application() -> Application:
    """Return the process's application, with the surface format that VTK needs."""
    running = QApplication.instance()
    if isinstance(running, Application):
        return running
    QSurfaceFormat.setDefaultFormat(_surface_format())
    app = Application()
    app.setApplicationName("homolog")
    app.setApplicationDisplayName("Homolog")
    app.setWindowIcon(application_icon())
    return app


def make_window(app: QApplication, home: Path) -> MainWindow:
    """Return a window with preferences and sessions in a folder; its views are not loaded yet."""
    memory = LogMemory()
    root = logging.getLogger()
    root.addHandler(memory)
    for name in ("homolog", "homolog_app"):
        logging.getLogger(name).setLevel(logging.INFO)
    theme = Theme(app, Preferences(home / "preferences.ini").scheme)
    window = MainWindow(Workspace(home, theme, memory))
    window.destroyed.connect(lambda: root.removeHandler(memory))
    return window


@contextmanager
def interrupt_closes(window: MainWindow) -> Iterator[None]:
    """Let Ctrl-C close the window like its close button, and a second one terminate the program.

    Python's default is an exception at an arbitrary point. In a call from Qt whose
    arguments are being converted, this crashes PySide.
    """

    def close() -> None:
        if not window.close():  # the user chose to continue
            signal.signal(signal.SIGINT, handle)

    def handle(_number: int, _frame: object) -> None:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        QTimer.singleShot(0, window, close)

    with handling(signal.SIGINT, handle):
        yield


def _load_views_soon(window: MainWindow) -> None:
    """Import the views' packages in the background, then create the views."""
    window.start_page.notice.setText("Loading the 3-D views…")
    imports = threading.Thread(
        target=importlib.import_module, args=["homolog_app.window.scene"], name="homolog-imports"
    )
    look = QTimer(window, interval=_LOOK_MS)

    def go_on() -> None:
        if not imports.is_alive():
            look.stop()
            window.start_page.notice.setText("")
            window.load_views()

    look.timeout.connect(go_on)
    QTimer.singleShot(_LOOK_MS, window, imports.start)
    QTimer.singleShot(2 * _LOOK_MS, window, look.start)


def _surface_format() -> QSurfaceFormat:
    """Return the surface format of pyvistaqt, which must be set before the first window is created."""
    result = QSurfaceFormat()
    result.setRenderableType(QSurfaceFormat.RenderableType.OpenGL)
    result.setProfile(QSurfaceFormat.OpenGLContextProfile.CoreProfile)
    result.setVersion(3, 2)
    result.setSwapBehavior(QSurfaceFormat.SwapBehavior.DoubleBuffer)
    result.setRedBufferSize(8)
    result.setGreenBufferSize(8)
    result.setBlueBufferSize(8)
    result.setDepthBufferSize(8)
    result.setAlphaBufferSize(8)
    return result


def _catch_exceptions(window: MainWindow) -> None:
    """Show unhandled exceptions in a dialog."""

    def show(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        _log.critical("unexpected error", exc_info=(kind, error, trace))
        window.help.show_error("", error)

    def note(args: threading.ExceptHookArgs) -> None:
        _log.critical("unexpected error in %s: %s", args.thread, args.exc_value)

    sys.excepthook = show
    threading.excepthook = note
