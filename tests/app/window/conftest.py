"""The real window for tests, and the rule that nothing of it outlives its test."""

import gc
import os
import shutil
import sys
import threading
import time
from pathlib import Path

import pytest

pytest.importorskip("PySide6.QtWidgets")
sys.path.insert(0, str(Path(__file__).parent))  # for accessibility.py

SIZE = (960, 640)  # pixels of a window: drawing takes time by the pixel


def pytest_collection_modifyitems(items):
    """Let what Qt warns of fail a test of the window, and one that hangs end the whole run.

    The other way to end it, an exception out of a signal handler, crashes PySide where it happens to be
    making the arguments of a call into Python.
    """
    for item in items:
        if item.path.is_relative_to(Path(__file__).parent):
            item.add_marker(pytest.mark.timeout(900, method="thread"))
            item.add_marker(pytest.mark.qt_log_level_fail("WARNING"))


@pytest.fixture(scope="session")
def qapp(tmp_path_factory):
    """Return the application with the surface format that the window needs.

    What remains of a first window, all modules and collected tests, is exempt from garbage collection: each
    test of a window collects, which would take longer than most of the tests.
    """
    from homolog_app.window.start import make_application, make_window

    app = make_application()
    window = make_window(app, tmp_path_factory.mktemp("home"))
    window.load_views()
    shut(window, app)
    del window
    gc.collect()
    gc.freeze()
    return app


@pytest.fixture
def wait(qapp):
    """Return a function that handles events until a condition holds."""

    from PySide6.QtCore import QEvent

    def until(condition, seconds=240.0, what=""):
        begin = time.monotonic()
        while not condition():
            waited = time.monotonic() - begin
            assert waited < seconds, f"waited {seconds} s in vain {what}"
            qapp.processEvents()
            qapp.sendPostedEvents(None, QEvent.Type.DeferredDelete)  # as the program's own loop does
            time.sleep(min(0.002 + 0.05 * waited, 0.03))  # looking takes time from what is waited for

    return until


@pytest.fixture
def no_questions(monkeypatch):
    """Let a question that a test doesn't answer fail it instead of waiting for ever."""
    monkeypatch.setattr("PySide6.QtWidgets.QMessageBox.exec", lambda box: pytest.fail(box.text()))


@pytest.fixture
def make_window(qapp, tmp_path, wait, no_questions, kept_windows):
    """Return a function that opens a window; all of them are closed and must leave nothing behind."""
    windows = []

    def make(home=None, views=True):
        while kept_windows:
            shut(kept_windows.pop(), qapp)
        windows.append(opened(qapp, home or tmp_path / "home", wait, views=views))
        return windows[-1]

    yield make
    if windows:
        while windows:
            shut(windows.pop(), qapp)
        assert_nothing_left(qapp)


def opened(qapp, home, wait, views=True):
    """Return a window that is shown, with its views if they are wanted."""
    from homolog_app.window.start import make_window

    is_new = not home.is_dir()
    home.mkdir(exist_ok=True)
    window = make_window(qapp, home)
    window.workspace.preferences.ask_on_close = False
    window.workspace.theme.choose(os.environ.get("HOMOLOG_TEST_SCHEME", "light"))
    if is_new:  # else the size may be one that was kept
        window.resize(*SIZE)
    window.show()
    if views:
        window.load_views()
        wait(lambda: window.views is not None)
    return window


@pytest.fixture(scope="module")
def kept_windows(qapp):
    """Return a list for the window that the tests of a file share; it is closed after them."""
    windows = []
    yield windows
    if windows:
        shut(windows.pop(), qapp)
        assert_nothing_left(qapp)


@pytest.fixture
def window(request, no_questions, kept_windows, qapp, wait, tmp_path_factory):
    """Return an open window with its views: the one that the test before has left, its study closed.

    Tests that are marked `own_window` or open windows by themselves have one that nobody has used.
    """
    if request.node.get_closest_marker("own_window") is not None or "make_window" in request.fixturenames:
        yield request.getfixturevalue("make_window")()
        return
    if not kept_windows:
        kept_windows.append(opened(qapp, tmp_path_factory.mktemp("home"), wait))
    yield kept_windows[0]
    if not left(kept_windows[0], wait):
        shut(kept_windows.pop(), qapp)


def left(window, wait):
    """Close the study of a window, and put back how it looks; return whether it can be used again."""
    from PySide6.QtWidgets import QDialog
    from shiboken6 import isValid

    if not isValid(window) or window.workspace.closed:
        return False
    work, session = window.workspace.work, window.workspace.session
    for dialog in window.findChildren(QDialog):
        dialog.close()
    work.cancel()
    window.projects.begin()
    wait(lambda: not session.job.kind and not session.job.following)
    window.workspace.theme.choose(os.environ.get("HOMOLOG_TEST_SCHEME", "light"))
    session.show_page(0)
    window.resize(*SIZE)
    return True


@pytest.fixture
def beans(window, ellipsoids, wait):
    """Return a window in which four small shapes are listed and read, 32 particles asked for."""
    window.projects.open_paths([ellipsoids])
    window.workspace.edit_settings("groom", "mesh_edge", coarse_settings())
    window.workspace.edit_settings("optimize", "particles", quick_settings())
    wait(lambda: len(window.workspace.session.surveys) == 4)
    return window


def quick_settings(particles=32, anneal=20):
    from homolog.settings import OptimizeSettings

    return OptimizeSettings(
        particles=particles, split_iterations=5, anneal_iterations=anneal, settle_iterations=20
    )


def coarse_settings():
    """Return settings of grooming that cost little: meshes of some 800 vertices, and nothing is registered.

    Registration takes seconds, when shapes are groomed, when a project is opened and when a run starts.
    """
    from homolog.settings import Alignment, GroomSettings, Mirror

    return GroomSettings(mesh_edge=1.0, alignment=Alignment.CENTER, mirror=Mirror.OFF)


@pytest.fixture(scope="session")
def coarse():
    """Return settings of grooming that cost little."""
    return coarse_settings()


@pytest.fixture
def quick():
    """Return the function that makes settings of a run that takes a second."""
    return quick_settings


@pytest.fixture(scope="session")
def groomed_cache(ellipsoids, tmp_path_factory):
    """Return a folder with the groomed shapes: processes that groom take seconds to start."""
    from concurrent.futures import ThreadPoolExecutor

    from homolog.cohort import read_cohort
    from homolog.grooming import groom_cohort

    folder = tmp_path_factory.mktemp("groomed")
    with ThreadPoolExecutor(1) as executor:
        groom_cohort(read_cohort(ellipsoids), coarse_settings(), executor=executor, cache=folder)
    return folder


@pytest.fixture(scope="session")
def finished(ellipsoids, groomed_cache, tmp_path_factory):
    """Return a project with a result and the frames of its run; not to be written to."""
    from homolog.cohort import read_cohort
    from homolog.io.project import ProjectFolder
    from homolog.settings import RunSettings
    from homolog_app.window.jobs import RunJob

    project = ProjectFolder(tmp_path_factory.mktemp("finished") / "study")
    shutil.copytree(groomed_cache, project.groomed)
    settings = RunSettings(groom=coarse_settings(), optimize=quick_settings())
    RunJob(project, read_cohort(ellipsoids), settings, resume=False).execute()
    return project.folder


@pytest.fixture
def explored(window, finished, tmp_path, wait):
    """Return the window with a copy of the finished project open, its model fitted if a page wants it."""
    session = window.workspace.session
    shutil.copytree(finished, tmp_path / "copy")
    window.projects.open_paths([tmp_path / "copy"])
    wait(lambda: session.result is not None and session.step == "explore" and not session.job.is_busy)
    return window


@pytest.fixture(scope="session")
def bean_project(made_once):
    """Return a project of ten coffee beans, those with a wide slot in a group; not to be written to.

    A voxel lies apart from the first, so that grooming has a note on it.
    """
    import SimpleITK

    from homolog.beans.files import write_beans
    from homolog.beans.generate import draw_beans
    from homolog.cohort import Cohort, Subject

    beans = draw_beans(10)
    middle = sorted(bean.width for bean in beans)[5]

    def write(folder):
        for index, subject in enumerate(write_beans(folder, beans, 5).subjects):
            image = SimpleITK.Shrink(SimpleITK.ReadImage(subject.path), [2, 2, 2])  # they are read often
            image[1, 1, 1] = int(index == 0)
            SimpleITK.WriteImage(image, subject.path)

    def compute(folder):
        subjects = [
            Subject(path.stem, path.resolve(), "wide" if bean.width >= middle else "slim")
            for path, bean in zip(sorted(scans.glob("*.nrrd")), beans, strict=True)
        ]
        cohort = Cohort(tuple(subjects), scans)
        run_quickly(folder / "project", cohort, anneal=80, alignment="none", spacing=1.5)

    scans = made_once("beans", write)
    return made_once("slots", compute) / "project"


@pytest.fixture(scope="session")
def run():
    """Return the function that runs a cohort quickly and returns the project's folder."""
    return run_quickly


def run_quickly(folder, cohort, mesh_edge=3.0, anneal=20, **groom):
    from concurrent.futures import ThreadPoolExecutor

    from homolog.grooming import groom_cohort
    from homolog.io.project import ProjectFolder
    from homolog.run import Run
    from homolog.settings import GroomSettings, RunSettings

    settings = RunSettings(
        groom=GroomSettings(mesh_edge=mesh_edge, mirror="off", **groom),
        optimize=quick_settings(128, anneal),
        device="cpu",
        workers=1,
    )
    project = ProjectFolder(folder)
    with ThreadPoolExecutor(2) as executor:  # processes that groom take seconds to start
        groom_cohort(cohort, settings.groom, executor=executor, cache=project.groomed)
    Run(project, cohort, settings).execute()
    return folder


@pytest.fixture
def explore(window, tmp_path, wait):
    """Return a function that opens a copy of a project on a page of Explore, its model fitted."""

    def open_page(project, page):
        shutil.copytree(project, tmp_path / project.name)
        window.projects.open_paths([tmp_path / project.name])
        wait(
            lambda: window.workspace.session.result is not None and window.workspace.session.step == "explore"
        )
        window.commands[f"explore.{page}"].trigger()
        explore = window.inspector.explore
        wait(lambda: explore.fitted.shape is not None)
        return explore.page

    return open_page


@pytest.fixture
def groomed(beans, wait, groomed_cache):
    """Return the window after grooming."""
    shutil.copytree(groomed_cache, beans.workspace.project.groomed)
    beans.commands["run.groom"].trigger()
    wait(lambda: not beans.workspace.session.job.is_busy)
    assert beans.workspace.session.is_groomed
    return beans


@pytest.fixture
def plots():
    """Let the plots of pages be drawn."""


@pytest.fixture(autouse=True)
def _plots_as_needed(request, monkeypatch):
    """Draw the plots of pages in tests that use `plots` only: each takes a tenth of a second."""
    if "plots" not in request.fixturenames:
        from homolog_app.window.explore.plot_canvas import PlotCanvas

        monkeypatch.setattr(PlotCanvas, "draw", lambda canvas: None)


@pytest.fixture
def own_permutations():
    """Let questions of the window have the program's own numbers of permutations and repeats."""


@pytest.fixture(autouse=True)
def _few_permutations(request, monkeypatch):
    """Ask questions with few permutations, but in tests that use `own_permutations`: they take seconds."""
    if "own_permutations" not in request.fixturenames:
        from homolog.comparison.question import Question

        def quick(**question):
            return Question(**(question | {"permutations": 499}))

        monkeypatch.setattr("homolog_app.window.explore.group_form.Question", quick)


@pytest.fixture
def pixel(wait, plots):
    """Return the function that says where a point of the data is on the canvas of a plot."""
    from PySide6.QtCore import QPoint

    def place(canvas, x, y):
        canvas.grab()  # it is drawn when it is seen
        at, up = canvas.figure.axes[0].transData.transform((x, y)) / canvas.device_pixel_ratio
        return QPoint(round(at), round(canvas.height() - up))

    return place


@pytest.fixture
def close(qapp):
    """Return a function that closes a window and handles what that leaves to do."""
    return lambda window: shut(window, qapp)


@pytest.fixture
def errors(monkeypatch):
    """Return the list of errors that would have been shown, instead of dialogs that nobody closes."""
    from homolog_app.window.help import HelpController

    shown = []
    monkeypatch.setattr(HelpController, "show_error", lambda _self, kind, error: shown.append((kind, error)))
    return shown


def shut(window, qapp):
    from PySide6.QtCore import QEvent
    from shiboken6 import isValid

    if isValid(window):
        window.close()
        window.deleteLater()
    for _ in range(3):
        qapp.processEvents()
        qapp.sendPostedEvents(None, QEvent.Type.DeferredDelete)


def assert_nothing_left(qapp):
    """Fail if a widget, a running timer or a thread of the window is still there."""
    from PySide6.QtCore import QTimer

    gc.collect()
    for _ in range(3):
        qapp.processEvents()
    widgets = [widget for widget in qapp.topLevelWidgets() if widget.isVisible()]
    assert not widgets, f"still open: {widgets}"
    for thread in threading.enumerate():
        if thread.name == "homolog-compute":  # in native code, which nothing stops
            thread.join(240.0)
            assert not thread.is_alive(), "the computing thread is still there"
    kinds = {QTimer, *QTimer.__subclasses__()}
    timers = [item for item in gc.get_objects() if type(item) in kinds and _runs(item)]
    assert not timers, f"timers still run: {timers}"


def _runs(timer):
    from shiboken6 import isValid

    return isValid(timer) and timer.isActive()
