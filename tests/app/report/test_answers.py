"""Answers to questions about groups: what is printed, and the tables."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from homolog.comparison.ask import ask
from homolog.comparison.findings import Seen, decimals, findings
from homolog.comparison.places import EDGE, INNER, OUTER, Region, SurfaceCarrier, directions_of
from homolog.comparison.question import Question
from homolog.comparison.sample import Sample, column_of
from homolog.comparison.sample_rows import sample_rows
from homolog.errors import InputError
from homolog.io.particles import read_particles, write_particles
from homolog.io.records import ProjectRecord
from homolog.io.report_details import Axes, ReportDetails, write_details
from homolog.io.results import particle_file, read_result
from homolog.statistics.cautions import p_text
from homolog.statistics.effects import Effect
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.exports.settings import TableSettings
from homolog_app.exports.tables import write_tables

HOSTILE = "<script>alert('x')</script> & co"


def test_three_groups_are_analyzed_with_and_without_size_and_written_as_tables(
    project, capsys, analyze, rows_of
):
    assert analyze(project, "--size", "both") == 0
    said = capsys.readouterr().out
    lines = [line.strip() for line in said.splitlines()]
    shown = [lines[at : at + 4] for at, line in enumerate(lines) if line.startswith(("C - A", "B - A"))]
    assert [[line.partition(":")[0] for line in each[1:]] for each in shown] == [
        ["Size", noun, "Place"] for noun in ("Shape", "Shape", "Form", "Form")
    ]
    assert "not excluded" in shown[0][2]  # B - A
    assert "D = " in shown[1][2]
    folder = project.folder / "analysis" / "groups_group_A_B_C"
    tests = rows_of(folder / "tests.csv")
    assert [row["comparison"] for row in tests] == ["A, B, C", "B - A", "C - A", "C - B"]
    low, far, high = (float(tests[0][f"mahalanobis_d_corrected{end}"]) for end in ("_low_90", "", "_high_90"))
    assert 0.0 < low < far < high
    particles = rows_of(folder / "particles_C_-_A.csv")
    top = max(particles, key=lambda row: float(row["mean_z_mm"]))
    assert float(top["outward_mm"]) == pytest.approx(4.0, abs=1.5)
    assert float(top["p_fwe"]) <= 0.05
    assert float(top["outward_p_fwe"]) <= 0.05
    assert float(top["outward_t_welch"]) > 3.0
    assert [row["name"] for row in rows_of(folder / "subjects.csv")][4] == HOSTILE
    assert (project.folder / "analysis" / "groups_group_A_B_C_without_size" / "tests.csv").is_file()


def test_regions_say_where_the_difference_is_how_large_and_which_way(project, analyze, rows_of):
    assert analyze(project, "--between", "A", "C", "--alignment", "as-it-lies") == 0
    (row,) = rows_of(project.folder / "analysis" / "groups_group_A_C_as_it_lies" / "regions.csv")
    low, mean, high = (float(row[f"mean_outward_{end}mm"]) for end in ("low_95_", "", "high_95_"))
    assert low < mean < high
    assert row["peak_displacement_towards"] == "+z"
    assert "+z" in row["peak_place"]
    assert float(row["peak_z_mm"]) > 15.0
    low, value, high = (float(row[f"peak_outward{end}_mm"]) for end in ("_low_95", "", "_high_95"))
    assert 0.0 < low < value < high
    assert value == pytest.approx(4.0, abs=2.0)
    least, mean, largest = (float(row[f"{of}_outward_mm"]) for of in ("least", "mean", "largest"))
    assert least <= mean <= largest
    assert least <= value <= largest
    assert float(row["peak_p_fwe_corrected"]) <= 0.05
    (tests,) = rows_of(project.folder / "analysis" / "groups_group_A_C_as_it_lies" / "tests.csv")
    assert row["particles"] == tests["particles_p_fwe_corrected_05"]


def test_the_inner_surface_of_a_hollow_shape_is_told_from_the_outer_one(unit_sphere):
    points, faces = unit_sphere(300)
    wall = TriangleMesh(
        np.concatenate([20.0 * points, 14.0 * points]), np.concatenate([faces, faces[:, ::-1] + len(points)])
    )
    solid = TriangleMesh(20.0 * points, faces)
    for mesh, walls in ((wall, [OUTER, INNER]), (solid, ["", ""])):
        nearest = np.arange(len(mesh.vertices)) // len(points)
        carrier = SurfaceCarrier(mesh, np.zeros((len(nearest), 2)), np.arange(2), nearest)
        assert carrier.walls_at_particles(2) == walls


def test_the_edge_of_an_opening_is_told_from_both_walls():
    """A tube that is closed at one end; its inner wall sees much of the outside near the opening."""
    heights, turns = np.linspace(0.0, 30.0, 16), np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)
    outline = [*((10.0, z) for z in heights), (8.0, 30.0), *((6.0, z) for z in heights[:0:-1]), (0.0, 3.0)]
    outline = [(0.0, 0.0), *outline]
    points = np.array([[r * np.cos(t), r * np.sin(t), z] for r, z in outline for t in turns])
    ring = np.arange(32)
    faces = np.array(
        [
            face
            for row in range(len(outline) - 1)
            for i, k in zip(32 * row + ring, 32 * row + (ring + 1) % 32, strict=True)
            for face in ((i, k, k + 32), (i, k + 32, i + 32))
        ]
    )
    mesh = TriangleMesh(points, faces)
    at = np.repeat(np.arange(len(outline)), 32)
    walls = SurfaceCarrier(mesh, np.zeros((len(at), 2)), np.arange(2), at).walls_at_particles(len(outline))
    assert walls[17] == EDGE
    assert set(walls[2:16]) == {OUTER}  # sharp corners may be either
    assert set(walls[19:]) == {INNER}


def test_places_have_the_names_that_the_authors_give_them(project, capsys, analyze, rows_of):
    question = ["--between", "A", "C", "--size", "with"]
    assert analyze(project, *question, "--places", "basal/apical") == 2
    assert "--places basal/apical: must be two names for each" in capsys.readouterr().err
    assert analyze(project, *question, "--places", "septal/lateral -y/+y basal/apical") == 0
    rows = rows_of(project.folder / "analysis" / "groups_group_A_C" / "regions.csv")
    top = max(rows, key=lambda row: float(row["peak_z_mm"]))
    assert "apical" in top["peak_place"]
    words = {word for row in rows for word in row["peak_place"].split()}
    assert words <= {"septal", "lateral", "-y", "+y", "basal", "apical", "middle"}


def test_places_are_called_by_anatomy_only_if_somebody_has_confirmed_the_axes():
    assert not directions_of(ReportDetails()).are_the_patients
    assert not directions_of(ReportDetails(axes=Axes.FILE)).are_the_patients
    assert directions_of(ReportDetails(axes=Axes.PATIENT)).are_the_patients


def test_numbers_have_two_digits_of_half_their_interval_and_none_below_a_tenth_of_a_voxel():
    assert [decimals(width) for width in (0.05, 1.2, 4.6, 46.0)] == [3, 2, 1, 0]
    assert [decimals(0.05, edge) for edge in (0.5, 1.25, 10.0)] == [2, 1, 0]


def test_where_nothing_is_shown_the_smallest_effect_that_is_not_excluded_is_told(project):
    sample = Sample.of(read_result(project))
    answer = ask(sample, Question(between=("A", "B"), permutations=199))
    (finding,) = findings(answer)
    assert not finding.is_significant
    assert f"up to D = {answer.overall.distance.high:.1f}" in finding.shape


def test_what_a_test_can_see_shrinks_with_the_number_of_subjects():
    random = np.random.default_rng(4)
    base = 10.0 * random.normal(size=(20, 3))
    seen = []
    for count in (8, 32):
        shapes = base + random.normal(size=(2 * count, 20, 3)) * [1.0, 0.1, 0.1]
        sample = Sample.of_arrays(shapes, {"group": count * ["a"] + count * ["b"]})
        question = Question(between=("a", "b"), alignment="as-it-lies", modes=2, permutations=99)
        answer = ask(sample, question)
        seen.append(Seen.of(answer, answer.overall))
    assert 1.5 < seen[0].whole / seen[1].whole < 6.0
    assert 1.5 < seen[0].displacement / seen[1].displacement < 6.0


def test_effects_of_numbers_are_told_per_power_of_ten_near_their_deviation(project):
    answer = ask(
        Sample.of(read_result(project)),
        Question(between=("A", "C"), covariates=("age", "sex"), permutations=199),
    )
    assert answer.steps == {"age": 10.0}
    (overall,) = findings(answer)
    assert "age (per 10)" in overall.covariates
    assert "sex: m - f" in overall.covariates  # all are named, significant or not


def test_each_p_is_printed_with_no_more_digits_than_it_has():
    assert [p_text(p) for p in (0.0, 0.00099, 0.0123, 0.21, 1.0)] == [
        "p < 0.001",
        "p < 0.001",
        "p = 0.012",
        "p = 0.21",
        "p > 0.99",
    ]
    assert p_text(1 / 200, 199) == "p = 0.005"
    assert p_text(1 / 100, 99) == "p = 0.01"
    assert p_text(1 / 20, 19) == "p = 0.05"


def test_a_group_that_scatters_more_raises_a_caution_where_answers_are_read(
    project, capsys, analyze, rows_of
):
    record = project.read().result
    for index, subject in enumerate(record.subjects):
        if subject.group == "A":
            place = particle_file(project, subject.file, "world")
            shape = read_particles(place)
            generator = np.random.default_rng(index)
            push = 3.0 * np.tanh(np.linalg.norm(shape, axis=1, keepdims=True)) * generator.normal(size=(1, 3))
            write_particles(place, shape * (1.0 + push / 20.0))
    assert analyze(project, "--between", "A", "B", "--alignment", "as-it-lies") == 0
    said = capsys.readouterr().out
    assert "differ in covariance" in said
    assert "remain valid; T²" in said
    (row,) = rows_of(project.folder / "analysis" / "groups_group_A_B_as_it_lies" / "tests.csv")
    assert float(row["dispersion_p"]) <= 0.05
    assert float(row["dispersion_largest_to_smallest"]) > 1.5
    low, high = (float(row[f"dispersion_second_to_first_{end}_95"]) for end in ("low", "high"))
    assert low < float(row["dispersion_second_to_first"]) < high
    assert not low < 1.0 < high
    assert 0.0 <= float(row["omega_squared_low_90"]) <= float(row["omega_squared"]) <= 1.0


def test_a_subject_that_lies_far_from_all_others_is_named(project, capsys, analyze):
    broken = 60.0 * np.random.default_rng(3).normal(size=(60, 3))
    write_particles(particle_file(project, "s3", "world"), broken)
    assert analyze(project, "--size", "with") == 0
    assert "Caution: A, B, C: subject 3" in capsys.readouterr().out


def test_pairs_of_groups_are_corrected_and_form_and_shape_do_not_pay_for_each_other(
    project, analyze, rows_of
):
    assert analyze(project, "--alignment", "form", "shape") == 0
    rows = rows_of(project.folder / "analysis" / "groups_group_A_B_C" / "tests.csv")
    assert [row["pairs_corrected_for"] for row in rows] == ["1", "3", "3", "3"]
    assert rows[0]["p_permutation_corrected"] == rows[0]["p_permutation"]
    for quantity in ("", "size_", "auc_"):
        raw = min(float(row[f"{quantity}p_permutation"]) for row in rows[1:])
        corrected = min(float(row[f"{quantity}p_permutation_corrected"]) for row in rows[1:])
        assert corrected == pytest.approx(min(3 * raw, 1.0))


def test_tables_say_what_they_are_of_and_what_each_column_holds(project, analyze, rows_of):
    assert analyze(project, "--between", "A", "C", "--covariates", "age", "--alignment", "form") == 0
    folder = project.folder / "analysis" / "groups_group_A_C_for_age"
    (test,) = rows_of(folder / "tests.csv")
    assert (test["result_fingerprint"], test["alignment"], test["covariates"]) == ("abc", "form", "age")
    assert test["date"]
    assert test["homolog_version"]
    assert float(test["mahalanobis_d_corrected"]) < float(test["mahalanobis_d_plain"])
    assert float(test["auc_low_95"]) <= float(test["auc"]) <= float(test["auc_high_95"])
    kept = json.loads((folder / "study.json").read_text())
    assert kept["answered"]["fingerprint"] == "abc"
    meanings = rows_of(folder / "columns.csv")
    assert {row["file"] for row in meanings} == {path.name for path in folder.glob("*.csv")} - {"columns.csv"}
    assert all(row["meaning"] for row in meanings)
    assert not [row for row in meanings if row["meaning"] == "the column of the question"][1:]
    particle = rows_of(folder / "particles_C_-_A.csv")[0]
    assert float(particle["outward_low_95_mm"]) < float(particle["outward_mm"])
    sample = rows_of(folder / "sample.csv")
    ages = [row for row in sample if row["variable"] == "age"]
    assert [(row["minimum"], row["maximum"]) for row in ages] == [("40.0", "70.0"), ("44.0", "74.0")]
    assert [row["n"] for row in sample if row["variable"] == "subjects"] == ["6", "6"]
    assert [row for row in sample if row["variable"] == "voxel"] == []
    left_out = [row["left_out_because"] for row in rows_of(folder / "subjects.csv")]
    assert left_out.count("group is 'B'") == 6


def test_the_least_p_of_all_signs_is_that_of_the_observed_ones_and_their_opposites(project):
    result = read_result(project)
    answer = ask(Sample.of(result), Question(kind="pairs", between=("A", "B"), pairs="couple"))
    assert answer.overall.test.exact
    assert answer.overall.test.p_permutation >= 1 / (answer.overall.test.permutations + 1)


QUESTIONS = [
    ({"between": ("A", "B", "C")}, '"~ group"'),
    ({"kind": "regression", "column": "age"}, '"~ age"'),
    ({"kind": "formula", "formula": "~ sex + age"}, '"~ sex [+] age"'),
]


@pytest.mark.parametrize(("asked", "formula"), QUESTIONS)
def test_an_individual_that_was_measured_twice_is_refused_with_what_to_ask(project, asked, formula):
    result = read_result(project)
    columns = tuple({**own, "subject": f"p{index // 2}"} for index, own in enumerate(result.columns))
    sample = Sample.of(replace(result, columns=columns))
    with pytest.raises(InputError, match=f"more than one row.*{formula} with subject as its subject"):
        ask(sample, Question(permutations=99, **asked))


@pytest.mark.parametrize(("asked", "formula"), QUESTIONS)
def test_columns_that_look_like_visits_are_refused_with_what_to_ask(project, asked, formula):
    result = read_result(project)
    columns = tuple(
        {"age": own["age"], "sex": own["sex"], "patient": f"{index // 2}", "visit": "12"[index % 2]}
        for index, own in enumerate(result.columns)
    )
    with pytest.raises(InputError, match=f"'patient' names 9 subjects.*{formula} with patient"):
        ask(Sample.of(replace(result, columns=columns)), Question(permutations=99, **asked))


def test_pairs_of_two_measurements_of_an_individual_are_compared(project):
    result = read_result(project)
    columns = tuple({**own, "subject": own["couple"]} for own in result.columns)
    question = Question(kind="pairs", between=("A", "B"), pairs="subject", permutations=99)
    assert ask(Sample.of(replace(result, columns=columns)), question).overall.counts


def test_tables_are_marked_as_soon_as_particles_are_placed_anew(project, analyze):
    assert analyze(project, "--between", "A", "C", "--size", "with") == 0
    folder = project.folder / "analysis" / "groups_group_A_C"
    with project.locked(), project.replacing_result() as following:
        following.write(project.read())
    assert "earlier result" in (folder / "OUT_OF_DATE.txt").read_text()


def test_the_size_of_shapes_that_the_run_brought_to_one_is_still_compared(project):
    record = project.read().result
    before = column_of(read_result(project), "shape-size")
    subjects = []
    for index, subject in enumerate(record.subjects):
        scale = 1.0 + 0.1 * (index % 4)
        place = particle_file(project, subject.file, "world")
        write_particles(place, read_particles(place) * scale)
        subjects.append(
            subject.model_copy(update={"alignment": np.diag([scale, scale, scale, 1.0]).tolist()})
        )
    project.write(ProjectRecord(result=record.model_copy(update={"subjects": subjects})))
    after = column_of(read_result(project), "shape-size")
    np.testing.assert_allclose(np.array(after, float), np.array(before, float), rtol=1e-6)


def test_voxels_of_the_files_are_told_by_group_and_ranges_where_there_are_many_sizes(project):
    result = read_result(project)
    study = SimpleNamespace(question=Question(between=("A", "B")), left_out={}, labels=result.groups)
    edges = [(0.5, 0.5, 2.0 if group == "A" else 3.0) for group in result.groups]
    rows = sample_rows(study, replace(result, voxels=tuple(edges)))
    voxels = [(row.group, row.category, row.count) for row in rows if row.variable == "voxel"]
    assert voxels == [
        ("A", "0.5 x 0.5 x 2", 6),
        ("A", "0.5 x 0.5 x 3", 0),
        ("B", "0.5 x 0.5 x 2", 0),
        ("B", "0.5 x 0.5 x 3", 6),
    ]
    assert {row.variable: row.unit for row in rows if row.unit} == {"shape-size": "mm", "voxel": "mm"}
    many = tuple((0.5, 0.5, 1.0 + 0.1 * index) for index in range(len(edges)))
    rows = sample_rows(study, replace(result, voxels=many))
    texts = {row.category for row in rows if row.variable == "voxel"}
    assert len(texts) == 1
    assert texts.pop().startswith("0.5 x 0.5 x 1 to ")


def test_a_region_moves_out_or_in_only_where_the_interval_tells_it():
    effect = Effect(1.0, 0.5, 1.5)
    particles, position = np.arange(2), np.zeros(3)
    region = Region(
        particles, 2.0, 0, position, "left", INNER, effect, 1.0, "left", effect, (0.5, 1.5), 0.01, 0.01
    )
    assert region.direction(effect) == "out of the tissue (cavity narrower)"
    assert region.direction(Effect(-1.0, -1.5, -0.5)) == "into the tissue (cavity wider)"
    assert "neither" in region.direction(Effect(0.4, -0.5, 1.3))


def test_exported_tables_are_those_stored_unless_data_or_places_have_changed(
    project, analyze, monkeypatch, tmp_path
):
    assert analyze(project, "--between", "A", "C", "--size", "with") == 0
    (stored,) = (project.folder / "analysis").iterdir()
    asked = []

    def counted(sample, question, tick):
        asked.append(question)
        return ask(sample, question, tick)

    monkeypatch.setattr("homolog_app.exports.tables.ask", counted)
    monkeypatch.setattr("homolog_app.exports.tables._write_subjects", lambda *_: None)

    def exported(name):
        (tmp_path / name).mkdir()
        write_tables(project, tmp_path / name, TableSettings())
        return tmp_path / name / stored.name

    assert (exported("same") / "tests.csv").read_bytes() == (stored / "tests.csv").read_bytes()
    assert not asked
    write_details(project, ReportDetails(axes=Axes.PATIENT))
    assert "superior" in (exported("named") / "regions.csv").read_text("utf-8")
    assert len(asked) == 1
    (stored / "OUT_OF_DATE.txt").touch()
    write_details(project, ReportDetails())
    exported("old")
    assert len(asked) == 2
