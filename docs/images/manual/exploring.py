"""Pictures of the pages Modes, Groups (of a number) and Measure, for `make.py`."""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from homolog_app.window.main_window import MainWindow

__all__ = ["keep_exploring"]


def keep_exploring(
    window: "MainWindow", until: Callable[[Callable[[], object]], None], keep: Callable[[str], None]
) -> None:
    """Keep a picture of each of the three pages; the result of the coffee beans is open."""
    from homolog.beans.generate import draw_beans

    order, session, explore = window.commands, window.workspace.session, window.inspector.explore
    names = [member.name for member in session.study.members]
    beans = dict(zip(names, draw_beans(len(names)), strict=True))
    for group, side in (("anterior", -1.0), ("posterior", 1.0)):
        session.select(name for name, bean in beans.items() if side * bean.position > 0.0)
        session.set_group(group)
    order["explore.modes"].trigger()
    until(lambda: explore.fitted.shape is not None)
    modes = explore.page
    modes.sliders.choose(1)  # shows it, though it is not above chance
    modes.sliders.choose(0)
    modes.sliders.show_value(0, 1.5)
    session.select(["bean_04"])
    keep("modes")
    order["view.grid9"].trigger()
    keep("steps")
    order["view.grid1"].trigger()
    order["explore.groups"].trigger()
    groups = explore.page
    study = session.study
    messages = {
        member.name: replace(
            member, subject=replace(member.subject, columns={"slot_mm": f"{beans[member.name].position:.2f}"})
        )
        for member in study.members
    }
    session.edit("Table", study.with_members(messages))
    groups.form.column.setCurrentText("slot_mm (as a number)")
    groups.form.column.activated.emit(groups.form.column.currentIndex())
    groups.answers = []
    order["explore.test"].trigger()
    until(lambda: groups.answers)
    order["view.grid4"].trigger()
    groups.way.setValue(100)
    keep("effect")
    order["view.grid1"].trigger()
    order["explore.measure"].trigger()
    measure = explore.page
    until(lambda: measure.table.rowCount() > 0)
    for box, entry in ((measure.map, "None"), (measure.kind, "Along the mode")):
        box.setCurrentText(entry)
        box.activated.emit(box.currentIndex())
    measure.place.setValue(100)
    keep("measure")
    explore.tabs.setCurrentIndex(0)
