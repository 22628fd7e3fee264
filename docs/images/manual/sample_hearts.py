"""Pictures of the sample hearts: tour, cut-away, groups, wall thickness and a patient, for `make.py`."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from homolog_app.window.main_window import MainWindow

__all__ = ["keep_cut", "keep_groups", "keep_hearts", "keep_patient", "keep_scan"]


def keep_hearts(
    window: "MainWindow", until: Callable[[Callable[[], object]], None], keep: Callable[[str], None]
) -> None:
    """Generate the hearts, keep the tour's first card, place particles, and keep the other pictures."""
    session, work, order = window.workspace.session, window.workspace.work, window.commands
    order["file.sample_hearts"].trigger()
    until(lambda: len(session.surveys) == 20)
    order["view.grid9"].trigger()
    keep("tour")
    window.tour.card.end.click()
    for command in ("run.groom", "run.start"):
        order[command].trigger()
        until(lambda: not work.session.job.is_busy)
    keep_cut(window, until, keep)


def keep_scan(
    window: "MainWindow", until: Callable[[Callable[[], object]], None], keep: Callable[[str], None]
) -> None:
    """Generate some hearts with grey-value scans, groom them and keep the slices."""
    from homolog.samples import make_study, write_study

    session, work, order = window.workspace.session, window.workspace.work, window.commands
    with tempfile.TemporaryDirectory() as folder:
        write_study(Path(folder), make_study("hearts", 4, 5), 5, scans=True)
        window.projects.open_paths([Path(folder)])
        until(lambda: len(session.surveys) == 4)
        session.select(["heart_02"])
        window.workspace.session.show_step("groom")
        order["run.groom"].trigger()
        until(lambda: not work.session.job.is_busy and session.is_groomed)
        order["view.slice"].trigger()
        until(lambda: window.views.stage.slices.reader.read is not None)
        keep("scan")
        order["view.slice"].trigger()
        window.workspace.preferences.ask_on_close = False
        order["file.close"].trigger()


def keep_cut(
    window: "MainWindow", until: Callable[[Callable[[], object]], None], keep: Callable[[str], None]
) -> None:
    """Keep the cut-away of the subjects and the map of thickness; the hearts' result is open."""
    order, explore = window.commands, window.inspector.explore
    window.workspace.session.show_step("explore")
    order["view.grid4"].trigger()
    order["view.corner"].trigger()
    order["view.clip"].trigger()
    bar = window.views.stage.clip
    bar.plane.setCurrentText("Coronal")
    keep("cut")
    keep_groups(window, until, keep)
    order["explore.measure"].trigger()
    measure = explore.page
    until(lambda: measure.table.rowCount() > 0)
    measure.who.setCurrentText("heart_06")
    measure.map.setCurrentText("Wall thickness")
    measure.kind.setCurrentText("By group")
    for box in (measure.map, measure.kind):
        box.activated.emit(box.currentIndex())
    keep("thickness")
    order["view.clip"].trigger()
    keep_patient(window, until, keep)
    order["file.close"].trigger()


def keep_groups(
    window: "MainWindow", until: Callable[[Callable[[], object]], None], keep: Callable[[str], None]
) -> None:
    """Compare the groups, and keep the map; the hearts are cut open."""
    session, order = window.workspace.session, window.commands
    order["explore.groups"].trigger()
    order["view.grid1"].trigger()
    page = window.inspector.explore.page
    until(lambda: window.inspector.explore.fitted.shape is not None and not session.job.is_busy)
    order["explore.test"].trigger()
    until(lambda: page.answers and not session.job.is_busy)
    order["view.corner"].trigger()
    keep("groups")


def keep_patient(
    window: "MainWindow", until: Callable[[Callable[[], object]], None], keep: Callable[[str], None]
) -> None:
    """Compare a heart after an infarct, which is none of the study's, with all of them; keep its page."""
    from homolog.samples import make_study, write_study

    window.commands["explore.patient"].trigger()
    page, work = window.inspector.explore.page, window.workspace.work
    until(lambda: not work.session.job.is_busy)
    page.make_reference()
    until(lambda: page.reference is not None and not work.session.job.is_busy)
    with tempfile.TemporaryDirectory() as folder:
        write_study(Path(folder), make_study("hearts", 4, 9), 9)
        page.compare(Path(folder) / "heart_02.nrrd")
        until(lambda: page.comparison is not None and not work.session.job.is_busy)
    keep("patient")
