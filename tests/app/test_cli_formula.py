"""Formulas: asked on the command line and in Python."""

import csv

import numpy as np
import pytest

import homolog as hl
from homolog.io.meshes import write_mesh
from homolog.io.particle_array import particle_file
from homolog.io.particles import write_particles
from homolog.io.project import ProjectFolder
from homolog.io.records import ProjectRecord, ResultRecord, ResultSubject
from homolog.io.results import mean_file
from homolog.settings import RunSettings
from homolog_app.cli import main

AGES = np.linspace(40.0, 70.0, 24)


@pytest.fixture
def grown(tmp_path, ball):
    """Return a project of 24 balls: those of group b bulge upward with age, by 0.1 mm a year."""
    generator = np.random.default_rng(4)
    base = ball.vertices[:: len(ball.vertices) // 60][:60]
    centred = base - base.mean(axis=0)
    bulge = np.clip(centred[:, 2:] / np.abs(centred[:, 2]).max(), 0.0, 1.0) ** 2 * [0.0, 0.0, 1.0]
    project = ProjectFolder(tmp_path / "study")
    subjects = []
    for index, age in enumerate(AGES):
        group = "ab"[index % 2]
        shape = base + 0.1 * generator.normal(size=base.shape)
        shape += (group == "b") * 0.1 * (age - AGES.mean()) * bulge
        for frame in ("world", "local"):
            write_particles(particle_file(project, f"s{index}", frame), shape)
        columns = {"age": f"{age:.3f}", "sex": "mfmfmmff"[index % 8], "site": "xy"[index % 2]}
        subjects.append(
            ResultSubject(
                name=f"s{index}",
                file=f"s{index}",
                group=group,
                columns=columns,
                content="0",
                alignment=np.eye(4).tolist(),
            )
        )
    project.model.mkdir()
    write_mesh(mean_file(project), ball)
    record = ResultRecord(
        finished="2025-01-01T00:00:00+00:00",
        ended="converged",
        iterations=20,
        particles=60,
        metric="geodesic",
        folded_faces=0,
        settings=RunSettings(),
        device="cpu",
        versions={"homolog": "9.9"},
        seconds={},
        fingerprint="abc",
        subjects=subjects,
        excluded=[],
    )
    project.write(ProjectRecord(result=record))
    return project.folder, bulge, base


def rows_of(path):
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def test_a_known_interaction_is_found_alike_on_the_command_line_and_in_python(grown, tmp_path, capsys):
    folder, bulge, base = grown
    out = tmp_path / "tables"
    formula = "~ group * age + sex"
    asked = [
        "analyze",
        str(folder),
        "--formula",
        formula,
        "--alignment",
        "as-it-lies",
        "--permutations",
        "499",
    ]
    assert main([*asked, "--modes", "2", "--out", str(out), "--anyway"]) == 0
    said = capsys.readouterr().out
    settings = {"alignment": "as-it-lies", "permutations": 499, "modes": 2, "anyway": True}
    answer = hl.compare(folder, formula, out=tmp_path / "same", **settings)
    assert answer.text in said
    for name in ("anova.csv", "differences.csv", "columns.csv"):
        assert (out / name).read_text("utf-8") == (tmp_path / "same" / name).read_text("utf-8")
    tests = {(row["on"], row["term"]): row for row in rows_of(out / "anova.csv")}
    for on in ("coordinates", "modes"):
        assert float(tests[on, "group:age"]["p"]) < 0.01 < 0.05 < float(tests[on, "sex"]["p"])
        assert tests[on, "residuals"]["df"] == "19"
    assert "The effect of age depends on group" in said
    found = {(row["of"], row["difference"]): row for row in rows_of(out / "differences.csv")}
    steeper = found["differences of slopes of age by group", "age, b - a"]
    planted = 0.1 * np.sqrt(np.square(bulge).sum() / len(base))
    assert float(steeper["length_mm"]) == pytest.approx(planted, rel=0.1)
    own = [float(steeper[f"mahalanobis_d_corrected{end}"]) for end in ("_low_90", "", "_high_90")]
    assert 0.0 < own[0] < own[1] < own[2]
    data = {"disease": list("ab") * 12, "years": AGES.round(3)}
    shapes = hl.Project(folder).aligned
    renamed = hl.compare(shapes, "~ disease * years", data, alignment="as-it-lies", permutations=99)
    assert {row.term: row.p for row in renamed.coordinates}["disease:years"] == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--formula", "~ group + site"], "site can't be told from group"),
        (["--formula", "~ group + weight"], "there is no column 'weight'"),
        (
            ["--formula", "~ group + sex", "--covariates", "age"],
            "--covariates can't be combined with --formula",
        ),
        (["--squares", "I"], "--squares belongs to --formula"),
    ],
)
def test_what_cannot_be_estimated_is_refused_in_one_line_before_anything_is_computed(
    grown, capsys, monkeypatch, options, words
):
    def computed(*_, **__):
        raise AssertionError("it was computed")

    monkeypatch.setattr("homolog.inspection.verdict.refuse_unusable", computed)
    assert main(["analyze", str(grown[0]), *options]) != 0
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1
    assert not (grown[0] / "analysis").exists()
