"""Two programs in one project: the second is told; newer programs' projects are left alone."""

import json

import pytest

from homolog.errors import InputError
from homolog_app.cli import INPUT_ERROR, main


@pytest.mark.parametrize(
    "arguments", [("run",), ("run", "--resume"), ("report",), ("analyze",)], ids=" ".join
)
def test_a_second_command_line_is_told_and_changes_nothing(project, holder, contents, arguments, capsys):
    if "--resume" in arguments:
        project.write(project.read().model_copy(update={"unfinished": True}))
    before = contents(project.folder)
    name, *options = arguments
    with holder(project):
        assert main([name, str(project.folder), *options]) == INPUT_ERROR
    output = capsys.readouterr().err
    assert f"{project.folder}: is in use by another Homolog (process " in output
    assert output.endswith("; close that one or wait\n")
    assert contents(project.folder) == before


def test_a_project_of_a_newer_homolog_is_left_alone(project, run_of, contents):
    path = project.folder / "project.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"version": 2, "news": [1, 2]}))
    before = contents(project.folder)
    for act in (project.read, project.cohort, run_of(project).execute):
        with pytest.raises(InputError, match=r"\(format 2\); update Homolog"):
            act()
    assert contents(project.folder) == before
