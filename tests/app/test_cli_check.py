"""homolog check, from the command line to the project."""

import csv
import json
import shutil

import numpy as np
import pytest

from homolog.io.particles import write_particles
from homolog.io.project import ProjectFolder
from homolog.io.results import particle_file, read_result
from homolog.run.repair import COLUMNS
from homolog_app.cli import INPUT_ERROR, OK, main

PAIR = [7, 30]


@pytest.fixture
def swapped(finished_run, tmp_path):
    """Return a copy of a project in which two particles of its second subject are exchanged."""
    project = ProjectFolder(tmp_path / "project")
    shutil.copytree(finished_run.folder, project.folder, ignore=shutil.ignore_patterns(".lock"))
    result, record = read_result(project), project.read().result
    for frame, points in (("local", result.local), ("world", result.world)):
        changed = points[1].copy()
        changed[PAIR] = points[1][PAIR[::-1]]
        write_particles(particle_file(project, record.subjects[1].file, frame), changed)
    return project


def test_an_exchange_is_printed_first_and_written_as_csv_and_json(swapped, tmp_path, capsys):
    table, objects = tmp_path / "list.csv", tmp_path / "list.json"
    for path in (table, objects):
        assert main(["check", str(swapped.folder), "--out", str(path), "--progress", "none"]) == OK
    verdict, first = capsys.readouterr().out.splitlines()[:2]
    assert verdict.startswith("Verdict: ")
    assert "exchanged particles" in first
    assert "particles 7 and 30" in first
    with table.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert tuple(rows[0]) == COLUMNS
    assert (rows[0]["subject"], rows[0]["particles"]) == ("b", "7 30")
    local = read_result(swapped).local[1, 7]
    place = [float(rows[0][name]) for name in ("x_mm", "y_mm", "z_mm")]
    np.testing.assert_allclose(place, local, atol=1e-3)
    assert [load["words"] for load in json.loads(objects.read_text())] == [row["words"] for row in rows]


def test_only_severe_suspects_are_listed_if_asked_for(swapped, capsys):
    assert main(["check", str(swapped.folder), "--min-severity", "1000", "--progress", "none"]) == OK
    assert capsys.readouterr().out.splitlines()[1:] == ["0 suspects of 4 subjects x 48 particles"]


def test_repairing_puts_the_exchange_right_and_keeps_the_plan_of_the_next_run(swapped, finished_run, capsys):
    changed = swapped.read()
    settings = changed.settings.model_copy(
        update={"optimize": changed.settings.optimize.model_copy(update={"particles": 99})}
    )
    swapped.write(changed.model_copy(update={"settings": settings}))
    assert main(["check", str(swapped.folder), "--repair", "1", "--progress", "none"]) == OK
    assert capsys.readouterr().out.splitlines()[1].startswith("repaired: b: particles 7 and 30")
    true, repaired = read_result(finished_run).local, read_result(swapped).local
    spacing = np.sqrt(4 * np.pi * 7.5**2 / 48)
    assert np.linalg.norm(repaired[1, PAIR] - true[1, PAIR], axis=1).max() < 0.7 * spacing
    np.testing.assert_array_equal(repaired[[0, 2, 3]], true[[0, 2, 3]])
    record = swapped.read()
    assert record.settings.optimize.particles == 99
    assert record.result.settings.optimize.particles == 48
    assert "optimized again" in record.result.subjects[1].notes[-1]
    assert (swapped.model / "mean.vtp").is_file()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--out", "list.txt"], ".csv or .json"),
        (["--repair", "-1"], "--repair"),
        (["--min-severity", "nan"], "--min-severity"),
        (["--workers", "0"], "--workers"),
    ],
)
def test_wrong_options_are_refused_before_any_work(swapped, capsys, options, message):
    assert main(["check", str(swapped.folder), *options]) == INPUT_ERROR
    assert message in capsys.readouterr().err


def test_a_project_without_result_is_refused(tmp_path, capsys):
    assert main(["check", str(tmp_path), "--progress", "none"]) == INPUT_ERROR
    assert str(tmp_path) in capsys.readouterr().err


def test_a_result_whose_surface_was_groomed_anew_is_refused_by_name(swapped, capsys):
    from homolog.io.meshes import read_mesh, write_mesh
    from homolog.io.results import surface_file
    from homolog.surfaces.mesh import TriangleMesh

    path = surface_file(swapped, swapped.read().result.subjects[2].file)
    mesh = read_mesh(path)
    write_mesh(path, TriangleMesh(3.0 * mesh.vertices, mesh.faces))
    assert main(["check", str(swapped.folder), "--progress", "none"]) == INPUT_ERROR
    assert "c: " in capsys.readouterr().err
