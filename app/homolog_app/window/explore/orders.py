"""What the commands of Explore do."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from homolog_app.window.explore.compare_box import choose_other
from homolog_app.window.explore.groups_page import GroupsPage
from homolog_app.window.explore.measure_page import MeasurePage
from homolog_app.window.explore.modes_page import ModesPage
from homolog_app.window.explore.page import ExplorePage

if TYPE_CHECKING:
    from homolog_app.window.main_window import MainWindow

__all__ = ["exploring"]


def exploring(window: "MainWindow") -> dict[str, Callable[[], object]]:
    """Return the handlers of the commands of Explore."""
    panel = window.inspector.explore
    modes, groups = panel.page_of(ModesPage), panel.page_of(GroupsPage)
    measure = panel.page_of(MeasurePage)

    def turn_to(page: ExplorePage) -> None:
        panel.open_page(page)
        window.show_step("explore")

    def test() -> None:
        turn_to(groups)
        groups.test()

    return {
        "explore.modes": lambda: turn_to(modes),
        "explore.groups": lambda: turn_to(groups),
        "explore.measure": lambda: turn_to(measure),
        "explore.mean": modes.sliders.reset.click,
        "explore.test": test,
        "explore.compare": lambda: choose_other(window, panel.fitted),
        "explore.table": measure.export,
    }
