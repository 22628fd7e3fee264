"""The page of a report, and what Python says of it."""

import json
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

import homolog as hl
from homolog.comparison.seeds import SeedAnswer, write_spread
from homolog.comparison.stored import folder_of, read_requests, stored_answers
from homolog.errors import InputError
from homolog.io.project import ProjectFolder
from homolog.io.records import ProjectRecord
from homolog.io.report_details import Axes, ReportDetails, read_details
from homolog.statistics.effects import Effect
from homolog.surfaces.mesh import TriangleMesh
from homolog_app import api
from homolog_app.cli import main
from homolog_app.report.sample import measures_of

HOSTILE = "<script>alert('x')</script> & co"


def test_structure_cohort_and_axes_are_kept_and_used(project, without_figures, analyze, rows_of):
    assert analyze(project, "--between", "A", "C", "--size", "with", "--axes", "patient") == 0
    rows = rows_of(project.folder / "analysis" / "groups_group_A_C" / "regions.csv")
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


def test_python_answers_describes_and_reports_as_the_commands_do(project, capsys, without_figures, analyze):
    assert analyze(project, "--between", "A", "B", "--covariates", "age", "--pairs", "twin") == 2
    refused = capsys.readouterr().err
    with pytest.raises(InputError) as error:
        api.analyze(project.folder, between=["A", "B"], covariates=["age"], pairs="twin")
    assert str(error.value) in refused
    options = ["--between", "A", "B", "--covariates", "age", "grade", "--complete-cases", "--axes", "patient"]
    assert analyze(project, *options) == 0
    printed = capsys.readouterr().out
    form, shape = api.analyze(
        project.folder, between=["A", "B"], covariates=["age", "grade"], complete_cases=True, axes="patient",
        permutations=199, null_repeats=0,
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
    assert analyze(project, "--between", "A", "C", "--null-repeats", "50") == 0
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
        "to compare the type I error rate of F",
        "Homolog 9.9",
        "parallel analysis",
        "permutations",
        "(allometry) remains",
        "Where",
        "smoothing 1.0 voxels",
        "one-sided",
        "could be exchanged",
        "Excluded before the run: 1. scan.nrrd: is empty",
        "sex: f",
    ):
        assert part in text, part
    assert "not for the number of questions" not in text  # form and shape are answers to one
    assert text.count("Equality of dispersion was tested") == 1  # what studies share is told once
    assert text.count("Shapes were aligned by generalized Procrustes") == 2  # they differ in that
    assert "nan" not in text.lower().split()


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
    assert content.count(b"/Type /Page ") >= 4
    assert content.count(b"/Subtype /Image") >= len(list((report.parent / "figures").glob("*.svg")))


def test_methods_are_those_of_each_study(project, without_figures, analyze):
    assert analyze(project, "--between", "A", "C", "--alignment", "rigid") == 0
    own = ["--alignment", "rigid", "--modes", "2", "--permutations", "299"]
    assert analyze(project, "--between", "A", "B", *own) == 0
    page = api.report(project.folder).read_text(encoding="utf-8")
    paragraphs = dict(re.findall(r"<p>Study ([\d, ]+): ([^<]+)", page[page.index("Methods") :]))
    studies = [request.modes for request in read_requests(project)]
    first, second = (paragraphs[str(studies.index(modes) + 1)] for modes in (None, 2))
    assert "parallel analysis" in first
    assert "199 random permutations" in first
    assert "chosen beforehand" in second
    assert "299 random permutations" in second
    quality = project.folder / "report" / "quality.csv"
    assert {"compactness", "generalization", "specificity"} <= set(
        re.findall("[a-z]+", quality.read_text("utf-8").splitlines()[0])
    )


def test_methods_that_studies_share_are_told_once(project, without_figures, analyze):
    for options in ([], ["--covariates", "age"]):
        assert analyze(project, "--between", "A", "C", *options) == 0
    page = api.report(project.folder).read_text(encoding="utf-8")
    paragraphs = dict(re.findall(r"<p>Study ([\d, ]+): ([^<]+)", page[page.index("Methods") :]))
    aligned, tested = "Shapes were aligned by generalized Procrustes", "let s_g² be the mean of"
    assert [numbers for numbers, text in paragraphs.items() if aligned in text] == ["1, 3", "2, 4"]
    assert [numbers for numbers, text in paragraphs.items() if tested in text] == ["3, 4"]
    sentences = [sentence for text in paragraphs.values() for sentence in text.split(". ")]
    assert len(sentences) == len(set(sentences))
    assert page.count("residuals were permuted [") == 1


def test_the_primary_study_leads_and_the_others_are_secondary(project, without_figures, analyze, rows_of):
    def first_page():
        page = re.sub(r"<[^>]+>", " ", api.report(project.folder).read_text(encoding="utf-8"))
        return page[page.index("Main results") : page.index("Sample")]

    assert analyze(project, "--between", "A", "C") == 0
    assert analyze(project, "--between", "B", "C", "--primary", "as-it-lies") == 2
    assert analyze(project, "--between", "B", "C") == 0
    text = first_page()
    assert "No study was declared primary" in text
    assert "0.025 significant" in text
    assert "secondary" not in text
    assert analyze(project, "--between", "B", "C", "--primary", "similarity") == 0
    assert analyze(project, "--between", "B", "C") == 0  # it remains primary when it is answered again
    text = first_page()
    assert "Study 1 was declared primary" in text
    assert "Study 1 (primary; shape; allometry remains). C − B" in text
    assert "Study 2 (secondary; form). C − B" in text
    kept = stored_answers(project)
    assert [study.is_primary for study in kept] == [True, False, False, False]
    tables = [folder_of(project, study.question) / "tests.csv" for study in kept]
    assert [rows_of(table)[0]["primary"] for table in tables] == ["1", "0", "0", "0"]
    assert analyze(project, "--between", "A", "C", "--primary") == 0
    assert read_requests(project)[0].name == "groups_group_A_C"
    assert analyze(project, "--between", "A", "C", "--primary", "none") == 0
    assert not any(study.is_primary for study in stored_answers(project))
    assert {row["primary"] for table in tables for row in rows_of(table)} == {"0"}


def test_a_region_of_one_particle_or_of_one_seed_is_not_claimed(project, without_figures, analyze, rows_of):
    assert analyze(project, "--between", "A", "C", "--size", "with") == 0
    page = api.report(project.folder).read_text(encoding="utf-8")
    assert "Largest regions" in page
    assert "No region can be claimed" not in page
    folder = folder_of(project, read_requests(project)[0])
    fingerprint = project.read().result.fingerprint
    (test,) = rows_of(folder / "tests.csv")
    p = float(test["p_permutation_corrected"])
    accuracy = Effect(0.6, 0.4, 0.8, 0.3)
    answer = SeedAnswer("C - A", 0, p, Effect(2.22, 1.0, 3.0), 0, 0.0, accuracy, None, None, 199, fingerprint)
    write_spread(folder, [replace(answer, seed=seed) for seed in range(3)])
    page = api.report(project.folder).read_text(encoding="utf-8").replace("\xa0", " ")
    assert "2.22 (1.00 to 3.00)" in page
    assert "With seeds 0, 1, 2 the placement of particles" in page
    assert "values of the first seed; other seeds" not in page
    assert "Largest regions, by" not in page
    assert "No region can be claimed for C − A" in page
    assert "not shown to exceed chance: C − A (Study 1, p = 0.30)" in page  # medians, as in the table


def test_the_first_page_says_which_pairs_differ(project, without_figures, analyze):
    assert analyze(project, "--size", "with", "--covariates", "age") == 0
    page = re.sub(r"<[^>]+>", " ", api.report(project.folder).read_text(encoding="utf-8"))
    first = page[page.index("Main results") : page.index("Shape model")]
    assert "Study 1 (form, adjusted for age). The groups differ in form." in first
    assert "Of the pairs C − A, C − B differ; no difference can be shown of B − A." in first


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
    (request,) = read_requests(project)
    assert (request.alignment, request.earlier) == ("rigid", True)
    assert folder_of(project, request) == folder
    assert main(["report", str(project.folder), "--progress", "none"]) == 0
    text = (project.folder / "report" / "report.html").read_text(encoding="utf-8")
    assert "shapes as they lie" in text
