import os
import signal
import subprocess
import sys
import time
import types

import numpy as np
import pytest

from homolog.workers import main_guard_hint, worker_processes


def alive(pid):
    try:
        with open(f"/proc/{pid}/stat") as stream:
            return stream.read().split(")")[1].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc")
def test_workers_end_at_once_when_the_block_is_left():
    with worker_processes(2) as executor:
        pid = executor.submit(os.getpid).result(60)
        executor.submit(time.sleep, 1000)
        assert pid != os.getpid()
        assert alive(pid)
    assert not alive(pid)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems have no server of processes")
def test_workers_are_forked_with_what_grooms_loaded_and_nothing_of_this_process_changed():
    before = dict(os.environ)
    with worker_processes(1) as executor:
        loaded = executor.submit(eval, "set(__import__('sys').modules)").result(60)
        threads = executor.submit(os.getenv, "OPENBLAS_NUM_THREADS").result(60)
        gpus = executor.submit(os.getenv, "CUDA_VISIBLE_DEVICES").result(60)
    assert gpus == ""  # no context of CUDA is forked
    assert "homolog.grooming.cohort" in loaded
    assert not {"matplotlib", "PySide6", "vtkmodules"} & loaded
    assert threads == before.get("OPENBLAS_NUM_THREADS", "1")
    assert dict(os.environ) == before


def test_a_fresh_worker_sees_the_present_environment(monkeypatch):
    monkeypatch.setenv("WORKERS_TEST", "now")
    with worker_processes(1, fresh=True) as executor:
        assert executor.submit(os.getenv, "WORKERS_TEST").result(60) == "now"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc")
def test_workers_end_with_a_killed_parent_and_its_temporary_folder_is_removed(tmp_path):
    code = (
        "import os, time\n"
        "from homolog.workers import worker_processes\n"
        "if __name__ == '__main__':\n"
        "    with worker_processes(2) as executor:\n"
        "        print(executor.submit(os.getpid).result(60), flush=True)\n"
        "        executor.submit(time.sleep, 1000).result()\n"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "TMPDIR": str(tmp_path)}
    command = [sys.executable, "-c", code]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=environment
    ) as parent:
        pid = int(parent.stdout.readline())
        assert alive(pid)
        assert [*tmp_path.glob("pymp-*")]  # of multiprocessing
        parent.send_signal(signal.SIGKILL)
    deadline = time.monotonic() + 30
    while (alive(pid) or [*tmp_path.glob("pymp-*")]) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not alive(pid)
    assert not [*tmp_path.glob("pymp-*")]


def test_only_a_script_of_the_user_is_told_to_guard_its_work(monkeypatch):
    script = types.ModuleType("__main__")
    script.__file__, script.__spec__ = "study.py", None
    monkeypatch.setitem(sys.modules, "__main__", script)
    assert "__main__" in main_guard_hint()
    script.__file__ = "/usr/bin/homolog"
    assert main_guard_hint() == ""


def test_workers_end_at_once_while_they_are_sending_results():
    for wait in np.linspace(0.0, 0.1, 6):
        with worker_processes(2) as executor:
            futures = [executor.submit(np.ones, 4_000_000) for _ in range(12)]
            futures[0].result()
            time.sleep(wait)
        assert all(future.done() for future in futures)
