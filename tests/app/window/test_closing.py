"""Closing a project: what was asked for is done first."""

import subprocess
import sys
import threading
from dataclasses import replace

import numpy as np
import pytest

pytestmark = pytest.mark.window


@pytest.fixture
def changed(explored, monkeypatch):
    """Return the window with unsaved particles; the answer to all questions is Save or Stop."""
    session = explored.workspace.session
    local = session.result.result.local[:, ::-1].copy()
    moved = replace(session.result, result=replace(session.result.result, local=local))
    session.exchange_result(moved, "Optimize again")
    monkeypatch.setattr("homolog_app.window.project_controller.ask", lambda *given: given[3][0])
    monkeypatch.setattr(type(explored.workspace.preferences), "ask_on_close", True)
    return explored


def particles_of(window):
    from homolog.io.results import read_result

    return read_result(window.workspace.project).local


def test_particles_are_in_the_project_before_the_window_is_left(changed):
    result = changed.workspace.session.result.result
    assert changed.projects.may_leave()
    np.testing.assert_allclose(particles_of(changed), result.local, atol=1e-4)


def test_particles_are_saved_after_a_computation_was_stopped(changed, wait):
    work, session = changed.workspace.work, changed.workspace.session
    result, begun = session.result.result, threading.Event()

    def compute(tick):
        begun.set()
        while True:
            tick(0.5, "counting")

    wait(lambda: not session.job.is_busy)
    work.compute("reference", compute, "counting", lambda _: None)
    wait(begun.is_set)
    assert changed.projects.may_leave()
    np.testing.assert_allclose(particles_of(changed), result.local, atol=1e-4)


CHILD = """
import sys, threading, time
from PySide6.QtCore import QStandardPaths, QTimer
from homolog_app.window import start

begun = threading.Event()
def compile_for_hours(tick):
    begun.set()
    time.sleep(3600)

def close():
    if begun.is_set():
        timer.stop()
        print(window().close(), flush=True)

def window():
    return next(item for item in start.QApplication.topLevelWidgets() if type(item).__name__ == "MainWindow")

QStandardPaths.setTestModeEnabled(True)
start.make_application()
timer = QTimer(interval=100)
timer.timeout.connect(close)
timer.start()
import homolog_app.window.work
homolog_app.window.work.prepare = compile_for_hours
sys.exit(start.start([]))
"""


def test_the_program_ends_while_something_that_can_not_be_stopped_is_computed(tmp_path):
    script = tmp_path / "child.py"
    script.write_text(CHILD, encoding="utf-8")
    ended = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=240)
    assert (ended.returncode, ended.stdout) == (0, "True\n"), ended.stderr
