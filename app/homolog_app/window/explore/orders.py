"""What the commands of Explore do."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtWidgets import QFileDialog

from homolog_app.window.asking import Part, reported
from homolog_app.window.explore.check_page import CheckPage
from homolog_app.window.explore.groups_page import GroupsPage
from homolog_app.window.explore.measure_page import MeasurePage
from homolog_app.window.explore.modes_page import ModesPage
from homolog_app.window.explore.page import ExplorePage

if TYPE_CHECKING:
    from homolog_app.window.main_window import MainWindow

__all__ = ["Exploring"]


class Exploring(Part):
    """Turns pages and carries out what is ordered of them."""

    def __init__(self, window: "MainWindow") -> None:
        super().__init__(window)
        self._panel = window.inspector.explore
        self._modes, self._groups = self._panel.page_of(ModesPage), self._panel.page_of(GroupsPage)
        self._measure = self._panel.page_of(MeasurePage)
        self._check = self._panel.page_of(CheckPage)

    def handlers(self) -> dict[str, Callable[[], object]]:
        """Return what the commands of Explore do."""
        return {
            "explore.modes": lambda: self._turn_to(self._modes),
            "explore.groups": lambda: self._turn_to(self._groups),
            "explore.measure": lambda: self._turn_to(self._measure),
            "explore.check": lambda: self._turn_to(self._check),
            "check.look": self._check.checked.want,
            "check.next": self._next_suspect,
            "check.mend": self._check.mend_chosen,
            "check.mend_all": self._check.mend_all,
            "check.keep": self._check.checked.write,
            "check.export": self.write_suspects,
            "explore.mean": self._modes.sliders.reset.click,
            "explore.test": self._test,
            "explore.keep": self._groups.keep_study,
            "explore.compare": self.compare,
            "explore.table": self.write_table,
        }

    @reported
    def compare(self) -> None:
        """Ask for a project's folder and show its result beside the open one."""
        folder = QFileDialog.getExistingDirectory(self._window, "Compare with the result of a project")
        if folder:
            self._panel.fitted.compare_with(Path(folder))

    @reported
    def write_table(self) -> None:
        """Ask for a file and write the measures of the subjects."""
        path, _ = QFileDialog.getSaveFileName(self._window, "Export measures", "measures.csv", "CSV (*.csv)")
        if path:
            self._measure.write(Path(path))

    @reported
    def write_suspects(self) -> None:
        """Ask for a file and write the list of suspects."""
        path, _ = QFileDialog.getSaveFileName(
            self._window, "Export suspects", "suspects.csv", "CSV (*.csv);;JSON (*.json)"
        )
        if path:
            self._check.checked.export(Path(path))

    def _next_suspect(self) -> None:
        self._turn_to(self._check)
        self._check.go_to_next()

    def _turn_to(self, page: ExplorePage) -> None:
        self._panel.open_page(page)
        self._window.show_step("explore")

    def _test(self) -> None:
        self._turn_to(self._groups)
        self._groups.test()
