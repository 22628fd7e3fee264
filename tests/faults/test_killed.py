"""Programs that are killed; tests/benchmarks/kill.py does it at random moments and more often."""

import os
import signal
import subprocess
import sys
import time

import pytest

from homolog.errors import InputError
from homolog.io.project import ProjectFolder
from homolog.io.results import read_result
from homolog.run import table_cache

RUN = """
import os, signal, sys
from pathlib import Path
from homolog.cohort import read_cohort
from homolog.io.project import ProjectFolder
from homolog.run import Run, table_cache
from homolog.settings import RunSettings

folder, settings, place, times = sys.argv[1:]
left = int(times)
table_cache.WORTH_S = 0.0  # so short a run would keep none

def die(event, arguments):
    global left
    if event == "os.rename" and place in str(arguments[0]):
        left -= 1
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)

if __name__ == "__main__":  # workers import this file too
    sys.addaudithook(die)
    folder, settings = Path(folder), RunSettings.model_validate_json(settings)
    Run(ProjectFolder(folder / "project"), read_cohort(folder / "scans"), settings).execute()
"""


@pytest.fixture
def killed_at(project, short_settings, search_path):
    """Return a function that runs the project and kills it when it renames a file for the n-th time."""

    def run(place, times):
        folder = project.folder.parent
        (folder / "program.py").write_text(RUN)
        command = [sys.executable, "program.py", ".", short_settings.model_dump_json(), place, str(times)]
        ended = subprocess.run(
            command, cwd=folder, env=search_path, capture_output=True, text=True, check=False
        )
        assert ended.returncode == -signal.SIGKILL, ended.stderr

    return run


@pytest.mark.parametrize(
    ("moment", "place", "times"),
    [
        ("grooming", "-b.npz", 1),
        ("splitting", "-checkpoint.npz", 3),
        ("moving the new result into place", ".next/model", 1),
    ],
)
def test_a_killed_run_is_resumed_to_the_same_result(
    moment, place, times, project, run_of, results, killed_at
):
    whole = results(project.folder)
    if moment == "grooming":
        (project.groomed / "b.npz").unlink()
    killed_at(place, times)
    project.recover()
    assert read_result(project).names == ("a", "b", "c", "d")
    assert results(project.folder) == whole
    if project.read().unfinished:
        run_of(project, resume=True).execute()
        assert results(project.folder) == whole
    with project.locked():
        assert not list(project.folder.rglob(".part-*"))


def test_a_run_killed_between_two_geodesic_tables_solves_only_those_it_lacks(
    project, run_of, results, killed_at, monkeypatch
):
    whole, solved = results(project.folder), []

    def solve(plan, real=table_cache.each_table, **how):
        solved.extend(task.name for task in plan.tasks)
        return real(plan, **how)

    killed_at("/geodesics/", 3)
    assert len([path for path in project.geodesics.iterdir() if not path.name.startswith(".")]) == 2
    monkeypatch.setattr(table_cache, "each_table", solve)
    run_of(project, resume=True).execute()
    assert len(solved) == 2
    assert results(project.folder) == whole
    assert not project.geodesics.exists()


def test_the_lock_of_a_killed_program_is_taken_over(tmp_path, holder):
    project = ProjectFolder(tmp_path / "project")
    with holder(project) as other:
        with pytest.raises(InputError, match="in use"), project.locked():
            pass
        other.kill()
    with project.locked():
        assert (project.folder / ".lock").exists()


SPAWN = """
import os, sys, time
from concurrent.futures import wait
from homolog.workers import worker_processes
if __name__ == "__main__":
    with worker_processes(2) as executor:
        print(*{executor.submit(os.getpid).result() for _ in range(9)}, flush=True)
        wait([executor.submit(time.sleep, 60)])
"""


def test_the_workers_of_a_killed_program_end_with_it(tmp_path, search_path):
    (tmp_path / "program.py").write_text(SPAWN)
    command = [sys.executable, tmp_path / "program.py"]
    with subprocess.Popen(command, env=search_path, stdout=subprocess.PIPE, text=True) as parent:
        workers = [int(part) for part in parent.stdout.readline().split()]
        parent.kill()
    deadline = time.monotonic() + 20.0
    while any(is_alive(worker) for worker in workers):
        assert time.monotonic() < deadline, "workers live on"
        time.sleep(0.05)
    assert workers


def is_alive(number):
    try:
        os.kill(number, 0)
        with open(f"/proc/{number}/stat") as stream:
            return stream.read().split(")")[1].split()[0] != "Z"
    except (ProcessLookupError, FileNotFoundError):
        return False
