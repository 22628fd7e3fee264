"""Runs killed at random moments of each phase, forked from one warm process; benchmarks/kill.py does more."""

import json
import shutil
import subprocess
import sys

import pytest

PHASES = ("grooming", "geodesics", "splitting", "optimizing", "writing")
PROGRAM = """
import json, os, random, shutil, signal, sys, threading, time
from pathlib import Path
from homolog.cohort import read_cohort
from homolog.io.project import ProjectFolder
from homolog.io.results import read_result
from homolog.run import Run, table_cache
from homolog.settings import GroomSettings, OptimizeSettings, RunSettings

SETTINGS = RunSettings(
    groom=GroomSettings(alignment="center", mesh_edge=4.0),
    optimize=OptimizeSettings(particles=24, split_iterations=5, anneal_iterations=30, settle_iterations=30),
    device="cpu",
    workers=1,
)
COHORT, WHOLE, KILLED = Path("scans"), Path("whole"), Path("killed")
table_cache.WORTH_S = 0.0  # so short a run would keep none

def run(folder, follow=lambda phase: None, **how):
    project = ProjectFolder(folder)
    Run(project, read_cohort(COHORT), SETTINGS, **how).execute(lambda status: follow(status.phase))

def forked(work):
    # Run in a child of its own, and return the signal or exit code that ended it.
    child = os.fork()
    if child:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    try:
        work()
    finally:
        os._exit(int(sys.exc_info()[0] is not None))

def contents(folder):
    kept = [folder / "energies.csv", *folder.glob("particles/*"), *folder.glob("model/*")]
    return {str(one.relative_to(folder)): one.read_bytes() for one in kept}

def killed_in(phase, longest):
    begun = []
    def follow(now):
        if now == phase and not begun:
            begun.append(now)
            moment = random.uniform(0.0, longest)
            threading.Timer(moment, os.kill, (os.getpid(), signal.SIGKILL)).start()
    run(KILLED, follow)

def main():
    random.seed(11)
    spans, since = {}, [time.monotonic()]
    def note(phase):
        if phase not in spans:
            spans[phase] = time.monotonic()
    run(WHOLE)
    run(WHOLE, note)
    ends = [*list(spans.values())[1:], time.monotonic()]
    spans = {phase: end - begin for (phase, begin), end in zip(spans.items(), ends)}
    whole = contents(WHOLE)
    for number in range(int(sys.argv[1])):
        phase = sys.argv[2 + number % (len(sys.argv) - 2)]
        shutil.rmtree(KILLED, ignore_errors=True)
        shutil.copytree(WHOLE, KILLED)
        if phase == "grooming":
            next(KILLED.glob("groomed/*.npz")).unlink()
        ended = forked(lambda: killed_in(phase, max(0.01, 0.7 * spans.get(phase, 0.0))))
        readable = forked(lambda: read_result(ProjectFolder(KILLED))) == 0
        unfinished = ProjectFolder(KILLED).read().unfinished
        resumed = forked(lambda: run(KILLED, resume=True)) == 0 if unfinished else True
        alike = contents(KILLED) == whole
        print(json.dumps([phase, ended, readable, unfinished, resumed, alike]), flush=True)

if __name__ == "__main__":  # workers import this file too
    main()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="processes can't be forked there")
@pytest.mark.timeout(600)
def test_runs_killed_at_random_moments_of_each_phase_stay_readable_and_are_resumed_to_the_same_bytes(
    ellipsoids, tmp_path, search_path
):
    (tmp_path / "program.py").write_text(PROGRAM)
    (tmp_path / "scans").mkdir()
    for name in ("a.nrrd", "b.nrrd"):
        shutil.copy(ellipsoids / name, tmp_path / "scans")
    command = [sys.executable, "program.py", str(len(PHASES)), *PHASES]
    done = subprocess.run(command, cwd=tmp_path, env=search_path, capture_output=True, text=True, check=False)
    tries = [json.loads(line) for line in done.stdout.splitlines()]
    assert (done.returncode, len(tries)) == (0, len(PHASES)), done.stderr
    assert sum(ended == -9 for _, ended, *_ in tries) >= 3, tries  # others came to their end before
    for phase, ended, readable, _, resumed, alike in tries:
        assert (readable, resumed, alike) == (True, True, True), (phase, ended, done.stderr)
