"""The page *Cohort*: the table of subjects, and the choice of a label."""

from dataclasses import replace
from typing import TYPE_CHECKING

from pydantic import ValidationError
from PySide6.QtCore import QItemSelectionModel, QModelIndex, QPoint, QSize, QSortFilterProxyModel, Qt
from PySide6.QtGui import QIcon, QResizeEvent
from PySide6.QtWidgets import (
    QAbstractItemDelegate,
    QComboBox,
    QCompleter,
    QFrame,
    QHeaderView,
    QLineEdit,
    QSizePolicy,
    QTableView,
    QWidget,
)

from homolog.arrays import Array
from homolog.parameters import fault_text
from homolog.settings import GroomSettings
from homolog_app.rendering.text import millilitres
from homolog_app.window.actions import Actions
from homolog_app.window.cohort_model import GROUP, NAME, STATUS, VOLUME, CohortModel, thumbnail
from homolog_app.window.session import Session
from homolog_app.window.theme import Theme, scaled
from homolog_app.window.widgets import (
    GRID,
    Panel,
    button,
    choice,
    column,
    dress_table,
    fill,
    having,
    label,
    link,
    named_rows,
    row,
    say,
)

if TYPE_CHECKING:
    from homolog.io.structures import Structure

__all__ = ["CohortPanel", "CohortTools", "LabelPicker"]


_TOOLS = ("file.add", "file.import", "file.export", "edit.group", "edit.include", "edit.remove")
_NAMED_TOOLS = ("file.import", "edit.group")
_GROUP_PX = (56, 120)
_NAME_PX, _LONG_NAME_PX, _VOLUME_PX, _STATUS_PX = 140, 220, 72, 96
_TICK_PX = 24  # check boxes, which size hints of a styled table omit
_ICON_PX = 76  # status column while names are long
_MEASURED_ROWS = 100  # rows measured for the width, beyond the visible ones


class _Table(QTableView):
    """A table whose name column takes the free width; Enter moves to the cell below."""

    def closeEditor(self, editor: QWidget, hint: QAbstractItemDelegate.EndEditHint) -> None:
        """Edit the cell below after Enter, unless the edit may have moved the row."""
        super().closeEditor(editor, hint)
        index = self.currentIndex()
        below = index.siblingAtRow(index.row() + 1)
        moves = self.horizontalHeader().sortIndicatorSection() == index.column()
        if hint == QAbstractItemDelegate.EndEditHint.SubmitModelCache and below.isValid() and not moves:
            self.setCurrentIndex(below)
            self.edit(below)

    def fit_names(self) -> None:
        """Fit the column of names to its content, if there is room, and then that of the status."""
        head = self.horizontalHeader()
        head.setResizeContentsPrecision(_MEASURED_ROWS)
        head.resizeSection(VOLUME, max(scaled(_VOLUME_PX), self.sizeHintForColumn(VOLUME)))
        for place in range(STATUS + 1, self.model().columnCount()):
            width = max(self.sizeHintForColumn(place), head.sectionSizeHint(place))
            head.resizeSection(place, min(width, scaled(_GROUP_PX[1])))
        least = scaled(_ICON_PX)
        others = sum(head.sectionSize(column) for column in (GROUP, VOLUME)) + least
        free = self.viewport().width() - others
        whole = self.sizeHintForColumn(NAME) + _TICK_PX
        names = max(scaled(_NAME_PX), min(max(free, scaled(_LONG_NAME_PX)), whole))
        left = max(0, free - names)
        head.resizeSection(NAME, names)
        head.resizeSection(STATUS, max(scaled(_STATUS_PX), min(least + left, self.sizeHintForColumn(STATUS))))

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Give the free width to the names."""
        super().resizeEvent(event)
        if self.model() is not None:
            self.fit_names()


class CohortTools(QWidget):
    """A row of buttons; frequent commands show their names if all of these fit."""

    def __init__(self, actions: Actions) -> None:
        super().__init__()
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        self._tools = {identifier: actions.button(identifier, self) for identifier in _TOOLS}
        self._row = row(*self._tools.values(), ..., on=self, gap=GRID // 2)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Show the names if they fit."""
        super().resizeEvent(event)
        self._set_style(Qt.ToolButtonStyle.ToolButtonTextBesideIcon)
        if self._row.sizeHint().width() > event.size().width():
            self._set_style(Qt.ToolButtonStyle.ToolButtonIconOnly)

    def _set_style(self, style: Qt.ToolButtonStyle) -> None:
        for identifier in _NAMED_TOOLS:
            self._tools[identifier].setToolButtonStyle(style)


class CohortPanel(Panel):
    """The table of subjects, its filter, and the choice of a label where files hold several."""

    def __init__(self, session: Session, theme: Theme, actions: Actions) -> None:
        super().__init__(
            "Cohort", "Tick the subjects to study. Double-click a cell to type a group, or import a table."
        )
        self._session = session
        self._following = False
        self._fitted: tuple[list[str], bool] = [], False
        self.model = CohortModel(session, theme, self)
        self.rows = QSortFilterProxyModel(self)
        self.rows.setSourceModel(self.model)
        self.rows.setSortRole(Qt.ItemDataRole.UserRole)
        self.rows.setFilterKeyColumn(-1)
        self.rows.setFilterCaseSensitivity(Qt.CaseSensitivity.CaseInsensitive)
        self.filter = QLineEdit(placeholderText="Filter by name, group or status…", clearButtonEnabled=True)
        self.filter.setAccessibleName("Filter subjects")
        self.filter.textChanged.connect(self.rows.setFilterFixedString)
        self.table = self._table()
        actions.offer(self.table, "edit.group", "edit.include", "run.regroom", "edit.remove")
        self.labels = LabelPicker(session, theme)
        fill(self.body, CohortTools(actions), self.labels, self.filter, (self.table, 1))
        self.count, self.problems = label("", "Hint", wrap=True), label("", "Problem", wrap=True)
        self.proceed = button("Next: Groom", "primary", actions["view.groom"].trigger)
        fill(self.footer, self.count, self.problems, self.proceed)
        self.table.selectionModel().selectionChanged.connect(self._update_selection)
        link(self._count, session.study_changed, session.surveys_changed)
        link(self.table.fit_names, self.model.modelReset, session.surveys_changed, session.groomed_changed)
        link(self._show_selection, session.selection_changed, self.model.modelReset)
        self._count()

    def _table(self) -> "_Table":
        table = _Table()
        dress_table(table, "Subjects", 240)
        table.setTabKeyNavigation(True)
        table.setModel(self.rows)
        table.setSortingEnabled(True)
        table.sortByColumn(-1, Qt.SortOrder.AscendingOrder)
        table.setEditTriggers(QTableView.EditTrigger.DoubleClicked | QTableView.EditTrigger.EditKeyPressed)
        table.setTextElideMode(Qt.TextElideMode.ElideMiddle)
        table.setIconSize(QSize(32, 32))
        table.verticalHeader().setDefaultSectionSize(40)
        head = table.horizontalHeader()
        head.setDefaultAlignment(Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter)
        head.setStretchLastSection(True)
        for place, width in (
            (NAME, _NAME_PX),
            (GROUP, _GROUP_PX[0]),
            (VOLUME, _VOLUME_PX),
            (STATUS, _STATUS_PX),
        ):
            head.resizeSection(place, scaled(width))
        head.setSectionResizeMode(QHeaderView.ResizeMode.Interactive)
        return table

    def subject_at(self, place: QPoint) -> str:
        """Return the subject at a position of the screen; empty if there is none."""
        view = self.table.viewport()
        at = view.mapFromGlobal(place)
        row = self.table.indexAt(at)
        if not view.rect().contains(at) or not row.isValid():
            return ""
        return self.model.member(self.rows.mapToSource(row).row()).name

    def _count(self) -> None:
        members = self._session.study.members
        surveys = [self._session.surveys.get(member.name) for member in members]
        waiting = sum(survey is not None and survey.awaits_choice for survey in surveys)
        bad = [
            survey for survey in surveys if survey is not None and survey.problem and not survey.awaits_choice
        ]
        included = len(self._session.study.included)
        groups = self._session.study.groups
        if (groups, bool(self._session.surveys)) != self._fitted:  # the first thumbnails need space, too
            self._fitted = groups, bool(self._session.surveys)
            low, high = map(scaled, _GROUP_PX)
            width = min(max(self.table.sizeHintForColumn(GROUP), low), high)
            self.table.horizontalHeader().resizeSection(GROUP, width)
            self.table.fit_names()
        parts = [f"{included} of {len(members)} {'subject' if len(members) == 1 else 'subjects'} included"]
        parts += ["two or more are needed"] if included < 2 else []
        parts += [f"groups: {', '.join(groups)}"] if groups else []
        self.count.setText(" · ".join(parts))
        listed = "; ".join(f"{survey.subject.name}: {survey.problem}" for survey in bad[:3])
        more = f" and {len(bad) - 3} more, see the table" if len(bad) > 3 else ""
        plural = "file" if len(bad) == 1 else "files"
        lines = [f"{len(bad)} {plural} excluded. {listed}{more}"] if bad else []
        owners = "1 subject has" if waiting == 1 else f"{waiting} subjects have"
        lines += [f"{owners} several structures; choose one above."] if waiting else []
        say(self.problems, "\n".join(lines))
        self.proceed.setEnabled(included >= 2 and not waiting)

    def _update_selection(self) -> None:
        if self._following:
            return
        rows = self.table.selectionModel().selectedRows()
        self._session.select(self.model.member(self.rows.mapToSource(row).row()).name for row in rows)

    def _show_selection(self) -> None:
        selection = self.table.selectionModel()
        chosen = set(self._session.selection)
        shown = {self.model.member(self.rows.mapToSource(row).row()).name for row in selection.selectedRows()}
        if shown == chosen:
            return
        self._following = True
        selection.clearSelection()
        first: QModelIndex | None = None
        mode = QItemSelectionModel.SelectionFlag.Select | QItemSelectionModel.SelectionFlag.Rows
        for place in range(self.rows.rowCount()):
            index = self.rows.index(place, 0)
            if self.model.member(self.rows.mapToSource(index).row()).name in chosen:
                selection.select(index, mode)
                first = first or index
        if first is not None:
            self.table.scrollTo(first)
        self._following = False


_PICTURE = 40
_VISIBLE = 14
_QUESTION = "The files contain several structures. Choose one, or type part of its name; or several together."
_SEVERAL, _ALL = -1, "All structures"


class LabelPicker(QFrame):
    """Choice among several structures: a list with name, thumbnail, volume and number of subjects.

    Typed text is searched for anywhere in the names. Several that are modelled together are listed in
    `several`, as after ``--structures``; `align_by` names the one by which subjects are aligned.
    """

    def __init__(self, session: Session, theme: Theme) -> None:
        super().__init__()
        self.setObjectName("Banner")
        self._session, self._theme = session, theme
        self._shown: object = None
        self._names: list[str] = []
        self.choice = having(QComboBox(), accessibleName="Label to study", editable=True)
        self.choice.setIconSize(QSize(_PICTURE, _PICTURE))
        self.choice.setInsertPolicy(QComboBox.InsertPolicy.NoInsert)
        self.choice.setMaxVisibleItems(_VISIBLE)
        completer = QCompleter(self.choice.model(), self.choice)
        completer.setCompletionMode(QCompleter.CompletionMode.PopupCompletion)
        completer.setCaseSensitivity(Qt.CaseSensitivity.CaseInsensitive)
        completer.setFilterMode(Qt.MatchFlag.MatchContains)
        self.choice.setCompleter(completer)
        self.choice.activated.connect(self._choose)
        about = "Names of files or labels, or numbers of labels; wall=2+3 joins labels."
        self.several = having(QLineEdit(), accessibleName="Structures", toolTip=about)
        self.several.editingFinished.connect(self._choose_several)
        self.align_by = choice("Align by", None, "Structure by which whole subjects are aligned")
        self.align_by.activated.connect(self._choose_several)
        self.problem = label("", "Problem", wrap=True)
        self.problem.hide()
        self._together = QWidget()
        together = named_rows((("Structures", self.several), ("Align by", self.align_by)))
        column(together, self.problem, on=self._together)
        question = label(_QUESTION, wrap=True)
        edges = (2 * GRID, GRID, 2 * GRID, 2 * GRID)
        column(question, self.choice, self._together, on=self, edges=edges)
        link(self._fill, session.surveys_changed, session.study_changed, theme.changed)
        self.hide()

    def _fill(self) -> None:
        surveys = self._session.surveys
        if not any(survey.labels for survey in surveys.values()):
            self.hide()
            return
        from homolog.io.label_names import same_name
        from homolog.io.structures import (
            SubjectStructure,
            joined,
        )  # slow to import; loaded anyway once files are read

        groom, optimize = self._session.study.settings.groom, self._session.study.settings.optimize
        count = len(self._session.study.members)
        labels_of = {
            name: [
                SubjectStructure(label.name, label.value, label.volume_ml or 0.0, label.at_border)
                for label in survey.labels
            ]
            for name, survey in surveys.items()
        }
        structures = joined(labels_of)
        self.setVisible(len(structures) > 1)
        texts = [_text(structure, count) for structure in structures]
        state = (self._theme.colours, groom.source, optimize.align_by, texts)
        if len(structures) < 2 or state == self._shown:
            return
        self._shown = state
        pictures = {
            label.name or label.value: label.thumbnail
            for survey in reversed(surveys.values())
            for label in survey.labels
            if label.thumbnail is not None
        }
        self.choice.clear()
        self.choice.addItem("All labels together", None)
        chosen = 0
        for index, (structure, text) in enumerate(zip(structures, texts, strict=True), start=1):
            data = structure.name or structure.values[0]
            picture = pictures.get(data)
            icon = QIcon() if picture is None else self._icon(picture)
            self.choice.addItem(icon, text, data)
            named = groom.segment is not None and same_name(structure.name, groom.segment)
            if named or (
                groom.segment is None and groom.label is not None and groom.label in structure.values
            ):
                chosen = index
        self.choice.addItem("Several, modelled together", _SEVERAL)
        several = groom.structures is not None
        self.choice.setCurrentIndex(self.choice.count() - 1 if several else chosen)
        self._names = [structure.name or str(structure.values[0]) for structure in structures]
        self._together.setVisible(several)
        if several:
            self.several.setText(groom.structures)
            self.align_by.clear()
            self.align_by.addItems([_ALL, *groom.of_structures])
            self.align_by.setCurrentText(optimize.align_by or _ALL)
            self.problem.hide()

    def _icon(self, picture: Array) -> QIcon:
        return QIcon(thumbnail(picture, self._theme.colours.bone, _PICTURE))

    def _choose(self) -> None:
        chosen = self.choice.currentData()
        if chosen == _SEVERAL:
            self._edit({"structures": ",".join(self._names)}, None)
        else:
            self._edit({"segment" if isinstance(chosen, str) else "label": chosen}, None)

    def _choose_several(self) -> None:
        by = self.align_by.currentText()
        try:
            self._edit({"structures": self.several.text()}, by)
        except ValidationError as error:
            text = fault_text(error.errors()[0])
            self.problem.setText(text[:1].upper() + text[1:])
            self.problem.show()

    def _edit(self, picked: dict[str, object], align_by: str | None) -> None:
        """Choose a label, a name or several structures; raises ValidationError."""
        study = self._session.study
        none = {"label": None, "segment": None, "structures": None}
        groom = GroomSettings.model_validate(study.settings.groom.model_dump() | none | picked)
        by = align_by if align_by in groom.of_structures else None
        optimize = study.settings.optimize.model_copy(update={"align_by": by})
        settings = study.settings.model_copy(update={"groom": groom, "optimize": optimize})
        self._session.edit("Structures", replace(study, settings=settings))


def _text(structure: "Structure", subjects: int) -> str:
    """Return the list entry of a structure."""
    median = structure.volumes[1]
    parts = [structure.title, *([millilitres(median)] if median else [])]
    if len(structure.by_subject) < subjects:
        parts.append(f"in {len(structure.by_subject)} of {subjects} subjects")
    if structure.at_border:
        parts.append(f"at the border in {len(structure.at_border)}")
    return " · ".join(parts)
