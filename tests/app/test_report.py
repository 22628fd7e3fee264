import csv
import re
import xml.etree.ElementTree as ElementTree
from html.parser import HTMLParser

import numpy as np
import pytest

from homolog.files.meshes import write_mesh
from homolog.files.particles import write_particles
from homolog.files.project import Project
from homolog.files.records import ProjectRecord, ResultRecord, ResultSubject
from homolog.files.results import mean_file, particle_file
from homolog.files.tables import write_table
from homolog.settings import RunSettings
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.cli import main

HOSTILE = "<script>alert('x')</script> & co"
QUICK = ["--permutations", "199", "--null", "50", "--progress", "none"]


@pytest.fixture
def project(tmp_path, unit_sphere):
    """A finished project: 18 spheres of 20 mm in three groups; those of C bulge upward by 4 mm."""
    return _project(tmp_path / "study", unit_sphere)


def _project(folder, unit_sphere):
    project = Project(folder)
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
    )  # fmt: skip
    project.write(ProjectRecord(result=result))
    return project


def _rows(path):
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def _analyze(project, *words):
    return main(["analyze", str(project.folder), *words, *QUICK])


def test_three_groups_are_analyzed_with_and_without_size_and_written_as_tables(project, capsys):
    assert _analyze(project) == 0
    said = capsys.readouterr().out
    assert "6 A, 6 B, 6 C: the groups differ in shape" in said
    assert "C - A (6 A, 6 C): the shapes differ" in said
    assert "B - A (6 A, 6 B): no difference in shape can be shown" in said
    folder = project.folder / "analysis" / "groups_group_A_B_C"
    tests = _rows(folder / "tests.csv")
    assert [row["comparison"] for row in tests] == ["A, B, C", "B - A", "C - A", "C - B"]
    particles = _rows(folder / "particles_C_-_A.csv")
    top = max(particles, key=lambda row: float(row["mean_z_mm"]))
    assert float(top["outward_mm"]) == pytest.approx(4.0, abs=1.5)
    assert float(top["p_family"]) <= 0.05
    assert float(top["outward_p_family"]) <= 0.05
    assert float(top["outward_t_welch"]) > 3.0
    assert [row["name"] for row in _rows(folder / "subjects.csv")][4] == HOSTILE
    assert (project.folder / "analysis" / "groups_group_A_B_C_without_size" / "tests.csv").is_file()


def test_regression_and_pairs_are_analyzed(project, capsys):
    assert _analyze(project, "--regress", "age", "--covariates", "sex", "--size", "with") == 0
    assert "effect of age, allowing for sex" in capsys.readouterr().out
    assert _analyze(project, "--pairs", "twin", "--between", "A", "B", "--size", "with") == 2
    assert "pair 't0' has two subjects that are 'A'" in capsys.readouterr().err


def test_a_subject_that_lies_far_from_all_others_is_named_first(project, capsys):
    broken = 60.0 * np.random.default_rng(3).normal(size=(60, 3))
    write_particles(particle_file(project, "s3", "world"), broken)
    assert _analyze(project, "--size", "with") == 0
    assert capsys.readouterr().out.startswith("Caution: subject 3: lies far from all other shapes.")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--group", "nothing"], "there is no column 'nothing'; the cohort has: group, size, age"),
        (["--between", "A", "Z"], "no subject is in 'Z'; there are: A, B, C"),
        (["--group", "site"], "one group only"),
        (["--regress", "sex"], "holds words"),
        (["--regress", "site"], "is the same for all subjects"),
        (["--regress", "grade"], "no value for subject 7"),
        (["--covariates", "grade"], "no value for subject 7"),
        (["--covariates", "site"], "'site' is the same for all subjects"),
        (["--group", "age", "--between", "40", "42"], "'40' has 1 of the two or more subjects"),
        (["--modes", "17"], "17 modes are more than the 15"),
        (["--modes", "0"], "--modes 0: Input should be greater than or equal to 1"),
        (["--pairs", "twin"], "between two values of a column"),
    ],
)
def test_a_question_that_cannot_be_answered_is_refused_and_not_kept(project, words, message, capsys):
    assert _analyze(project, *words) == 2
    error = capsys.readouterr().err
    assert message in error
    assert "Traceback" not in error
    assert not list(project.folder.rglob("study.json"))


class _Page(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags, self.links, self.sources, self.words = [], [], [], []

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.links += [value for name, value in attributes if name == "href"]
        self.sources += [value for name, value in attributes if name == "src"]

    def handle_data(self, data):
        self.words.append(data)


@pytest.fixture(scope="module")
def report(tmp_path_factory, unit_sphere):
    """The report's path, after a study of two groups."""
    project = _project(tmp_path_factory.mktemp("report") / "study", unit_sphere)
    assert _analyze(project, "--between", "A", "C", "--size", "with") == 0
    assert main(["report", str(project.folder), "--progress", "none"]) == 0
    return project.folder / "report" / "report.html"


def test_the_report_needs_no_network_and_shows_names_as_they_are(report):
    text = report.read_text(encoding="utf-8")
    page = _Page()
    page.feed(text)
    assert "script" not in page.tags
    assert HOSTILE in "".join(page.words)
    assert all(source.startswith("data:image/png;base64,") for source in page.sources)
    assert not re.search(r"https?://", text)
    for link in page.links:
        assert (report.parent / link).is_file(), link


def test_the_report_says_what_was_found_how_and_that_it_is_for_research(report):
    words = re.sub(r"<[^>]+>", " ", report.read_text(encoding="utf-8"))
    for part in (
        "For research use",
        "C - A (6 A, 6 C): the shapes differ",
        "Hotelling",
        "False alarms on this cohort",
        "Homolog 9.9",
        "parallel analysis",
        "permutations",
        "fingerprint",
    ):
        assert part in words, part
    assert "nan" not in words.lower().split()


def test_every_figure_lies_beside_the_report_as_vector_graphics(report):
    drawn = sorted(path.stem for path in (report.parent / "figures").glob("*.svg"))
    assert {"scree", "scores", "modes", "quality", "energies"} < set(drawn)
    assert drawn == sorted(path.stem for path in (report.parent / "figures").glob("*.pdf"))
    for path in (report.parent / "figures").glob("*.svg"):
        assert ElementTree.parse(path).getroot().tag.endswith("svg")


def test_a_project_without_a_result_has_no_report(tmp_path, capsys):
    project = Project(tmp_path / "empty")
    project.write(ProjectRecord())
    assert main(["report", str(project.folder), "--progress", "none"]) == 2
    assert "has no result yet" in capsys.readouterr().err
