import importlib
import os
import signal
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from homolog.cluster import SubjectWorkers, each_in_workers, retried_on_workers
from homolog.errors import Cancelled, InputError, NumericalError, WorkerDiedError
from homolog.progress import no_tick
from homolog.workers import worker_processes

_WORK = """
import os
from homolog.errors import InputError

def dies_once(path):
    if not path.exists():
        path.touch()
        os._exit(1)
    return path.name

def dies(path):
    os._exit(1)

def process(path):
    return os.getpid()

def refuses(path):
    raise InputError(f"{path.name}: bad")
"""


@pytest.fixture
def work(tmp_path, monkeypatch):
    """Functions in a module that workers can import."""
    (tmp_path / "work_of_workers.py").write_text(_WORK)
    monkeypatch.syspath_prepend(tmp_path)
    return importlib.import_module("work_of_workers")


def test_what_a_dead_worker_had_in_hand_is_begun_again(tmp_path, work):
    jobs = {name: tmp_path / name for name in "abc"}
    with SubjectWorkers(1) as workers:
        assert dict(workers.each(work.dies_once, jobs, "testing")) == {name: name for name in "abc"}


def test_workers_that_always_die_end_the_work(tmp_path, work):
    with SubjectWorkers(1) as workers, pytest.raises(NumericalError, match="fewer workers"):
        list(workers.each(work.dies, {"a": tmp_path / "a"}, "testing"))


def test_an_error_of_a_subject_is_raised_at_once(tmp_path, work):
    with SubjectWorkers(1) as workers, pytest.raises(InputError, match="bad"):
        list(workers.each(work.refuses, {"a": tmp_path / "a"}, "testing"))


def test_workers_are_kept_from_one_step_to_the_next(tmp_path, work):
    with SubjectWorkers(1) as workers:
        first, second = (dict(workers.each(work.process, {"a": tmp_path}, "testing")) for _ in range(2))
    assert first == second


def test_no_thread_fails_when_workers_are_left_with_jobs_waiting():
    ticks = []

    def cancel(fraction, message):
        ticks.append(fraction)
        if len(ticks) > 4:  # after some 0.4 s
            raise Cancelled

    with worker_processes(2) as executor:
        process = executor.submit(os.getpid).result(60)
        jobs = {str(number): 1000.0 for number in range(20)}
        with pytest.raises(Cancelled):
            next(each_in_workers(executor, time.sleep, jobs, "waiting", cancel))
        os.kill(process, signal.SIGTERM)  # as at the end of the block, where its thread may see this first
        time.sleep(0.2)


def test_few_jobs_wait_in_the_executor_at_a_time(monkeypatch):
    monkeypatch.setattr("homolog.cluster._AHEAD", 3)
    waiting, most = set(), []

    class Counting(ThreadPoolExecutor):
        def submit(self, function, /, *arguments):
            future = super().submit(function, *arguments)
            waiting.add(future)
            most.append(len(waiting))
            return future

    with Counting(1) as executor:
        for name, future in each_in_workers(
            executor, str, {f"{k}": k for k in range(20)}, "testing", no_tick
        ):
            waiting.discard(future)
            assert future.result() == name
    assert len(most) == 20
    assert max(most) == 3


@pytest.mark.parametrize("deaths", [2, 3])
def test_work_is_repeated_with_new_workers_until_three_have_died(deaths):
    executors = []

    def work(executor):
        executors.append(executor)
        if len(executors) <= deaths:
            raise WorkerDiedError("died")
        return "done"

    if deaths < 3:
        assert retried_on_workers(work, "testing", 1) == "done"
    else:
        with pytest.raises(WorkerDiedError):
            retried_on_workers(work, "testing", 1)
    assert len(set(executors)) == 3
