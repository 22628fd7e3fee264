"""Scans of subjects: chosen, read in the computing thread, and shown behind the slices."""

import logging
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from PySide6.QtCore import QObject, QPoint, Qt, Signal, Slot
from PySide6.QtWidgets import QFileDialog, QMenu

from homolog.arrays import FloatArray
from homolog.cohort import IMAGE_SUFFIXES, dicom_files, suffix_of
from homolog.errors import InputError
from homolog.grooming.scans import Scan, check_frame, read_scan
from homolog.progress import Tick
from homolog_app.views.slices import Outline, SliceScene, first_preset
from homolog_app.window.dialogs import Controller, reported
from homolog_app.window.runner import JobOutcome, Runner, Task
from homolog_app.window.session import Session

__all__ = ["ReadScan", "ScanController", "ScanReader", "sliced_subject"]


_log = logging.getLogger(__name__)


class ReadScan:
    """A scan with what is shown of it at first: window and notes."""

    def __init__(self, scan: Scan, inside: float) -> None:
        self.scan = scan
        self.automatic = scan.automatic_window()
        self.preset = first_preset(scan)
        outside = round(100.0 * (1.0 - inside))
        beyond = (f"{outside} % of the structure lies outside of the scan",) if outside else ()
        self.notes = (*scan.notes, *beyond)


class ScanReader(QObject):
    """Holds one scan: that of the newest wish. The one before is let go first."""

    changed = Signal()

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self.read: ReadScan | None = None
        self.problem = ""
        self._wanted: tuple[str, Path] | None = None
        self._next: Task | None = None
        self._runner: Runner | None = None

    @property
    def is_busy(self) -> bool:
        """Whether the scan is being read."""
        return self._runner is not None and self._runner.job is not None

    def want(self, sliced: SliceScene) -> None:
        """Read a subject's scan unless it is there already, or being read."""
        wanted = None if sliced.image is None else (sliced.name, sliced.image)
        if wanted == self._wanted:
            return
        self._wanted, self.read, self.problem, self._next = wanted, None, "", None
        if self._runner is not None:
            self._runner.cancel()
        if wanted is None:
            return
        task = Task(partial(_read, wanted[1], sliced.name, sliced.points), "reading the scan")
        if self._runner is None:
            self._runner = Runner(self)
            self._runner.ended.connect(self._ended)
        if self._runner.job is None:
            self._runner.start(task)
        else:
            self._next = task

    def close(self) -> None:
        """End the thread."""
        if self._runner is not None:
            self._runner.close()

    @Slot(object)
    def _ended(self, ended: JobOutcome) -> None:
        assert self._runner is not None
        if self._next is not None:
            task, self._next = self._next, None
            self._runner.start(task)
            return
        if ended.error is not None:
            known = isinstance(ended.error, InputError)
            self.problem = str(ended.error) if known else f"The scan can't be read: {ended.error!r}"
            _log.warning("%s", self.problem, exc_info=None if known else ended.error)
        elif not ended.cancelled and self._wanted is not None:
            self.read = ended.result
        self.changed.emit()


def _read(path: Path, name: str, points: FloatArray, tick: Tick) -> ReadScan:
    scan = read_scan(path, tick)
    return ReadScan(scan, check_frame(scan, points, name) if len(points) else 1.0)


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
