"""Pictures of the views: the window's and the command line's are the same, pixel by pixel."""

import json
import os
import shlex
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

pytestmark = pytest.mark.window


def pixels(path):
    with Image.open(path) as picture:
        return np.asarray(picture)


@pytest.fixture
def both(window, tmp_path, wait):
    """Return a function that saves a picture of the views from the dialog, and by its command line."""
    from homolog_app.cli import main
    from homolog_app.window.export.dialog import ScreenshotDialog

    window.resize(960, 720)  # drawing takes time by the pixel

    def saved(**changes):
        session, work = window.workspace.session, window.workspace.work
        wait(lambda: not work.session.job.is_busy and len(session.surveys) == len(session.study.members))
        window.commands["view.screenshot"].trigger()
        (dialog,) = [widget for widget in window.findChildren(ScreenshotDialog) if widget.isVisible()]
        dialog.edit("", dialog.settings.model_copy(update={"scale": 1, **changes}))
        dialog.place.setText(str(tmp_path / "mine.png"))
        dialog.go.click()
        assert "pixels" in dialog.note.text()
        arguments = shlex.split(dialog.line.text().replace("mine.png", "theirs.png"))
        dialog.close()
        assert arguments[:3] == ["homolog", "export", "screenshot"]
        assert main([*arguments[1:], "--progress", "none"]) == 0
        return pixels(tmp_path / "mine.png"), pixels(tmp_path / "theirs.png"), arguments

    return saved


def assert_same(mine, theirs):
    np.testing.assert_array_equal(mine, theirs)
    colours = mine.astype(np.uint32) @ (256 ** np.arange(mine.shape[2], dtype=np.uint32))
    assert len(np.unique(colours)) > 50, "there is nothing to see"


def test_subjects_are_drawn_again_with_layout_camera_opacity_scheme_and_size_of_texts(
    explored, both, monkeypatch
):
    explored.commands["view.raw"].trigger()
    wanted = {"a": "view.grid1", "b": "view.grid9"}
    for command in wanted.values():
        explored.commands[command].trigger()
        mine, theirs, _ = both()
        assert_same(mine, theirs)
    explored.views.stage.bar.opacity.setValue(40)
    explored.commands["view.head"].trigger()
    explored.commands["view.theme"].trigger()
    dark, theirs, _ = both()
    assert_same(dark, theirs)
    assert dark.mean() < mine.mean()
    monkeypatch.setattr("homolog_app.window.scene.text_scale", lambda: 1.5)  # of the system's font
    explored.views.stage.scene.show_page(0)
    larger, theirs, _ = both()
    assert_same(larger, theirs)
    assert (larger != dark).any()


def test_views_that_are_turned_alone_and_a_page_of_them_are_drawn_again(explored, both):
    explored.commands["view.grid1"].trigger()
    explored.commands["view.next"].trigger()
    explored.commands["view.link"].trigger()
    camera = explored.views.stage.scene.grid.cells[0].renderer.GetActiveCamera()
    camera.Azimuth(33.0)
    camera.Zoom(1.7)
    mine, theirs, text = both()
    assert_same(mine, theirs)
    assert json.loads(text[text.index("--scene") + 1])["canvas"]["page"] == 1


def test_a_moment_of_the_run_is_drawn_again(explored, both, wait):
    time = explored.views.stage.footer.time
    wait(lambda: time.maximum() > 0)
    time.setValue(0)
    mine, theirs, text = both()
    assert_same(mine, theirs)
    assert '"moment":0' in text[text.index("--scene") + 1]


def test_modes_are_drawn_again_alone_in_rows_and_beside_a_subject(explore, finished, window, both):
    page = explore(finished, "modes")
    page.sliders.show_value(0, 1.3)
    page.arrows.setChecked(True)
    window.commands["view.front"].trigger()
    assert_same(*both(scale=2)[:2])
    page.choose_layout(4)
    assert_same(*both()[:2])
    page.choose_layout(1)
    page.who.setCurrentText("b")
    page.who.activated.emit(2)
    assert_same(*both()[:2])


def test_another_run_beside_is_drawn_again(explore, finished, both, wait):
    page = explore(finished, "modes")
    page.fitted.compare_with(finished)
    wait(lambda: page.fitted.other is not None)
    assert_same(*both()[:2])


def test_an_answer_about_a_number_is_drawn_again(explore, bean_project, window, both, wait):
    page = explore(bean_project, "groups")
    page.form.column.setCurrentText("size (as a number)")
    page.form.column.activated.emit(page.form.column.currentIndex())
    page.form.alignment.setCurrentText("Form: size and shape together")
    window.commands["explore.test"].trigger()
    wait(lambda: bool(page.answers), seconds=120)
    page.way.setValue(80)
    page.significant.setChecked(True)
    assert_same(*both()[:2])
    page.choose_layout(4)
    assert_same(*both()[:2])


def test_measures_and_checks_are_drawn_again(explore, finished, window, both, wait):
    page = explore(finished, "measure")
    page.place.setValue(120)
    assert_same(*both()[:2])
    window.commands["explore.check"].trigger()
    page = window.inspector.explore.page
    wait(lambda: page.checked.inspection is not None)
    page.look.mark(5, 1, np.array([5, 7]))
    for show in ("places", "neighbours", "distances", "ensemble", "checkerboard"):
        page.look.show_what.setCurrentIndex(page.look.show_what.findData(show))
        wait(lambda: not window.workspace.session.job.is_busy)
        assert_same(*both()[:2])


def test_groomed_surfaces_before_a_run_are_drawn_again_and_transparently(groomed, both, tmp_path):
    groomed.projects.save_to(tmp_path / "study")
    mine, theirs, _ = both(transparent=True)
    assert_same(mine, theirs)
    assert mine.shape[2] == 4
    assert (mine[..., 3] == 0).mean() > 0.3


def test_a_picture_needs_no_display(explored, both, tmp_path):
    mine, _, message = both()
    bare = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = subprocess.run(
        [sys.executable, "-m", "homolog_app", *message[1:]],
        env=bare,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert_same(mine, pixels(tmp_path / "theirs.png"))


@pytest.mark.parametrize(
    ("view", "message"),
    [
        ("nothing.json", "can't be read"),
        ("{}", "view: Field required"),
        ('{"view": {"page": "moon"}}', "view"),
        ('{"view": {"page": "subjects", "moment": 999}}', "no recorded frame 999"),
        ('{"view": {"page": "modes", "subject": "nobody"}}', "no subject 'nobody'"),
        ('{"view": {"page": "measure", "mode": 50}}', "no mode 51"),
    ],
)
def test_what_is_wrong_with_a_view_is_said(finished, tmp_path, capsys, view, message):
    from homolog_app.cli import main

    line = ["export", "screenshot", str(finished), "--scene", view, "--out", str(tmp_path / "p.png")]
    assert main([*line, "--progress", "none"]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "p.png").exists()


@pytest.fixture
def running(groomed, wait):
    """Return a window in which a run has been paused."""
    from homolog.settings import OptimizeSettings

    groomed.workspace.edit_settings("optimize", "particles", OptimizeSettings(particles=128))
    groomed.commands["run.start"].trigger()
    wait(lambda: groomed.views.run.frame is not None)
    groomed.commands["run.pause"].trigger()
    wait(lambda: groomed.workspace.session.job.run.status.paused)
    yield groomed
    groomed.commands["run.cancel"].trigger()
    wait(lambda: not groomed.workspace.session.job.is_busy)


def dialog_of(window):
    from homolog_app.window.export.dialog import ScreenshotDialog

    window.commands["view.screenshot"].trigger()
    (dialog,) = [widget for widget in window.findChildren(ScreenshotDialog) if widget.isVisible()]
    return dialog


def test_views_that_are_not_in_the_project_have_a_picture_and_no_command(running, tmp_path):
    dialog = dialog_of(running)
    dialog.place.setText(str(tmp_path / "mine.png"))
    assert (dialog.line.text(), dialog.copy.isEnabled()) == ("", False)
    dialog.go.click()
    dialog.close()
    assert pixels(tmp_path / "mine.png").std() > 0
    assert [path.name for path in tmp_path.glob("mine*")] == ["mine.png"]


def test_a_picture_shows_what_was_seen_when_it_was_asked_for(explored, tmp_path):
    dialog = dialog_of(explored)
    dialog.place.setText(str(tmp_path / "one.png"))
    explored.commands["view.head"].trigger()
    explored.commands["view.grid1"].trigger()
    dialog.go.click()
    dialog.place.setText(str(tmp_path / "two.png"))
    dialog.go.click()
    dialog.close()
    later = dialog_of(explored)
    later.place.setText(str(tmp_path / "three.png"))
    later.go.click()
    later.close()
    np.testing.assert_array_equal(pixels(tmp_path / "one.png"), pixels(tmp_path / "two.png"))
    assert (pixels(tmp_path / "one.png") != pixels(tmp_path / "three.png")).any()


def test_no_context_of_qt_counts_as_current_after_vtk_has_drawn_aside(explored, wait):
    from PySide6.QtGui import QOpenGLContext

    scene = explored.views.stage.scene
    scene.plot.makeCurrent()
    assert QOpenGLContext.currentContext() is not None
    scene.picture()
    assert QOpenGLContext.currentContext() is None  # as VTK's own was, which is gone
    scene.plot.update()
    wait(lambda: QOpenGLContext.currentContext() is not None, what="for the views to be drawn again")
