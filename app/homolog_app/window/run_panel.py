"""The pages *Groom* and *Correspond*."""

from collections.abc import Mapping, Sequence

from PySide6.QtCore import QSignalBlocker, Qt, QTimer, Signal, SignalInstance
from PySide6.QtWidgets import (
    QComboBox,
    QHBoxLayout,
    QHeaderView,
    QLabel,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
    QWidget,
)

from homolog.io.project import ProjectFolder
from homolog.io.records import note_kinds
from homolog.settings import GroomSettings, OptimizeSettings, RunSettings
from homolog.surfaces.mirroring import mirrors
from homolog_app.rendering.text import millilitres, signed
from homolog_app.scenes.subjects import Groomed
from homolog_app.studies.files import interrupted_text
from homolog_app.studies.study import outdated_text
from homolog_app.window.actions import Actions
from homolog_app.window.form import SettingsForm, SettingsPair
from homolog_app.window.runner import Status
from homolog_app.window.session import Session
from homolog_app.window.theme import scaled
from homolog_app.window.widgets import (
    GRID,
    ActionButton,
    Panel,
    Progress,
    choice,
    dress_table,
    label,
    rule,
    set_primary,
)

__all__ = ["GroomNotes", "GroomPanel", "RunPanel"]


_NOTES_PX, _ROW_PX, _NAME_PX = 168, 28, 160
_FIRST_SHARE = 100  # stretch factor: the table of notes takes nearly all free height
_GROOM_MAIN = ("label", "smoothing", "alignment", "pieces")


class GroomPanel(Panel):
    """Settings of grooming, its button, and its report on the selected subject."""

    settings_edited = Signal(str, object)
    resource_edited = Signal(str, object)

    def __init__(self, session: Session, actions: Actions) -> None:
        super().__init__(
            "Groom", "Fill, smooth and align the shapes. Check the contours before you continue."
        )
        self._session = session
        self.form = SettingsPair(GroomSettings, _GROOM_MAIN)
        self.form.edited.connect(self.settings_edited)
        self.resources = _resources(self.form, ("workers", "cluster"), self.resource_edited)
        self.report = label("", "Hint", wrap=True)
        self.report.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.subject = label("", "SectionTitle", wrap=True)
        self.notes = GroomNotes()
        self.notes.chosen.connect(self._go_to)
        self.mirrored = label("", "Hint", wrap=True)
        self.again = ActionButton("Groom this subject again", actions["run.regroom"])
        self.body.addWidget(self.form)
        self.body.addWidget(self.mirrored)
        self.body.addWidget(rule())
        self.body.addWidget(self.notes, _FIRST_SHARE)
        for widget in (self.subject, self.report, self.again):
            self.body.addWidget(widget)
        self.body.addStretch(1)
        self.progress = Progress(actions["run.cancel"])
        self.go = ActionButton("Groom", actions["run.groom"], "primary")
        self.proceed = ActionButton("Next: Correspond", actions["view.correspond"], "primary")
        for below in (self.form.help, self.progress, self.go, self.proceed):
            self.footer.addWidget(below)
        for signal in (
            session.study_changed,
            session.groomed_changed,
            session.result_changed,
            session.selection_changed,
        ):
            signal.connect(self._show)
        self._show()

    def _go_to(self, name: str) -> None:
        """Select a subject, and scroll to the changes of its grooming and the button below them."""
        self._session.select([name])
        QTimer.singleShot(0, self, lambda: self.reveal(self.again))

    def show_busy(self, status: Status | None) -> None:
        """Show the progress of grooming, or hide it."""
        was_busy = status is not None and self.go.isHidden()
        self.progress.show_status(status)
        if not was_busy:
            self.go.setVisible(status is None)
            self._show()

    def _show(self) -> None:
        session = self._session
        self.form.show_values(session.study.settings.groom)
        self.resources.show_values(session.study.settings)
        idle = not self.progress.isVisibleTo(self)
        count = len(session.study.included)
        # An opened project loads its result before its groomed surfaces.
        done = session.is_groomed or (session.result is not None and not session.groomed)
        self.go.setText("Groom all again" if done else f"Groom {count} subjects")
        set_primary(self.go, not done)
        self.proceed.setVisible(idle and done)
        turned = [name for name, groomed in session.groomed.items() if mirrors(groomed.alignment)]
        self.mirrored.setText(f"Mirrored to the other side: {', '.join(turned)}")
        self.mirrored.setVisible(bool(turned))
        name = session.selection[0] if session.selection else ""
        self.notes.show_notes(
            {name: groomed.subject.report.notes for name, groomed in session.groomed.items()}, name
        )
        groomed = session.groomed.get(name)
        for widget in (self.subject, self.report, self.again):
            widget.setVisible(groomed is not None)
        if groomed is not None:
            self.subject.setText(name)
            self.report.setText(_sentences(groomed))


def _resources(pair: SettingsPair, names: tuple[str, ...], edited: SignalInstance) -> SettingsForm:
    """Return a form for settings of the run, folded below others; edits are emitted as name and value."""
    others = tuple(name for name in RunSettings.model_fields if name not in names)
    form = SettingsForm(RunSettings, leave_out=others, help_=pair.help, least_px=pair.name_px)
    form.edited.connect(lambda name, settings: edited.emit(name, getattr(settings, name)))
    pair.add_folded(form)
    return form


def _sentences(groomed: Groomed) -> str:
    report = groomed.subject.report
    change = 100.0 * (report.volume_after / report.volume_before - 1.0)
    lines = [
        f"Volume {millilitres(report.volume_before)} in the file, "
        f"{millilitres(report.volume_after)} groomed ({signed(change, 1)} %)",
        f"{len(groomed.subject.mesh.vertices)} vertices, {report.genus} handle{'s' * (report.genus != 1)}",
        *(f"• {note[:1].upper()}{note[1:]}" for note in report.notes),
    ]
    return "\n".join(lines)


class GroomNotes(QWidget):
    """Subjects with notes of grooming as a table, all or those with one kind of note.

    Attributes
    ----------
    kinds : QComboBox
        The kind of note shown; the first entry means all.
    table : QTableWidget
        Name and notes of each subject.
    """

    chosen = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self._notes: Mapping[str, Sequence[str]] = {}
        self.title = label("", "SectionTitle")
        self.kinds = choice("Kind of note")
        self.table = QTableWidget(0, 2)
        self.table.setHorizontalHeaderLabels(["Subject", "Note"])
        dress_table(self.table, "Notes", 0)
        self.table.setSelectionMode(QTableWidget.SelectionMode.SingleSelection)
        self.table.setEditTriggers(QTableWidget.EditTrigger.NoEditTriggers)
        self.table.verticalHeader().setDefaultSectionSize(scaled(_ROW_PX))
        head = self.table.horizontalHeader()
        head.setDefaultAlignment(Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter)
        head.setSectionResizeMode(0, QHeaderView.ResizeMode.ResizeToContents)
        head.setMaximumSectionSize(scaled(_NAME_PX))
        head.setStretchLastSection(True)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(GRID)
        for widget in (self.title, self.kinds, self.table):
            column.addWidget(widget)
        self.kinds.activated.connect(self._show_rows)
        self.table.currentCellChanged.connect(self._choose)

    def show_notes(self, notes: Mapping[str, Sequence[str]], selected: str) -> None:
        """Show the notes of all groomed subjects, and mark the selected subject's row."""
        noted = {name: own for name, own in notes.items() if own}
        self.setVisible(bool(noted))
        self.title.setText(f"Notes on {len(noted)} of {len(notes)} subjects")
        if noted != self._notes:
            self._notes = noted
            self._show_kinds()
            self._show_rows()
        self._mark(selected)

    def _show_kinds(self) -> None:
        """List the kinds of notes, and the notes of each subject, the rarest first."""
        kinds = sorted(note_kinds(self._notes), key=lambda kind: len(kind.names))
        every: dict[str, list[str]] = {name: [] for name in self._notes}
        self.kinds.clear()
        self.kinds.addItem("All notes", every)
        for kind in kinds:
            own: dict[str, list[str]] = {}
            for name, note in kind.notes:
                own.setdefault(name, []).append(note)
                every[name].append(note)
            who = kind.names[0] if len(own) == 1 else f"{len(own)} subjects"
            self.kinds.addItem(f"{who}: {kind.text}", own)
            self.kinds.setItemData(self.kinds.count() - 1, kind.text, Qt.ItemDataRole.ToolTipRole)
        self.kinds.setItemData(0, every)

    def _show_rows(self) -> None:
        shown = self.kinds.currentData()
        with QSignalBlocker(self.table):
            self.table.setRowCount(len(shown))
            for row, (name, own) in enumerate(shown.items()):
                for column, text in enumerate((name, "; ".join(own))):
                    item = QTableWidgetItem(text)
                    item.setToolTip("\n".join([name, *own]))
                    self.table.setItem(row, column, item)
            self.table.setCurrentCell(-1, -1)
        rows = self.table.horizontalHeader().sizeHint().height() + len(shown) * scaled(_ROW_PX) + GRID // 2
        self.table.setMinimumHeight(min(rows, scaled(_NOTES_PX)))
        above = self.title.sizeHint().height() + self.kinds.sizeHint().height() + 2 * GRID
        self.setMaximumHeight(above + rows)

    def _mark(self, name: str) -> None:
        """Select the row of a subject, or none."""
        names = list(self.kinds.currentData() or ())
        with QSignalBlocker(self.table):
            self.table.clearSelection()
            if name in names:
                self.table.selectRow(names.index(name))

    def _choose(self, row: int) -> None:
        item = self.table.item(row, 0)
        if item is not None:
            self.chosen.emit(item.text())


_RUN_MAIN = ("method", "particles", "seed")
_STOPPED = (
    "The last run was stopped. Resume continues from its checkpoint; Run again starts from the beginning."
)
_FIRST = "Groom the shapes first, and check the surfaces."


class RunPanel(Panel):
    """Method, particles, seed and device; run, pause, cancel, resume."""

    settings_edited = Signal(str, object)
    resource_edited = Signal(str, object)

    def __init__(self, session: Session, actions: Actions) -> None:
        super().__init__("Correspond", "Place corresponding particles on every shape.")
        self._session, self._actions = session, actions
        self.form = SettingsPair(OptimizeSettings, _RUN_MAIN)
        self.form.edited.connect(self.settings_edited)
        self.device = QComboBox()
        self.device.setAccessibleName("Device")
        self.show_devices({"auto": "Automatic"})
        self.device.activated.connect(
            lambda _: self.resource_edited.emit("device", self.device.currentData())
        )
        self.resources = _resources(self.form, ("workers", "memory", "cluster"), self.resource_edited)
        self.device.setToolTip("Compute device. Automatic selects the first GPU, or the CPU without one.")
        self.summary = label("", "Hint", wrap=True)
        self.further = label("", "Hint", wrap=True)
        self.more, self.fit = (
            ActionButton(text, actions[command])
            for text, command in (("Add particles", "run.more"), ("Fit new subjects", "run.fit"))
        )
        self.from_result = self._make_further()
        for widget in (
            self._device_row(),
            self.form,
            rule(),
            self.summary,
            self.from_result,
        ):
            self.body.addWidget(widget)
        self.body.addStretch()
        self.progress = Progress(actions["run.cancel"])
        self.pause = ActionButton("Pause", actions["run.pause"])
        self.go = ActionButton("Run", actions["run.start"], "primary")
        self.resume = ActionButton("Resume", actions["run.resume"])
        self.keep = ActionButton("Keep particles", actions["run.keep"])
        self.proceed = ActionButton("Next: Explore", actions["view.explore"], "primary")
        self._lay_out_footer()
        session.study_changed.connect(self.refresh)
        session.groomed_changed.connect(self.refresh)
        session.result_changed.connect(self.refresh)
        self.refresh()

    def _device_row(self) -> QWidget:
        name = QLabel("Device")
        name.setBuddy(self.device)
        name.setFixedWidth(self.form.name_px)
        result = QWidget()
        row = QHBoxLayout(result)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(GRID)
        row.addWidget(name)
        row.addWidget(self.device, 1)
        return result

    def _make_further(self) -> QWidget:
        """Return the controls that extend a result."""
        further = QWidget()
        column = QVBoxLayout(further)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(GRID)
        column.addWidget(label("Extend the result", "SectionTitle"))
        column.addWidget(self.further)
        both = QHBoxLayout()
        both.addWidget(self.more)
        both.addWidget(self.fit)
        both.addStretch()
        column.addLayout(both)
        return further

    def _lay_out_footer(self) -> None:
        self.footer.addWidget(self.form.help)
        self.footer.addWidget(self.progress)
        self.progress.buttons.insertWidget(0, self.pause)
        row = QHBoxLayout()
        row.setSpacing(GRID)
        row.addWidget(self.go, 1)
        row.addWidget(self.resume)
        row.addWidget(self.keep)
        self.footer.addLayout(row)
        self.footer.addWidget(self.proceed)

    def show_devices(self, devices: dict[str, str]) -> None:
        """List the devices of this machine: alias and description."""
        self.device.clear()
        for alias, text in devices.items():
            self.device.addItem(text, alias)
        self.refresh_device()

    def show_busy(self, status: Status | None) -> None:
        """Show the progress of a run, or hide it."""
        was_busy = status is not None and self.go.isHidden()
        self.progress.show_status(status)
        self.pause.setText("Resume" if status is not None and status.paused else "Pause")
        if not was_busy:
            self.go.setVisible(status is None)
            self.form.setEnabled(status is None)
            self.device.setEnabled(status is None)
            self.refresh()

    def refresh(self) -> None:
        """Update settings and buttons."""
        session = self._session
        idle = not self.progress.isVisibleTo(self)
        self.form.show_values(session.study.settings.optimize)
        self.resources.show_values(session.study.settings)
        self.refresh_device()
        result = session.result
        done = result is not None
        current = result is not None and not outdated_text(session.study, result.record)
        resumable = self._actions["run.resume"].isEnabled()
        self.go.setText("Run again" if done or resumable else "Run")
        self._show_further()
        set_primary(self.go, not current and not resumable)
        set_primary(self.proceed, current)
        set_primary(self.resume, not done)
        self.resume.setVisible(idle and resumable)
        self.keep.setVisible(idle and self._actions["run.keep"].isEnabled())
        self.proceed.setVisible(idle and done)
        reading = session.folder is not None and not session.groomed
        ready = session.is_groomed or done or resumable or not idle or reading
        text = session.result.summary if session.result else "" if ready else _FIRST
        if self.resume.isVisibleTo(self):
            text = f"{self._interrupted()}\n{text}".strip()
        self.summary.setText(text)

    def _interrupted(self) -> str:
        """Describe the progress of the unfinished run."""
        folder = self._session.folder
        if folder is None:
            return _STOPPED
        particles = self._session.study.settings.optimize.particles
        return interrupted_text(ProjectFolder(folder).checkpoint, particles)

    def _show_further(self) -> None:
        """Show how the result can be extended."""
        possible = self._session.extension_of
        self.from_result.setVisible(possible is not None)
        if possible is None:
            return
        self.further.setText(possible.message)
        count = len(possible.subjects)
        self.more.setText(f"Add {possible.particles} particles" if possible.particles else "Add particles")
        self.fit.setText(f"Fit {count} new subject{'s' * (count != 1)}" if count else "Fit new subjects")

    def refresh_device(self) -> None:
        """Show the chosen device; one that this machine lacks is listed as missing."""
        chosen = self._session.study.settings.device
        if self.device.findData(chosen) < 0:
            self.device.addItem(f"{chosen} (not on this machine)", chosen)
        self.device.setCurrentIndex(self.device.findData(chosen))
