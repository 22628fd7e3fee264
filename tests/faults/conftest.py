import os
import resource
import shutil
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest

from homolog.cohort import read_cohort
from homolog.io.project import ProjectFolder
from homolog.run import Run

ROOT = Path(__file__).parents[2]


@pytest.fixture
def project(finished_run, ellipsoids, tmp_path):
    """Return a copy of the finished project, beside a copy of the ellipsoids in ``scans``."""
    shutil.copytree(ellipsoids, tmp_path / "scans")
    shutil.copytree(finished_run.folder, tmp_path / "project")
    return ProjectFolder(tmp_path / "project")


@pytest.fixture
def run_of(short_settings):
    """Return a function that makes a run of the scans beside a project."""

    def make(project, **options):
        return Run(project, read_cohort(project.folder.parent / "scans"), short_settings, **options)

    return make


@pytest.fixture
def contents():
    """Return a function that reads every file of a folder, but locks, by name."""

    def read(folder):
        return {
            str(path.relative_to(folder)): path.read_bytes()
            for path in sorted(folder.rglob("*"))
            if path.is_file() and path.name not in (".lock", ".holder")
        }

    return read


@pytest.fixture
def results():
    """Return a function that reads the files of a result by name; without the record and its time of day."""

    def read(folder):
        files = [folder / "energies.csv", *folder.glob("particles/*"), *folder.glob("model/*")]
        return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(files)}

    return read


@pytest.fixture
def files_up_to():
    """Return a block in which the system lets no file of this process grow beyond some bytes.

    The limit has to be gone before pytest itself writes: its output may go to a file.
    """

    @contextmanager
    def limit(size):
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)

    return limit


@pytest.fixture
def mounted(tmp_path):
    """Return a function that mounts something on a new folder; skips where that is not allowed."""
    places = []

    def mount(*arguments):
        place = tmp_path / f"mounted{len(places)}"
        place.mkdir()
        done = subprocess.run(["mount", *arguments, str(place)], capture_output=True, text=True, check=False)
        if done.returncode != 0:
            pytest.skip(f"file systems can't be mounted here: {done.stderr.strip()}")
        places.append(place)
        return place

    yield mount
    for place in places:
        subprocess.run(["umount", "-l", str(place)], check=True)


@pytest.fixture
def read_only(mounted):
    """Return a function that gives a folder as one that can't be written to; root heeds mounts only."""
    changed = []

    def make(folder):
        if os.getuid() == 0:
            return mounted("--bind", "-o", "ro", str(folder))
        for path in (folder, *folder.rglob("*")):
            changed.append((path, path.stat().st_mode))
            path.chmod(0o555 if path.is_dir() else 0o444)
        return folder

    yield make
    for path, mode in changed:
        path.chmod(mode)


@pytest.fixture
def search_path():
    """Return an environment in which other processes find the program."""
    return os.environ | {
        "PYTHONPATH": os.pathsep.join(str(ROOT / part) for part in ("core", "app", "resources"))
    }


HOLD = """
import sys, time
from pathlib import Path
from homolog.io.project import ProjectFolder
with ProjectFolder(Path(sys.argv[1])).locked():
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def holder(search_path):
    """Return a context in which another program has a project open."""

    @contextmanager
    def hold(project):
        command = [sys.executable, "-c", HOLD, str(project.folder)]
        with subprocess.Popen(command, env=search_path, stdout=subprocess.PIPE, text=True) as other:
            assert other.stdout.readline() == "held\n"
            yield other
            other.kill()

    return hold
