"""What slices show of a subject, and how it gets its scan: from a dialog, or dropped on it."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from PySide6.QtCore import QPoint, Qt
from PySide6.QtWidgets import QFileDialog, QMenu

from homolog.cohort import IMAGE_SUFFIXES, dicom_files, suffix_of
from homolog_app.window.questions import Controller, reported
from homolog_app.window.session import Session
from homolog_app.window.slices.planes import Outline, SliceScene

__all__ = ["ScanController", "sliced_subject"]

_FILES = f"Scans ({' '.join(f'*{suffix}' for suffix in IMAGE_SUFFIXES)})"


def sliced_subject(session: Session, name: str) -> SliceScene:
    """Return what slices show of a subject: scan, segmentation, and groomed surface or the result's."""
    subject = next(member.subject for member in session.study.members if member.name == name)
    survey, groomed, result = session.surveys.get(name), session.groomed.get(name), session.result
    outlines: list[Outline] = []
    if groomed is not None:
        outlines = [Outline("Groomed surface", groomed.subject.mesh)]
    elif result is not None and name in result.surfaces:
        outlines = [Outline("Groomed surface", result.surfaces[name][0])]
    elif survey is not None and survey.surface is not None and survey.voxels is None:
        outlines = [Outline("Surface", survey.surface)]
    return SliceScene(name, subject.image, survey.voxels if survey else None, outlines)


class ScanController(Controller):
    """Gives subjects, and the patient of Explore's page, their scans."""

    @reported
    def choose(self, name: str) -> None:
        """Ask for the scan of what the slices show."""
        path, _ = QFileDialog.getOpenFileName(self._window, f"Scan of {name}", "", _FILES)
        if path:
            file = Path(path)
            self.give(name, file.parent if file.suffix.lower() == ".dcm" else file)

    def give(self, name: str, path: Path) -> None:
        """Make a file, or the folder of a DICOM series, the scan of a subject or of the patient."""
        session, page = self._workspace.session, self._window.inspector.explore.page
        if self._window.step == "explore" and page.set_scan(name, path):
            return
        members = {
            member.name: replace(member, subject=replace(member.subject, image=path))
            for member in session.study.members
            if member.name == name
        }
        session.edit("Set scan", session.study.with_members(members))

    def offer(self, paths: Sequence[Path], at: QPoint) -> bool:
        """Ask what an image is that was dropped on a subject: its scan, or another subject.

        Parameters
        ----------
        paths : sequence of Path
            What was dropped.
        at : QPoint
            Where, in the window.

        Returns
        -------
        bool
            Whether the question was asked; False if it was no single image, or not on a subject.
        """
        name = self._subject_at(at)
        is_image = len(paths) == 1 and (suffix_of(paths[0]) in IMAGE_SUFFIXES or _is_series(paths[0]))
        if not name or not is_image:
            return False
        (path,) = paths
        menu = QMenu(self._window)
        menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        menu.addAction(f"Scan of {name.replace('&', '&&')}", lambda: self.give(name, path))
        menu.addAction("Another subject", lambda: self._window.projects.open_paths([path]))
        menu.popup(self._window.mapToGlobal(at))
        return True

    def _subject_at(self, at: QPoint) -> str:
        """Return the subject whose row or slices are at a place of the window; nothing if there is none."""
        views, table = self._window.views, self._window.inspector.cohort
        if views is not None and views.shows_slices:
            slices = views.stage.slices
            if slices.rect().contains(slices.mapFrom(self._window, at)):
                return slices.name
        if not table.isVisible():
            return ""
        return table.subject_at(self._window.mapToGlobal(at))


def _is_series(path: Path) -> bool:
    return path.is_dir() and bool(dicom_files(path))
