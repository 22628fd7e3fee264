"""The page of a report, and what Python says of it."""

import json
import re
import xml.etree.ElementTree as ElementTree
from html.parser import HTMLParser

import numpy as np
import pytest

import homolog as hl
from homolog.comparison.stored import folder_of, stored_answers
from homolog.errors import InputError
from homolog.io.project import ProjectFolder
from homolog.io.records import ProjectRecord
from homolog.io.report_details import Axes, ReportDetails, read_details
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.cli import main
from homolog_app.report.rows import measures_of

HOSTILE = "<script>alert('x')</script> & co"


def test_structure_cohort_and_axes_are_kept_and_used(project, without_figures, analyze, rows_of):
    assert analyze(project, "--between", "A", "C", "--size", "with", "--axes", "patient") == 0
    rows = rows_of(project.folder / "analysis" / "groups_group_A_C" / "regions.csv")
    assert any("superior" in row["peak_place"] for row in rows)
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


def test_python_answers_describes_and_reports_as_the_commands_do(project, capsys, without_figures, analyze):
    assert analyze(project, "--between", "A", "B", "--covariates", "age", "--pairs", "twin") == 2
    refused = capsys.readouterr().err
    with pytest.raises(InputError) as error:
        hl.analyze(project.folder, between=["A", "B"], covariates=["age"], pairs="twin")
    assert str(error.value) in refused
    options = ["--between", "A", "B", "--covariates", "age", "grade", "--complete-cases", "--axes", "patient"]
    assert analyze(project, *options) == 0
    printed = capsys.readouterr().out
    (shape,) = hl.analyze(
        project.folder,
        between=["A", "B"],
        covariates=["age", "grade"],
        complete_cases=True,
        permutations=199,
    )
    assert f"{shape.text}\n" == printed
    assert any("excluded for missing values" in caution for caution in shape.cautions)
    assert (shape.comparison.title, shape.pairwise, shape.seeds) == ("B - A", (), ())
    opened = hl.Project(project.folder)
    opened.describe(structure="sphere")
    page = hl.report(project.folder, cohort="Twins").read_text(encoding="utf-8")
    assert "Structure: sphere. " in page
    assert "Cohort: Twins." in page
    assert opened.details == ReportDetails(structure="sphere", cohort="Twins", axes=Axes.PATIENT)
    with pytest.raises(InputError, match="axes='scanner': choose one of auto, patient, file"):
        opened.describe(axes="scanner")
    with pytest.raises(InputError, match="structure: "):
        opened.describe(structure="long" * 100)


def test_tables_and_figures_are_numbered_and_referred_to(report):
    page = report.read_text(encoding="utf-8")
    for kind in ("Table", "Figure"):
        numbers = [int(number) for number in re.findall(rf"caption>{kind} (\d+)\. ", page)]
        assert numbers == list(range(1, len(numbers) + 1))
    text = re.sub(r"<[^>]+>", " ", page)
    cited = {int(number) for found in re.findall(r"\[([\d, ]+)\]", text) for number in found.split(",")}
    listed = [int(number) for number in re.findall(r"<p>(\d+)\. ", page)]
    assert listed == list(range(1, len(cited) + 1)) == sorted(cited)


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
def report(tmp_path_factory, make_project, analyze):
    """The report's path, after a study of two groups."""
    project = make_project(tmp_path_factory.mktemp("report") / "study")
    assert analyze(project, "--between", "A", "C") == 0
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


def test_every_figure_lies_beside_the_report_as_vector_graphics(report):
    drawn = sorted(path.stem for path in (report.parent / "figures").glob("*.svg"))
    assert {"scree", "scores", "modes"} < set(drawn)
    assert drawn == sorted(path.stem for path in (report.parent / "figures").glob("*.pdf"))
    for path in (report.parent / "figures").glob("*.svg"):
        assert ElementTree.parse(path).getroot().tag.endswith("svg")


def test_the_page_lies_beside_as_pdf_with_its_figures_and_tables(report):
    content = report.with_suffix(".pdf").read_bytes()
    assert content.startswith(b"%PDF")
    assert content.rstrip().endswith(b"%%EOF")
    assert content.count(b"/Type /Page ") >= 2
    assert content.count(b"/Subtype /Image") >= len(list((report.parent / "figures").glob("*.svg")))


def test_the_primary_study_leads_and_stays_primary_when_it_is_answered_again(project, analyze, rows_of):
    assert analyze(project, "--between", "A", "C") == 0
    assert analyze(project, "--between", "B", "C", "--primary", "as-it-lies") == 2
    for _ in range(2):
        assert analyze(project, "--between", "B", "C", "--primary", "shape") == 0
    kept, _ = stored_answers(project)
    assert [stored.is_primary for stored in kept] == [True, False]
    tables = [folder_of(project, stored.question) / "tests.csv" for stored in kept]
    assert [rows_of(table)[0]["primary"] for table in tables] == ["1", "0"]
    assert analyze(project, "--between", "A", "C", "--primary") == 0
    assert stored_answers(project)[0][0].question.between == ("A", "C")
    assert analyze(project, "--between", "A", "C", "--primary", "none") == 0
    assert not any(stored.is_primary for stored in stored_answers(project)[0])
    assert {row["primary"] for table in tables for row in rows_of(table)} == {"0"}


def test_a_report_of_three_questions_is_short(project, analyze):
    for options in ([], ["--covariates", "age"]):
        assert analyze(project, "--between", "A", "C", *options) == 0
    assert analyze(project, "--regress", "age") == 0
    page = hl.report(project.folder).read_text(encoding="utf-8")
    assert page.count("<caption>") <= 8
    assert (
        len(re.sub(r"<details>.*?</details>|<style>.*?</style>|<[^>]+>", " ", page, flags=re.S).split())
        <= 2500
    )
    content = (project.folder / "report" / "report.pdf").read_bytes()
    assert content.count(b"/Type /Page ") <= 6
    names = [line for line in page.splitlines() if line.startswith(("<h2>", "<h3>"))]
    assert names[0] == "<h2>Main results</h2>"


def test_measures_of_hollow_shapes_have_the_thickness_of_their_wall(unit_sphere):
    points, faces = unit_sphere(300)
    wall = TriangleMesh(
        np.concatenate([20.0 * points, 14.0 * points]), np.concatenate([faces, faces[:, ::-1] + len(points)])
    )
    volume, area, thickness = measures_of([wall], hollow=True)
    assert thickness.values[0] == pytest.approx(6.0, rel=0.05)
    assert volume.values[0] == pytest.approx(4.0 / 3.0 * np.pi * (8.0 - 2.744), rel=0.05)
    assert area.values[0] == pytest.approx(4.0 * np.pi * (4.0 + 1.96), rel=0.05)
    assert len(measures_of([wall], hollow=False)) == 2


def test_an_open_surface_has_an_area_and_no_volume(unit_sphere):
    points, faces = unit_sphere(300)
    meshes = [TriangleMesh(points, faces), TriangleMesh(points, faces[5:])]
    (area,) = measures_of(meshes, hollow=False)
    assert area.column == "area_cm2"


def test_answers_that_are_damaged_or_lack_a_value_are_left_out_and_named(project, without_figures, analyze):
    assert analyze(project, "--between", "A", "C") == 0
    assert analyze(project, "--regress", "age") == 0
    folder = project.folder / "analysis" / "regression_age_without_size"
    kept = folder / "study.json"
    kept.write_text(kept.read_text("utf-8").replace('"age"', '"grade"'), "utf-8")  # one subject has none
    (project.folder / "analysis" / "broken").mkdir()
    (project.folder / "analysis" / "broken" / "study.json").write_text("[", "utf-8")
    page = hl.report(project.folder).read_text(encoding="utf-8")
    assert "no value for subject 7" in page
    assert "broken/study.json: is damaged" in page
    assert "C − A" in page


def test_a_project_without_a_result_has_no_report(tmp_path, capsys):
    project = ProjectFolder(tmp_path / "empty")
    project.write(ProjectRecord())
    assert main(["report", str(project.folder), "--progress", "none"]) == 2
    assert "has no result yet" in capsys.readouterr().err


def test_a_question_of_an_earlier_version_is_answered_and_the_change_is_told(project, without_figures):
    folder = project.folder / "analysis" / "groups_group_A_C"
    folder.mkdir(parents=True)
    question = {"kind": "groups", "column": "group", "between": ["A", "C"], "pairs": None, "covariates": []}
    question |= {"scaling": False, "modes": None, "permutations": 199, "null_repeats": 0, "seed": 0}
    (folder / "study.json").write_text(json.dumps(question))
    ((stored,), _) = stored_answers(project)
    request = stored.question
    assert (request.alignment, request.earlier) == ("form", True)
    assert folder_of(project, request) == folder
    assert main(["report", str(project.folder), "--progress", "none"]) == 0
    text = (project.folder / "report" / "report.html").read_text(encoding="utf-8")
    assert "shapes as they lie" in text
