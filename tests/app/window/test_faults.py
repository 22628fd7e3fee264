"""The window when other programs, disks or folders don't do what they should."""

import os
import resource
import shutil
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from homolog.errors import InputError
from homolog.io.project import ProjectFolder
from homolog_app.window.commands import COMMANDS

pytestmark = pytest.mark.window

PROGRAM = """
import sys, time
from pathlib import Path
from homolog.errors import InputError
from homolog.io.project import ProjectFolder
try:
    with ProjectFolder(Path(sys.argv[1])).locked():
        print("held", flush=True)
        time.sleep(float(sys.argv[2]))
except InputError as error:
    print(error, flush=True)
"""


@contextmanager
def other_program(folder, seconds):
    """Let another program take a project; give what it says."""
    core = Path(__file__).parents[3] / "core"
    command = [sys.executable, "-c", PROGRAM, str(folder), str(seconds)]
    around = os.environ | {"PYTHONPATH": str(core)}
    with subprocess.Popen(command, env=around, stdout=subprocess.PIPE, text=True) as running:
        yield running.stdout.readline().strip()
        running.kill()


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.name[0] != "." and path.is_file()}


@pytest.fixture
def full_disk():
    """Return a context in which no file of this process can grow."""

    @contextmanager
    def limit():
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (16, before[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)

    return limit


def test_a_project_that_another_program_has_open_is_opened_read_only_if_the_user_agrees(
    window, finished, tmp_path, monkeypatch, wait
):
    folder, questions, answers = copied(finished, tmp_path), [], ["Cancel", "Open read-only", "Close"]
    monkeypatch.setattr(
        "homolog_app.window.project_controller.ask",
        lambda _window, *options: questions.append(options) or answers.pop(0),
    )
    session, commands = window.workspace.session, window.commands
    with other_program(folder, 300) as said:
        assert said == "held"
        before = contents(folder)
        window.projects.open_paths([folder])
        assert session.folder is None
        window.projects.open_paths([folder])
        wait(lambda: session.result is not None and not window.workspace.session.job.is_busy)
        assert "process" in questions[1][1]
        assert session.folder == folder
        assert "read-only" in window.windowTitle()
        session.select(["a"])
        session.set_group("sick")
        assert not window.workspace.is_changed
        assert not any(commands[entry.id].isEnabled() for entry in COMMANDS if entry.writes)
        assert "another Homolog" in commands["file.save"].toolTip()
        assert contents(folder) == before
        window.projects.save_to(tmp_path / "own")
        assert not session.read_only
        assert commands["run.start"].isEnabled()
        assert contents(folder) == before


def test_other_programs_are_kept_out_of_an_open_project_until_it_is_closed(explored):
    folder = explored.workspace.session.folder
    with other_program(folder, 0) as said:
        assert "in use" in said
    explored.projects.leave()
    with other_program(folder, 0) as said:
        assert said == "held"


def test_a_save_to_a_full_disk_is_told_and_leaves_the_project_as_it_was(explored, full_disk, errors):
    folder = explored.workspace.session.folder
    before = (folder / "project.json").read_bytes()
    explored.workspace.session.select(["a"])
    explored.workspace.session.set_group("sick")
    with full_disk():
        explored.projects.save()
    (error,) = errors
    assert isinstance(error[1], InputError)
    assert f"{folder / 'project.json'}: can't be written: File too large; " in str(error[1])
    assert (folder / "project.json").read_bytes() == before
    assert explored.workspace.is_changed
    explored.projects.save()
    assert ProjectFolder(folder).read().subjects[0].group == "sick"


def test_a_project_deleted_while_it_is_open_is_told_and_saved_from_memory_elsewhere(
    explored, errors, tmp_path, monkeypatch
):
    from homolog.io.project import ProjectFolder
    from homolog.io.results import read_result

    folder = explored.workspace.session.folder
    shutil.rmtree(folder)
    explored.workspace.session.select(["a"])
    explored.workspace.session.set_group("sick")
    held = explored.workspace.session.result
    explored.projects.save()
    assert ["was moved or deleted" in str(error) for _, error in errors] == [True]
    assert explored.workspace.is_changed
    assert not folder.exists()
    messages = []
    monkeypatch.setattr(
        "homolog_app.window.project_controller.ask",
        lambda _, __, text, answers: messages.append(text) or answers[0],
    )
    explored.projects.save_to(tmp_path / "elsewhere")
    assert len(errors) == 1
    assert "could not be saved" in messages[0]
    written = read_result(ProjectFolder(tmp_path / "elsewhere"))
    np.testing.assert_allclose(written.world, held.result.world, atol=1e-5)
    assert written.groups[written.names.index("a")] == "sick"
    assert not explored.workspace.is_changed


def test_a_journal_that_cannot_be_written_is_told_and_work_goes_on(beans, full_disk, caplog):
    beans.workspace.write_journal()
    (path,) = beans.workspace.sessions.glob("*/journal.json")
    before = path.read_bytes()
    beans.workspace.session.select(["a"])
    beans.workspace.session.set_group("sick")
    with full_disk():
        beans.workspace.write_journal()
    assert f"{path}: can't be written: File too large" in caplog.text
    assert path.read_bytes() == before


def test_preferences_that_cannot_be_written_are_told_and_those_before_stay(window, full_disk, caplog):
    preferences, path = window.workspace.preferences, window.workspace.home / "preferences.ini"
    preferences.scheme = "light"
    before = path.read_bytes()
    with full_disk():
        preferences.scheme = "dark"
    assert f"{path}: can't be written; make room on its disk" in caplog.text
    assert path.read_bytes() == before


def test_the_problem_report_names_nobody_who_was_ever_in_the_session(window, ellipsoids, tmp_path, errors):
    from homolog_app.window.dialogs import problem_report

    folder = tmp_path / "Klinik Ost"
    folder.mkdir()
    (folder / "cohort.csv").write_text(
        "name,path,group,number\nErika Muster,Muster Erika.nrrd,Borderline,4711007\n"
        f"Max Beispiel,{ellipsoids / 'a.nrrd'},Gesund,61\n"
    )
    window.projects.open_paths([folder / "cohort.csv"])
    session, memory = window.workspace.session, window.workspace.memory
    lines = [
        f"INFO {member.name} {member.subject.path} {member.subject.group} 4711007"
        for member in session.study.members
    ]
    lines.append(f"WARNING {tmp_path}/Otto Normal/table.csv: lacks the column name")
    lines.append(f'  File "{Path(problem_report.__code__.co_filename)}", line 3')
    memory.lines.extend((20, line) for line in lines)
    session.noticed.emit("Imported from Klara Beispielhaft.zip")
    assert any("Klara" in line for _, line in memory.lines)
    session.edit("Remove subjects", session.study.without(["Erika Muster"]))
    window.projects.begin()
    text = problem_report(session, memory, f"InputError: {folder / 'Muster Erika.nrrd'}: cut short")
    for secret in (
        "Erika",
        "Muster",
        "Max",
        "Beispiel",
        "Klinik",
        "Borderline",
        "Gesund",
        "4711007",
        "Otto",
        "Klara",
    ):
        assert secret not in text, text
    assert "PATH: lacks the column" in text
    assert 'File "homolog_app/window/dialogs.py", line 3' in text
    assert "cut short" in text


def copied(finished, tmp_path):
    return Path(shutil.copytree(finished, tmp_path / "copy"))


def test_a_copy_of_a_project_ends_at_the_first_error_and_leaves_nothing(tmp_path, monkeypatch):
    import errno

    from homolog_app.window.study_files import copy_project

    old, tried = tmp_path / "old", []
    old.mkdir()
    for name in "abc":
        (old / name).write_text(name)

    def fail(source, target):
        tried.append(source)
        raise OSError(errno.ENOSPC, "No space left on device", target)

    monkeypatch.setattr(shutil, "copy2", fail)
    with pytest.raises(InputError, match="new: can't be written: No space left on device"):
        copy_project(old, tmp_path / "new")
    assert len(tried) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["old"]


@pytest.mark.window
def test_progress_does_not_reach_pages_that_nobody_sees(window, monkeypatch):
    from homolog_app.window.explore.modes_page import ModesPage

    questions = []
    page = window.inspector.explore.page_of(ModesPage)
    monkeypatch.setattr(page, "show_state", lambda: questions.append("modes"))
    window.workspace.session.job_progressed.emit()
    assert not questions
    monkeypatch.setattr(page, "isVisible", lambda: True)
    window.workspace.session.job_progressed.emit()
    assert questions == ["modes"]
