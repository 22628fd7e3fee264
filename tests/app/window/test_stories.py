"""What a user does, on the real window."""

import shutil
from itertools import pairwise

import numpy as np
import pytest
from PySide6.QtCore import Qt

from homolog.cohort import Subject
from homolog.settings import OptimizeSettings
from homolog_app.window.start_page import BEANS, HEARTS, stops_for
from homolog_app.window.study import Member, Study

pytestmark = [pytest.mark.window, pytest.mark.own_window]


def test_a_dropped_folder_becomes_particles_that_are_saved_and_found_again(
    groomed, make_window, close, errors, wait, tmp_path
):
    groomed.commands["run.start"].trigger()
    wait(lambda: not groomed.workspace.session.job.is_busy)
    assert not errors
    before = groomed.workspace.session.result.result
    assert before.world.shape == (4, 32, 3)
    groomed.workspace.session.show_step("explore")
    groomed.projects.save_to(tmp_path / "study")
    close(groomed)

    again = make_window()
    again.projects.open_paths([tmp_path / "study"])
    wait(lambda: again.workspace.session.result is not None)
    after = again.workspace.session.result
    assert after.result.names == before.names
    np.testing.assert_array_equal(after.result.world, before.world)
    assert len(after.frames) > 1
    assert again.workspace.session.step == "explore"


def test_the_previous_result_stays_when_the_next_run_is_cancelled(explored, errors, wait):
    session, work = explored.workspace.session, explored.workspace.work
    result = session.result
    wait(lambda: len(session.surveys) == 4)
    explored.commands["run.groom"].trigger()
    wait(lambda: not work.session.job.is_busy)
    explored.workspace.edit_settings("optimize", "particles", OptimizeSettings(particles=128))
    explored.commands["run.start"].trigger()
    wait(lambda: work.session.job.run is not None and work.session.job.run.frame is not None)
    explored.commands["run.cancel"].trigger()
    wait(lambda: not work.session.job.is_busy)
    assert session.result is result
    assert not errors


def test_the_particles_of_a_cancelled_run_can_be_kept(groomed, errors, wait):
    work = groomed.workspace.work
    groomed.workspace.edit_settings("optimize", "particles", OptimizeSettings(particles=128))
    groomed.commands["run.start"].trigger()
    wait(lambda: (job := work.session.job.run) and job.frame)
    changes, steps = [work.session.preliminary], []
    work.session.job_changed.connect(lambda: changes.append(work.session.preliminary))
    work.session.job_progressed.connect(lambda: steps.append(work.session.job.status.fraction))
    wait(lambda: (job := work.session.job.run) and job.frame.world.shape[1] >= 16 and len(steps) > 2)
    assert steps == sorted(steps)
    # Pages are refreshed for a new preliminary model, and not while a run goes on as before.
    assert all(new is not before for before, new in pairwise(changes))
    groomed.commands["run.cancel"].trigger()
    wait(lambda: not work.session.job.is_busy)
    assert groomed.workspace.session.result is None
    groomed.commands["run.keep"].trigger()
    wait(lambda: not work.session.job.is_busy)
    assert groomed.workspace.session.result.result.world.shape[1] >= 16
    assert not errors


def test_the_finished_run_can_be_played_from_its_first_moment(explored, errors, wait):
    time = explored.views.stage.footer.time
    assert explored.commands["run.play"].isEnabled()
    explored.commands["run.play"].trigger()
    seen = []
    time.valueChanged.connect(seen.append)
    wait(lambda: time.value() == time.maximum())
    assert seen == list(range(1, time.maximum() + 1))
    assert not errors


def test_twenty_good_files_load_and_five_bad_ones_are_listed_with_their_reason(
    window, ellipsoids, tmp_path, wait
):
    import SimpleITK

    folder = tmp_path / "mixed"
    folder.mkdir()
    for number in range(5):
        for good in ellipsoids.iterdir():
            (folder / f"good_{number}_{good.name}").write_bytes(good.read_bytes())
    whole = (ellipsoids / "a.nrrd").read_bytes()
    (folder / "bad_cut.nrrd").write_bytes(whole[: len(whole) // 2])
    (folder / "bad_empty.nrrd").write_bytes(b"")
    (folder / "bad_text.nii.gz").write_bytes(b"no image at all")
    (folder / "bad_open.stl").write_text("solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\n")
    blank = SimpleITK.GetImageFromArray(np.zeros((8, 8, 8), np.uint8))
    SimpleITK.WriteImage(blank, folder / "bad_blank.mha")
    window.projects.open_paths([folder])
    session = window.workspace.session
    wait(lambda: len(session.surveys) == 25)
    assert len(session.study.included) == 20
    panel = window.inspector.cohort
    assert panel.problems.text().startswith("5 files excluded.")
    rows = {panel.rows.index(row, 0).data(): row for row in range(panel.rows.rowCount())}
    for name in ("bad_cut", "bad_empty", "bad_text", "bad_open", "bad_blank"):
        reason = session.surveys[name].problem
        shown = [panel.rows.index(rows[name], k) for k in range(panel.rows.columnCount())]
        assert reason
        assert any(reason in str(item.data(Qt.ItemDataRole.ToolTipRole)) for item in shown)


@pytest.mark.parametrize(
    ("sample", "pages"),
    [("file.sample", ["Overview"]), ("file.sample_hearts", ["Modes", "Groups"])],
    ids=["beans", "hearts"],
)
def test_a_tour_leads_from_the_sample_to_a_result(
    window, monkeypatch, errors, wait, ellipsoids, groomed_cache, coarse, quick, sample, pages
):
    monkeypatch.setattr("homolog_app.window.start_page.Sample.make", lambda *_: ellipsoids)
    window.commands[sample].trigger()
    wait(lambda: window.tour.card.isVisible())
    session, card = window.workspace.session, window.tour.card
    wait(lambda: len(session.surveys) == 4 and card.go_on.isEnabled())
    shutil.copytree(groomed_cache, window.workspace.project.groomed)
    window.workspace.edit_settings("groom", "mesh_edge", coarse)
    window.workspace.edit_settings("optimize", "particles", quick(16))
    title = card.title.text()
    window.inspector.cohort.proceed.click()
    assert card.title.text() != title  # the tour follows who goes on by another way
    card.back.click()
    for step in ("groom", "correspond"):
        card.go_on.click()
        assert window.workspace.session.step == step
        card.offer.click()
        wait(lambda: card.go_on.isEnabled() and not window.workspace.session.job.is_busy)
    assert not window.docks.curves.isVisible()  # the card has their room
    for page in pages:
        card.go_on.click()
        assert window.workspace.session.step == "explore"
        assert window.inspector.explore.page.title == page
    last = card.title.text()
    if len(pages) > 1:
        window.commands["explore.modes"].trigger()
        assert card.title.text() != last
        window.commands["explore.groups"].trigger()
        assert card.title.text() == last
    card.go_on.click()
    assert not card.isVisible()
    assert not errors


def test_the_tour_of_a_study_that_is_no_sample_speaks_of_any_study(beans):
    beans.commands["help.tour"].trigger()
    assert beans.tour.card.title.text() == "Subjects"
    while beans.tour.card.go_on.isEnabled():
        beans.tour.card.go_on.click()
    assert beans.workspace.session.step == "groom"


def test_only_the_folder_of_a_sample_has_the_tour_of_the_sample(tmp_path):
    path = tmp_path / "heart_01.nrrd"
    hearts = Study((Member(Subject("heart_01", path)),))
    assert stops_for(hearts) not in (HEARTS.stops, BEANS.stops)
    (tmp_path / "truth").mkdir()
    (tmp_path / "truth" / "heart_01.ply").touch()
    assert stops_for(hearts) is HEARTS.stops


def test_buttons_of_grooming_are_disabled_while_their_commands_are(groomed, wait):
    from PySide6.QtWidgets import QPushButton

    session = groomed.workspace.session
    session.show_step("groom")
    session.select([session.study.members[0].name])
    panel = groomed.inspector.groom
    buttons = [button for button in panel.findChildren(QPushButton) if button.text().startswith("Groom")]
    assert len(buttons) == 2
    assert all(button.isEnabled() for button in buttons)
    groomed.commands["run.start"].trigger()
    assert not any(button.isEnabled() for button in buttons)
    groomed.commands["run.cancel"].trigger()
    wait(lambda: not session.job.is_busy)
    assert all(button.isEnabled() for button in buttons)
