"""Slices in place of the views or next to them: their subject and scan."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from PySide6.QtCore import QPoint
from PySide6.QtGui import QAction
from PySide6.QtWidgets import QWidget

from homolog.arrays import FloatArray
from homolog.cohort import IMAGE_SUFFIXES, dicom_files, suffix_of
from homolog.geometry import inverse_matrices, transform_points
from homolog_app.rendering.content import Content
from homolog_app.scenes.slices import Outline, SliceScene
from homolog_app.window.cohort_panel import CohortPanel
from homolog_app.window.explore.panel import ExplorePanel
from homolog_app.window.session import Session
from homolog_app.window.stage import Stage
from homolog_app.window.workspace import Controller, Workspace, reported

__all__ = ["ScanController", "sliced_subject"]


_FILES = f"Scans ({' '.join(f'*{suffix}' for suffix in IMAGE_SUFFIXES)})"


def sliced_subject(session: Session, name: str) -> SliceScene:
    """Return the slices of a subject: scan, segmentation, and groomed surface or that of the result."""
    subject = next(member.subject for member in session.study.members if member.name == name)
    survey, groomed, result = session.surveys.get(name), session.groomed.get(name), session.part
    outlines: list[Outline] = []
    if groomed is not None:
        outlines = [Outline("Groomed surface", groomed.subject.mesh)]
    elif result is not None and name in result.surfaces:
        outlines = [Outline("Groomed surface", result.surfaces[name][0])]
    elif survey is not None and survey.surface is not None and survey.voxels is None:
        outlines = [Outline("Surface", survey.surface)]
    return SliceScene(name, subject.image, survey.voxels if survey else None, outlines)


class ScanController(Controller):
    """Assigns scans to subjects and to the patient."""

    def __init__(
        self,
        window: QWidget,
        workspace: Workspace,
        explore: ExplorePanel,
        table: CohortPanel,
        stage: Stage,
        slicing: QAction,
    ) -> None:
        super().__init__(window, workspace)
        self._slicing = slicing
        self._explore, self._table, self._slices, self._scene = explore, table, stage.slices, stage.scene
        self._session = workspace.session
        self._slices.scan_wanted.connect(self.choose)

    @reported
    def choose(self, name: str) -> None:
        """Ask for the scan of the subject shown in slices."""
        file = self._workspace.files.file(self._window, f"Scan of {name}", _FILES)
        if file:
            self.give(name, file.parent if file.suffix.lower() == ".dcm" else file)

    def give(self, name: str, path: Path) -> None:
        """Set a file, or the folder of a DICOM series, as the scan of a subject or of the patient."""
        session, page = self._workspace.session, self._explore.page
        if session.step == "explore" and page.set_scan(name, path):
            return
        members = {
            member.name: replace(member, subject=replace(member.subject, image=path))
            for member in session.study.members
            if member.name == name
        }
        session.edit("Set scan", session.study.with_members(members))

    def meanings(self, path: Path, at: QPoint) -> dict[str, Callable[[], object]]:
        """Return that an image dropped on a subject (row, view or slices) can be its scan."""
        name = self.subject_at(at)
        is_image = suffix_of(path) in IMAGE_SUFFIXES or (path.is_dir() and bool(dicom_files(path)))
        return {f"Scan of {name}": partial(self._give_and_show, name, path)} if name and is_image else {}

    @reported
    def _give_and_show(self, name: str, path: Path) -> None:
        self.give(name, path)
        self._session.select([name])
        if not self._slicing.isChecked():
            self._slicing.trigger()

    @property
    def index(self) -> int:
        """Index of the included subject whose slices are shown: the first selected one."""
        names = [subject.name for subject in self._session.study.included]
        return next((names.index(name) for name in self._session.selection if name in names), 0)

    def show(self, patient: SliceScene | None) -> None:
        """Show the slices of the patient, or of the selected subject."""
        included = self._session.study.included
        if included:
            scene = patient or sliced_subject(self._session, included[self.index].name)
            self._slices.show_subject(scene)

    def point(self, name: str, shown: Content, place: FloatArray) -> None:
        """Move the crosshair to a point that was clicked or is shown in a close-up."""
        local = transform_points(inverse_matrices(shown.alignment), np.asarray(place)[None])[0]
        self._slices.go_to(name, local)

    def subject_at(self, at: QPoint) -> str:
        """Return the subject at a position of the window; empty if there is none."""
        slices = self._slices
        if slices.isVisible() and slices.rect().contains(slices.mapFrom(self._window, at)):
            return slices.name
        if self._table.isVisible() and (name := self._table.subject_at(self._window.mapToGlobal(at))):
            return name
        plot = self._scene.plot
        inside = plot.mapFrom(self._window, at)
        return self._scene.picker.name_at(inside) if plot.isVisible() and plot.rect().contains(inside) else ""
