"""``homolog plan`` from a finished run to a page."""

import shutil

import pytest

from homolog.comparison import plan as planning
from homolog_app.cli import INPUT_ERROR, OK, main


@pytest.fixture
def pilot(finished_run, tmp_path, monkeypatch):
    """Return the folder of a project of four ellipsoids, which are too few for anything but a test."""
    monkeypatch.setattr(planning, "FEWEST", 2)
    return shutil.copytree(finished_run.folder, tmp_path / "pilot")


def arguments(folder, *more):
    given = ["--effect", "2", "--per-group", "4", "8", "--studies", "20", "--anyway", "--progress", "none"]
    return ["plan", str(folder), *given, *more]


def test_a_plan_is_printed_and_written_and_computed_once(pilot, tmp_path, capsys, monkeypatch):
    out = tmp_path / "plan.html"
    assert main(arguments(pilot, "--out", str(out))) == OK
    printed = capsys.readouterr().out
    assert "per group" in printed
    assert "2 mm outward" in printed
    assert "research use" in out.read_text("utf-8")

    def again(*_, **__):
        raise AssertionError("the plan is stored")

    monkeypatch.setattr(planning, "plan_study", again)
    assert main(arguments(pilot)) == OK
    assert capsys.readouterr().out.splitlines() == printed.splitlines()[:-1]
    (pilot / "plan" / "plan.json").write_text("{", "utf-8")  # damaged: computed again
    with pytest.raises(AssertionError, match="stored"):
        main(arguments(pilot))


def test_a_plan_of_another_suffix_or_a_small_pilot_is_one_line(finished_run, tmp_path, capsys):
    assert main(arguments(finished_run.folder, "--out", str(tmp_path / "plan.txt"))) == INPUT_ERROR
    assert "as .pdf or .html" in capsys.readouterr().err
    assert main(arguments(finished_run.folder)) == INPUT_ERROR
    assert "too small to plan from" in capsys.readouterr().err
    assert not (finished_run.folder / "plan").exists()
