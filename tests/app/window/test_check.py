"""The Check page: suspects, looking into them, and particles optimized again."""

import json
import shutil

import numpy as np
import pytest
from PySide6.QtCore import QPointF

pytestmark = pytest.mark.window

PAIR = [5, 20]
SUBJECT = 2


@pytest.fixture(scope="session")
def converged(ellipsoids, groomed_cache, coarse, tmp_path_factory):
    """Return a project whose particles are in place; not to be written to."""
    from homolog.cohort import read_cohort
    from homolog.io.project import ProjectFolder
    from homolog.settings import OptimizeSettings, RunSettings
    from homolog_app.window.jobs import RunJob

    project = ProjectFolder(tmp_path_factory.mktemp("converged") / "study")
    shutil.copytree(groomed_cache, project.groomed)
    settings = RunSettings(
        groom=coarse,
        optimize=OptimizeSettings(
            particles=64, split_iterations=10, anneal_iterations=60, settle_iterations=40
        ),
    )
    RunJob(project, read_cohort(ellipsoids), settings, resume=False).execute()
    return project.folder


@pytest.fixture
def swapped(converged, tmp_path):
    """Return a copy of the project in which two particles of one subject are exchanged."""
    from homolog.io.particles import write_particles
    from homolog.io.project import ProjectFolder
    from homolog.io.results import particle_file, read_result

    folder = tmp_path / "swapped"
    shutil.copytree(converged, folder)
    project = ProjectFolder(folder)
    result, record = read_result(project), project.read().result
    for frame, points in (("local", result.local), ("world", result.world)):
        changed = points[SUBJECT].copy()
        changed[PAIR] = points[SUBJECT][PAIR[::-1]]
        write_particles(particle_file(project, record.subjects[SUBJECT].file, frame), changed)
    return folder


@pytest.fixture
def opened(window, swapped, errors, wait):
    """Return the window with that project open at the Check page, suspects found."""
    window.projects.open_paths([swapped])
    wait(lambda: window.workspace.session.result is not None and window.workspace.session.step == "explore")
    window.commands["explore.check"].trigger()
    wait(lambda: page_of(window).checked.inspection is not None and not window.workspace.session.job.is_busy)
    assert not errors
    return window


@pytest.fixture
def checking(opened):
    """Return the window with whole shapes and no suspect chosen."""
    page_of(opened).table.clearSelection()
    opened.commands["view.reset"].trigger()
    return opened


def page_of(window):
    from homolog_app.window.explore.check_page import CheckPage

    return window.inspector.explore.page_of(CheckPage)


def settled(window, wait):
    wait(lambda: not window.workspace.session.job.is_busy)


def show(window, wait, what):
    look = page_of(window).look
    look.show_what.setCurrentIndex(look.show_what.findData(what))
    settled(window, wait)


def test_a_planted_swap_heads_the_list_and_is_mended_undone_and_kept(
    checking, swapped, converged, errors, wait, monkeypatch
):
    from homolog.io.project import ProjectFolder
    from homolog.io.results import read_result

    page, session = page_of(checking), checking.workspace.session
    first = page.rows.suspects[0]
    assert (first.subject, set(first.particles)) == (SUBJECT, set(PAIR))
    checking.commands["check.next"].trigger()
    assert session.selection == (session.result.result.names[SUBJECT],)
    before, on_disk = session.result, (swapped / "model" / "scores.csv").read_bytes()

    with monkeypatch.context() as patch:  # a repair that finds nothing better keeps the particles
        patch.setattr("homolog.run.repair.repair_result", lambda _, local, *others: local)
        checking.commands["check.mend"].trigger()
        wait(lambda: "previous places" in page.message.text())
        settled(checking, wait)
    assert session.result is before
    assert not checking.workspace.is_changed

    checking.commands["check.mend"].trigger()
    wait(lambda: session.result is not before)
    settled(checking, wait)
    assert not any(
        suspect.subject == SUBJECT and set(PAIR) & set(suspect.particles) for suspect in page.rows.suspects
    )
    true = read_result(ProjectFolder(converged)).local[SUBJECT]
    spacing = page.checked.inspection.located.spacing[SUBJECT]
    assert np.linalg.norm(session.result.result.local[SUBJECT] - true, axis=1)[PAIR].max() < 0.5 * spacing
    assert (swapped / "model" / "scores.csv").read_bytes() == on_disk
    assert page.keep.isVisible()

    checking.commands["edit.undo"].trigger()
    assert session.result is before
    assert not checking.workspace.is_changed  # nothing is left to be saved
    assert set(page.rows.suspects[0].particles) == set(PAIR)
    checking.commands["edit.redo"].trigger()

    checking.commands["file.save"].trigger()
    wait(lambda: page.checked.is_written)
    settled(checking, wait)
    kept = read_result(ProjectFolder(swapped))
    np.testing.assert_array_equal(kept.local, session.result.result.local)
    assert (swapped / "model" / "scores.csv").read_bytes() != on_disk
    assert "optimized again" in ProjectFolder(swapped).read().result.subjects[SUBJECT].notes[-1]
    assert not page.keep.isVisible()
    assert not errors


def test_the_page_opens_on_the_most_severe_suspect(opened):
    page, scene = page_of(opened), opened.views.stage.scene
    worst = page.checked.inspection.suspects[0]
    assert worst.description in page.message.text()
    centre = scene.grid.cameras.each[0].GetFocalPoint()
    assert np.linalg.norm(worst.place - centre) < 0.1 * np.ptp(scene.grid.cells[0].vertices, axis=0).max()


def test_a_suspect_is_chosen_by_a_click_and_not_by_the_keyboard_that_comes_to_the_table(checking, wait):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    page, places = page_of(checking), []
    page.message.clear()
    page.place_wanted.connect(lambda *place: places.append(place))
    checking.activateWindow()
    page.table.setFocus()
    wait(page.table.hasFocus)
    assert (page.message.text(), places) == ("", [])
    at = page.table.visualRect(page.table.model().index(0, 0)).center()
    for _ in range(2):  # the second double click goes back to the place
        QTest.mouseClick(page.table.viewport(), Qt.MouseButton.LeftButton, pos=at)
        QTest.mouseDClick(page.table.viewport(), Qt.MouseButton.LeftButton, pos=at)
    assert "exchanged" in page.message.text()
    assert len(places) == 3


def test_all_suspects_are_optimized_again_in_one_step_that_can_be_undone(checking, errors, wait):
    page, session = page_of(checking), checking.workspace.session
    before, count = session.result, len(page.rows.suspects)
    checking.commands["check.mend_all"].trigger()
    wait(lambda: session.result is not before)
    settled(checking, wait)
    assert not any(
        suspect.subject == SUBJECT and set(PAIR) & set(suspect.particles) for suspect in page.rows.suspects
    )
    if count > 1:
        assert f"{len(page.rows.suspects)} are left" in page.message.text()
    checking.commands["edit.undo"].trigger()
    assert session.result is before
    assert not errors


def test_the_close_up_on_a_suspect_stays_when_something_else_is_shown_or_undone(checking, errors, wait):
    page, session, scene = page_of(checking), checking.workspace.session, checking.views.stage.scene
    checking.commands["check.next"].trigger()
    camera = scene.canvas.cameras[0]
    page.look.show_what.setCurrentIndex(page.look.show_what.findData("distances"))
    wait(lambda: page.look.marks.distances is not None and not checking.workspace.session.job.is_busy)
    assert scene.canvas.cameras[0] == camera
    page.look.show_what.setCurrentIndex(page.look.show_what.findData("places"))
    assert scene.canvas.cameras[0] == camera
    before = session.result
    checking.commands["check.mend"].trigger()
    wait(lambda: session.result is not before)
    settled(checking, wait)
    camera = scene.canvas.cameras[0]
    checking.commands["edit.undo"].trigger()
    assert scene.canvas.cameras[0] == camera
    assert not errors


def test_a_result_is_inspected_only_when_the_page_is_seen(window, swapped, wait):
    session = window.workspace.session
    window.projects.open_paths([swapped])
    wait(lambda: session.result is not None and not session.job.is_busy)
    session.show_step("cohort")
    session.show_page("Check")  # as a project opens that was closed so
    assert not session.job.is_busy
    session.show_step("explore")
    assert session.job.is_busy
    wait(lambda: page_of(window).checked.inspection is not None and not session.job.is_busy)


def test_the_close_up_ends_with_the_page(checking):
    scene, session = checking.views.stage.scene, checking.workspace.session
    checking.commands["check.next"].trigger()
    assert scene.fitted != scene.looks
    session.show_page("Overview")
    assert scene.fitted == scene.looks
    scene.go_to(scene.shown[0].name, np.zeros(3), np.array([0.0, 0.0, 1.0]))
    assert scene.fitted != scene.looks
    session.show_step("cohort")
    assert scene.fitted == scene.looks


def test_particles_that_could_not_be_written_count_as_unsaved(checking, monkeypatch, errors, wait):
    from homolog.errors import InputError

    def fails(*_):
        raise InputError("the disk is full")

    session = checking.workspace.session
    before = session.result
    checking.commands["check.next"].trigger()
    checking.commands["check.mend"].trigger()
    wait(lambda: session.result is not before)
    settled(checking, wait)
    monkeypatch.setattr("homolog.run.result.write_table", fails)
    checking.commands["file.save"].trigger()
    assert checking.workspace.is_changed  # a window that is closed now would still be asked
    wait(lambda: errors)
    settled(checking, wait)
    assert "disk is full" in str(errors[0][1])
    assert checking.workspace.is_changed
    assert page_of(checking).keep.isVisible()


def test_cancelling_the_search_leaves_it_to_be_asked_for_again(window, swapped, errors, wait):
    window.projects.open_paths([swapped])
    wait(lambda: window.workspace.session.result is not None and window.workspace.session.step == "explore")
    settled(window, wait)
    window.commands["explore.check"].trigger()
    page = page_of(window)
    wait(lambda: window.workspace.session.job.kind == "check")
    window.commands["run.cancel"].trigger()
    settled(window, wait)
    if page.checked.inspection is None:
        assert page.again.isVisible()
        page.again.click()
    wait(lambda: page.checked.inspection is not None)
    assert not errors


@pytest.mark.parametrize("count", [0, 1, None])
def test_the_scheme_can_change_whatever_number_of_suspects_is_listed(checking, count):
    page = page_of(checking)
    page.rows.show_suspects(page.rows.suspects[:count], ["a", "b", "c", "d"])
    for scheme in ("dark", "light"):
        checking.workspace.theme.choose(scheme)  # what Qt warns of would fail the test


def test_a_clicked_particle_is_ringed_on_every_shape_with_its_normals(checking, wait):
    page, scene = page_of(checking), checking.views.stage.scene
    checking.commands["view.front"].trigger()
    scene.picture()
    world = checking.workspace.session.result.result.world
    nearest = int(world[0][:, 1].argmin())
    renderer = scene.grid.cells[0].renderer
    renderer.SetWorldPoint(*world[0][nearest], 1.0)
    renderer.WorldToDisplay()
    x, y, _ = renderer.GetDisplayPoint()
    ratio = scene.devicePixelRatioF()
    scene.picker.pick_at(QPointF(x / ratio, scene.plot.height() - 1 - y / ratio))
    assert page.look.chosen == nearest
    for m, content in enumerate(scene.shown):
        middle = content.lines.reshape(-1, 3).mean(axis=0)
        assert np.linalg.norm(middle - world[m][nearest]) < 1.0
    assert f"particle {nearest}" in page.sphere.accessibleDescription()
    np.testing.assert_allclose(np.linalg.norm(page.sphere.points, axis=1), 1.0, atol=1e-6)


def test_both_particles_of_an_exchange_have_their_colour_and_number_on_every_shape(checking):
    page, scene = page_of(checking), checking.views.stage.scene
    checking.commands["check.next"].trigger()
    first, second = page.rows.suspects[0].particles
    tints = scene.shown_now.tints
    for content in scene.shown:
        tint = tints[content.name]
        assert len({tuple(tint[first]), tuple(tint[second]), tuple(np.delete(tint, PAIR, axis=0)[0])}) == 3
        assert content.numbers.values.tolist() == [first, second]
        np.testing.assert_array_equal(content.numbers.colours, tint[[first, second]])
        assert len(content.lines) == 2 * 28


def test_of_many_particles_of_a_suspect_only_the_chosen_one_has_its_number(checking):
    from homolog_app.scenes.check import Marks, checked_scene

    page, shown = page_of(checking), checking.views.subjects
    inspection, names = page.checked.inspection, [content.name for content in shown]
    many, few = (
        checked_scene(shown, inspection, names, Marks("located", 3, 0, np.arange(count))) for count in (9, 8)
    )
    assert many.contents[0].numbers.values.tolist() == [3]
    assert len(many.contents[0].lines) == 9 * 28
    assert sorted(few.contents[0].numbers.values) == list(range(8))


def test_neighbours_are_coloured_by_the_distances_of_their_own_shape(checking, wait):
    page, scene = page_of(checking), checking.views.stage.scene
    page.look.particle.setValue(7)
    show(checking, wait, "neighbours")
    names = checking.workspace.session.result.result.names
    places = page.checked.inspection.located
    for m, name in enumerate(names[:4]):
        tints = scene.grid.tints[name]
        near = places.distances[m][[7]].toarray()[0] > 0.0
        assert (tints[~near][np.arange(len(tints))[~near] != 7] == 168).all()
        assert (tints[near] != 168).any(axis=1).all()
    assert scene.bar.scale.unit == "mm"
    reach = max(d[[7]].max() * s for d, s in zip(places.distances, places.spacing, strict=True))
    assert reach <= scene.bar.scale.high * (1 + 1e-6) < 1.35 * reach


def test_distances_along_the_surface_stand_beside_straight_ones_on_one_scale(checking, wait):
    page, scene = page_of(checking), checking.views.stage.scene
    page.look.particle.setValue(7)
    show(checking, wait, "distances")
    wait(lambda: page.look.marks.distances is not None)
    distances = page.look.marks.distances
    assert [content.name.split(": ")[1] for content in scene.shown] == ["along the surface", "straight"]
    assert (distances.along >= distances.straight - 1e-3).all()
    assert distances.along.max() <= scene.bar.scale.high < 1.35 * distances.along.max()
    # another place is picked on the surface
    from homolog_app.window.scene import Pick

    place = page.checked.inspection.located.world[0, 30]
    page.handle_pick(Pick(scene.shown[1].name, place, None))
    settled(checking, wait)
    again = page.look.marks.distances
    np.testing.assert_array_equal(again.place, place)
    assert again.along.min() < 1.0


def test_the_last_of_several_places_clicked_in_a_row_is_the_one_that_is_measured(checking, wait):
    from homolog_app.window.scene import Pick

    page, names = page_of(checking), checking.workspace.session.result.result.names
    world = page.checked.inspection.located.world
    page.look.show_what.setCurrentIndex(page.look.show_what.findData("distances"))
    for m, particle in ((0, 3), (1, 30), (2, 50)):
        page.handle_pick(Pick(names[m], world[m, particle], particle))
    wait(lambda: page.look.marks.distances is not None)
    assert page.look.marks.distances.subject == 2
    np.testing.assert_array_equal(page.look.marks.distances.place, world[2, 50])


def test_each_part_of_the_energy_colours_the_particles(checking, wait):
    page, scene = page_of(checking), checking.views.stage.scene
    names = checking.workspace.session.result.result.names
    for part in ("sampling", "ensemble", "normals"):
        show(checking, wait, part)
        wait(lambda: page.look.marks.energies is not None)
        assert scene.bar.scale.title.lower().startswith(part)
        values = getattr(page.look.marks.energies, part)
        m, worst = np.unravel_index(values.argmax(), values.shape)
        assert tuple(scene.grid.tints[names[m]][worst]) == tuple(scene.bar.scale.table[-1])


def test_a_pattern_has_the_same_share_of_each_tone_on_all_shapes(checking, wait):
    page, scene = page_of(checking), checking.views.stage.scene
    for pattern in ("checkerboard", "stripes"):
        show(checking, wait, pattern)
        wait(lambda: page.look.marks.texture is not None)
        shares = [
            float(content.colours.astype(float).mean(axis=0)[0] - 38) / (236 - 38) for content in scene.shown
        ]
        assert all(0.3 < item < 0.7 for item in shares)
        assert max(shares) - min(shares) < 0.08


def test_the_window_and_the_command_line_write_the_same_list(checking, swapped, tmp_path):
    from homolog_app.cli import main

    for kind in ("csv", "json"):
        own, other = tmp_path / f"window.{kind}", tmp_path / f"line.{kind}"
        page_of(checking).checked.export(own)
        assert main(["check", str(swapped), "--out", str(other), "--progress", "none"]) == 0
        assert own.read_bytes() == other.read_bytes()
    assert json.loads(own.read_text())[0]["kind"] == "exchanged particles"


def test_two_subjects_are_told_to_be_too_few(explored, errors, wait):
    from dataclasses import replace

    session = explored.workspace.session
    settled(explored, wait)
    two = session.result.result
    kept = {name: session.result.surfaces[name] for name in two.names[:2]}
    result = replace(
        two,
        names=two.names[:2],
        groups=two.groups[:2],
        columns=two.columns[:2],
        local=two.local[:2],
        world=two.world[:2],
        alignments=two.alignments[:2],
    )
    session.result = replace(session.result, result=result, surfaces=kept)
    session.result_changed.emit()
    explored.commands["explore.check"].trigger()
    settled(explored, wait)
    assert "three or more" in page_of(explored).state.text()
    assert not errors


def test_a_texture_has_pages_of_subjects_and_no_playback_of_the_run(checking, wait):
    look, footer = page_of(checking).look, checking.views.stage.footer
    checking.commands["view.grid1"].trigger()
    look.show_what.setCurrentIndex(0)
    footer.show_frames(5)
    wait(footer.play.isVisible)
    look.show_what.setCurrentIndex(look.show_what.findData("stripes"))
    settled(checking, wait)
    wait(lambda: not footer.play.isVisible())
    assert footer.isVisible()
    name = checking.views.stage.scene.shown[0].name
    checking.commands["view.next"].trigger()
    assert checking.views.stage.scene.shown[0].name != name
    look.show_what.setCurrentIndex(0)
    wait(footer.play.isVisible)


def test_a_close_up_has_the_whole_shape_in_a_corner(checking, wait):
    scene = checking.views.stage.scene
    cells = scene.grid.cells

    def overviews():
        scene.plot.repaint()
        return [cell.overview.shown for cell in cells[: scene.grid.count]]

    wait(lambda: not any(overviews()))
    checking.commands["check.next"].trigger()
    settled(checking, wait)
    for camera in scene.grid.cameras.each:  # seen from an end, the whole shape may fit
        camera.SetParallelScale(0.4 * camera.GetParallelScale())
    wait(lambda: all(overviews()))
    checking.commands["view.reset"].trigger()
    wait(lambda: not any(overviews()))


def test_a_wall_in_front_of_a_close_up_is_cut_away_until_the_whole_shapes_are_shown(checking):
    scene, names = checking.views.stage.scene, [content.name for content in checking.views.subjects]
    mesh = scene.grid.cells[0].content.groomed.placed(scene.grid.cells[0].content.alignment)
    vertex = int(mesh.vertices[:, 2].argmax())
    place, normal = mesh.vertices[vertex], mesh.vertex_normals[vertex]
    scene.go_to(names[0], place, normal)
    assert scene.canvas.clip is None
    scene.go_to(names[0], place, -normal)  # as of a place on the inner wall of a hollow organ
    kept, origin = scene.canvas.clip.cut(scene.grid.bounds, normal)
    depths = (np.array([place, mesh.vertices[int(mesh.vertices[:, 2].argmin())]]) - origin) @ kept
    assert depths[0] == pytest.approx(-depths[1], rel=0.2)  # midway, so that it grazes neither wall
    scene.fit()
    assert scene.canvas.clip is None
