import csv
import json
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from html.parser import HTMLParser
from types import SimpleNamespace

import numpy as np
import pytest

import homolog as hl
from homolog.errors import InputError
from homolog.files.meshes import write_mesh
from homolog.files.particles import read_particles, write_particles
from homolog.files.project import ProjectFolder
from homolog.files.records import ProjectRecord, ResultRecord, ResultSubject
from homolog.files.report_details import Axes, ReportDetails, read_details
from homolog.files.results import mean_file, particle_file, read_result
from homolog.files.tables import write_table
from homolog.settings import RunSettings
from homolog.surfaces.mesh import TriangleMesh
from homolog_app import api
from homolog_app.cli import main
from homolog_app.plots import new_figure
from homolog_app.rendering.colours import LIGHT, page_colours
from homolog_app.report.figures import ReportFigure
from homolog_app.report.findings import corrections_text, p_text
from homolog_app.report.page import Page
from homolog_app.report.request import (
    Answered,
    StudyRequest,
    column_of,
    read_requests,
    study_folder,
    write_request,
)
from homolog_app.report.sample import sample_rows
from homolog_app.report.sheets import sheets_of, wrapped_cells, write_page
from homolog_app.report.study import run_study
from homolog_app.report.surface_maps import EDGE, INNER, OUTER, SurfaceCarrier, directions_of

HOSTILE = "<script>alert('x')</script> & co"
QUICK = ["--permutations", "199", "--null-repeats", "50", "--progress", "none"]


@pytest.fixture
def project(tmp_path, unit_sphere):
    """A finished project: 18 spheres of 20 mm in three groups; those of C bulge upward by 4 mm."""
    return _project(tmp_path / "study", unit_sphere)


def _project(folder, unit_sphere):
    project = ProjectFolder(folder)
    generator = np.random.default_rng(0)
    points, faces = unit_sphere(300)
    base = 20.0 * points[::5]
    subjects = []
    for index in range(18):
        group = "ABC"[index % 3]
        modes = generator.normal(size=3)
        shape = base * (1.0 + 0.05 * modes * [1.0, 0.8, 0.6]) + 0.1 * generator.normal(size=base.shape)
        if group == "C":
            shape = shape + 4.0 * np.clip(base[:, 2:] / 20.0, 0.0, 1.0) ** 2 * [0.0, 0.0, 1.0]
        name = HOSTILE if index == 4 else f"subject {index}"
        columns = {"age": str(40 + 2 * index), "sex": "mf"[index % 2], "site": "one"}
        columns |= {"twin": f"t{index // 6}", "grade": "" if index == 7 else str(index % 4)}
        columns |= {
            "dose": "30 y" if index == 3 else str(index),
            "weight": "inf" if index == 2 else str(index),
        }
        columns |= {
            "couple": f"c{index // 3}",
            "code": str(index // 2 % 3 + 1),
            "stage": "NA" if index == 7 else "1",
        }
        columns["halves"] = "" if index == 1 else columns["couple"]
        columns["scanner"] = ("1", "1.0", "2")[index // 3 % 3]
        columns["half"] = "x" if index % 3 < 2 else "xy"[index % 2]
        subjects.append(
            ResultSubject(
                name=name,
                file=f"s{index}",
                group=group,
                columns=columns,
                content="0",
                alignment=np.eye(4).tolist(),
            )
        )
        for frame in ("world", "local"):
            write_particles(particle_file(project, f"s{index}", frame), shape)
    project.model.mkdir()
    for table in ("scores", "eigenvalues"):
        write_table(project.model / f"{table}.csv", ["name"], [])
    write_mesh(mean_file(project), TriangleMesh(20.0 * points, faces))
    write_table(
        project.folder / "energies.csv",
        ["iteration", "sampling", "ensemble", "normals"],
        [[step, -float(step), 2.0 / (step + 1), 1.0] for step in range(20)],
    )
    result = ResultRecord(
        finished="2025-01-01T00:00:00+00:00", ended="converged", iterations=20, particles=60,
        metric="geodesic", folded_faces=0, settings=RunSettings(), device="cpu",
        versions={"homolog": "9.9"}, seconds={}, fingerprint="abc", subjects=subjects,
        excluded=["scan.nrrd: is empty"],
    )  # fmt: skip
    project.write(ProjectRecord(result=result))
    return project


def _rows(path):
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def _analyze(project, *options):
    return main(["analyze", str(project.folder), *options, *QUICK])


def test_three_groups_are_analyzed_with_and_without_size_and_written_as_tables(project, capsys):
    assert _analyze(project) == 0
    said = capsys.readouterr().out
    assert "6 A, 6 B, 6 C: the groups differ in shape" in said
    assert "C - A (6 A, 6 C): they differ in form" in said
    assert "B - A (6 A, 6 B): no difference in shape can be shown" in said
    assert "none of 60 particles" in said
    folder = project.folder / "analysis" / "groups_group_A_B_C"
    tests = _rows(folder / "tests.csv")
    assert [row["comparison"] for row in tests] == ["A, B, C", "B - A", "C - A", "C - B"]
    low, far, high = (float(tests[0][f"mahalanobis_d_corrected{end}"]) for end in ("_low_95", "", "_high_95"))
    assert 0.0 < low < far < high
    assert "common mean D = " in said
    particles = _rows(folder / "particles_C_-_A.csv")
    top = max(particles, key=lambda row: float(row["mean_z_mm"]))
    assert float(top["outward_mm"]) == pytest.approx(4.0, abs=1.5)
    assert float(top["p_fwe"]) <= 0.05
    assert float(top["outward_p_fwe"]) <= 0.05
    assert float(top["outward_t_welch"]) > 3.0
    assert [row["name"] for row in _rows(folder / "subjects.csv")][4] == HOSTILE
    assert (project.folder / "analysis" / "groups_group_A_B_C_without_size" / "tests.csv").is_file()


def test_regions_say_where_the_difference_is_how_large_and_which_way(project):
    assert _analyze(project, "--between", "A", "C", "--alignment", "as-it-lies") == 0
    (row,) = _rows(project.folder / "analysis" / "groups_group_A_C_as_it_lies" / "regions.csv")
    assert row["peak_place"] == row["peak_displacement_towards"] == "+z"
    assert float(row["peak_z_mm"]) > 15.0
    low, value, high = (float(row[f"peak_outward{end}_mm"]) for end in ("_low_95", "", "_high_95"))
    assert 0.0 < low < value < high
    assert value == pytest.approx(4.0, abs=1.5)
    least, mean, largest = (float(row[f"{of}_outward_mm"]) for of in ("least", "mean", "largest"))
    assert least <= mean <= largest
    assert least <= value <= largest
    assert float(row["peak_p_fwe_corrected"]) <= 0.05
    (tests,) = _rows(project.folder / "analysis" / "groups_group_A_C_as_it_lies" / "tests.csv")
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


def test_structure_cohort_and_axes_are_kept_and_used(project, without_figures):
    assert _analyze(project, "--between", "A", "C", "--size", "with", "--axes", "patient") == 0
    rows = _rows(project.folder / "analysis" / "groups_group_A_C" / "regions.csv")
    assert "superior" in {row["peak_place"] for row in rows}
    remarks = "--structure", "left <ventricle>", "--cohort", "Twins"
    assert main(["report", str(project.folder), *remarks, "--progress", "none"]) == 0
    details = read_details(project)
    assert (details.structure, details.cohort, details.axes) == ("left <ventricle>", "Twins", Axes.PATIENT)
    page = (project.folder / "report" / "report.html").read_text(encoding="utf-8")
    assert "left &lt;ventricle&gt;" in page
    assert "Cohort: Twins." in page
    assert main(["report", str(project.folder), "--cohort", "", "--progress", "none"]) == 0
    assert read_details(project).cohort == ""
    (project.folder / "report.json").write_text("[", encoding="utf-8")
    with pytest.raises(InputError, match="is damaged"):
        read_details(project)


def test_python_answers_describes_and_reports_as_the_commands_do(project, capsys, without_figures):
    assert _analyze(project, "--between", "A", "B", "--covariates", "age", "--pairs", "twin") == 2
    refused = capsys.readouterr().err
    with pytest.raises(InputError) as error:
        api.analyze(project.folder, between=["A", "B"], covariates=["age"], pairs="twin")
    assert str(error.value) in refused
    options = ["--between", "A", "B", "--covariates", "age", "grade", "--complete-cases", "--axes", "patient"]
    assert _analyze(project, *options) == 0
    printed = capsys.readouterr().out
    form, shape = api.analyze(
        project.folder, between=["A", "B"], covariates=["age", "grade"], complete_cases=True, axes="patient",
        permutations=199, null_repeats=50,
    )  # fmt: skip
    assert f"{form.text}\n{shape.text}\n" == printed
    assert any("excluded for missing values" in caution for caution in form.cautions)
    assert (form.comparison.title, form.pairwise, form.seeds) == ("B - A", (), ())
    opened = hl.Project(project.folder)
    opened.describe(structure="sphere")
    page = api.report(project.folder, cohort="Twins").read_text(encoding="utf-8")
    assert "Structure: sphere. " in page
    assert "Cohort: Twins." in page
    assert opened.details == ReportDetails(structure="sphere", cohort="Twins", axes=Axes.PATIENT)
    with pytest.raises(InputError, match="axes='scanner': choose one of auto, patient, file"):
        opened.describe(axes="scanner")
    with pytest.raises(InputError, match="structure: "):
        opened.describe(structure="long" * 100)


def test_places_have_the_names_that_the_authors_give_them(project, capsys):
    question = ["analyze", str(project.folder), *QUICK, "--between", "A", "C", "--size", "with"]
    assert main([*question, "--places", "basal/apical"]) == 2
    assert "--places basal/apical: must be two names for each" in capsys.readouterr().err
    assert main([*question, "--places", "septal/lateral -y/+y basal/apical"]) == 0
    rows = _rows(project.folder / "analysis" / "groups_group_A_C" / "regions.csv")
    top = max(rows, key=lambda row: float(row["peak_z_mm"]))
    assert "apical" in top["peak_place"]
    words = {word for row in rows for word in row["peak_place"].split()}
    assert words <= {"septal", "lateral", "-y", "+y", "basal", "apical", "middle"}


def test_axes_are_those_of_the_patient_only_if_all_files_say_so(project):
    record = project.read().result
    image = {"voxel": [1.0, 1.0, 1.0]}
    note = {"notes": ["its header gives no patient orientation (no qform or sform); RAS axes were assumed"]}
    for last, stated in ((image, True), (image | note, False), ({}, False)):
        rows = [item.model_copy(update=image) for item in record.subjects[:-1]]
        rows.append(record.subjects[-1].model_copy(update=last))
        directions = directions_of(ReportDetails(), record.model_copy(update={"subjects": rows}))
        assert directions.are_the_patients == stated
    assert not directions_of(ReportDetails(axes=Axes.FILE), None).are_the_patients


def test_an_interval_that_is_wider_than_its_column_breaks_between_its_numbers():
    (lines,) = wrapped_cells(["-9.64 (-11.52 to -7.77)"], [5.9])
    assert len(lines) == 2
    assert " ".join(lines).split() == ["\u22129.64", "(\u221211.52", "to", "\u22127.77)"]


def test_rows_of_a_long_table_are_not_broken_and_every_sheet_repeats_number_and_header():
    page = Page("title", "notice")
    page.paragraph("above")
    page.table(["number", "remark"], [(f"row {row}", "long " * 60) for row in range(40)], caption="Remarks")
    sheets = sheets_of(page)
    assert len(sheets) > 2
    rows = []
    for number, sheet in enumerate(sheets):
        texts = {text.get_text(): text for text in sheet.figure.texts}
        assert ("Table 1. Remarks" if number == 0 else "Table 1 (continued)") in texts
        assert {"number", "remark"} <= set(texts)
        rows += [name for name in texts if name.startswith("row ")]
        sheet.figure.canvas.draw()
        lowest = min(text.get_window_extent().y0 for text in texts.values())
        assert lowest / sheet.figure.dpi > 0.5
        long = [text for text in sheet.figure.texts if text.get_text().startswith("long")]
        assert len({len(text.get_text().splitlines()) for text in long}) == 1
    assert rows == [f"row {row}" for row in range(40)]


def test_a_pdf_has_contents_bookmarks_and_figures_as_vector_graphics(tmp_path):
    page = Page("title", "notice")
    for number in range(9):
        page.heading(f"Chapter {number}")
        page.heading(f"Section {number}", 3)
        page.paragraph("word " * 1300)
    figure = new_figure(4.0, 3.0, page_colours(LIGHT))
    figure.subplots().plot([0, 1], [0, 1])
    page.figures([ReportFigure("line", figure, "A line")])
    write_page(tmp_path / "page.pdf", page)
    content = (tmp_path / "page.pdf").read_bytes()
    assert content.count(b"/Type /Outlines") == 1
    assert b"/Count 9" in content
    assert content.count(b"/Dest [") == 18
    assert b"/Subtype /Image" not in content
    contents = sheets_of(page)
    assert len(contents) > 8
    count = len(re.findall(rb"/Type /Page\b", content))
    assert count == len(contents) + 1


def test_tables_and_figures_are_numbered_and_referred_to(report):
    page = report.read_text(encoding="utf-8")
    for kind in ("Table", "Figure"):
        numbers = [int(number) for number in re.findall(rf"caption>{kind} (\d+)\. ", page)]
        assert numbers == list(range(1, len(numbers) + 1))
    assert "those of the table" not in page
    assert page.count("Size alone") <= 3


def test_regression_and_pairs_are_analyzed(project, capsys):
    assert _analyze(project, "--regress", "age", "--covariates", "sex", "--size", "with") == 0
    said = capsys.readouterr().out
    assert "age, adjusted for sex" in said
    assert "Covariate sex: m - f: " in said
    (row,) = _rows(project.folder / "analysis" / "regression_age_for_sex" / "covariates.csv")
    assert (row["comparison"], row["n"]) == ("sex: m - f", "18")
    assert _analyze(project, "--pairs", "twin", "--between", "A", "B", "--size", "with") == 2
    assert "pair 't0' has two" in capsys.readouterr().err


def test_a_subject_that_lies_far_from_all_others_is_named(project, capsys):
    broken = 60.0 * np.random.default_rng(3).normal(size=(60, 3))
    write_particles(particle_file(project, "s3", "world"), broken)
    assert _analyze(project, "--size", "with") == 0
    assert "Caution: A, B, C: subject 3" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--group", "nothing"], "no column 'nothing'; the cohort has: group, shape-size, age"),
        (["--between", "A", "Z"], "no subject is in 'Z'; groups are: A, B, C"),
        (["--group", "site"], "one group only"),
        (["--regress", "sex"], "contains words"),
        (["--regress", "code:c"], "compare the groups of 'code' instead"),
        (["--regress", "site"], "is the same for all subjects"),
        (["--regress", "grade"], "no value for subject 7"),
        (["--covariates", "grade"], "no value for subject 7"),
        (["--covariates", "site"], "'site' is the same for all subjects"),
        (["--group", "age", "--between", "40", "42"], "'40' has 1 of the two or more subjects"),
        (["--modes", "17"], "17 modes are more than the 15"),
        (["--modes", "0"], "--modes 0: must be at least 1"),
        (["--pairs", "twin"], "between two values of column 'group'; name two of: A, B, C"),
        (["--pairs", "twin", "--between", "X", "Y"], "no subject is in 'X'; groups are: A, B, C"),
        (["--pairs", "twin", "--regress", "age"], "can't be combined with --regress"),
        (["--pairs", "halves", "--between", "A", "B"], "'halves': no pair for subject 1; fill it in"),
        (["--covariates", "age", "age"], "'age' is given twice"),
        (["--covariates", "dose"], "'dose' contains numbers, but also '30 y' of subject 3"),
        (["--covariates", "weight"], "'inf' of subject 2 is not finite"),
        (["--size", "with", "--alignment", "rigid"], "give one of them"),
    ],
)
def test_a_question_that_cannot_be_answered_is_refused_and_not_kept(project, options, message, capsys):
    assert _analyze(project, *options) == 2
    error = capsys.readouterr().err
    assert message in error
    assert "Traceback" not in error
    assert not list(project.folder.rglob("study.json"))


def test_spellings_of_a_declared_category_are_told_and_those_of_a_number_are_not(project, capsys):
    assert _analyze(project, "--between", "A", "B", "--covariates", "scanner:c", "--size", "with") == 0
    assert "'scanner' contains '1' and '1.0', which were treated as different" in capsys.readouterr().out
    assert _analyze(project, "--between", "A", "B", "--covariates", "scanner", "--size", "with") == 0
    assert "treated as different" not in capsys.readouterr().out


def test_each_p_is_printed_with_no_more_digits_than_it_has():
    assert [p_text(p) for p in (0.0, 0.00099, 0.0123, 0.21, 1.0)] == [
        "p < 0.001", "p < 0.001", "p = 0.012", "p = 0.21", "p > 0.99",
    ]  # fmt: skip
    assert p_text(1 / 200, 199) == "p = 0.005"
    assert p_text(1 / 100, 99) == "p = 0.01"
    assert p_text(1 / 20, 19) == "p = 0.05"


def test_a_group_that_scatters_more_raises_a_caution_where_answers_are_read(project, capsys):
    record = project.read().result
    for index, subject in enumerate(record.subjects):
        if subject.group == "A":
            place = particle_file(project, subject.file, "world")
            shape = read_particles(place)
            generator = np.random.default_rng(index)
            push = 3.0 * np.tanh(np.linalg.norm(shape, axis=1, keepdims=True)) * generator.normal(size=(1, 3))
            write_particles(place, shape * (1.0 + push / 20.0))
    assert _analyze(project, "--between", "A", "B", "--alignment", "as-it-lies") == 0
    said = capsys.readouterr().out
    assert "differ in dispersion" in said
    assert "assume equal dispersion" in said
    (row,) = _rows(project.folder / "analysis" / "groups_group_A_B_as_it_lies" / "tests.csv")
    assert float(row["dispersion_p"]) <= 0.05
    assert float(row["dispersion_ratio"]) > 1.5


def test_form_and_shape_count_as_two_answers_and_pairs_are_corrected(project):
    assert _analyze(project) == 0
    rows = _rows(project.folder / "analysis" / "groups_group_A_B_C" / "tests.csv")
    assert [row["answers"] for row in rows] == ["2"] * 4
    assert [row["pairs_corrected_for"] for row in rows] == ["1", "3", "3", "3"]
    least = min(rows[1:], key=lambda row: float(row["p_permutation"]))
    assert float(least["p_permutation_corrected"]) == pytest.approx(min(6 * float(least["p_permutation"]), 1))
    raw = sorted(float(row["size_p_permutation"]) for row in rows[1:])
    corrected = sorted(float(row["size_p_permutation_corrected"]) for row in rows[1:])
    assert corrected[0] == pytest.approx(min(3 * raw[0], 1.0))
    raw = sorted(float(row["auc_p_permutation"]) for row in rows[1:])
    corrected = sorted(float(row["auc_p_permutation_corrected"]) for row in rows[1:])
    assert corrected[0] == pytest.approx(min(6 * raw[0], 1.0))


def test_tables_say_what_they_are_of_and_what_each_column_holds(project):
    assert _analyze(project, "--between", "A", "C", "--covariates", "age", "--alignment", "rigid") == 0
    folder = project.folder / "analysis" / "groups_group_A_C_for_age"
    (test,) = _rows(folder / "tests.csv")
    assert (test["result_fingerprint"], test["alignment"], test["covariates"]) == ("abc", "rigid", "age")
    assert test["date"]
    assert test["homolog_version"]
    assert float(test["mahalanobis_d_corrected"]) < float(test["mahalanobis_d_plain"])
    assert float(test["auc_low_95"]) <= float(test["auc"]) <= float(test["auc_high_95"])
    kept = json.loads((folder / "study.json").read_text())
    assert kept["answered"]["fingerprint"] == "abc"
    meanings = _rows(folder / "columns.csv")
    assert {row["file"] for row in meanings} == {path.name for path in folder.glob("*.csv")} - {"columns.csv"}
    assert all(row["meaning"] for row in meanings)
    assert not [row for row in meanings if row["meaning"] == "the column of the question"][1:]
    particle = _rows(folder / "particles_C_-_A.csv")[0]
    assert float(particle["outward_low_95_mm"]) < float(particle["outward_mm"])
    sample = _rows(folder / "sample.csv")
    ages = [row for row in sample if row["variable"] == "age"]
    assert [(row["minimum"], row["maximum"]) for row in ages] == [("40.0", "70.0"), ("44.0", "74.0")]
    assert [row["n"] for row in sample if row["variable"] == "subjects"] == ["6", "6"]
    assert [row for row in sample if row["variable"] == "voxel"] == []
    left_out = [row["left_out_because"] for row in _rows(folder / "subjects.csv")]
    assert left_out.count("group is 'B'") == 6


def test_subjects_without_a_value_are_left_out_by_choice_and_counted(project, capsys):
    question = ["--covariates", "grade:c", "--between", "A", "B", "--size", "with"]
    assert _analyze(project, *question) == 2
    assert _analyze(project, *question, "--complete-cases") == 0
    assert "1 subject was excluded for missing values" in capsys.readouterr().out
    (folder,) = (project.folder / "analysis").iterdir()
    (test,) = _rows(folder / "tests.csv")
    assert (test["n"], test["complete_cases"]) == ("11", "1")
    gone = {row["name"]: row["left_out_because"] for row in _rows(folder / "subjects.csv")}
    assert gone["subject 7"] == "no value of grade"
    assert _analyze(project, "--regress", "grade", "--size", "with", "--complete-cases") == 0
    (test,) = _rows(project.folder / "analysis" / "regression_grade_complete_cases" / "tests.csv")
    assert test["n"] == "17"
    assert test["unit"] == "per unit of grade"


def test_subjects_without_a_partner_are_said_to_be_left_out_for_that(project, capsys):
    question = ["--pairs", "twin", "--between", "A", "B", "--size", "with", "--complete-cases"]
    record = project.read().result
    subjects = [
        subject.model_copy(
            update={"columns": {**subject.columns, "twin": f"t{index // 3}" if index != 3 else "t9"}}
        )
        for index, subject in enumerate(record.subjects)
    ]
    project.write(ProjectRecord(result=record.model_copy(update={"subjects": subjects})))
    assert _analyze(project, *question) == 0
    said = capsys.readouterr().out
    assert "2 subjects were excluded because the other one of their pair is missing" in said
    assert "missing values" not in said


def test_the_least_p_of_all_signs_is_that_of_the_observed_ones_and_their_opposites(project):
    result = read_result(project)
    signs = StudyRequest(kind="pairs", between=("A", "B"), pairs="couple", null_repeats=0, answers=2)
    study = run_study(result, signs)
    assert study.overall.test.exact
    assert "With all 64 permutations the least possible p" in corrections_text(study)
    assert "is 0.031, 0.062 after correction" in corrections_text(study)
    assert "discriminant" not in corrections_text(study)


def test_numbers_that_are_declared_categories_become_columns(project):
    for name, covariate in (("number", "code"), ("category", "code:c")):
        assert _analyze(project, "--between", "A", "B", "--size", "with", "--covariates", covariate) == 0, (
            name
        )
    folders = sorted((project.folder / "analysis").iterdir())
    dof = [int(float(_rows(folder / "tests.csv")[0]["f_dof_denominator"])) for folder in folders]
    modes = [int(_rows(folder / "tests.csv")[0]["modes"]) for folder in folders]
    assert dof[0] + modes[0] == dof[1] + modes[1] + 1


def test_a_covariate_that_is_the_same_within_one_pair_of_groups_is_told_not_refused(project, capsys):
    assert _analyze(project, "--covariates", "half", "--size", "with") == 0
    assert "B - A: a covariate" in capsys.readouterr().out


def test_a_column_called_size_is_the_users_own(project, capsys):
    record = project.read()
    subjects = [
        subject.model_copy(update={"columns": {**subject.columns, "size": str(index % 5)}})
        for index, subject in enumerate(record.result.subjects)
    ]
    project.write(
        record.model_copy(update={"result": record.result.model_copy(update={"subjects": subjects})})
    )
    assert _analyze(project, "--regress", "size", "--size", "with") == 0
    said = capsys.readouterr().out
    assert "'shape-size'" in said
    assert "Size alone" in said
    assert _analyze(project, "--regress", "shape-size", "--size", "with") == 0
    assert "Size alone" not in capsys.readouterr().out  # against itself


def test_no_answer_overwrites_that_of_another_question(project):
    long = [f"{'a very long name of a group ' * 5}{item}" for item in "AB"]
    questions = [
        StudyRequest(between=tuple(long)),
        StudyRequest(between=(long[0], long[0] + "C")),
        StudyRequest(between=tuple(long), alignment="similarity"),
        StudyRequest(between=("a b", "c")),
        StudyRequest(between=("a", "b c")),
        StudyRequest(kind="pairs", between=("A", "B"), pairs="twin"),
        StudyRequest(kind="pairs", between=("A", "B"), pairs="couple"),
        StudyRequest(seed=3),
        StudyRequest(seed=4),
    ]
    folders = []
    for entry in questions:
        folders.append(study_folder(project, entry))
        write_request(entry, folders[-1], Answered.now(project))
    assert len(set(folders)) == len(questions)
    assert [study_folder(project, question) for question in questions] == folders
    assert max(len(folder.name) for folder in folders) < 140
    assert sorted(read_request.question for read_request in read_requests(project)) == sorted(
        question.question for question in questions
    )


def test_a_question_of_an_earlier_version_is_answered_and_the_change_is_told(project, without_figures):
    folder = project.folder / "analysis" / "groups_group_A_C"
    folder.mkdir(parents=True)
    question = {"kind": "groups", "column": "group", "between": ["A", "C"], "pairs": None, "covariates": []}
    question |= {"scaling": False, "modes": None, "permutations": 199, "null_repeats": 0, "seed": 0}
    (folder / "study.json").write_text(json.dumps(question))
    (request,) = read_requests(project)
    assert (request.alignment, request.earlier) == ("rigid", True)
    assert study_folder(project, request) == folder
    assert main(["report", str(project.folder), "--progress", "none"]) == 0
    text = (project.folder / "report" / "report.html").read_text(encoding="utf-8")
    assert "shapes as they lie" in text


def test_tables_are_marked_as_soon_as_particles_are_placed_anew(project):
    assert _analyze(project, "--between", "A", "C", "--size", "with") == 0
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


class _Page(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags, self.links, self.sources, self.texts = [], [], [], []

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.links += [value for name, value in attributes if name == "href"]
        self.sources += [value for name, value in attributes if name == "src"]

    def handle_data(self, data):
        self.texts.append(data)


@pytest.fixture(scope="module")
def report(tmp_path_factory, unit_sphere):
    """The report's path, after a study of two groups."""
    project = _project(tmp_path_factory.mktemp("report") / "study", unit_sphere)
    assert _analyze(project, "--between", "A", "C") == 0
    assert main(["report", str(project.folder), "--progress", "none"]) == 0
    return project.folder / "report" / "report.html"


def test_the_report_needs_no_network_and_shows_names_as_they_are(report):
    text = report.read_text(encoding="utf-8")
    page = _Page()
    page.feed(text)
    assert "script" not in page.tags
    assert HOSTILE in "".join(page.texts)
    assert all(source.startswith("data:image/png;base64,") for source in page.sources)
    assert not re.search(r"https?://", text)
    for link in page.links:
        assert (report.parent / link).is_file(), link


def test_the_report_says_what_was_found_how_and_that_it_is_for_research(report):
    text = re.sub(r"<[^>]+>", " ", report.read_text(encoding="utf-8"))
    for part in (
        "For research use",
        "C − A (6 A, 6 C): they differ in form",
        "Hotelling",
        "Type I error rates on this cohort",
        "Homolog 9.9",
        "parallel analysis",
        "permutations",
        "fingerprint",
        "Where",
        "smoothing 1.0 voxels",
        "one-sided",
        "Excluded before the run: 1. scan.nrrd: is empty",
        "sex: f",
    ):
        assert part in text, part
    assert "questions were asked" not in text  # form and shape are answers to one
    assert text.count("Equality of dispersion was tested") == 1  # what studies share is told once
    assert text.count("Shapes were aligned by generalized Procrustes") == 2  # they differ in that
    assert "nan" not in text.lower().split()


def test_every_figure_lies_beside_the_report_as_vector_graphics(report):
    drawn = sorted(path.stem for path in (report.parent / "figures").glob("*.svg"))
    assert {"scree", "scores", "modes", "quality", "energies"} < set(drawn)
    assert drawn == sorted(path.stem for path in (report.parent / "figures").glob("*.pdf"))
    for path in (report.parent / "figures").glob("*.svg"):
        assert ElementTree.parse(path).getroot().tag.endswith("svg")


def test_the_page_lies_beside_as_pdf_with_its_figures_and_tables(report):
    content = report.with_suffix(".pdf").read_bytes()
    assert content.startswith(b"%PDF")
    assert content.rstrip().endswith(b"%%EOF")
    assert content.count(b"/Type /Page ") >= 4
    assert content.count(b"/Subtype /Image") >= len(list((report.parent / "figures").glob("*.svg")))


def test_methods_of_a_study_like_an_earlier_one_tell_the_difference(project, without_figures):
    for options in ([], ["--covariates", "age"]):
        assert _analyze(project, "--between", "A", "C", *options) == 0
    page = api.report(project.folder).read_text(encoding="utf-8")
    like = r"\. Its methods were those of the study “([^”]*)”, except: Shapes were aligned by generalized"
    assert [result.partition("; ")[2] for result in re.findall(like, page)] == 2 * ["form (size and shape)"]
    assert page.count("residuals were permuted (Freedman and Lane).") == 1


def test_a_project_without_a_result_has_no_report(tmp_path, capsys):
    project = ProjectFolder(tmp_path / "empty")
    project.write(ProjectRecord())
    assert main(["report", str(project.folder), "--progress", "none"]) == 2
    assert "has no result yet" in capsys.readouterr().err


def test_voxels_of_the_files_are_told_by_group_and_ranges_where_there_are_many_sizes(project):
    result = read_result(project)
    study = SimpleNamespace(request=StudyRequest(between=("A", "B")), left_out={}, labels=result.groups)
    edges = [(0.5, 0.5, 2.0 if group == "A" else 3.0) for group in result.groups]
    rows = sample_rows(study, replace(result, voxels=tuple(edges)))
    voxels = [(row.group, row.category, row.count) for row in rows if row.variable == "voxel"]
    assert voxels == [
        ("A", "0.5 x 0.5 x 2", 6), ("A", "0.5 x 0.5 x 3", 0),
        ("B", "0.5 x 0.5 x 2", 0), ("B", "0.5 x 0.5 x 3", 6),
    ]  # fmt: skip
    many = tuple((0.5, 0.5, 1.0 + 0.1 * index) for index in range(len(edges)))
    rows = sample_rows(study, replace(result, voxels=many))
    texts = {row.category for row in rows if row.variable == "voxel"}
    assert len(texts) == 1
    assert texts.pop().startswith("0.5 x 0.5 x 1 to ")
