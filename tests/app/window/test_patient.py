"""The Patient page: a reference of the open result, a file that is dropped, and what is seen of it."""

import numpy as np
import pytest
from PySide6.QtCore import QPoint

pytestmark = pytest.mark.window


@pytest.fixture(scope="module")
def made():
    """Return a list for the reference that the first page makes; the other pages take it."""
    return []


@pytest.fixture
def _small_references(small_references):
    with small_references():
        yield


@pytest.fixture
def page(explored, wait, _small_references, made):
    """Return the page with a reference of four ellipsoids, fitted in a thread."""
    explored.commands["explore.patient"].trigger()
    page = explored.inspector.explore.page
    wait(lambda: not page.workspace.session.job.is_busy)
    if made:
        page.set_reference(made[0])
        return page
    page.make.click()
    wait(lambda: page.reference is not None, 300.0)
    made.append(page.reference)
    return page


@pytest.fixture
def patient(page, explored, ellipsoids, wait):
    """Return the page after a file was dropped on the window."""
    explored.drops.take([ellipsoids / "a.nrrd"], QPoint(9, 9))
    wait(lambda: page.comparison is not None and not page.workspace.session.job.is_busy, 300.0)
    return page


def test_controls_are_those_of_the_present_table_though_it_was_not_saved(explored, wait, monkeypatch):
    from homolog.errors import Cancelled

    session, seen = explored.workspace.session, []
    session.select(["a", "b", "c"])
    session.set_group("Healthy")
    explored.commands["explore.patient"].trigger()
    wait(lambda: not session.job.is_busy)

    def make(_project, *, result, **_given):
        seen.append(result.groups)
        raise Cancelled

    monkeypatch.setattr("homolog.patient.make_reference", make)
    explored.inspector.explore.page.make.click()
    wait(lambda: bool(seen) and not session.job.is_busy)
    assert seen[0][:3] == ("Healthy",) * 3


def test_the_group_that_is_called_as_controls_are_is_chosen_first(explored):
    session = explored.workspace.session
    for names, group in ((["a", "b"], "ABC"), (["c", "d"], "Healthy")):
        session.select(names)
        session.set_group(group)
    explored.commands["explore.patient"].trigger()
    box = explored.inspector.explore.page.group
    assert box.currentText() == "Healthy"
    box.setCurrentIndex(0)
    session.set_group("ill")
    assert box.currentText() == "All subjects"


def test_a_dropped_file_is_compared_and_not_added_to_the_study(patient, explored, tmp_path, wait):
    assert len(explored.workspace.session.study.members) == 4
    assert patient.comparison.name == "a"
    assert "limit" in patient.finding.text()
    assert "percentile" in patient.bars.accessibleDescription()
    assert explored.commands["patient.save"].isEnabled()
    patient.write(tmp_path / "report")
    written = tmp_path / "report" / "report.pdf"
    wait(lambda: written.is_file() and not patient.workspace.session.job.is_busy, 300.0)
    patient.save_reference(tmp_path / "ref.npz")
    first = patient.reference
    patient.open_reference(tmp_path / "ref.npz")
    assert patient.reference.fingerprint == first.fingerprint
    assert patient.comparison is None
    assert not explored.commands["patient.save"].isEnabled()


@pytest.fixture
def printed(explored, tmp_path, wait, monkeypatch):
    """Return a function that prints the patient to a file, and returns the number of pages and the file."""
    from PySide6.QtPrintSupport import QPrintDialog

    path, asked = tmp_path / "printed.pdf", []

    def accept(dialog):
        asked.append(dialog.maxPage())
        dialog.printer().setOutputFileName(str(path))
        return QPrintDialog.DialogCode.Accepted

    def print_patient():
        explored.commands["file.print"].trigger()
        wait(lambda: bool(asked) and not explored.workspace.session.job.is_busy, 300.0)
        return asked[-1], path.read_bytes()

    monkeypatch.setattr(QPrintDialog, "exec", accept)
    return print_patient


@pytest.mark.usefixtures("patient")
def test_the_pages_of_the_report_are_printed_on_whole_sheets(printed):
    pages, content = printed()
    assert 2 <= pages <= 3  # with the table of what could be found
    assert content.count(b"/MediaBox") == content.count(b"/Type /Page\n") == pages
    sides = [float(side) for side in content.split(b"/MediaBox [")[1].split(b"]")[0].split()]
    assert sides[2:] == pytest.approx([595.0, 842.0], abs=1.0)  # A4 [points]


def test_a_follow_up_is_printed_after_the_pages_of_the_first_time(patient, printed, ellipsoids, wait):
    patient.further.add_time(ellipsoids / "b.nrrd", repeats=False)
    session = patient.workspace.session
    wait(lambda: patient.further.times.follow_up is not None and not session.job.is_busy, 300.0)
    pages, content = printed()
    assert pages == content.count(b"/Type /Page\n") > 2


def test_the_page_shows_how_far_its_comparison_is_and_the_status_bar_does_elsewhere(
    page, explored, ellipsoids, wait
):
    session = page.workspace.session
    page.compare(ellipsoids / "a.nrrd")
    wait(lambda: session.job.kind == "patient")
    assert not page.progress.isHidden()
    assert explored.status.bar.isHidden()
    session.show_page("Overview")
    assert not explored.status.bar.isHidden()
    explored.commands["run.cancel"].trigger()
    wait(lambda: not session.job.is_busy)
    assert page.progress.isHidden()


def test_notes_of_grooming_are_not_among_the_cautions():
    from types import SimpleNamespace

    from homolog_app.window.explore.patient_page import remark_texts

    comparison = SimpleNamespace(
        remarks=("holes were filled", "age is extrapolated"), cautions=("age is extrapolated",)
    )
    assert remark_texts({"": comparison}) == ("Holes were filled", "Age is extrapolated")
    assert remark_texts({}) == ("", "")


def test_a_region_is_looked_at_on_the_surface_of_the_patient(ball):
    from types import SimpleNamespace

    from scipy.sparse import csr_array, eye_array

    from homolog.patient.own_surface import OwnSurface
    from homolog.surfaces.mesh import TriangleMesh
    from homolog_app.scenes.patient import region_place

    expected = ball
    middle, count = expected.vertices.mean(axis=0), len(expected.vertices)
    mesh = TriangleMesh(middle + 0.98 * (expected.vertices - middle), expected.faces)
    region = SimpleNamespace(vertices=np.array([5, 7]), centre=7)
    for weights in (csr_array(eye_array(count)), csr_array((count, count))):  # without any, the nearest
        own = OwnSurface(mesh, weights)
        comparison = SimpleNamespace(own=own, matched=expected, placement=np.eye(4))
        place, seen_from = region_place(comparison, region)
        np.testing.assert_allclose(place, mesh.vertices[7])
        assert seen_from @ (place - middle) > 0.0


def test_views_show_the_map_and_what_leads_to_it(patient, explored):
    scene = explored.views.stage.scene
    assert [content.name for content in scene.shown] == ["a"]
    explored.commands["view.grid4"].trigger()
    assert [content.name for content in scene.shown] == ["Mean", "Patient", "Expected", "a"]
    explored.commands["view.grid1"].trigger()
    patient.way.setValue(0)
    (shown,) = scene.shown
    there = shown.groomed.placed(shown.alignment).vertices
    np.testing.assert_allclose(there, patient.comparison.mean.vertices, atol=1e-5)
    patient.percent.entered.emit(60.0)
    (shown,) = scene.shown
    own = patient.comparison.mesh
    np.testing.assert_array_equal(shown.groomed.faces, own.faces)
    there = shown.groomed.placed(shown.alignment).vertices
    away = np.linalg.norm(there - own.placed(shown.alignment).vertices, axis=1)
    whole = np.linalg.norm(patient.comparison.matched.vertices - patient.comparison.mean.vertices, axis=1)
    assert away.mean() == pytest.approx(0.4 * whole.mean(), rel=0.1)
    patient.way.setValue(400)
    (shown,) = scene.shown
    np.testing.assert_array_equal(shown.groomed.vertices, own.vertices)
    assert len(shown.colours) == len(shown.groomed.vertices)


def test_differences_within_the_limit_are_called_faint_or_grey_but_not_both(patient):
    from homolog_app.rendering.content import SubjectContents

    subjects = SubjectContents()
    patient.only_beyond.setChecked(False)
    faint = patient.shown(subjects).scale
    assert (faint.note, faint.grey_label) == ("faint within the limit", "")
    patient.only_beyond.setChecked(True)
    grey = patient.shown(subjects).scale
    assert (grey.note, grey.grey_label) == ("", "within the limit of 5 % of healthy subjects")
    patient.only_beyond.setChecked(False)


def test_the_way_leads_mode_by_mode_to_the_patient_and_the_mean_can_lie_over_it(patient, explored):
    scene = explored.views.stage.scene
    patient.path.setCurrentIndex(1)
    patient.path.activated.emit(1)
    notes = []
    for value in (0, 100, 399, 400):
        patient.way.setValue(value)
        (shown,) = scene.shown
        notes.append(shown.note)
    assert notes[0] == "the mean"
    assert "of mode 1" in notes[1]
    assert "outside the modes" in notes[2]
    assert notes[3] == ""
    patient.overlaid.setChecked(True)
    (shown,) = scene.shown
    mean = shown.raw.placed(shown.alignment).vertices
    np.testing.assert_allclose(mean, patient.comparison.mean.vertices, atol=1e-6)
    assert shown.note == "transparent over the mean"


def test_the_nearest_controls_are_named_and_saved_only_if_that_is_wanted(patient, tmp_path):
    from homolog.patient import Reference

    assert patient.nearest.text().count(" SD") == 3
    patient.save_reference(tmp_path / "anonymous.npz")
    assert Reference.load(tmp_path / "anonymous.npz").names == ()
    patient.single.setChecked(True)
    patient.save_reference(tmp_path / "named.npz")
    assert set(Reference.load(tmp_path / "named.npz").names) == {"a", "b", "c", "d"}


def test_slices_show_the_map_and_go_to_a_region_that_is_looked_at(patient, explored):
    explored.commands["view.slice"].trigger()
    slices = explored.views.stage.slices
    (outline,) = slices.sliced.outlines
    assert (slices.name, outline.title) == ("a", "Map")
    assert len(outline.colours) == len(outline.mesh.vertices)
    mesh = patient.comparison.mesh.vertices
    assert np.abs(outline.mesh.vertices.mean(axis=0) - mesh.mean(axis=0)).max() < 1.0
    place = patient.comparison.expected.vertices[3]
    patient.place_wanted.emit("a", place, np.array([0.0, 0.0, 1.0]))
    assert np.linalg.norm(mesh - slices.place, axis=1).min() < 2.0
    assert patient.set_scan("a", tmp := patient.workspace.home / "none.nrrd")
    assert slices.sliced.image == tmp


def test_a_later_time_is_compared_with_the_first_and_a_repeat_tells_the_error(
    patient, explored, ellipsoids, tmp_path, wait
):
    patient.further.add_time(ellipsoids / "b.nrrd", repeats=False)
    wait(
        lambda: patient.further.times.follow_up is not None and not patient.workspace.session.job.is_busy,
        300.0,
    )
    scene = explored.views.stage.scene
    assert [content.name for content in scene.shown] == ["b"]
    assert "No measurement error" in patient.further.change.text()
    patient.further.add_time(ellipsoids / "c.nrrd", repeats=True)
    wait(lambda: len(patient.further.times.repeats) == 1 and not patient.workspace.session.job.is_busy, 300.0)
    follow_up = patient.further.times.follow_up
    (change,) = follow_up.changes
    assert follow_up.repeats == 1
    assert len(patient.places) == len(change.regions)
    patient.map.setCurrentIndex(0)
    patient.map.activated.emit(0)
    assert [content.name for content in scene.shown] == ["a"]
    patient.write(tmp_path / "report")
    wait(lambda: (tmp_path / "report").is_dir() and not patient.workspace.session.job.is_busy, 300.0)
    written = {str(path.relative_to(tmp_path / "report")) for path in (tmp_path / "report").rglob("*.*")}
    assert {"follow_up.pdf", "changes.csv", "a/report.pdf", "b/report.pdf"} <= written


def test_the_patient_is_set_beside_further_groups(patient, tmp_path, wait):
    patient.save_reference(tmp_path / "other.npz")
    patient.further.compare_groups([tmp_path / "other.npz"])
    wait(lambda: patient.further.groups and not patient.workspace.session.job.is_busy, 300.0)
    first, second = patient.further.groups
    assert first[2:5] == pytest.approx(second[2:5])
    assert patient.further.typical.text().count("p = ") == 2
    assert "Not a diagnosis" in patient.further.caution.text()


def test_side_and_flat_ends_are_asked_for_and_given_to_the_comparison(page, ellipsoids, monkeypatch, wait):
    from dataclasses import replace

    from homolog.errors import Cancelled

    given = []

    def compare(_reference, _path, values, cut_off, tick):
        given.append((values, cut_off))
        raise Cancelled

    monkeypatch.setattr("homolog_app.window.explore.patient_page.compared", compare)
    assert page.form.side is None
    page.set_reference(replace(page.reference, provenance=replace(page.reference.provenance, side="right")))
    page.form.side.setCurrentText("left")
    page.form.cut_off.setChecked(True)
    page.compare(ellipsoids / "a.nrrd")
    wait(lambda: bool(given) and not page.workspace.session.job.is_busy)
    assert given == [({"side": "left"}, True)]


def test_a_file_that_is_no_shape_leaves_the_patient_as_it_is(patient, explored, tmp_path, wait):
    (tmp_path / "notes.txt").write_text("nothing")
    before = patient.comparison
    patient.compare(tmp_path / "notes.txt")
    wait(lambda: not patient.workspace.session.job.is_busy)
    assert patient.comparison is before


def test_a_file_dropped_before_there_is_a_reference_says_what_is_missing_and_adds_no_subject(
    explored, ellipsoids
):
    explored.commands["explore.patient"].trigger()
    noticed, session = [], explored.workspace.session
    session.noticed.connect(noticed.append)
    explored.inspector.explore.page.reference = None
    before = session.study
    explored.drops.take([ellipsoids / "a.nrrd"], QPoint(9, 9))
    assert len(noticed) == 1
    assert session.study == before
