import os
import re
import subprocess
import sys

import pytest

from homolog import __version__
from homolog.errors import Cancelled, InputError, NumericalError
from homolog.io.project import ProjectFolder
from homolog.io.records import ProjectRecord, SubjectRecord
from homolog_app.cli import main

VERSION = rf"homolog {re.escape(__version__)}( \([0-9a-f]+\))?\n"  # with the commit in a git checkout


def test_the_version_is_told(capsys):
    with pytest.raises(SystemExit, match="0"):
        main(["--version"])
    assert re.fullmatch(VERSION, capsys.readouterr().out)


def test_the_module_runs_as_the_script_does():
    done = subprocess.run(
        [sys.executable, "-m", "homolog_app", "--version"],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert re.fullmatch(VERSION, done.stdout)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="elsewhere there always is a display")
def test_without_a_display_the_window_is_refused_with_a_hint(monkeypatch, capsys):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM"):
        monkeypatch.delenv(name, raising=False)
    assert main([]) == 2
    assert "homolog --help" in capsys.readouterr().err


def test_files_in_place_of_their_folder_are_refused_with_the_remedy(tmp_path, capsys):
    files = [tmp_path / "a.nrrd", tmp_path / "b.nrrd"]
    for file in files:
        file.touch()
    with pytest.raises(SystemExit, match="2"):
        main(["run", *map(str, files), "--out", str(tmp_path / "project")])
    assert "folder of these files" in capsys.readouterr().err


@pytest.mark.parametrize("options", [["nothing"], ["info"], ["run", "--particles"]])
def test_a_wrong_use_ends_with_two_and_a_hint(options, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(options)
    assert "usage: homolog" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "code", "text"),
    [
        (InputError("a: is empty\nb: is missing"), 2, "homolog: a: is empty\nhomolog: b: is missing\n"),
        (NumericalError("a: no surface"), 1, "homolog: a: no surface\n"),
        (
            PermissionError(13, "Permission denied", "/x/a.nrrd"),
            2,
            "homolog: /x/a.nrrd: Permission denied; check its permissions, or choose another location\n",
        ),
        (Cancelled("cancelled"), 130, "cancelled\n"),
        (KeyboardInterrupt(), 130, "cancelled\n"),
    ],
)
def test_errors_become_lines_and_exit_codes(monkeypatch, capsys, error, code, text):
    def fail(arguments):
        raise error

    monkeypatch.setattr("homolog_app.cli.project.ProjectFolder", fail)
    assert main(["info", "."]) == code
    assert capsys.readouterr().err == text


@pytest.mark.parametrize("kind", [ZeroDivisionError, OSError])
def test_a_bug_is_not_hidden(monkeypatch, kind):
    def fail(arguments):
        raise kind

    monkeypatch.setattr("homolog_app.cli.project.ProjectFolder", fail)
    with pytest.raises(kind):
        main(["info", "."])


def test_info_tells_subjects_groups_and_an_unfinished_run(tmp_path, capsys):
    project = ProjectFolder(tmp_path)
    subjects = [
        SubjectRecord(name=name, path=f"{name}.nrrd", group=group) for name, group in ("aX", "bY", "cX")
    ]
    project.write(ProjectRecord(subjects=subjects, unfinished=True))
    assert main(["info", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    assert "3 (2 X, 1 Y)" in text
    assert f"interrupted before the first particles; to continue: homolog run {tmp_path} --resume" in text
    assert "none yet" in text


def test_a_folder_in_place_of_a_command_opens_the_window_on_it(tmp_path, monkeypatch):
    opened = []
    monkeypatch.setattr("homolog_app.cli.open_window", lambda paths: opened.append(list(paths)) or 0)
    assert main([str(tmp_path)]) == 0
    assert opened == [[str(tmp_path)]]
    with pytest.raises(SystemExit):
        main([str(tmp_path / "nothing")])


def test_info_of_another_folder_is_an_input_error(tmp_path, capsys):
    assert main(["info", str(tmp_path)]) == 2
    assert capsys.readouterr().err == f"homolog: {tmp_path}: is not a project (it contains no project.json)\n"


def test_info_as_json_is_the_record(tmp_path, capsys):
    record = ProjectRecord(subjects=[SubjectRecord(name="a", path="a.nrrd")])
    ProjectFolder(tmp_path).write(record)
    assert main(["info", str(tmp_path), "--json"]) == 0
    assert ProjectRecord.model_validate_json(capsys.readouterr().out) == record
