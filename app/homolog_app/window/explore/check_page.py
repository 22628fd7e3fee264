"""The page *Check*: the table of suspects, and their repair."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from PySide6.QtCore import (
    QAbstractTableModel,
    QModelIndex,
    QPersistentModelIndex,
    QSize,
    Qt,
    QTimer,
    Slot,
)
from PySide6.QtWidgets import QHeaderView, QTableView

from homolog.arrays import FloatArray
from homolog_app.rendering.content import SubjectContents, ViewContents
from homolog_app.scenes.check import checked_scene
from homolog_app.scenes.states import CheckView
from homolog_app.scenes.structures import ALL
from homolog_app.window.actions import Actions
from homolog_app.window.explore.check_display import CheckDisplay, NormalSphere
from homolog_app.window.explore.check_state import InspectionState
from homolog_app.window.explore.page import ExplorePage, ModelCache
from homolog_app.window.glossary import explanation
from homolog_app.window.theme import Theme, icon, scaled
from homolog_app.window.widgets import (
    GRID,
    Progress,
    button,
    dress_table,
    enable_all,
    fill,
    label,
    say,
    show_all,
)
from homolog_app.window.workspace import Workspace

if TYPE_CHECKING:
    from homolog.inspection import Suspect
    from homolog_app.window.scene import Pick

__all__ = ["CheckPage", "SuspectModel", "suspect_table"]


_ICONS = {
    "exchanged particles": "exchanged",
    "normal outliers": "normal_outlier",
    "swapped neighbourhood": "neighbourhood",
    "folded triangles": "folded",
    "uncovered region": "uncovered",
}
_HEADINGS = ("What", "Subject", "Severity")
_Index = QModelIndex | QPersistentModelIndex


class SuspectModel(QAbstractTableModel):
    """One suspect per row, the most severe first."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self._theme = theme
        self.suspects: Sequence[Suspect] = ()
        self._names: Sequence[str] = ()
        theme.changed.connect(self._refresh_icons)

    def show_suspects(self, suspects: "Sequence[Suspect]", names: Sequence[str]) -> None:
        """Show other suspects; `names` are those of the subjects."""
        self.beginResetModel()
        self.suspects, self._names = suspects, names
        self.endResetModel()

    def _refresh_icons(self) -> None:
        if self.suspects:
            self.dataChanged.emit(self.index(0, 0), self.index(len(self.suspects) - 1, 0))

    def rowCount(self, parent: _Index = QModelIndex()) -> int:  # noqa: B008 - Qt's own default
        """Return the number of suspects."""
        return 0 if parent.isValid() else len(self.suspects)

    def columnCount(self, parent: _Index = QModelIndex()) -> int:  # noqa: B008 - Qt's own default
        """Return the number of columns."""
        return len(_HEADINGS)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = 0) -> Any:  # noqa: ANN401
        """Return a heading."""
        if orientation == Qt.Orientation.Horizontal and role == Qt.ItemDataRole.DisplayRole:
            return _HEADINGS[section]
        return explanation(_HEADINGS[section]) if role == Qt.ItemDataRole.ToolTipRole else None

    def data(self, index: _Index, role: int = 0) -> Any:  # noqa: ANN401 - what Qt's roles ask for
        """Return the content of a cell."""
        suspect = self.suspects[index.row()]
        cells = (suspect.kind.value.capitalize(), self._names[suspect.subject], f"{suspect.severity:.1f}")
        if role == Qt.ItemDataRole.DisplayRole:
            return cells[index.column()]
        if role == Qt.ItemDataRole.ToolTipRole:
            return suspect.description
        if role == Qt.ItemDataRole.AccessibleTextRole:
            return ", ".join(cells)
        if role == Qt.ItemDataRole.DecorationRole and index.column() == 0:
            colours = self._theme.colours
            return icon(_ICONS[suspect.kind.value], colours.text, colours.faint)
        if role == Qt.ItemDataRole.TextAlignmentRole and index.column() == 2:
            return Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        return None


def suspect_table(model: SuspectModel) -> QTableView:
    """Return the widget that shows the table."""
    table = QTableView()
    dress_table(table, "Suspects", 200)
    table.setModel(model)
    table.setSelectionMode(QTableView.SelectionMode.SingleSelection)
    table.setIconSize(QSize(20, 20))
    table.verticalHeader().setDefaultSectionSize(28)
    head = table.horizontalHeader()
    head.setDefaultAlignment(Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter)
    for column, mode in enumerate(
        (
            QHeaderView.ResizeMode.ResizeToContents,
            QHeaderView.ResizeMode.Stretch,
            QHeaderView.ResizeMode.Fixed,
        )
    ):
        head.setSectionResizeMode(column, mode)
    head.resizeSection(2, scaled(76))
    return table


_WORK = ("check", "mend", "keep", "distances", "energies", "texture")


class CheckPage(ExplorePage):
    """List of suspects, the chosen particle, and what the views show of it."""

    title = "Check"
    hint = "Particles that may be mismatched. Select a row to see them."

    def __init__(self, workspace: Workspace, actions: Actions, fitted: ModelCache) -> None:
        super().__init__(workspace, actions, fitted)
        self.checked = InspectionState(workspace, self, self.title)
        self.rows = SuspectModel(workspace.theme)
        self.table = suspect_table(self.rows)
        actions.offer(self.table, "check.mend", "check.mend_all", "check.export")
        self.state, self.message = label("", "Hint", wrap=True), label("", wrap=True)
        self.again, self.export, self.repair, self.mend_all_button, self.keep = (
            button(text, look, actions[command].trigger, toolTip=actions[command].toolTip())
            for text, look, command in (
                ("Find suspects", "", "check.look"),
                ("Export list…", "", "check.export"),
                ("Optimize again here", "primary", "check.mend"),
                ("Optimize again at all suspects", "", "check.mend_all"),
                ("Save to project", "", "check.keep"),
            )
        )
        changed = "Particles have changed; the project still has the previous ones."
        self.unsaved = label(changed, "Hint", wrap=True)
        self.progress = Progress(actions["run.cancel"])
        self.look = CheckDisplay(workspace)
        self.plots = self.sphere = NormalSphere(workspace.theme)
        self._is_new = False
        self._below = (self.progress, self.unsaved, self.keep, self.mend_all_button, self.repair)
        fill(self.body, self.state, (self.table, 1), self.message, [self.again, self.export, ...])
        fill(self.body, GRID, self.look, ...)
        fill(self.footer, *self._below)
        self._connect()
        self._show_inspection()

    def enter(self) -> None:
        """Show what was found while another page was open."""
        if self._is_new:
            QTimer.singleShot(0, self, self._open_on_finding)  # the views of the other page come to an end

    def _open_on_finding(self) -> None:
        """Choose the most severe suspect of an inspection that has not been seen."""
        self._is_new = not self.isVisible()
        if not self._is_new and self.rows.suspects:
            self.table.selectRow(0)

    def handle_pick(self, pick: "Pick") -> None:
        """Choose what was clicked."""
        self.look.handle_pick(pick)

    def shown(self, subjects: SubjectContents) -> ViewContents:
        """Return the shapes with marks and colours."""
        inspection = self.checked.inspection
        if inspection is None:
            return ViewContents(subjects)
        return replace(checked_scene(subjects, inspection, self._names, self.look.marks), stays=True)

    @property
    def chosen(self) -> CheckView | None:
        """The marks; None until the result is inspected."""
        return self.look.view if self.checked.inspection is not None else None

    @property
    def layouts(self) -> tuple[int, ...] | None:
        """Subjects are paged, except for the two views of distances."""
        return (1,) if self.look.marks.distances is not None and self.look.view.show == "distances" else None

    def go_to_next(self) -> None:
        """Choose the next suspect in the list, after the last one the first."""
        count, row = len(self.rows.suspects), self._row
        if count == 1 and row == 0:
            self._choose(row)
        elif count:
            self.table.selectRow((row + 1) % count)

    def repair_chosen(self) -> None:
        """Optimize the particles around the chosen suspect again."""
        suspect = self._suspect
        if suspect is not None:
            self.checked.repair([suspect])
        else:
            self._say("Choose a suspect in the list first.")

    def repair_all(self) -> None:
        """Optimize the particles around all suspects again, one after the other."""
        self.checked.repair(self.rows.suspects)

    @property
    def _names(self) -> tuple[str, ...]:
        result = self.workspace.session.part
        return result.result.names if result is not None else ()

    @property
    def _suspect(self) -> "Suspect | None":
        return self.rows.suspects[self._row] if 0 <= self._row < len(self.rows.suspects) else None

    @property
    def _row(self) -> int:
        """The selected row. Qt's current row can be another: keyboard focus sets it, too."""
        rows = self.table.selectionModel().selectedRows()
        return rows[0].row() if rows else -1

    def _connect(self) -> None:
        session = self.workspace.session
        self.checked.changed.connect(self._show_inspection)
        self.checked.inspected.connect(self._open_on_finding)
        self.checked.repaired.connect(self._show_repaired)
        self.table.selectionModel().selectionChanged.connect(lambda *_: self._choose(self._row))
        self.table.activated.connect(lambda index: self._choose(index.row()))
        self.look.changed.connect(self._show_marks)
        self.look.wanted.connect(self._go)
        self.sphere.subject_chosen.connect(self._look_on)
        session.selection_changed.connect(lambda: self.sphere.show_selection(session.selection))

    def _show_inspection(self) -> None:
        inspection = self.checked.inspection
        self.rows.show_suspects(inspection.suspects if inspection else (), self._names)
        self._say("")
        self.look.show_inspection(inspection, self._names)
        self.show_state()

    @Slot()
    def show_state(self) -> None:
        """Update status and buttons."""
        inspection, job = self.checked.inspection, self.workspace.session.job
        suspects = inspection.suspects if inspection is not None else ()
        alone = self.workspace.session.aspect == ALL  # all structures are optimized together
        show_all(bool(suspects), self.table, self.export, self.repair, self.mend_all_button)
        enable_all(not job.is_busy, self.keep)
        self.mend_all_button.setEnabled(not job.is_busy and alone)
        self.repair.setEnabled(self._suspect is not None and not job.is_busy and alone)
        self.progress.show_status(job.status if job.kind == "mend" else None)
        self.again.setVisible(inspection is None and self.checked.is_possible and job.kind not in _WORK)
        show_all(not self.checked.is_written, self.keep, self.unsaved)
        self.base.setHidden(all(widget.isHidden() for widget in self._below))
        if job.kind in _WORK and job.status is not None:
            doing = f"{job.status.message[:1].upper()}{job.status.message[1:]}"
            text = f"{doing}: {100 * job.status.fraction:.0f} %"
        elif not self.checked.is_possible:
            part = self.workspace.session.part
            text = "Suspects are found by comparing three or more subjects."
            if part is not None and part.parts:
                text = "Structures are checked one by one: choose one above."
        elif inspection is None:
            text = "Not checked yet."
        elif not suspects:
            text = "No suspects: neighbours, normals, triangles and coverage are as usual."
        else:
            on, verb = len({suspect.subject for suspect in suspects}), "suspect" + "s" * (len(suspects) != 1)
            text = f"{len(suspects)} {verb} on {on} of {len(self._names)} subjects, the most severe first."
        self.state.setText(text)

    def _say(self, text: str) -> None:
        say(self.message, text)

    def _show_marks(self) -> None:
        inspection, particle = self.checked.inspection, self.look.chosen
        if inspection is not None and particle is not None:
            normals, mean = inspection.located.normals[:, particle], inspection.consensus.normals[particle]
            self.sphere.show_normals(particle, self._names, normals, mean)
        else:
            self.sphere.show_nothing()
        self.shown_changed.emit()

    def _choose(self, row: int) -> None:
        if 0 <= row < len(self.rows.suspects):
            suspect = self.rows.suspects[row]
            self._say(f"{self._names[suspect.subject]}: {suspect.description}.")
            self.look.mark(int(suspect.particles[0]), suspect.subject, suspect.particles)
            self.show_state()
            self._go(suspect.subject, suspect.place)

    def _look_on(self, name: str) -> None:
        particle = self.look.chosen
        if particle is not None:
            self.look.mark(particle, self._names.index(name))
            self.workspace.session.select([name])

    def _go(self, subject: int, place: FloatArray) -> None:
        inspection = self.checked.inspection
        if inspection is not None:
            nearest = int(np.linalg.norm(inspection.located.world[subject] - place, axis=1).argmin())
            self.workspace.session.select([self._names[subject]])
            self.place_wanted.emit(self._names[subject], place, inspection.located.normals[subject, nearest])

    def _show_repaired(self, suspects: "Sequence[Suspect]", better: int) -> None:
        """Show the outcome, without moving the view."""
        inspection = self.checked.inspection
        if inspection is None:
            return
        revert = " Undo reverts it; saving keeps it." if better else ""
        if len(suspects) > 1:
            left = len(inspection.suspects)
            self._say(
                f"Optimized again at {len(suspects)} suspects: {better} better, the others stay; "
                f"{left} {'is' if left == 1 else 'are'} left.{revert}"
            )
            return
        (suspect,) = suspects
        if not better:
            self._say(
                "Optimized again without improvement: the particles keep their previous places. "
                f"{self._names[suspect.subject]}: {suspect.description}."
            )
            return
        self.look.mark(int(suspect.particles[0]), suspect.subject, suspect.particles)
        near = [
            candidate
            for candidate in inspection.suspects
            if candidate.subject == suspect.subject and np.isin(candidate.particles, suspect.particles).any()
        ]
        outcome = "No longer suspect." if not near else f"Less severe, still suspect: {near[0].description}."
        self._say(f"Optimized again. {outcome}{revert}")
        self._go(suspect.subject, suspect.place)
