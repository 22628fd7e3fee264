"""The page *Groom*: settings, what grooming says of the subjects, and the cures of one of them."""

from PySide6.QtCore import QSignalBlocker, Qt, QTimer, Signal
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import (
    QButtonGroup,
    QHeaderView,
    QPushButton,
    QTableWidget,
    QTableWidgetItem,
    QWidget,
)

from homolog.errors import InputError
from homolog.settings import GroomSettings, OwnGrooming, Pieces, Turn
from homolog_app.rendering.text import millilitres, signed
from homolog_app.scenes.subjects import Groomed, Triage
from homolog_app.window.actions import Actions
from homolog_app.window.cut_box import CutBox
from homolog_app.window.form import SettingsPair, resources_form
from homolog_app.window.runner import Status
from homolog_app.window.session import Session
from homolog_app.window.theme import scaled
from homolog_app.window.widgets import (
    GRID,
    ActionButton,
    Panel,
    Progress,
    button,
    choice,
    column,
    dress_table,
    enable_all,
    fill,
    label,
    link,
    prose,
    row,
    rule,
    say,
    set_primary,
    show_all,
)

__all__ = ["Cures", "GroomPanel", "TriageLists"]

_MAIN = ("label", "smoothing", "alignment", "pieces")
_LISTS = {
    "Look at": "Subjects with a note that fewer than half have",
    "Whole cohort": "Notes on half of the subjects or more, each once",
    "Fine": "Subjects without a note of their own",
}
_EMPTY = (
    "No subject differs from the others.",
    "Nothing was noted on most subjects.",
    "Every subject has a note.",
)
_LIST_PX, _NAME_PX = 190, 150
_WIDEST_TUNNEL = 10.0  # the largest value of the setting
_TURNS = {
    "As found": None,
    "Turned about its long axis": Turn.LONG,
    "Turned about its middle axis": Turn.MIDDLE,
    "Turned about its short axis": Turn.SHORT,
}


class GroomPanel(Panel):
    """Settings of grooming, its button, three lists of subjects, and what can be done for one of them."""

    settings_edited = Signal(str, object)
    resource_edited = Signal(str, object)

    def __init__(self, session: Session, actions: Actions) -> None:
        super().__init__(
            "Groom", "Fill, smooth and align the shapes. Check the contours before you continue."
        )
        self._session = session
        self.form = SettingsPair(GroomSettings, _MAIN)
        self.form.edited.connect(self.settings_edited)
        self.resources = resources_form(self.form, ("workers", "cluster"), self.resource_edited)
        self.triage = TriageLists()
        self.triage.chosen.connect(self._go_to)
        self.subject, self.report = label("", "SectionTitle", wrap=True), prose("Hint")
        self.cures = Cures(session, actions)
        self.cuts = CutBox(actions)
        fill(self.body, self.form, rule(), self.triage, self.subject, self.report, self.cures, self.cuts, ...)
        self.progress = Progress(actions["run.cancel"])
        self.go = ActionButton("Groom", actions["run.groom"], "primary")
        self.proceed = ActionButton("Next: Correspond", actions["view.correspond"], "primary")
        fill(self.footer, self.form.help, self.progress, self.go, self.proceed)
        link(self._show, session.study_changed, session.groomed_changed)
        link(self._show, session.result_changed, session.selection_changed)
        self._show()

    def _go_to(self, name: str) -> None:
        """Select a subject, and scroll to what can be done for it."""
        self._session.select([name])
        QTimer.singleShot(0, self, lambda: self.reveal(self.cures))

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
        name = session.selection[0] if session.selection else ""
        included = {subject.name for subject in session.study.included}
        self.triage.show_triage(
            Triage.of({name: item for name, item in session.groomed.items() if name in included}), name
        )
        groomed = session.groomed.get(name)
        show_all(groomed is not None, self.subject, self.report, self.cures, self.cuts)
        if groomed is not None:
            self.subject.setText(name)
            self.report.setText(_sentences(groomed))
            self.cures.show_subject(name)


def _sentences(groomed: Groomed) -> str:
    report = groomed.subject.report
    if report.rims:
        size = f"Open surface of {groomed.subject.mesh.area / 100.0:.3g} cm²"
    else:
        change = 100.0 * (report.volume_after / report.volume_before - 1.0)
        size = (
            f"Volume {millilitres(report.volume_before)} in the file, "
            f"{millilitres(report.volume_after)} groomed ({signed(change, 1)} %)"
        )
    return "\n".join([size, *(f"• {note[:1].upper()}{note[1:]}" for note in report.notes)])


class Cures(QWidget):
    """What can be done for one subject; each edits its column ``grooming`` and grooms it alone."""

    def __init__(self, session: Session, actions: Actions) -> None:
        super().__init__()
        self._session, self._again = session, actions["run.regroom"]
        self._name = ""
        self.pieces = self._toggle("Keep all pieces", "Join its separate pieces by the shortest bridges.")
        self.holes = self._toggle("Close holes", "Fill holes through it up to 10 voxels wide.")
        self.mirror = self._toggle(
            "Mirror", "Take its mirror image: left and right are exchanged in its file."
        )
        turned = "Turn it by 180° if it lies the other way round than the others."
        self.turn = choice("Orientation", _TURNS, turned)
        self.turn.activated.connect(self._edit)
        self.leave_out = ActionButton("Leave out", actions["edit.include"])
        self.again = ActionButton("Groom this subject again", self._again)
        pairs = ([(self.pieces, 1), (self.holes, 1)], [(self.mirror, 1), (self.leave_out, 1)])
        column(*pairs, self.turn, self.again, on=self)
        self._again.changed.connect(self._follow)

    def _toggle(self, text: str, tip: str) -> QPushButton:
        return button(text, "pick", self._edit, checkable=True, toolTip=tip)

    def _follow(self) -> None:
        enable_all(self._again.isEnabled(), self.pieces, self.holes, self.mirror, self.turn)

    def show_subject(self, name: str) -> None:
        """Show what has been done for a subject."""
        self._name = name
        try:
            own = self._session.own_grooming(name)
        except InputError:
            own = OwnGrooming()  # grooming refuses the cell with its fault
        self.pieces.setChecked(own.pieces is Pieces.ALL)
        self.holes.setChecked(own.tunnels == _WIDEST_TUNNEL)
        self.mirror.setChecked(own.mirrored)
        self.turn.setCurrentIndex(list(_TURNS.values()).index(own.turned))

    def _edit(self) -> None:
        own = self._session.own_grooming(self._name).model_copy(
            update={
                "pieces": Pieces.ALL if self.pieces.isChecked() else None,
                "tunnels": _WIDEST_TUNNEL if self.holes.isChecked() else None,
                "mirrored": self.mirror.isChecked(),
                "turned": self.turn.currentData(),
            }
        )
        self._session.set_own_grooming(self._name, own)
        self._again.trigger()


class TriageLists(QWidget):
    """Three lists of which one is shown: subjects to look at, notes on the whole cohort, and the others.

    Attributes
    ----------
    heads : list of QPushButton
        They choose the list and show its length.
    table : QTableWidget
        Its rows: a subject or number of subjects, and the notes.
    """

    chosen = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self._shown: Triage | None = None
        self.heads = [button(text, "pick", checkable=True, toolTip=tip) for text, tip in _LISTS.items()]
        self.heads[0].setChecked(True)
        group = QButtonGroup(self)
        for head in self.heads:
            group.addButton(head)
        group.buttonClicked.connect(self._show_rows)
        self.table = QTableWidget(0, 2)
        dress_table(self.table, "Notes", scaled(_LIST_PX))
        self.table.setSelectionMode(QTableWidget.SelectionMode.SingleSelection)
        self.table.setEditTriggers(QTableWidget.EditTrigger.NoEditTriggers)
        self.table.setWordWrap(True)
        titles = self.table.horizontalHeader()
        titles.setDefaultAlignment(Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter)
        titles.setSectionResizeMode(0, QHeaderView.ResizeMode.ResizeToContents)
        titles.setMaximumSectionSize(scaled(_NAME_PX))
        titles.setStretchLastSection(True)
        self.empty = label("", "Hint", wrap=True)
        lists = row(*((head, 1) for head in self.heads), gap=GRID // 2)
        column(lists, self.empty, self.table, on=self)
        self.table.currentCellChanged.connect(self._choose)

    def show_triage(self, triage: Triage, selected: str) -> None:
        """Show the lists, and mark the selected subject's row."""
        self.setVisible(bool(triage.look or triage.whole or triage.fine))
        if triage != self._shown:
            self._shown = triage
            counts = len(triage.look), len(triage.whole), len(triage.fine)
            for head, text, count in zip(self.heads, _LISTS, counts, strict=True):
                head.setText(f"{text} · {count}")
            self._show_rows()
        self._mark(selected)

    def _show_rows(self) -> None:
        assert self._shown is not None
        place = next(at for at, head in enumerate(self.heads) if head.isChecked())
        rows = (
            [(name, "\n".join(notes)) for name, notes in self._shown.look.items()],
            [(f"{count} subjects", text) for text, count in self._shown.whole],
            [(name, "") for name in self._shown.fine],
        )[place]
        say(self.empty, "" if rows else _EMPTY[place])
        self.table.setVisible(bool(rows))
        self.table.setHorizontalHeaderLabels(
            ["Subjects" if place == 1 else "Subject", "" if place == 2 else "Note"]
        )
        with QSignalBlocker(self.table):
            self.table.setRowCount(len(rows))
            for row, texts in enumerate(rows):
                for column, text in enumerate(texts):
                    item = QTableWidgetItem(text)
                    item.setToolTip(text)
                    self.table.setItem(row, column, item)
            self.table.setCurrentCell(-1, -1)
        self._fit_rows()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Give each note the lines that it needs at the new width."""
        super().resizeEvent(event)
        QTimer.singleShot(0, self, self._fit_rows)  # after the columns have their widths

    def _fit_rows(self) -> None:
        self.table.resizeRowsToContents()
        for line in range(self.table.rowCount()):
            self.table.setRowHeight(line, self.table.rowHeight(line) + GRID)

    def _mark(self, name: str) -> None:
        """Select the row of a subject, or none."""
        with QSignalBlocker(self.table):
            self.table.clearSelection()
            for item in self.table.findItems(name, Qt.MatchFlag.MatchExactly) if name else ():
                self.table.selectRow(item.row())

    def _choose(self, row: int) -> None:
        if not self.heads[1].isChecked() and (item := self.table.item(row, 0)) is not None:
            self.chosen.emit(item.text())
