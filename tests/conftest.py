"""What all tests share: the real cohorts, and the rules for tests that need Qt or open windows."""

import gc
import os
import secrets
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
WINDOWS = "tests/app/window/"

try:  # pytest-qt would end the whole session where Qt lacks a system library, so it is not loaded by itself
    import PySide6.QtWidgets  # noqa: F401
except ImportError as error:
    QT_FAULT = f"Qt can't be loaded ({error}); README.md names the packages that a window needs"
    collect_ignore = ["app/window"]
else:
    QT_FAULT = ""
    pytest_plugins = ["pytestqt.plugin"]


@pytest.fixture(scope="session")
def data():
    """Return the folder of the real cohorts; they are not part of the repository."""
    folder = Path(os.environ.get("HOMOLOG_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"the real cohorts are not here ({folder}); set HOMOLOG_DATA to their folder")
    return folder


@pytest.fixture(scope="session")
def gpu():
    """Return the first GPU's alias, for tests that are marked ``cuda``."""
    from homolog.device import choose_device

    device = choose_device("auto")
    if device == "cpu":
        pytest.skip("there is no NVIDIA GPU, or it is hidden: pytest -m cuda shows it to the tests")
    return device


@pytest.fixture(autouse=True)
def _gpu_for_marked_tests(request):
    """Skip tests marked ``cuda`` where there is no GPU."""
    if request.node.get_closest_marker("cuda") is not None:
        request.getfixturevalue("gpu")


@pytest.fixture(scope="session")
def made_once(tmp_path_factory):
    """Return a function that fills a folder of this process; of several processes only the first works.

    The others copy what it made, with its times: a project may be open in one process at a time only.
    """
    from filelock import FileLock

    def folder_of(name, fill):
        folder = tmp_path_factory.mktemp(name)
        if "PYTEST_XDIST_WORKER" not in os.environ:
            fill(folder)
            return folder
        common = tmp_path_factory.getbasetemp().parent / f"made-once-{name}"
        with FileLock(f"{common}.lock"):
            if common.is_dir():
                shutil.copytree(common, folder, dirs_exist_ok=True)
            else:
                fill(folder)
                partial = common.with_suffix(".partial")
                shutil.copytree(folder, partial)
                partial.rename(common)
        return folder

    return folder_of


@pytest.fixture(scope="session")
def ellipsoids(made_once):
    """Return a folder with the label maps of four ellipsoids, 1 mm voxels; not to be written to."""
    import SimpleITK

    def fill(folder):
        (folder / "scans").mkdir()
        grid = np.stack(np.meshgrid(*[np.arange(-11.0, 12.0)] * 3, indexing="ij"))
        for name, axes in (("a", (9, 7, 6)), ("b", (10, 7, 5)), ("c", (8, 7.5, 6)), ("d", (9.5, 6, 6.5))):
            inside = (np.square(grid) / np.square(axes)[:, None, None, None]).sum(axis=0) <= 1.0
            image = SimpleITK.GetImageFromArray(inside.astype(np.uint8).T)
            SimpleITK.WriteImage(image, folder / "scans" / f"{name}.nrrd")

    return made_once("cohort", fill) / "scans"


@pytest.fixture(scope="session")
def short_settings():
    """Return settings of a run that takes a moment."""
    from homolog.settings import GroomSettings, OptimizeSettings, RunSettings

    return RunSettings(
        groom=GroomSettings(alignment="center", mesh_edge=2.0),
        optimize=OptimizeSettings(
            particles=48, split_iterations=5, anneal_iterations=20, settle_iterations=20
        ),
        device="cpu",
        workers=1,
    )


@pytest.fixture(scope="session")
def finished_run(made_once, ellipsoids, short_settings):
    """Return a project beside the ellipsoids, with a result of theirs; not to be written to."""
    from homolog.cohort import read_cohort
    from homolog.io.project import ProjectFolder
    from homolog.run import Run

    def fill(folder):
        shutil.copytree(ellipsoids, folder / "scans")
        Run(ProjectFolder(folder / "project"), read_cohort(folder / "scans"), short_settings).execute()

    project = ellipsoids.parent / "project"
    shutil.copytree(made_once("finished-run", fill) / "project", project)
    return ProjectFolder(project)


@pytest.fixture(scope="session")
def one_thread():
    """Return what yields a thread in place of `worker_processes`, which take seconds to start."""

    @contextmanager
    def executor_of(_count):
        with ThreadPoolExecutor(1) as executor:
            yield executor

    return executor_of


@pytest.fixture(scope="session")
def small_references(one_thread):
    """Return a context in which references are made of as few as four controls, fitted in a thread."""
    from homolog.patient import build, left_out

    @contextmanager
    def patched():
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(left_out, "worker_processes", one_thread)
            patch.setattr(build, "FEWEST", 4)
            yield

    return patched


def pytest_configure(config):
    """Hide GPUs, as most tests compare to the last digit, which the CPU alone repeats: not with -m cuda."""
    if config.option.markexpr != "cuda":
        os.environ["CUDA_VISIBLE_DEVICES"] = ""
    # Before pytest-xdist starts its processes, which inherit it; each of them has its core.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("LP_NUM_THREADS", "1")  # those that draw where OpenGL is emulated
    os.environ.setdefault("HOMOLOG_ANATOMY_SEED", str(secrets.randbelow(10**6)))
    if shutil.which("Xvfb") and (hasattr(config, "workerinput") or not _has_display()):
        config.add_cleanup(_open_display())


def _open_display():
    """Start a display server for this process and return what ends it.

    Windows of two processes on one display would take the focus and the pointer from each other.
    """
    reader, writer = os.pipe()
    command = ["Xvfb", "-displayfd", str(writer), "-screen", "0", "1920x1200x24", "-nolisten", "tcp"]
    if shutil.which("setpriv"):  # a process that crashes takes its server with it
        command = ["setpriv", "--pdeathsig", "TERM", *command]
    server = subprocess.Popen(command, pass_fds=[writer], stderr=subprocess.DEVNULL)
    os.close(writer)
    with os.fdopen(reader) as answer:
        number = answer.readline().strip()
    if number:
        os.environ["DISPLAY"] = f":{number}"

    def close():
        server.terminate()
        try:
            server.wait(10)
        except subprocess.TimeoutExpired:
            server.kill()

    return close


def pytest_collection_modifyitems(items):
    """Check types first: as the last long test it would leave the other processes without work."""
    items.sort(key=lambda item: item.path.name != "test_repository.py")


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Turn garbage collection off: what is loaded with the tests stays, and to look at it takes seconds."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


def pytest_collection_finish():
    """Exempt modules and tests from garbage collection: each run collects, as the tests of windows do."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config):
    """Run all tests in a process per core, four at most; chosen files in this process, or with ``-n 2``."""
    if "PYTEST_XDIST_AUTO_NUM_WORKERS" in os.environ:
        return None  # by pytest-xdist itself
    if config.args_source is not pytest.Config.ArgsSource.TESTPATHS:
        return 0
    return min(os.cpu_count() or 1, 4)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Keep the tests of a file in one process, for their fixtures, in the order of the files.

    All windows are in one process where the processes can't have displays of their own.
    """
    from xdist.scheduler import LoadScopeScheduling

    shared = shutil.which("Xvfb") is None

    class ByFile(LoadScopeScheduling):
        def _split_scope(self, nodeid):
            file = nodeid.partition("::")[0]
            return WINDOWS if shared and file.startswith(WINDOWS) else file

    config.option.loadscopereorder = False  # windows, which take longest, come before the many short files
    return ByFile(config, log)


@pytest.fixture(scope="module", autouse=True)
def _garbage():
    """Collect the garbage of a file's tests: the application of the windows turns Python's collection off."""
    yield
    if not gc.isenabled():
        gc.collect()


def pytest_runtest_setup(item):
    """Skip tests of Qt where it can't be loaded, and of windows where none can open; a fault in CI."""
    reason = ""
    if item.get_closest_marker("window") is not None:
        reason = QT_FAULT or _display_fault()
    elif item.get_closest_marker("qt") is not None:
        reason = QT_FAULT
    if not reason:
        return
    if os.environ.get("CI"):
        pytest.fail(reason, pytrace=False)
    pytest.skip(reason)


def pytest_report_header():
    """Say at the top what will not be tested, and which random anatomies will be."""
    return [
        f"window tests: {QT_FAULT or _display_fault() or 'on'}",
        f"random anatomies: HOMOLOG_ANATOMY_SEED={os.environ['HOMOLOG_ANATOMY_SEED']}",
    ]


def _display_fault():
    return "" if _has_display() else "no display server: install Xvfb to test the window"


def _has_display():
    linux = sys.platform.startswith("linux")
    return not linux or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


@pytest.fixture(scope="session")
def unit_sphere():
    """Return a function that spreads points evenly on the unit sphere: (n, 3) points and outward faces."""
    import numpy as np
    from scipy.spatial import ConvexHull

    def spread(count):
        index = np.arange(count)
        height = 1.0 - (2.0 * index + 1.0) / count
        turn = np.pi * (1.0 + 5**0.5) * index
        radius = np.sqrt(1.0 - height**2)
        points = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), height])
        faces = ConvexHull(points).simplices.copy()
        corners = points[faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        inward = np.einsum("fi,fi->f", normals, corners.mean(axis=1)) < 0
        faces[inward] = faces[inward][:, ::-1]
        return points, faces

    return spread


@pytest.fixture
def around():
    """Return the function that crops a mask to what is in it and one voxel around that."""

    def crop(mask):
        inside = np.argwhere(mask)
        low, high = np.maximum(inside.min(axis=0) - 1, 0), inside.max(axis=0) + 2
        return mask[tuple(slice(*span) for span in zip(low, high, strict=True))]

    return crop
