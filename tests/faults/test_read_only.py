"""Projects that can't be written to: they can be read, and whoever would write is told."""

import pytest

from homolog.errors import InputError
from homolog.io.project import ProjectFolder
from homolog.io.results import read_result
from homolog.run import Run
from homolog_app.cli import INPUT_ERROR, OK, main


@pytest.mark.parametrize("arguments", [("run",), ("report",), ("analyze",)], ids=" ".join)
def test_a_read_only_project_is_named_by_whatever_writes(project, read_only, contents, arguments, capsys):
    before, folder = contents(project.folder), read_only(project.folder)
    assert main([arguments[0], str(folder), *arguments[1:]]) == INPUT_ERROR
    output = capsys.readouterr().err
    assert f"{folder}: can't be written: " in output
    assert "choose a writable folder" in output
    assert contents(project.folder) == before


def test_a_read_only_project_can_be_looked_at(project, read_only, capsys):
    folder = read_only(project.folder)
    assert read_result(ProjectFolder(folder)).names == ("a", "b", "c", "d")
    assert main(["info", str(folder)]) == OK
    assert "4 subjects x 48 particles" in capsys.readouterr().out


def test_a_run_into_a_read_only_place_is_refused(project, read_only, short_settings):
    new = ProjectFolder(read_only(project.folder) / "new")
    with pytest.raises(InputError, match=r"new: can't be written: "):
        Run(new, project.cohort(), short_settings).execute()
