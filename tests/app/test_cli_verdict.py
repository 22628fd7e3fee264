"""The verdict on the command line, and the refusal of models that are not usable."""

import shutil

import numpy as np
import pytest

from homolog.inspection import Word, read_verdict
from homolog.io.particle_array import write_all_particles
from homolog.io.project import ProjectFolder
from homolog.io.results import read_result
from homolog_app.cli import INPUT_ERROR, OK, main


@pytest.fixture
def permuted(finished_run, tmp_path):
    """Return a copy of a project in which the particles of each subject are in another order."""
    project = ProjectFolder(tmp_path / "project")
    shutil.copytree(finished_run.folder, project.folder, ignore=shutil.ignore_patterns(".lock"))
    result, record = read_result(project), project.read().result
    generator = np.random.default_rng(0)
    order = np.array([generator.permutation(result.local.shape[1]) for _ in result.names])[..., None]
    write_all_particles(
        project,
        [subject.file for subject in record.subjects],
        np.take_along_axis(result.local, order, axis=1),
        np.take_along_axis(result.world, order, axis=1),
    )
    return project


def test_check_begins_with_the_verdict_that_the_project_stores(permuted, capsys):
    assert main(["check", str(permuted.folder), "--progress", "none"]) == OK
    verdict = read_verdict(permuted, read_result(permuted).world)
    assert verdict.word is Word.UNUSABLE
    assert capsys.readouterr().out.splitlines()[0] == verdict.line


@pytest.mark.parametrize("command", ["analyze", "report", "reference"])
def test_a_model_that_is_not_usable_is_refused_with_cause_and_remedy(permuted, tmp_path, capsys, command):
    options = ["--out", str(tmp_path / "reference.npz")] if command == "reference" else []
    assert main([command, str(permuted.folder), *options, "--progress", "none"]) == INPUT_ERROR
    message = capsys.readouterr().err
    assert "not usable" in message
    assert "exchanged at random" in message
    assert "landmarks" in message
    assert "option anyway" in message
    assert not (permuted.folder / "report").exists()


def test_a_report_that_is_written_anyway_says_so_on_its_first_page(permuted):
    assert main(["report", str(permuted.folder), "--anyway", "--progress", "none"]) == OK
    page = (permuted.folder / "report" / "report.html").read_text()
    begin, _ = page.split("Main results", 1)
    assert "Verdict: not usable." in begin
