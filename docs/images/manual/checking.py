"""The manual's pictures of the Check page: two particles of a finished result are exchanged and found."""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from homolog.files.results import Result
    from homolog_app.window.main_window import MainWindow

SUBJECT, APART = 2, 60


def keep_checking(
    window: "MainWindow", until: Callable[[Callable[[], object]], None], keep: Callable[[str], None]
) -> None:
    """Exchange two particles of the open result, and keep pictures of finding and looking into that."""
    from homolog_app.window.explore.check_page import CheckPage

    session, work, order = window.desk.session, window.desk.work, window.commands
    loaded = session.result
    assert loaded is not None
    session.result = replace(loaded, result=_exchanged(loaded.result))
    session.facts_changed.emit()
    order["view.grid4"].trigger()
    order["explore.check"].trigger()
    page = window.inspector.explore.page_of(CheckPage)
    until(lambda: page.checked.inspection is not None and not work.is_busy)
    order["check.next"].trigger()
    keep("check")
    for what, name, view in (
        ("distances", "check_distances", "view.reset"),
        ("checkerboard", "check_texture", "view.head"),
    ):
        page.look.show_what.setCurrentIndex(page.look.show_what.findData(what))
        until(lambda: not work.is_busy)
        order[view].trigger()
        keep(name)
    page.look.show_what.setCurrentIndex(0)
    session.result = loaded
    session.facts_changed.emit()


def _exchanged(result: "Result") -> "Result":
    import numpy as np

    from homolog.arrays import frozen

    first = int(result.world[SUBJECT][:, 2].argmax())
    pair = [first, (first + APART) % result.world.shape[1]]
    changed = []
    for points in (result.local, result.world):
        points = np.array(points)
        points[SUBJECT, pair] = points[SUBJECT, pair[::-1]]
        changed.append(frozen(points))
    return replace(result, local=changed[0], world=changed[1])
