"""What the commands of Explore do."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtWidgets import QFileDialog

from homolog_app.studies.study import FILES
from homolog_app.window.explore.check_page import CheckPage
from homolog_app.window.explore.groups_page import GroupsPage
from homolog_app.window.explore.measure_page import MeasurePage
from homolog_app.window.explore.modes_page import ModesPage
from homolog_app.window.explore.page import ExplorePage
from homolog_app.window.explore.patient_page import PatientPage
from homolog_app.window.questions import Controller, reported

if TYPE_CHECKING:
    from homolog_app.window.main_window import MainWindow

__all__ = ["ExploreController"]

_REFERENCES = "References (*.npz)"


class ExploreController(Controller):
    """Turns pages and carries out what is ordered of them."""

    def __init__(self, window: "MainWindow") -> None:
        super().__init__(window)
        self._panel = window.inspector.explore
        self._modes, self._groups = self._panel.page_of(ModesPage), self._panel.page_of(GroupsPage)
        self._measure = self._panel.page_of(MeasurePage)
        self._check = self._panel.page_of(CheckPage)
        self._patient = self._panel.page_of(PatientPage)
        for page in self._panel.pages:
            page.page_wanted.connect(partial(self._turn_to, page))

    def handlers(self) -> dict[str, Callable[[], object]]:
        """Return what the commands of Explore do."""
        return {
            "explore.modes": lambda: self._turn_to(self._modes),
            "explore.groups": lambda: self._turn_to(self._groups),
            "explore.measure": lambda: self._turn_to(self._measure),
            "explore.check": lambda: self._turn_to(self._check),
            "check.look": self._check.checked.want,
            "check.next": self._next_suspect,
            "check.mend": self._check.repair_chosen,
            "check.mend_all": self._check.repair_all,
            "check.keep": self._check.checked.write,
            "check.export": self.write_suspects,
            "explore.mean": self._modes.sliders.reset.click,
            "explore.test": self._groups.test,
            "explore.keep": self._groups.save_study,
            "explore.compare": self.compare,
            "explore.table": self.write_table,
            "explore.patient": lambda: self._turn_to(self._patient),
            "patient.reference": self._patient.make_reference,
            "patient.open_reference": self.open_reference,
            "patient.keep_reference": self.save_reference,
            "patient.open": self.open_patient,
            "patient.groups": self.compare_groups,
            "patient.later": lambda: self.add_time(repeats=False),
            "patient.repeat": lambda: self.add_time(repeats=True),
            "patient.save": self.save_patient,
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

    def drop_files(self, paths: Sequence[Path]) -> bool:
        """Let the open page have files that were dropped; return whether it took them."""
        return self._panel.page.drop_files(paths)

    @reported
    def open_reference(self) -> None:
        """Ask for a reference's file and compare with it."""
        path, _ = QFileDialog.getOpenFileName(self._window, "Open reference", "", _REFERENCES)
        if path:
            self._patient.open_reference(Path(path))
            self._window.refresh()

    @reported
    def save_reference(self) -> None:
        """Ask for a file and write the reference."""
        path, _ = QFileDialog.getSaveFileName(self._window, "Save reference", "reference.npz", _REFERENCES)
        if path:
            self._patient.save_reference(Path(path))

    @reported
    def open_patient(self) -> None:
        """Ask for a patient's file and compare it."""
        self._turn_to(self._patient)
        path, _ = QFileDialog.getOpenFileName(self._window, "Patient's segmentation or surface", "", FILES)
        if path:
            self._patient.compare(Path(path))

    @reported
    def compare_groups(self) -> None:
        """Ask for references of further groups and say how typical the patient is of each."""
        paths, _ = QFileDialog.getOpenFileNames(self._window, "References of further groups", "", _REFERENCES)
        if paths:
            self._patient.further.compare_groups([Path(path) for path in paths])

    @reported
    def add_time(self, *, repeats: bool) -> None:
        """Ask for the file of a later time, or for another segmentation of the first one."""
        title = "Another segmentation of the first time" if repeats else "The patient at a later time"
        path, _ = QFileDialog.getOpenFileName(self._window, title, "", FILES)
        if path:
            self._patient.further.add_time(Path(path), repeats=repeats)

    @reported
    def save_patient(self) -> None:
        """Ask for a new folder and write the patient's report there."""
        path, _ = QFileDialog.getSaveFileName(self._window, "Save report as (creates a folder)", "Patient")
        if path:
            self._patient.write(Path(path))

    def _next_suspect(self) -> None:
        self._turn_to(self._check)
        self._check.go_to_next()

    def _turn_to(self, page: ExplorePage) -> None:
        self._panel.open_page(page)
        self._window.show_step("explore")
