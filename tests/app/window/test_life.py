"""Life and death: cancel in every phase, crashes, random orders, opening and closing again and again."""

import gc
import random
import shutil
import signal
import subprocess
import sys
import threading
import time
import weakref

import pytest

from homolog.settings import OptimizeSettings
from homolog_app.window.study_files import JournalRecord

pytestmark = [pytest.mark.window, pytest.mark.own_window]

LONG = OptimizeSettings(particles=64, split_iterations=10)  # its last stage takes much longer than a test
PHASES = ("any", "geodesics", "splitting", "optimizing")


def start_run(window, wait):
    """Start a run and wait until it has started: files are read before."""
    session = window.workspace.session
    window.commands["run.start"].trigger()
    wait(lambda: session.job.run is not None or session.result is not None)


@pytest.mark.parametrize("phase", PHASES)
def test_a_run_can_be_cancelled_in_every_phase(groomed, errors, wait, phase):
    work = groomed.workspace.work
    groomed.workspace.edit_settings("optimize", "particles", LONG)
    start_run(groomed, wait)
    wait(lambda: work.session.job.run is None or phase in ("any", work.session.job.run.status.phase))
    assert work.session.job.run is not None
    groomed.commands["run.cancel"].trigger()
    wait(lambda: not work.session.job.is_busy)
    assert not errors
    assert groomed.commands["run.start"].isEnabled()


def test_a_paused_run_stands_still_and_goes_on(groomed, errors, wait):
    work = groomed.workspace.work
    groomed.workspace.edit_settings("optimize", "particles", LONG)
    start_run(groomed, wait)
    wait(lambda: work.session.job.run.frame is not None)
    groomed.commands["run.pause"].trigger()
    wait(lambda: work.session.job.run.status.paused)
    frame = work.session.job.run.frame
    wait(lambda: groomed.inspector.correspond.pause.text() == "Resume")
    assert work.session.job.run.frame is frame
    groomed.commands["run.pause"].trigger()
    wait(lambda: work.session.job.run.frame is not frame)
    groomed.commands["run.cancel"].trigger()
    wait(lambda: not work.session.job.is_busy)
    assert not errors


def test_a_cancelled_run_is_resumed_from_its_checkpoint(groomed, errors, wait, quick):
    work = groomed.workspace.work
    groomed.workspace.edit_settings("optimize", "particles", quick(64))
    start_run(groomed, wait)
    wait(lambda: work.session.job.run is None or groomed.workspace.project.checkpoint.is_file())
    groomed.commands["run.cancel"].trigger()
    wait(lambda: not work.session.job.is_busy)
    if groomed.workspace.session.result is None:
        assert groomed.commands["run.resume"].isEnabled()
        groomed.commands["run.resume"].trigger()
        wait(lambda: not work.session.job.is_busy)
    assert groomed.workspace.session.result.result.world.shape[1] == 64
    (record,) = groomed.workspace.sessions.glob("*/journal.json")
    wait(lambda: not JournalRecord.model_validate_json(record.read_bytes()).running)
    assert not errors


def test_a_project_whose_run_was_stopped_says_so_when_it_is_opened(
    groomed, close, make_window, tmp_path, wait
):
    work = groomed.workspace.work
    groomed.projects.save_to(tmp_path / "stopped")
    groomed.workspace.edit_settings("optimize", "particles", LONG)
    start_run(groomed, wait)
    wait(lambda: work.session.job.run is None or groomed.workspace.project.checkpoint.is_file())
    groomed.commands["run.cancel"].trigger()
    wait(lambda: not work.session.job.is_busy)
    groomed.projects.save()
    close(groomed)
    window = make_window()
    window.projects.open_paths([tmp_path / "stopped"])
    assert window.workspace.session.step == "correspond"
    wait(lambda: window.inspector.correspond.resume.isVisible())
    assert "Resume continues" in window.inspector.correspond.summary.text()


def test_fifty_random_orders_leave_the_window_whole(groomed, errors, wait, quick):
    orders = random.Random(3)
    groomed.workspace.edit_settings("optimize", "particles", quick(16))
    names = (
        "run.start",
        "run.pause",
        "run.cancel",
        "run.groom",
        "view.next",
        "view.grid1",
        "view.grid9",
        "view.raw",
        "edit.undo",
        "edit.redo",
        "view.slice",
        "view.theme",
        "run.play",
    )
    for _ in range(50):
        possible = [name for name in names if groomed.commands[name].isEnabled()]
        groomed.commands[orders.choice(possible)].trigger()
        pause = time.monotonic() + orders.random() * 0.15
        wait(lambda end=pause: time.monotonic() > end)
    groomed.workspace.work.cancel()
    wait(
        lambda: (
            groomed.workspace.session.job.run is None or not groomed.workspace.session.job.run.status.paused
        )
    )
    wait(lambda: not groomed.workspace.session.job.is_busy)
    assert not errors


def test_a_window_closed_in_mid_run_leaves_nothing_behind(groomed, close, wait):
    start_run(groomed, wait)
    wait(lambda: groomed.workspace.session.job.run.frame is not None)
    close(groomed)


def compute(window, kind, wait):
    """Let a window's computing thread begin a job of a kind."""
    session, pages = window.workspace.session, {"check": "check", "model": "modes", "groups": "groups"}
    wait(lambda: not session.job.is_busy and (len(session.surveys) == 4 or session.result is not None))
    name = {"groom": "run.groom", "run": "run.start"}.get(kind) or f"explore.{pages[kind]}"
    wait(window.commands[name].isEnabled)
    window.commands[name].trigger()
    if kind == "groups":
        page = window.inspector.explore.page
        wait(lambda: page.go.isEnabled())
        page.go.click()
    wait(lambda: session.job.kind == kind and not session.job.following, what=f"for {kind}")


@pytest.fixture
def endless(monkeypatch):
    """Return kinds of jobs, and an event: the computing thread goes on with them until that is set."""
    from homolog_app.window.work import Work

    kinds, closed, compute = set(), threading.Event(), Work.compute

    def computed(work, kind, job, message, take):
        execute = job if callable(job) else job.execute

        def held(*tick):
            result = execute(*tick)
            closed.wait(240.0)
            return result

        if kind in kinds and callable(job):
            job = held
        elif kind in kinds:
            job.execute = held
        compute(work, kind, job, message, take)

    monkeypatch.setattr(Work, "compute", computed)
    yield kinds, closed
    closed.set()


@pytest.mark.parametrize("kind", ["groom", "run", "check", "model", "groups"])
def test_a_computation_that_outlives_its_window_frees_nothing_of_it_in_its_own_thread(
    kind,
    make_window,
    ellipsoids,
    groomed_cache,
    finished,
    bean_project,
    tmp_path,
    close,
    wait,
    quick,
    coarse,
    endless,
    monkeypatch,
):
    from PySide6.QtCore import QObject

    from homolog_app.window.runner import Runner

    window, (kinds, closed), freed, close_runner = make_window(), endless, set(), Runner.close
    kinds.add(kind)
    project = {"check": finished, "model": finished, "groups": bean_project}.get(kind)
    window.projects.open_paths([ellipsoids if project is None else shutil.copytree(project, tmp_path / "p")])
    if project is None:
        window.workspace.edit_settings("groom", "mesh_edge", coarse)
        window.workspace.edit_settings("optimize", "particles", quick(16))
    if kind == "run":
        shutil.copytree(groomed_cache, window.workspace.project.groomed)
        compute(window, "groom", wait)
    compute(window, kind, wait)
    (thread,) = (thread for thread in threading.enumerate() if thread.name == "homolog-compute")
    monkeypatch.setattr(Runner, "cancel", lambda runner: None)  # as in native code, which looks at no tick
    monkeypatch.setattr(Runner, "close", lambda runner: close_runner(runner, 0.0))
    for item in window.findChildren(QObject):
        weakref.finalize(item, lambda: freed.add(threading.current_thread().name))
    close(window)
    del item, window
    assert thread.is_alive()
    closed.set()
    thread.join(240.0)
    gc.collect()
    assert freed == {threading.main_thread().name}


def test_windows_can_be_opened_and_closed_again_and_again(make_window, close):
    for _ in range(4):
        close(make_window())


def test_an_interrupt_closes_the_window_unless_the_user_lets_it_go_on(make_window, wait, monkeypatch):
    from homolog_app.window.start import interrupt_closes

    window, before = make_window(views=False), signal.getsignal(signal.SIGINT)
    answers = [False, True]
    monkeypatch.setattr(window.projects, "may_leave", lambda: answers.pop(0))
    with interrupt_closes(window):
        signal.raise_signal(signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) is signal.SIG_DFL  # a second one would end the program
        wait(lambda: signal.getsignal(signal.SIGINT) is not signal.SIG_DFL)
        assert window.isVisible()
        signal.raise_signal(signal.SIGINT)
        wait(lambda: not window.isVisible())
    assert not answers
    assert signal.getsignal(signal.SIGINT) is before


def test_a_closed_window_lets_go_of_everything_that_vtk_draws(qapp, ellipsoids, close, wait, tmp_path):
    from vtkmodules.vtkRenderingCore import vtkProp, vtkRenderer, vtkRenderWindow

    from homolog_app.window.start import make_window

    def drawn():
        gc.collect()
        kinds = vtkProp | vtkRenderer | vtkRenderWindow
        return sum(isinstance(item, kinds) for item in gc.get_objects())

    before = drawn()
    window = make_window(qapp, tmp_path)
    window.workspace.preferences.ask_on_close = False
    window.show()
    window.load_views()
    window.projects.open_paths([ellipsoids])
    wait(lambda session=window.workspace.session: len(session.surveys) == 4)
    assert drawn() > before + 16
    close(window)
    del window
    assert drawn() == before


CHILD = """
import sys, time
from pathlib import Path
from homolog.settings import GroomSettings, OptimizeSettings
from homolog_app.window.start import make_application, make_window

if __name__ == "__main__":
    home, cohort, cache = map(Path, sys.argv[1:])
    app = make_application()
    window = make_window(app, home)
    window.show()
    window.load_views()
    workspace = window.workspace
    def until(condition):
        while not condition():
            app.processEvents()
            time.sleep(0.01)
    window.projects.open_paths([cohort])
    workspace.edit_settings("groom", "mesh_edge", GroomSettings(
        mesh_edge=1.0, alignment="center", mirror="off"))
    workspace.edit_settings("optimize", "particles", OptimizeSettings(
        particles=128, split_iterations=30, anneal_iterations=100, settle_iterations=5))
    until(lambda: len(workspace.session.surveys) == 4)
    import shutil
    shutil.copytree(cache, workspace.project.groomed)
    window.commands["run.groom"].trigger()
    until(lambda: not workspace.session.job.is_busy)
    window.commands["run.start"].trigger()
    until(lambda: workspace.project.checkpoint.is_file())
    print("ready", flush=True)
    until(lambda: False)
"""


def test_files_are_read_at_once_while_kernels_are_being_compiled(make_window, ellipsoids, wait, monkeypatch):
    def compiling(tick):
        while True:
            tick(0.0, "compiling")
            time.sleep(0.01)

    monkeypatch.setattr("homolog_app.window.work.prepare", compiling)
    window = make_window()
    work = window.workspace.work
    work.go_on()
    wait(lambda: work.session.job.kind == "prepare")
    window.projects.open_paths([ellipsoids])
    wait(lambda: len(work.session.surveys) == 4)


def test_after_a_kill_in_mid_run_the_next_start_offers_what_was_lost(
    make_window, ellipsoids, groomed_cache, tmp_path, monkeypatch, errors, wait
):
    home = tmp_path / "home"
    home.mkdir()
    script = tmp_path / "child.py"
    script.write_text(CHILD, encoding="utf-8")
    child = subprocess.Popen(
        [sys.executable, script, home, ellipsoids, groomed_cache], stdout=subprocess.PIPE, text=True
    )
    assert "ready" in child.stdout.readline()
    child.kill()
    child.wait()
    child.stdout.close()

    questions = []

    def ask(_parent, title, message, answers):
        questions.append(f"{title} {message}")
        assert answers[-1] == "Later"  # closing the question discards nothing
        return answers[0]

    monkeypatch.setattr("homolog_app.window.project_controller.ask", ask)
    window = make_window(home)
    window.projects.offer_recovery()
    assert questions == [
        "Recover a study that was never saved? "
        "The program ended without closing it: 4 subjects, a run was in progress."
    ]
    session = window.workspace.session
    assert [member.name for member in session.study.members] == ["a", "b", "c", "d"]
    assert session.study.settings.optimize.particles == 128
    assert window.workspace.session.step == "correspond"
    window.commands["run.resume"].trigger()
    wait(lambda: not window.workspace.session.job.is_busy)
    assert session.result.result.world.shape == (4, 128, 3)
    assert not errors
