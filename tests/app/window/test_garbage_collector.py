"""Garbage is collected where Qt and VTK may be touched: in the window's thread."""

import gc
import threading

import pytest

from homolog_app.window.runner import GarbageCollector, Task

pytestmark = pytest.mark.window


@pytest.fixture
def collections():
    """Return a list that every collection adds its thread's name to."""
    threads = []

    def note(phase, _info):
        if phase == "start":
            threads.append(threading.current_thread().name)

    gc.callbacks.append(note)
    yield threads
    gc.callbacks.remove(note)


class Knot:
    """Refers to itself, so that only the collector frees it; notes in which thread that was."""

    def __init__(self, freed):
        self.itself = self
        self.freed = freed

    def __del__(self):
        self.freed.append(threading.current_thread().name)


def tie_knots(freed):
    """Return work that leaves garbage and makes the collector, were it on, run in its own thread."""

    def work(tick):
        for k in range(50):
            tick(k / 50, "knots")
            Knot(freed)
            _ = [[] for _ in range(2000)]

    return work


def test_python_does_not_collect_by_itself_while_a_window_is_open_nor_after_it_has_closed(make_window, close):
    window = make_window(views=False)
    assert not gc.isenabled()
    close(window)
    assert (
        not gc.isenabled()
    )  # another thread may still compute, and Qt deletes widgets without Python's lock


def test_no_widget_owns_the_screen(make_window, qapp, finished):
    """PySide makes the result of `widget.screen()` a child of the widget, and may delete it as garbage."""
    import shiboken6

    from homolog_app.window.export.choosers import KINDS
    from homolog_app.window.export.dialog import ExportDialog, Exported

    window = make_window(views=False)
    ExportDialog(window, KINDS["film"], Exported(finished, "film", finished.parent, 3, 1, {}))
    assert "parent" not in shiboken6.dump(qapp.primaryScreen())


def test_what_the_computing_thread_leaves_is_collected_in_the_windows(
    make_window, wait, collections, monkeypatch
):
    monkeypatch.setattr("homolog_app.window.runner.REST", 0.0)
    workspace = make_window(views=False).workspace
    freed, main = [], threading.current_thread().name
    ended = []
    workspace.work.runner.ended.connect(ended.append)
    workspace.work.runner.start(Task(tie_knots(freed), "knots"))
    hoard = []

    def all_are_freed():
        hoard.extend([] for _ in range(100))  # the collector rests where nothing new is made
        return ended and len(freed) == 50

    wait(all_are_freed)
    assert set(collections) == {main}
    assert set(freed) == {main}


def test_a_run_collects_no_garbage_in_its_own_thread(groomed, errors, wait, collections):
    groomed.commands["run.start"].trigger()
    wait(lambda: not groomed.workspace.session.job.is_busy)
    assert not errors
    assert set(collections) <= {threading.current_thread().name}


def test_all_garbage_is_collected_now_and_then_but_not_all_the_time(qapp, collections, monkeypatch):
    from PySide6.QtCore import QObject

    owner = QObject()
    garbage_collector = GarbageCollector(owner)
    monkeypatch.setattr("homolog_app.window.runner.REST", 1e6)
    kinds = []

    def note(phase, info):
        if phase == "start":
            kinds.append(info["generation"])

    gc.callbacks.append(note)
    enough = 2 * gc.get_threshold()[0]
    for _ in range(300):
        _ = [[] for _ in range(enough)]
        garbage_collector.sweep()
    gc.callbacks.remove(note)
    owner.deleteLater()
    assert kinds.count(2) == 1
    assert kinds.count(1) > 3
    assert kinds.count(0) > 100
