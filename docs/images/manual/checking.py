"""The manual's pictures of the Check page: two particles of a finished result are exchanged and found."""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from homolog.arrays import frozen

if TYPE_CHECKING:
    from homolog.inspection import Inspection
    from homolog.io.results import Result
    from homolog_app.window.main_window import MainWindow

SUBJECT, NEAR = 2, 8  # the exchanged particles are seen together


def keep_checking(
    window: "MainWindow", until: Callable[[Callable[[], object]], None], keep: Callable[[str], None]
) -> None:
    """Exchange two particles of the open result, and keep pictures of finding and looking into that."""
    from homolog_app.window.explore.check_page import CheckPage

    session, work, order = window.workspace.session, window.workspace.work, window.commands
    loaded = session.result
    assert loaded is not None
    session.written = replace(loaded, result=_exchanged(loaded.result))
    session.show_result(session.written)
    order["view.grid4"].trigger()
    order["explore.check"].trigger()
    page = window.inspector.explore.page_of(CheckPage)
    until(lambda: page.checked.inspection is not None and not work.session.job.is_busy)
    order["check.next"].trigger()
    keep("check")
    for what, name in (("checkerboard", "check_texture"), ("distances", "check_distances")):
        page.look.show_what.setCurrentIndex(page.look.show_what.findData(what))
        if what == "distances":
            page.look.mark(_beside_slot(page.checked.inspection), SUBJECT)
        until(lambda: not work.session.job.is_busy)
        order["view.head"].trigger()
        keep(name)
    page.look.show_what.setCurrentIndex(0)
    window.inspector.explore.tabs.setCurrentIndex(0)
    session.written = loaded
    session.show_result(loaded)


def _beside_slot(inspection: "Inspection | None") -> int:
    """Return the particle nearest to the axis of those that face the head."""
    assert inspection is not None
    world, normals = inspection.located.world[SUBJECT], inspection.located.normals[SUBJECT]
    off_axis = np.hypot(*(world - world.mean(axis=0))[:, :2].T)
    return int(np.where(normals[:, 2] > 0.85, off_axis, np.inf).argmin())


def _exchanged(result: "Result") -> "Result":
    world = result.world[SUBJECT]
    first = int(world[:, 2].argmax())
    nearest = np.linalg.norm(world - world[first], axis=1).argsort()
    pair = [first, int(nearest[NEAR])]
    changed = []
    for points in (result.local, result.world):
        points = np.array(points)
        points[SUBJECT, pair] = points[SUBJECT, pair[::-1]]
        changed.append(frozen(points))
    return replace(result, local=changed[0], world=changed[1])
