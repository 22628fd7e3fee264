"""Formulas: asked on the command line and in Python."""

import csv
import re

import numpy as np
import pandas as pd
import pytest

import homolog as hl
from homolog.comparison.stored import stored_answers
from homolog.errors import InputError
from homolog.inspection.verdict import Word
from homolog.io.meshes import write_mesh
from homolog.io.particle_array import particle_file, write_all_particles
from homolog.io.particles import write_particles
from homolog.io.project import ProjectFolder
from homolog.io.records import ProjectRecord, ResultRecord, ResultSubject
from homolog.io.results import mean_file, read_result
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
    for line in (*answer.table_lines, *answer.further_lines):
        assert line in said
    for name in ("anova.csv", "differences.csv", "allometry.csv", "columns.csv"):
        assert (out / name).read_text("utf-8") == (tmp_path / "same" / name).read_text("utf-8")
    tests = {(row["on"], row["term"]): row for row in rows_of(out / "anova.csv")}
    for on in ("coordinates", "modes"):
        assert float(tests[on, "group:age"]["p"]) < 0.01 < 0.05 < float(tests[on, "sex"]["p"])
        assert tests[on, "residuals"]["df"] == "19"
    assert re.search(r"group:age \(24 shapes\)\n *Size: .*\n *Form or pose: an effect on form or pose", said)
    (kept,), damaged = stored_answers(ProjectFolder(folder))
    assert not damaged
    assert (kept.question.formula, kept.question.kind) == (formula, "formula")
    assert kept.tests["group:age"].p == float(tests["coordinates", "group:age"]["p"])
    found = {(row["of"], row["difference"]): row for row in rows_of(out / "differences.csv")}
    steeper = found["differences of slopes of age by group", "age, b - a"]
    planted = 0.1 * np.sqrt(np.square(bulge).sum() / len(base))
    assert float(steeper["length_mm"]) == pytest.approx(planted, rel=0.1)
    own = [float(steeper[f"mahalanobis_d_corrected{end}"]) for end in ("_low_90", "", "_high_90")]
    assert 0.0 < own[0] < own[1] < own[2]


def test_rows_of_data_are_matched_by_name_in_any_order(grown):
    folder = grown[0]
    data = pd.DataFrame({"disease": list("ab") * 12, "years": AGES.round(3)}, [f"s{k}" for k in range(24)])
    settings = {"alignment": "as-it-lies", "permutations": 99, "anyway": True}
    p = {}
    for shuffled in (data, data.sample(frac=1.0, random_state=1)):
        for table in (shuffled, shuffled.reset_index(names="name"), shuffled.reset_index(names="subject")):
            answer = hl.compare(folder, "~ disease * years", table, **settings)
            p[tuple(row.p for row in answer.coordinates)] = answer
    assert len(p) == 1
    assert next(iter(p.values())).coordinates[2].p == pytest.approx(0.01)
    with pytest.raises(InputError, match="can't be matched to the subjects; add a column 'name'"):
        hl.compare(folder, "~ disease * years", data.reset_index(drop=True), **settings)
    with pytest.raises(InputError, match="by the index, no row is of s0"):
        hl.compare(folder, "~ disease * years", data.iloc[1:], **settings)
    shapes = hl.Project(folder).aligned
    in_order = hl.compare(shapes, "~ disease * years", data, alignment="as-it-lies", permutations=99)
    assert tuple(row.p for row in in_order.coordinates) in p


def test_size_is_tested_beside_shape_and_slopes_have_intervals(grown):
    folder = grown[0]
    answer = hl.compare(folder, "~ group * log_size", alignment="shape", permutations=199, anyway=True)
    assert [item.size is None for item in answer.terms] == [True, True, True]  # size is adjusted for
    answer = hl.compare(folder, "~ group * age", alignment="form", permutations=199, modes=2, anyway=True)
    assert all(item.size is not None and item.size.p is not None for item in answer.terms)
    apart = {(family.of, item.name): item for family in answer.differences for item in family.each}
    steeper = apart["differences of slopes of age by group", "age, b - a"]
    assert steeper.size.low < steeper.size.value < steeper.size.high
    assert steeper.distance.low < steeper.distance.value < steeper.distance.high
    number, along = answer.allometry[0]
    grown_ones = answer.design.numbers[number][1::2]
    assert np.corrcoef(along.scores[1::2], grown_ones)[0, 1] > 0.9


def test_an_unusable_model_needs_the_option_anyway(grown, capsys):
    folder, project = grown[0], ProjectFolder(grown[0])
    shapes = read_result(project).world
    generator = np.random.default_rng(0)
    order = np.array([generator.permutation(shapes.shape[1]) for _ in shapes])[..., None]
    shuffled = np.take_along_axis(shapes, order, axis=1)
    write_all_particles(project, [f"s{index}" for index in range(24)], shuffled, shuffled)
    assert hl.Project(folder).verdict.word is Word.UNUSABLE
    asked = ["analyze", str(folder), "--formula", "~ group * age", "--permutations", "99"]
    assert main(asked) != 0
    assert "add the option anyway" in capsys.readouterr().err
    assert not (folder / "analysis").exists()
    with pytest.raises(InputError, match="not usable"):
        hl.compare(folder, "~ group * age", permutations=99)
    assert main([*asked, "--anyway"]) == 0


def test_the_report_tells_a_formula_by_term(grown):
    folder = grown[0]
    asked = ["analyze", str(folder), "--formula", "~ group * age", "--permutations", "199", "--anyway"]
    assert main([*asked, "--alignment", "as-it-lies", "--primary"]) == 0
    assert main(["report", str(folder), "--anyway"]) == 0
    text = (folder / "report" / "report.html").read_text("utf-8")
    assert "group:age" in text
    assert "Analysis of variance" in text
    assert list((folder / "report" / "figures").glob("*allometry.svg"))


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
