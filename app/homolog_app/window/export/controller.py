"""Opening the export dialogs."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtWidgets import QWidget

from homolog.errors import InputError
from homolog.io.names import file_stems
from homolog_app.scenes.structures import POSES, SHAPES
from homolog_app.window.dialogs import ask
from homolog_app.window.explore.modes_page import ModesPage
from homolog_app.window.explore.panel import ExplorePanel
from homolog_app.window.explore.verdict_bar import may_use
from homolog_app.window.export.choosers import KINDS
from homolog_app.window.study_files import ViewRecord, save_project
from homolog_app.window.workspace import Controller, Workspace, reported

if TYPE_CHECKING:
    from PySide6.QtGui import QImage

    from homolog_app.rendering.camera import Canvas
    from homolog_app.rendering.content import ViewContents
    from homolog_app.scenes.states import Snapshot
    from homolog_app.window.export.dialog import Exported
    from homolog_app.window.views import Views

__all__ = ["ExportController"]


class ExportController(Controller):
    """The commands of File > Export.

    Attributes
    ----------
    views : Views or None
        Source of the initial camera and cut of films.
    """

    def __init__(self, window: QWidget, workspace: Workspace, explore: ExplorePanel) -> None:
        super().__init__(window, workspace)
        self._explore = explore
        self.views: Views | None = None

    def handlers(self) -> dict[str, Callable[[], object]]:
        """Return the handlers of the export commands."""
        return {f"export.{name}": partial(self.open, name) for name in KINDS}

    @reported
    def open(self, name: str) -> None:
        """Open the dialog of an export."""
        from homolog_app.window.export.dialog import ExportDialog

        kind = KINDS[name]
        if name == "report" and not may_use(self._window, self._workspace.session):
            return
        dialog = ExportDialog(self._window, kind, self._exported())
        if not kind.place:  # written into the project, which the window locks
            folder = self._workspace.session.folder
            dialog.started_export.connect(lambda: self._workspace.lock_project(None))
            dialog.finished_export.connect(lambda _: self._lock_again(folder))
        dialog.show()

    @reported
    def save_slices(self, picture: "QImage") -> None:
        """Ask for a file and save a picture of the slices there."""
        path = self._workspace.files.new(self._window, "Save picture", "slices.png", "Pictures (*.png)")
        if path and not picture.save(str(path)):
            raise InputError(f"{path}: can't be written; choose another folder, or a name that ends in .png")
        if path:
            self._workspace.session.noticed.emit(f"Picture written to {path}")

    @reported
    def open_screenshot(self, shown: "ViewContents", canvas: "Canvas", snapshot: "Snapshot | None") -> None:
        """Open the dialog for a picture of the views.

        Parameters
        ----------
        shown : ViewContents
        canvas : Canvas
        snapshot : Snapshot or None
            State of the views for the command line; None if the project's folder lacks their contents.
        """
        from homolog_app.window.export.dialog import ScreenshotDialog

        what = replace(self._exported(), caution="")  # data missing there are saved with the picture
        ScreenshotDialog(self._window, what, shown, canvas, snapshot).show()

    def may_close(self) -> bool:
        """Ask about running exports; return whether to continue closing."""
        if not self._running or not self._workspace.preferences.ask_on_close:
            return True
        answer = ask(
            self._window,
            "Stop the export?",
            "It has not finished; its files would be removed.",
            ("Stop", "Keep exporting"),
            1,
            lambda: not self._running,
        )
        return answer != "Keep exporting"

    @property
    def _running(self) -> bool:
        """Whether a dialog's export is running."""
        from homolog_app.window.export.dialog import ExportDialog

        return any(dialog.child.is_running for dialog in self._window.findChildren(ExportDialog))

    def close(self) -> None:
        """Close the dialogs and stop their exports."""
        from homolog_app.window.export.dialog import ExportDialog

        for dialog in self._window.findChildren(ExportDialog):
            dialog.close()

    @reported
    def _lock_again(self, folder: Path | None) -> None:
        if folder == self._workspace.session.folder and not self._workspace.closed:
            self._workspace.lock_project(folder)

    def _exported(self) -> "Exported":
        from homolog_app.window.export.dialog import Exported

        session, project = self._workspace.session, self._workspace.shown_project
        columns, modes = self._columns(), len(session.study.included) - 1
        shape = self._explore.fitted.shape
        if session.part is not None:
            modes = shape.modes if shape else len(session.part.result.names) - 1
        (stem,) = file_stems([session.title])
        return Exported(
            project=project.folder,
            name=stem,
            folder=session.folder.parent if session.folder else Path.home(),
            modes=modes,
            mode=min(self._explore.page_of(ModesPage).sliders.chosen + 1, modes),
            columns=columns,
            caution=self._caution(),
            anyway=session.result is not None and session.used_anyway is session.result,
            camera=self._camera(),
            clip=views.stage.scene.canvas.clip if (views := self.views) is not None else None,
        )

    def _camera(self) -> str:
        """Return the camera of the views, or of the first one if they are unlinked."""
        from homolog_app.exports.settings import camera_direction

        if (views := self.views) is None:
            return ""
        camera = views.stage.scene.canvas.cameras[0]
        return camera_direction(np.subtract(camera.eye, camera.at).tolist(), camera.up)

    def _columns(self) -> dict[str, list[str]]:
        """Return the columns of the result's subjects, with the current table."""
        from homolog.comparison.sample import column_of

        session = self._workspace.session
        if session.part is None:
            return {}
        result = session.part.result.with_table_of(session.study.whole.subjects)
        names = dict.fromkeys(name for column in result.columns for name in column)
        return {name: column_of(result, name) for name in ("group", *names)}

    def _caution(self) -> str:
        """Update the table of a draft; return a caution about other data that are not in the folder."""
        workspace, session = self._workspace, self._workspace.session
        if session.folder is None and not workspace.session.job.is_busy:
            save_project(workspace.project, session.study, ViewRecord())
        missing = session.missing
        parts = [f"{' and '.join(missing)} are exported only after the project is saved."] * bool(missing)
        if session.aspect in (SHAPES, POSES):
            parts.append("Only pictures of the views show shape or pose alone.")
        return " ".join(parts)
