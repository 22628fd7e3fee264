"""Texts that would be code elsewhere, archives that would be endless, links that lead elsewhere."""

import csv
import io
import time
import zipfile
from html.parser import HTMLParser

import numpy as np
import pytest
from harness import SLOWEST_S, watched
from matplotlib.figure import Figure
from targets import good_project, good_xlsx, octahedron

from homolog.cohort import Cohort, Subject
from homolog.errors import InputError
from homolog.io.markups import write_markups
from homolog.io.project import ProjectFolder
from homolog.io.tables import write_table
from homolog.run.import_model import import_model
from homolog_app.report.figures import ReportFigure
from homolog_app.report.page import Page
from homolog_app.report.write import write_report

EVIL = "<script>alert('x')</script>\" onload='x' <img src=x onerror=alert(1)> & ../../evil"


class Seen(HTMLParser):
    """What a browser would see."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.attributes, self.text = set(), set(), ""
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.attributes |= {name for name, _ in attrs}

    def handle_data(self, data):
        self.text += data


def test_a_page_shows_every_text_as_it_is_and_runs_none():
    page = Page(f"title {EVIL}", f"notice {EVIL}")
    page.heading(f"heading {EVIL}")
    page.paragraph(f"paragraph {EVIL}")
    page.caution(f"caution {EVIL}")
    page.points([(f"point {EVIL}", f"rest {EVIL}")])
    page.table([f"column {EVIL}"], [[f"cell {EVIL}"]], summary=f"summary {EVIL}")
    page.figures([ReportFigure("name", Figure(), f"caption {EVIL}")])
    page.links([f"figures/{EVIL}.svg"], f"links {EVIL}")
    seen = Seen(page.html)
    assert "script" not in seen.tags
    assert not {attribute for attribute in seen.attributes if attribute.startswith("on")}
    places = ("title", "notice", "heading", "paragraph", "caution", "point", "rest", "column", "cell")
    for place in (*places, "summary", "links", "caption"):
        assert f"{place} {EVIL}" in seen.text


def test_a_report_about_hostile_names_runs_none_and_stays_in_its_project(tmp_path):
    good_project(tmp_path)
    project = ProjectFolder(tmp_path / "project")
    write_report(project)  # unwatched: on a bare machine the first pictures compile kernels into a cache
    record = project.read()
    evil = {"name": EVIL, "group": EVIL[:25], "columns": {EVIL: EVIL}, "notes": [EVIL]}
    subjects = [record.result.subjects[0].model_copy(update=evil), *record.result.subjects[1:]]
    changes = {"subjects": subjects, "source": EVIL, "device": EVIL, "versions": {EVIL: EVIL}}
    project.write(record.model_copy(update={"result": record.result.model_copy(update=changes)}))
    with watched(project.folder) as done:
        path = write_report(project)
    assert [item for item in done if "matplotlib" not in item] == []
    seen = Seen(path.read_text(encoding="utf-8"))
    assert "script" not in seen.tags
    assert not {attribute for attribute in seen.attributes if attribute.startswith("on")}
    assert EVIL in seen.text


def test_landmarks_with_hostile_names_run_nothing_in_a_report(tmp_path):
    good_project(tmp_path)
    project = ProjectFolder(tmp_path / "project")
    points = octahedron().vertices @ np.diag([9.0, 7.0, 5.0])
    record = project.read()
    subjects = []
    for number, subject in enumerate(record.subjects):
        write_markups(tmp_path / f"{number}.mrk.json", points[:2] * 1.01, [EVIL, f"other {EVIL}"], title=EVIL)
        subjects.append(subject.model_copy(update={"landmarks": f"../{number}.mrk.json"}))
    project.write(record.model_copy(update={"subjects": subjects}))
    seen = Seen(write_report(project).read_text(encoding="utf-8"))
    assert "script" not in seen.tags
    assert not {attribute for attribute in seen.attributes if attribute.startswith("on")}
    assert EVIL in seen.text


def test_tables_keep_hostile_names_in_their_cells(tmp_path):
    write_table(tmp_path / "a.csv", ["name", EVIL], [['a","b\n', EVIL]])
    with (tmp_path / "a.csv").open(newline="") as stream:
        assert list(csv.reader(stream)) == [["name", EVIL], ['a","b\n', EVIL]]


def test_markups_keep_hostile_names_in_their_texts(tmp_path):
    write_markups(tmp_path / "a.mrk.json", np.zeros((1, 3)), [EVIL], title=EVIL)
    assert (tmp_path / "a.mrk.json").read_text().count("controlPoints") == 1


@pytest.mark.parametrize(
    "name", ["/etc/evil", "../../evil", "a/../../evil", "~/evil", "C:\\evil", ".hidden", "con"]
)
def test_an_import_writes_into_its_project_whatever_subjects_are_called(tmp_path, name):
    from targets import good_swproj

    good_swproj(tmp_path)
    file = tmp_path / "a.swproj"
    file.write_text(file.read_text().replace('"name": "a"', f'"name": {name!r}'.replace("'", '"')))
    with watched(tmp_path / "project") as done:
        import_model(file, ProjectFolder(tmp_path / "project"))
    assert done == []
    assert len(list((tmp_path / "project" / "particles").iterdir())) == 6


def test_a_manifest_may_point_anywhere_but_is_described_from_the_project(tmp_path):
    project = ProjectFolder(tmp_path / "project")
    cohort = Cohort((Subject("a", tmp_path / ".." / "scans" / "a.nrrd"),), tmp_path)
    assert project.describe(cohort)[0].path == "../../scans/a.nrrd"


def test_a_workbook_that_claims_a_million_columns_is_read_or_refused_at_once(tmp_path):
    good_xlsx(tmp_path)
    bloated = io.BytesIO()
    with zipfile.ZipFile(tmp_path / "a.xlsx") as source, zipfile.ZipFile(bloated, "w") as target:
        for item in source.infolist():
            data = source.read(item)
            if item.filename.endswith("sheet1.xml"):
                assert b'<dimension ref="' in data
                start = data.index(b'<dimension ref="') + 16
                data = data[:start] + b"A1:XFD1048576" + data[data.index(b'"', start) :]
                data = data.replace(b"</sheetData>", b'<row r="90000"><c r="XFD90000"/></row></sheetData>')
            target.writestr(item, data)
    (tmp_path / "a.xlsx").write_bytes(bloated.getvalue())
    began = time.process_time()
    import_model(tmp_path / "a.xlsx", ProjectFolder(tmp_path / "project"))
    assert time.process_time() - began < SLOWEST_S


def test_a_workbook_that_unpacks_without_end_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("homolog.spreadsheets.LARGEST_UNPACKED", 2**20)
    with zipfile.ZipFile(tmp_path / "a.xlsx", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("xl/workbook.xml", bytes(2**21))
    with pytest.raises(InputError, match="too large"):
        import_model(tmp_path / "a.xlsx", ProjectFolder(tmp_path / "project"))
