"""Several structures of each subject, on the real window."""

import numpy as np
import pytest
from PySide6.QtCore import Qt

from homolog.api.project import Project
from homolog.cohort import read_cohort
from homolog.geometry import fit_similarity, rotation_of
from homolog.io.constraints import cuts_of
from homolog.io.meshes import write_mesh
from homolog.io.project import ProjectFolder
from homolog.run.project_grooming import groom_project
from homolog.settings import OptimizeSettings, RunSettings
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.window.cutting import CutTool
from homolog_app.window.jobs import RunJob

pytestmark = pytest.mark.window


@pytest.fixture(scope="session")
def pairs(tmp_path_factory):
    """Return a folder with two solids a subject, of which one grows, and the other turns and moves."""
    from homolog.samples.solids import ellipsoid, surface_of

    line = np.arange(-1.4, 1.4, 0.1)
    grid = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1)
    ball = surface_of(ellipsoid(grid, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), np.full(3, -1.4), 0.1, 400)
    folder = tmp_path_factory.mktemp("pairs") / "scans"
    for number, name in enumerate("abcd"):
        angle = np.radians(10.0 * (number - 1.5))
        turn = np.array(
            [[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0, 0, 1]]
        )
        (folder / name).mkdir(parents=True)
        write_mesh(folder / name / "long.ply", TriangleMesh(ball.vertices * (9, 6, 6 + number), ball.faces))
        moved = ball.vertices * (3, 6, 5) @ turn.T + (14, 0, 0)
        write_mesh(folder / name / "flat.ply", TriangleMesh(moved, ball.faces))
    return folder


def settings_of(coarse):
    several = coarse.model_copy(update={"structures": "long,flat"})
    brief = OptimizeSettings(particles=16, split_iterations=5, anneal_iterations=20, settle_iterations=20)
    return RunSettings(groom=several, optimize=brief, device="cpu", workers=1)


@pytest.fixture(scope="session")
def joint(pairs, coarse, tmp_path_factory):
    """Return a project of both solids together; not to be written to."""
    project = ProjectFolder(tmp_path_factory.mktemp("joint") / "study")
    RunJob(project, read_cohort(pairs), settings_of(coarse), resume=False).execute()
    return project.folder


@pytest.fixture
def opened(window, joint, wait):
    window.projects.open_paths([joint])
    session = window.workspace.session
    wait(lambda: session.result is not None and session.step == "explore" and not session.job.is_busy)
    return window


def surfaces(window):
    """Return the visible surfaces of the first view."""
    cell = window.views.stage.scene.grid.cells[0]
    return [actor for actor in cell.surface_actors[::2] if actor.GetVisibility()]


def choose(window, aspect, wait):
    box = window.inspector.explore.aspects
    box.setCurrentIndex(box.findData(aspect))
    box.activated.emit(box.currentIndex())
    fitted = window.inspector.explore.fitted
    wait(lambda: fitted.shape is not None and not window.workspace.session.job.is_busy)
    return fitted.shape


def test_structures_are_stated_in_cohort_groomed_together_and_shown_as_layers(
    window, pairs, coarse, wait, errors
):
    window.projects.open_paths([pairs])
    session, picker = window.workspace.session, window.inspector.cohort.labels
    wait(lambda: len(session.surveys) == 4)
    picker.choice.setCurrentIndex(picker.choice.count() - 1)
    picker.choice.activated.emit(picker.choice.currentIndex())
    assert picker.several.text() == "flat,long"
    picker.several.setText("long,flat")
    picker.several.editingFinished.emit()
    picker.align_by.setCurrentText("long")
    picker.align_by.activated.emit(1)
    study = session.study.settings
    assert (study.groom.structures, study.optimize.align_by) == ("long,flat", "long")
    wait(lambda: all(survey.groom.structures == "long,flat" for survey in session.surveys.values()))
    assert list(window.views.stage.layers.rows) == ["long", "flat"]
    assert len(surfaces(window)) == 2

    given = settings_of(coarse)
    groomed, places = groom_project(session.study.cohort, given, window.workspace.project, lambda *_: None)
    assert [len(item.mesh.parts) for item in groomed] == [2] * 4
    assert places.shape == (4, 4, 4)
    assert not errors


def test_a_list_of_one_structure_is_refused_by_a_line(window, pairs, wait):
    window.projects.open_paths([pairs])
    session, picker = window.workspace.session, window.inspector.cohort.labels
    wait(lambda: len(session.surveys) == 4)
    picker.choice.setCurrentIndex(picker.choice.count() - 1)
    picker.choice.activated.emit(picker.choice.currentIndex())
    picker.several.setText("long")
    picker.several.editingFinished.emit()
    assert "two or more structures" in picker.problem.text()
    assert session.study.settings.groom.structures == "flat,long"


def test_a_structure_is_hidden_with_its_particles(opened):
    bar, grid = opened.views.stage.layers, opened.views.stage.scene.grid
    assert list(bar.rows) == ["long", "flat"]
    assert len(surfaces(opened)) == 2
    bar.rows["flat"].shown.click()
    assert len(surfaces(opened)) == 1
    assert not grid.display.layer("flat").shown
    bar.rows["long"].opacity.setValue(40)
    assert surfaces(opened)[0].GetProperty().GetOpacity() == pytest.approx(0.4)
    bar.rows["flat"].shown.click()
    bar.rows["long"].opacity.setValue(100)
    assert len(surfaces(opened)) == 2


def test_modes_of_pose_move_whole_structures_and_those_of_one_show_it_alone(opened, joint, wait):
    opened.commands["explore.modes"].trigger()
    shape = choose(opened, "poses", wait)
    far = shape.mean.moved(shape.mean.vertices + shape.moved(np.array([3.0])))
    for part, before in zip(far.parts, shape.mean.parts, strict=True):
        assert part.volume == pytest.approx(before.volume, rel=1e-4)  # nothing is stretched
    turned = shape.rigid.turns[0, 1] - shape.rigid.turns[0, 0]
    turns = Project(joint).relative_poses("long").rotations[:, 1]
    spread = np.sqrt(turns.var(axis=0, ddof=1).sum())
    assert np.degrees(np.linalg.norm(turned)) == pytest.approx(spread, rel=0.1)

    assert len(choose(opened, "structure:flat", wait).mean.parts) == 1
    assert len(surfaces(opened)) == 1
    opened.commands["explore.check"].trigger()
    assert opened.workspace.session.aspect == "structure:flat"


def test_shapes_without_pose_do_not_turn(opened, wait):
    opened.commands["explore.modes"].trigger()
    shape = choose(opened, "shapes", wait)
    for part in shape.result.parts:
        own = shape.result.world[:, part.particles]
        for subject in own:
            assert rotation_of(fit_similarity(own.mean(axis=0), subject, scaling=False)) == pytest.approx(
                np.eye(3), abs=1e-4
            )
    opened.commands["explore.groups"].trigger()
    assert opened.workspace.session.aspect == ""  # other pages compare what lies in the body


def test_volumes_and_distances_of_structures_are_measured(opened, wait, tmp_path):
    opened.commands["explore.measure"].trigger()
    page = opened.inspector.explore.page
    wait(lambda: page.table.rowCount() == 4)
    along = Qt.Orientation.Horizontal
    heads = [page.table.headerData(n, along) for n in range(page.table.columnCount())]
    assert heads[-3:] == ["long\n(ml)", "flat\n(ml)", "long–flat\n(mm)"]
    page.write(tmp_path / "measures.csv")
    rows = np.genfromtxt(tmp_path / "measures.csv", delimiter=",", names=True)
    assert rows["volume_long_ml"][3] > 1.3 * rows["volume_long_ml"][0]
    assert rows["distance_long_flat_mm"] == pytest.approx([2.0] * 4, abs=0.6)
    assert list(page.charts.structures) == ["volume_long_ml", "volume_flat_ml", "distance_long_flat_mm"]


def test_a_patient_has_all_structures_as_they_lie(opened, small_references, pairs, wait, tmp_path):
    session = opened.workspace.session
    opened.commands["explore.patient"].trigger()
    page = opened.inspector.explore.page
    with small_references():
        wait(lambda: not session.job.is_busy)
        page.make.click()
        wait(lambda: page.reference is not None, 300.0)
    page.compare(pairs / "d")
    wait(lambda: page.comparison is not None and not session.job.is_busy, 300.0)
    names = list(page.comparison.structures)
    assert [page.structure.itemText(row) for row in range(3)] == ["All structures", *names]
    (shape,) = page.shown(opened.views.subjects).contents
    assert list(shape.structures) == names
    assert len(shape.groomed.parts) == len(names)
    (pose,) = page.comparison.poses
    way = page.way
    way.setValue(0)
    (mean,) = page.shown(opened.views.subjects).contents
    expected = mean.raw or mean.groomed
    moved = shape.groomed.parts[1].vertices.mean(axis=0) - expected.parts[1].vertices.mean(axis=0)
    assert np.linalg.norm(moved) == pytest.approx(pose.distance, rel=0.2)
    page.structure.setCurrentIndex(2)
    page.structure.activated.emit(2)
    (alone,) = page.shown(opened.views.subjects).contents
    assert not alone.structures
    page.write(tmp_path / "report")
    wait(lambda: not session.job.is_busy, 300.0)
    written = {path.name for path in (tmp_path / "report").iterdir()}
    assert written == {"report.html", "report.pdf", "pose.csv", *names}


def test_a_structure_is_cut_and_carried_and_the_other_stays_whole(window, pairs, coarse, wait):
    session, commands = window.workspace.session, window.commands
    window.projects.open_paths([pairs])
    window.workspace.edit_settings("groom", "structures", settings_of(coarse).groom)
    wait(
        lambda: len(session.surveys) == 4 and all(item.groom.structures for item in session.surveys.values())
    )
    commands["run.groom"].trigger()
    wait(lambda: session.is_groomed and not session.job.is_busy, 300.0)
    session.show_step("groom")
    session.select(["a"])
    box, names = window.inspector.groom.cuts, list(session.cut_structures)
    box.structure.setCurrentIndex(1)
    box.tools["plane"].click()
    subject = next(item for item in session.study.included if item.name == "a")
    assert [key for key, text in subject.columns.items() if text] == [f"cut:{names[1]}"]
    assert cuts_of(subject, names[0]) == ()
    shown = next(item for item in window.views.stage.scene.shown if item.name == "a")
    whole = session.groomed["a"].subject.mesh
    assert shown.faded
    assert shown.groomed.parts[0].area == pytest.approx(whole.parts[0].area)
    assert shown.groomed.parts[1].area == pytest.approx(0.5 * whole.parts[1].area, rel=0.1)
    assert not session.is_groomed
    assert window.views.stage.scene.findChild(CutTool).handle.widget.GetEnabled()
    commands["edit.carry"].trigger()
    wait(lambda: not session.job.is_busy, 300.0)
    assert all(len(cuts_of(item, names[1])) == 1 for item in session.study.included)
    session.undo.undo()
    session.undo.undo()
    assert session.is_groomed
