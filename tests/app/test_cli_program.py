import os
import subprocess
import sys
from pathlib import Path

import pytest

from homolog import __version__
from homolog_app.cli import doctor, main

ROOT = Path(__file__).parents[2]
PATHS = ":".join(str(ROOT / folder) for folder in ("core", "app", "resources"))


def run(*command, **variables):
    """Run Python in a process of its own; returns what it did."""
    environment = os.environ | {"PYTHONPATH": PATHS} | variables
    return subprocess.run(
        [sys.executable, *command], capture_output=True, text=True, env=environment, check=False
    )


def test_the_package_runs_as_a_module():
    done = run("-m", "homolog", "--version")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"homolog {__version__}")


def test_the_version_names_the_commit_of_a_checkout(capsys):
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    commit = subprocess.check_output(["git", "-C", ROOT, "rev-parse", "--short", "HEAD"], text=True).strip()
    with pytest.raises(SystemExit):
        main(["--version"])
    assert capsys.readouterr().out == f"homolog {__version__} ({commit})\n"


@pytest.mark.parametrize(
    ("line", "expected"), [("homolog doc", {"doctor"}), ("homolog analyze --permut", {"--permutations"})]
)
def test_the_shell_completes_commands_and_options(line, expected, tmp_path):
    answer = tmp_path / "answer"
    run(
        "-m",
        "homolog",
        _ARGCOMPLETE="1",
        _ARGCOMPLETE_IFS="\n",
        COMP_LINE=line,
        COMP_POINT=str(len(line)),
        _ARGCOMPLETE_STDOUT_FILENAME=str(answer),
    )
    assert {word.strip() for word in answer.read_text().splitlines()} == expected


@pytest.fixture
def probes(monkeypatch):
    """Quick probes in place of those of this machine."""
    for name in ("_QT", "_KERNELS", "_OPENGL"):
        monkeypatch.setattr(doctor, name, "print('as usual')")


@pytest.mark.usefixtures("probes")
def test_doctor_has_a_line_for_each_part_of_the_machine(capsys):
    assert main(["doctor"]) == 0
    lines = capsys.readouterr().out.splitlines()
    parts = ["cores", "memory", "GPU", "kernels", "OpenGL", "Qt", "disk"]
    assert [line.split()[0] for line in lines] == parts
    assert "OpenGL  draws (as usual)" in lines


@pytest.mark.usefixtures("probes")
def test_doctor_names_the_remedy_of_a_library_that_does_not_load(capsys, monkeypatch):
    monkeypatch.setattr(doctor, "_QT", "raise ImportError('libEGL.so.1: cannot open shared object file')")
    monkeypatch.setattr(doctor, "_OPENGL", "import os; os.abort()")
    assert main(["doctor"]) == 2
    said = capsys.readouterr().out
    assert "libEGL.so.1: cannot open" in said
    assert "apt install libegl1" in said
    assert "does not draw (the process ended with -6)" in said


@pytest.mark.usefixtures("probes")
def test_a_machine_without_the_window_lacks_nothing(capsys, monkeypatch):
    monkeypatch.setattr(doctor, "_QT", "import a_module_that_nobody_has")
    assert main(["doctor"]) == 0
    assert "Qt      not installed; only the window needs it" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        (
            MemoryError("Unable to allocate 1.73 MiB"),
            "too little memory (Unable to allocate 1.73 MiB), while",
        ),
        (
            RuntimeError("Failed to allocate 809600 bytes on device 'cpu'"),
            "809600 bytes on device 'cpu'), while",
        ),
        (
            ImportError("vtk.so: failed to map segment from shared object"),
            "too little memory (vtk.so: failed",
        ),
        (RuntimeError("can't start new thread"), "the system refuses another thread; end other programs"),
        (Exception("CPU kernel build failed with error code -1"), "kernels can't be compiled (CPU kernel"),
    ],
)
def test_what_the_machine_lacks_is_said_in_one_line(error, expected, capsys, monkeypatch):
    def fails():
        raise error

    monkeypatch.setattr(doctor, "_cores", fails)
    assert main(["doctor"]) == 2
    said = capsys.readouterr().err
    assert expected in said
    assert said.count("\n") == 1


@pytest.mark.skipif(sys.platform != "linux", reason="limits of the address space are those of Linux")
def test_free_memory_obeys_the_limit_of_the_process():
    program = (
        "import resource; from homolog.memory import free_memory; resource.setrlimit(resource.RLIMIT_AS, "
        "(2 * 10**9, 2 * 10**9)); print(free_memory())"
    )
    assert 0 < int(run("-c", program).stdout) < 2e9


def test_a_picture_is_drawn_without_what_only_window_and_films_need(finished_run, tmp_path):
    program = """
import sys

class Missing:
    def find_spec(self, name, *_):
        if name.partition(".")[0] in ("PySide6", "pyvista", "pyvistaqt", "imageio_ffmpeg"):
            raise ModuleNotFoundError(name, name=name)

sys.meta_path.insert(0, Missing())
from homolog_app.cli import main
sys.exit(main(sys.argv[1:]))
"""
    project, picture = str(finished_run.folder), tmp_path / "mean.png"
    done = run("-c", program, "export", "still", project, "--out", str(picture), "--progress", "none")
    assert done.returncode == 0, done.stderr
    assert picture.read_bytes().startswith(b"\x89PNG")
    done = run(
        "-c", program, "export", "film", project, "--out", str(tmp_path / "mean.mp4"), "--progress", "none"
    )
    assert done.returncode == 2
    assert "imageio_ffmpeg is not installed" in done.stderr
    done = run("-c", program, project, DISPLAY=":1")
    assert done.returncode == 1
    assert "PySide6" in done.stderr
    assert done.stderr.count("\n") == 1
