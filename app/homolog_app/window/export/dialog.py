"""The dialog of an export, and that of a picture of the views."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from PySide6.QtCore import QUrl, Signal, Slot
from PySide6.QtGui import QCloseEvent, QDesktopServices, QGuiApplication, Qt
from PySide6.QtWidgets import (
    QDialog,
    QFileDialog,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QWidget,
)

from homolog.errors import InputError
from homolog_app.cli.options import options_of
from homolog_app.exports.settings import PictureSettings, ReportSettings, ScreenshotSettings
from homolog_app.rendering.camera import Canvas, Clip
from homolog_app.rendering.content import ViewContents
from homolog_app.rendering.grid import drawn
from homolog_app.scenes.states import Snapshot
from homolog_app.window.export.choosers import (
    NAMES_PX,
    SCREENSHOT,
    ExportKind,
    GroupChooser,
    MotionChooser,
    content_problem,
    first_settings,
    place_problem,
)
from homolog_app.window.export.process import ExportProcess, Preview
from homolog_app.window.form import SettingsForm, SettingsPair
from homolog_app.window.theme import scaled, screen_room
from homolog_app.window.widgets import (
    DIALOG_EDGES,
    GRID,
    ProgressBar,
    button,
    column,
    label,
    restyle,
    row,
    scrolling,
    show_all,
)

__all__ = ["ExportDialog", "Exported", "ScreenshotDialog"]


_FRAME = 80  # pixels: height of title bar and borders


@dataclass(frozen=True, slots=True)
class Exported:
    """The project to export, with its choices.

    Attributes
    ----------
    project : Path
        The folder, or that of the draft.
    name : str
        Prefix of file names.
    folder : Path
        Default folder of files.
    modes, mode : int
        Number of modes, and the initial one.
    columns : mapping of str to sequence of str
        Columns of the cohort's table with a value for each subject.
    camera : str
        Camera of the window's views (`exports.settings.camera_direction`); may be empty.
    clip : Clip or None
        Cutting plane of the window's views.
    anyway : bool
        Whether a report is written although the model is not usable.
    caution : str
        Data of the open study that are not in the project's folder; may be empty.
    """

    project: Path
    name: str
    folder: Path
    modes: int
    mode: int
    columns: Mapping[str, Sequence[str]]
    caution: str = ""
    camera: str = ""
    clip: Clip | None = None
    anyway: bool = False


class ExportDialog(QDialog):
    """Builds a ``homolog export`` command, runs it and shows its progress."""

    started_export = Signal()
    finished_export = Signal(str)

    def __init__(self, parent: QWidget, kind: ExportKind, what: Exported) -> None:
        super().__init__(parent)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.setWindowTitle(f"Export: {kind.title}")
        self.kind, self.exported = kind, what
        self.child = ExportProcess(self)
        self.settings = first_settings(kind, what.project, what.clip)
        self.chooser: MotionChooser | GroupChooser | None = None
        self.preview: Preview | None = None
        self.help: QLabel | None = None
        self.rows: SettingsPair | SettingsForm | None = None
        self.place, self.line = QLineEdit(), QLineEdit(readOnly=True)
        self.note = label("", "Hint", wrap=True)
        self.bar = ProgressBar()
        self.go, self.close_ = button("Export", "primary", self._start), button("Close", does=self.reject)
        self.show_, copied = button("Show in folder", does=self._show_result), QGuiApplication.clipboard()
        self.copy = button("Copy", "flat", lambda: copied.setText(self.line.text()))
        self._lay_out()
        self._connect()
        self._suggest_place()
        self._update()

    @property
    def out(self) -> Path | None:
        """Path of the export."""
        text = self.place.text().strip()
        return Path(text).expanduser() if self.kind.place and text else None

    def arguments(self) -> list[str]:
        """Return the arguments of ``homolog``."""
        settings = options_of(self.settings) if self.settings else []
        if isinstance(self.settings, ReportSettings):
            settings += [*self.settings.emptied, *(["--anyway"] if self.exported.anyway else [])]
        place = [f"--out={self.out}"] if self.out else []
        return ["export", self.kind.name, str(self.exported.project), *self.content(), *settings, *place]

    def content(self) -> list[str]:
        """Return the chosen content as command-line options."""
        return self.chooser.arguments() if self.chooser else []

    def closeEvent(self, event: QCloseEvent) -> None:
        """Stop the export, then close."""
        self._stop()
        event.accept()

    def reject(self) -> None:
        """Close; also called by Escape. A running export is cancelled first."""
        if self.child.is_running:
            self.child.cancel()
        else:
            self.close()

    def _stop(self) -> None:
        if self.preview is not None:
            self.preview.stop()
        self.child.stop()

    def _lay_out(self) -> None:
        browse = button("Browse…", does=self._browse)
        where = "Save as" if self.kind.suffixes else "Folder to create"
        caution = self.exported.caution
        column(
            label(self.kind.title, "PanelTitle"),
            label(self.kind.hint, "Hint", wrap=True),
            *([label(caution, "Problem", wrap=True)] if caution else []),
            (self._make_middle(), 1),
            *([self.help] if self.help is not None else []),
            *([_named(where, self.place, browse)] if self.kind.place else []),
            _named("Command line", self.line, self.copy),
            *(self.bar, self.note),
            [self.show_, ..., self.close_, self.go],
            on=self,
            edges=DIALOG_EDGES,
            gap=2 * GRID,
        )
        show_all(False, self.bar, self.show_)
        self.bar.setAccessibleName("Progress of the export")
        self.go.setDefault(True)
        height = 300 if self.settings is None else 600
        room = screen_room(self.parentWidget())
        wide, high = (1168, 840) if self.preview else (640, 640)  # the settings of a picture do not fit
        high = min(high, room.height() - _FRAME) if self.chooser else height
        self.resize(min(wide, room.width()), high)

    def _make_middle(self) -> QHBoxLayout:
        """Return the settings, which scroll, and the preview next to them."""
        what, model, main = self.exported, self.kind.settings, self.kind.main
        if self.kind.content == "motion":
            self.chooser = MotionChooser(what.modes, what.mode, what.columns, what.camera)
            self.preview = Preview(what.project)
        elif self.kind.content == "groups":
            self.chooser = GroupChooser(what.columns, optional=True)
        if model is not None and self.settings is not None:
            names = scaled(NAMES_PX)  # all editors are aligned
            rows = SettingsPair(model, main, names) if main else SettingsForm(model, least_px=names)
            rows.show_values(self.settings)
            rows.edited.connect(self.edit)
            rows.marked.connect(self._update)
            self.rows, self.help = rows, rows.help
        inner, parts = QWidget(), [part for part in (self.chooser, self.rows) if part is not None]
        column(*parts, ..., on=inner, edges=(0, 0, 2 * GRID, 0), gap=2 * GRID)
        scroll = scrolling(inner)
        scroll.setVisible(bool(parts))
        middle = row((scroll, 1), gap=2 * GRID)
        if self.preview is not None:
            middle.addWidget(self.preview, 0, Qt.AlignmentFlag.AlignTop)
        return middle

    def _connect(self) -> None:
        self.place.textChanged.connect(self._update)
        if self.chooser is not None:
            self.chooser.changed.connect(self._update)
        self.child.progressed.connect(self._progress)
        self.child.ended.connect(self._end)

    def _suggest_place(self) -> None:
        suffix = self.kind.suffixes[0] if self.kind.suffixes else ""
        stem, number = f"{self.exported.name}_{self.kind.name}", 1
        while (path := self.exported.folder / f"{stem}{f'_{number}' if number > 1 else ''}{suffix}").exists():
            number += 1
        self.place.setText(str(path))

    @Slot(str, object)
    def edit(self, _name: str, settings: object) -> None:
        """Set changed settings."""
        self.settings = settings  # type: ignore[assignment]
        self._update()

    @Slot()
    def _update(self) -> None:
        """Show the command, problems, and the first frame."""
        self.line.setText(shlex.join(["homolog", *self.arguments()]))
        self.line.setCursorPosition(0)
        problem = self._problem()
        if not self.child.is_running:
            self.note.setText(problem or self._warning())
            self._mark(bool(problem))
            self.go.setEnabled(not problem)
        if self.preview is not None and isinstance(self.settings, PictureSettings) and not problem:
            self.preview.want(self.chooser.arguments() if self.chooser else [], self.settings)

    def _problem(self) -> str:
        content = content_problem(self.chooser, self.settings) if self.chooser else ""
        typed = self.rows.problem if self.rows is not None else ""
        return content or typed or (place_problem(self.out, self.kind.suffixes) if self.kind.place else "")

    def _warning(self) -> str:
        return "Replaces the existing file." if self.out is not None and self.out.is_file() else ""

    @Slot()
    def _browse(self) -> None:
        kinds = [f"*{suffix}" for suffix in self.kind.suffixes if suffix]
        filters = f"{self.kind.title} ({' '.join(kinds)})" if kinds else ""
        options = QFileDialog.Option.DontConfirmOverwrite
        path, _ = QFileDialog.getSaveFileName(
            self,
            "Where to save",
            self.place.text(),
            f"{filters};;All (*)" if filters else "",
            options=options,
        )
        if path:
            self.place.setText(path)

    @Slot()
    def _start(self) -> None:
        self.bar.show_fraction(0.0)
        self._switch(running=True)
        self._mark(False)
        self.note.setText("Starting…")
        self.started_export.emit()
        self.child.start(self.arguments(), self.out)

    @Slot(float, str)
    def _progress(self, fraction: float, message: str) -> None:
        self.bar.show_fraction(fraction)
        self.note.setText(f"{message[:1].upper()}{message[1:]}…")

    @Slot(str, str)
    def _end(self, how: str, message: str) -> None:
        self._switch(running=False)
        self.show_.setVisible(how == "done")
        text = {"done": f"Done. {message or self._result}", "cancelled": "Cancelled; nothing was written."}
        self.note.setText(text.get(how, f"Not exported. {message}"))
        self._mark(how == "failed")
        self.finished_export.emit(how)

    def _mark(self, failed: bool) -> None:
        restyle(self.note, "objectName", "Problem" if failed else "Hint")

    def _switch(self, *, running: bool) -> None:
        self.bar.setVisible(running)
        self.show_.hide()
        self.go.setEnabled(not running)
        self.close_.setText("Cancel" if running else "Close")

    @property
    def _result(self) -> Path:
        """The file or folder that is written."""
        return self.out or self.exported.project / "report"

    @Slot()
    def _show_result(self) -> None:
        folder = self._result if self._result.is_dir() else self._result.parent
        QDesktopServices.openUrl(QUrl.fromLocalFile(str(folder)))


def _named(text: str, line: QLineEdit, *after: QWidget) -> QHBoxLayout:
    """Return a line with its name at the left."""
    name = QLabel(text)
    name.setBuddy(line)
    name.setFixedWidth(scaled(NAMES_PX))
    line.setAccessibleName(text)
    return row(name, (line, 1), *after)


class ScreenshotDialog(ExportDialog):
    """Size, background and location of the picture; the views remain usable.

    Parameters
    ----------
    parent : QWidget
    what : Exported
    shown : ViewContents
    canvas : Canvas
    snapshot : Snapshot or None
        Contents of the views, for the command line; None if the project lacks them, such as the particles of
        an unfinished run.
    """

    def __init__(
        self, parent: QWidget, what: Exported, shown: ViewContents, canvas: Canvas, snapshot: Snapshot | None
    ) -> None:
        self._shown, self._canvas, self._snapshot = shown, canvas, snapshot
        super().__init__(parent, SCREENSHOT, what)

    def content(self) -> list[str]:
        """Return the contents as options of the command line."""
        return ["--scene", self._snapshot.as_json] if self._snapshot else []

    @Slot()
    def _update(self) -> None:
        super()._update()
        if self._snapshot is None:
            self.line.clear()
            self.line.setPlaceholderText("None: the project lacks these views")
            self.copy.setEnabled(False)

    @Slot()
    def _start(self) -> None:
        from homolog_app.exports.pictures import write_still

        settings, out = self.settings, self.out
        assert isinstance(settings, ScreenshotSettings), "this kind of export has these settings"
        assert out is not None, "an export starts only with a path"
        try:
            pixels = drawn(self._shown, self._canvas, settings.scale, transparent=settings.transparent)
            write_still(out, pixels)
        except InputError as error:
            self._end("failed", str(error))
        else:
            self._end("done", f"{out}: {pixels.shape[1]} x {pixels.shape[0]} pixels")
