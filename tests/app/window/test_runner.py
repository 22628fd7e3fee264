"""The computing thread and its job."""

import threading

import pytest

from homolog_app.window.runner import Runner, Task

pytestmark = pytest.mark.window


@pytest.fixture
def runner(qapp):
    from PySide6.QtCore import QObject

    owner = QObject()
    made = Runner(owner)
    made.ends = []
    made.ended.connect(made.ends.append)
    yield made
    assert made.close()
    owner.deleteLater()


def forever(tick):
    while True:
        tick(0.5, "going round")


def test_a_result_comes_back_in_the_windows_thread(runner, wait):
    seen = []
    runner.ended.connect(lambda _: seen.append(threading.current_thread()))
    runner.start(Task(lambda tick: threading.current_thread().name, ""))
    wait(lambda: runner.ends)
    assert runner.ends[0].result == "homolog-compute"
    assert seen == [threading.main_thread()]


@pytest.mark.parametrize("error", [RuntimeError("device"), ValueError("value"), MemoryError(), SystemExit(1)])
def test_every_kind_of_error_ends_the_job_and_the_thread_lives_on(runner, wait, error):
    def fail(tick):
        raise error

    runner.start(Task(fail, ""))
    wait(lambda: runner.ends)
    assert runner.ends[0].error is error
    runner.start(Task(lambda tick: 7, ""))
    wait(lambda: len(runner.ends) == 2)
    assert runner.ends[1].result == 7


def test_a_paused_job_waits_and_can_be_cancelled(runner, wait):
    job = Task(forever, "")
    runner.start(job)
    job.set_paused(True)
    wait(lambda: job.status.paused)
    runner.cancel()
    wait(lambda: runner.ends)
    assert runner.ends[0].cancelled


def test_a_job_that_was_cancelled_before_it_began_never_works(runner, wait):
    worked = []
    job = Task(lambda tick: [tick(0.0, ""), worked.append(True)], "")
    job.cancel()
    runner.start(job)
    wait(lambda: runner.ends)
    assert runner.ends[0].cancelled
    assert not worked


def test_only_one_job_goes_on_at_a_time(runner):
    runner.start(Task(forever, ""))
    with pytest.raises(RuntimeError, match="in progress"):
        runner.start(Task(forever, ""))


def test_progress_is_told_in_order_and_the_newest_wins(runner, wait):
    messages = []
    runner.progressed.connect(lambda status: messages.append(status.fraction))
    runner.start(Task(lambda tick: [tick(step / 1000, "") for step in range(1000)], ""))
    wait(lambda: runner.ends)
    assert messages == sorted(messages)
    assert len(messages) < 1000


class Widget:
    """Stands for an object of Qt that a job refers to; notes in which thread it is freed."""

    def __init__(self, freed):
        self.freed = freed

    def __del__(self):
        self.freed.append(threading.current_thread())

    def work(self, tick):
        tick(0.5, "working")


def test_what_a_job_refers_to_is_freed_in_the_windows_thread(runner, wait):
    freed = []
    for _ in range(50):
        runner.start(Task(Widget(freed).work, ""))
        wait(lambda: runner.job is None)
        runner.ends.clear()
    assert runner.close()
    assert freed == [threading.main_thread()] * 50


def test_a_computation_that_can_not_be_stopped_frees_nothing_when_it_ends_after_its_window(qapp):
    from PySide6.QtCore import QObject

    freed, begun, released = [], threading.Event(), threading.Event()

    class Compiler(Widget):
        def work(self, tick):
            begun.set()
            released.wait(60.0)  # native code looks at no tick

    owner = QObject()
    runner = Runner(owner)
    runner.start(Task(Compiler(freed).work, ""))
    begun.wait()
    assert not runner.close(0.0)
    (thread,) = (thread for thread in threading.enumerate() if thread.name == "homolog-compute")
    owner.deleteLater()
    del owner, runner
    released.set()
    thread.join()
    assert threading.main_thread() is threading.current_thread()
    assert thread not in freed
