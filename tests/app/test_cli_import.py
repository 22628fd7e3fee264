"""``homolog import``, and what follows it."""

import csv
import shutil

import numpy as np
import pytest

from homolog.io.markups import write_markups
from homolog.io.particles import read_particles, write_particles
from homolog.io.project import ProjectFolder
from homolog.io.results import read_result
from homolog.io.shapeworks_export import write_shapeworks
from homolog_app.cli import main


@pytest.fixture
def exported(finished_run, tmp_path):
    """Return the finished run as a ShapeWorks project."""
    return write_shapeworks(finished_run, tmp_path / "out")


def test_an_imported_model_is_described_analyzed_and_reported(exported, tmp_path, capsys, without_figures):
    folder, project = exported.parent / f"{exported.stem}_particles", tmp_path / "imported"
    points = read_particles(folder / "a_world.particles")  # four are too few for a test
    for name, factor in (("e", 1.02), ("f", 0.97)):
        noise = np.random.default_rng(ord(name)).normal(scale=0.3, size=points.shape)
        write_particles(folder / f"{name}_world.particles", points * [factor, 1.0, 2.0 - factor] + noise)
    assert main(["import", str(folder), str(project), "--progress", "none"]) == 0
    printed = capsys.readouterr()
    assert "6 subjects x 48 particles" in printed.out
    assert "no surface" in printed.err
    assert main(["info", str(project)]) == 0
    facts = capsys.readouterr().out
    assert "source       particles in the folder project_particles" in facts
    assert "imported, not optimized here" in facts
    options = ["--permutations", "99", "--size", "with", "--progress", "none"]
    assert main(["analyze", str(project), "--regress", "size", *options]) == 0
    with (project / "analysis" / "regression_size" / "subjects.csv").open() as file:
        assert [row["name"] for row in csv.DictReader(file)] == ["a", "b", "c", "d", "e", "f"]
    assert main(["report", str(project), "--progress", "none"]) == 0
    page = (project / "report" / "report.html").read_text(encoding="utf-8")
    assert "placed by another program" in page
    assert "entropy-based particle optimization" not in page


def test_particles_without_surfaces_are_analyzed_but_not_checked(exported, tmp_path, capsys):
    project = str(tmp_path / "bare")
    (folder,) = exported.parent.glob("*_particles")
    assert main(["import", str(folder), project, "--progress", "none"]) == 0
    assert main(["report", project, "--progress", "none"]) == 0
    capsys.readouterr()
    assert main(["check", project, "--progress", "none"]) == 2
    error = capsys.readouterr().err
    assert "give surfaces" in error


def test_a_bad_source_is_one_line(tmp_path, capsys):
    assert main(["import", str(tmp_path / "gone.swproj"), str(tmp_path / "p"), "--progress", "none"]) == 2
    assert (
        capsys.readouterr().err == f"homolog: {tmp_path / 'gone.swproj'}: does not exist; correct the path\n"
    )
    assert not (tmp_path / "p").exists()


def test_landmark_errors_are_in_info_and_report(finished_run, ellipsoids, tmp_path, capsys, without_figures):
    shutil.copytree(ellipsoids, tmp_path / "scans")
    shutil.copytree(finished_run.folder, tmp_path / "project")
    project = ProjectFolder(tmp_path / "project")
    for name, points in zip(
        *[getattr(read_result(project), item) for item in ("names", "local")], strict=True
    ):
        write_markups(tmp_path / "scans" / f"{name}.mrk.json", points[[2, 9]], ("tip <b>", "base"))
    record = project.read()
    subjects = [
        subject.model_copy(update={"landmarks": f"../scans/{subject.name}.mrk.json"})
        for subject in record.subjects
    ]
    project.write(record.model_copy(update={"subjects": subjects}))
    assert main(["info", str(project.folder)]) == 0
    assert "2 landmarks of 4 subjects" in capsys.readouterr().out
    assert main(["report", str(project.folder), "--progress", "none"]) == 0
    page = (project.folder / "report" / "report.html").read_text(encoding="utf-8")
    assert "2 landmarks of 4 subjects, transferred to each other: mean" in page
    assert "tip &lt;b&gt;" in page
    assert "tip <b>" not in page
    (tmp_path / "scans" / "b.mrk.json").write_text("no markups")
    capsys.readouterr()
    assert main(["info", str(project.folder)]) == 0
    assert "b.mrk.json: can't be read" in capsys.readouterr().out
