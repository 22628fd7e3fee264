"""Files that are dropped on the window: what they mean where they fall."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QPoint, Qt
from PySide6.QtWidgets import QMenu, QWidget

from homolog.cohort import (
    IMAGE_SUFFIXES,
    MARKUP_SUFFIXES,
    MESH_SUFFIXES,
    TABLE_SUFFIXES,
    is_series,
    names_files,
    suffix_of,
)
from homolog.io.particles import PARTICLE_SUFFIXES
from homolog.io.project import ProjectFolder
from homolog_app.window.explore.page import ExplorePage
from homolog_app.window.explore.panel import ExplorePanel
from homolog_app.window.explore.patient_page import PatientPage
from homolog_app.window.project_controller import ProjectController
from homolog_app.window.workspace import Controller, Workspace, reported

if TYPE_CHECKING:
    from homolog_app.window.scans import ScanController

__all__ = ["Drops"]

Meanings = dict[str, Callable[[], object]]


class Drops(Controller):
    """Carries out the one meaning of dropped files, or offers several in a menu.

    Attributes
    ----------
    scans : ScanController or None
        Knows the subjects under the pointer; None until there are views.
    """

    def __init__(
        self, window: QWidget, workspace: Workspace, projects: ProjectController, explore: ExplorePanel
    ) -> None:
        super().__init__(window, workspace)
        self._projects, self._explore = projects, explore
        self.scans: ScanController | None = None

    @reported
    def take(self, paths: Sequence[Path], at: QPoint) -> None:
        """Use files that were dropped at a place of the window."""
        meanings = self.meanings(paths, at)
        if len(meanings) == 1:
            next(iter(meanings.values()))()
            return
        menu = QMenu(self._window)
        menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        for title, does in meanings.items():
            menu.addAction(title.replace("&", "&&"), partial(self.attempt, "drop", does))
        menu.popup(self._window.mapToGlobal(at))

    def meanings(self, paths: Sequence[Path], at: QPoint) -> Meanings:
        """Return what files can mean at a place of the window, at least one thing."""
        session, page, (path, *others) = self._workspace.session, self._page, paths
        add: Meanings = {"Another subject": partial(self._projects.open_paths, paths)}
        if others:
            return {"": partial(page.drop_files, paths)} if isinstance(page, PatientPage) else add
        if ProjectFolder(path).exists:
            compare = {f"Compare with {path.name}": partial(self._explore.fitted.compare_with, path)}
            opened: Meanings = {f"Open {path.name}": add.popitem()[1]}
            return {**compare, **opened} if page is not None and page.compares else opened
        suffix = suffix_of(path)
        if path.name.lower().endswith(MARKUP_SUFFIXES):
            return {"": partial(self._set_landmarks, path, at)}
        if suffix in PARTICLE_SUFFIXES:
            return {"": partial(self._projects.import_from, path)}
        if suffix in TABLE_SUFFIXES and session.study.members and not _lists_files(path):
            return {"": partial(self._projects.import_table, path)}
        if suffix == ".npz" or isinstance(page, PatientPage):
            return {"": partial(self._open_patient, path)}
        scan = self.scans.meanings(path, at) if self.scans is not None else {}
        is_shape = suffix in IMAGE_SUFFIXES + MESH_SUFFIXES or (path.is_dir() and is_series(path))
        patient = {"Patient": partial(self._open_patient, path)} if page is not None and is_shape else {}
        return {**scan, **patient, **add}

    @property
    def _page(self) -> ExplorePage | None:
        return self._explore.page if self._workspace.session.step == "explore" else None

    def _open_patient(self, path: Path) -> None:
        session = self._workspace.session
        if session.result is None:
            session.noticed.emit(f"{path.name}: a reference is opened on the page Patient, after a run")
            return
        session.show_page(PatientPage.title, "explore")
        self._explore.page_of(PatientPage).drop_files([path])

    def _set_landmarks(self, path: Path, at: QPoint) -> None:
        """Set the landmarks of the subject that has the file's name, or on which it was dropped."""
        session = self._workspace.session
        members = {member.name: member for member in session.study.members}
        stem = next(path.name[: -len(end)] for end in MARKUP_SUFFIXES if path.name.lower().endswith(end))
        name = stem if stem in members or self.scans is None else self.scans.subject_at(at)
        if name not in members:
            session.noticed.emit(f"{path.name}: no subject is called {stem}; drop it on its subject")
            return
        subject = replace(members[name].subject, landmarks=path)
        changed = {name: replace(members[name], subject=subject)}
        session.edit("Set landmarks", session.study.with_members(changed))
        session.noticed.emit(f"{path.name}: landmarks of {name}")


def _lists_files(table: Path) -> bool:
    from homolog.io.shapeworks import is_shapeworks

    return is_shapeworks(table) or names_files(table)
