"""The subjects as a table: include, name, group, volume, status and the covariates."""

from dataclasses import replace

import numpy as np
from PySide6.QtCore import QAbstractTableModel, QModelIndex, QObject, QPersistentModelIndex, Qt
from PySide6.QtGui import QColor, QImage, QPixmap

from homolog.arrays import Array
from homolog_app.rendering.colours import rgb
from homolog_app.rendering.text import millilitres
from homolog_app.scenes.subjects import Triage
from homolog_app.window.session import Session
from homolog_app.window.study import Member
from homolog_app.window.theme import Theme, pixmap

__all__ = ["CohortModel", "thumbnail"]

_Index = QModelIndex | QPersistentModelIndex
_HEADS = ("Subject", "Group", "Volume", "Status")
NAME, GROUP, VOLUME, STATUS = range(len(_HEADS))
_PICTURE = 32
_VOLUME_TIP = "Volume in the input file; Explore > Measure shows that of the groomed surface"


def thumbnail(shade: Array, colour: str, size: int = _PICTURE) -> QPixmap:
    """Colour a survey's picture (0 is background) for the screen."""
    tint = 255.0 * np.array(rgb(colour))
    ink = np.zeros((*shade.shape, 4), dtype=np.uint8)
    ink[..., :3] = tint * (shade[..., None] / 255.0)
    ink[..., 3] = np.where(shade > 0, 255, 0)
    image = QImage(ink.tobytes(), shade.shape[1], shade.shape[0], QImage.Format.Format_RGBA8888)
    result = QPixmap.fromImage(
        image.scaled(2 * size, 2 * size, mode=Qt.TransformationMode.SmoothTransformation)
    )
    result.setDevicePixelRatio(2.0)
    return result


class CohortModel(QAbstractTableModel):
    """The session's subjects as a table. Edits go through the session, so that they can be undone."""

    def __init__(self, session: Session, theme: Theme, parent: QObject) -> None:
        super().__init__(parent)
        self._session, self._theme = session, theme
        self._members: tuple[Member, ...] = ()
        self._columns: list[str] = []
        self._pictures: dict[tuple[str, str], QPixmap] = {}
        self._triage: Triage | None = None
        session.study_changed.connect(self._receive)
        for changed in (session.surveys_changed, session.groomed_changed, session.result_changed):
            changed.connect(self._refresh)
        theme.changed.connect(self._refresh)

    def member(self, row: int) -> Member:
        """Return the member of a row."""
        return self._members[row]

    def rowCount(self, parent: _Index = QModelIndex()) -> int:  # noqa: B008 - Qt's
        """Return the number of subjects."""
        return 0 if parent.isValid() else len(self._members)

    def columnCount(self, parent: _Index = QModelIndex()) -> int:  # noqa: B008 - Qt's
        """Return the number of columns, covariates included."""
        return 0 if parent.isValid() else len(_HEADS) + len(self._columns)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = 0) -> object:
        """Return a column's title."""
        if orientation == Qt.Orientation.Horizontal and role == Qt.ItemDataRole.ToolTipRole:
            return _VOLUME_TIP if section == VOLUME else None
        if role == Qt.ItemDataRole.TextAlignmentRole and section == VOLUME:
            return int(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        if orientation != Qt.Orientation.Horizontal or role != Qt.ItemDataRole.DisplayRole:
            return None
        heads = (*_HEADS, *self._columns)
        return heads[section] if section < len(heads) else None

    def flags(self, index: _Index) -> Qt.ItemFlag:
        """Return which cells can be ticked and edited."""
        result = super().flags(index)
        if index.column() == NAME:
            result |= Qt.ItemFlag.ItemIsUserCheckable
        if index.column() == GROUP or index.column() >= len(_HEADS):
            result |= Qt.ItemFlag.ItemIsEditable
        return result

    def data(self, index: _Index, role: int = Qt.ItemDataRole.DisplayRole) -> object:
        """Return the content of a cell."""
        member = self._members[index.row()]
        match role:
            case Qt.ItemDataRole.DisplayRole | Qt.ItemDataRole.EditRole:
                return self._text(member, index.column())
            case Qt.ItemDataRole.UserRole:
                return self._sort_key(member, index.column())
            case Qt.ItemDataRole.CheckStateRole if index.column() == NAME:
                return Qt.CheckState.Checked if member.included else Qt.CheckState.Unchecked
            case Qt.ItemDataRole.DecorationRole:
                return self._picture(member, index.column())
            case Qt.ItemDataRole.ToolTipRole:
                return self._tip(member)
            case Qt.ItemDataRole.ForegroundRole if not member.included:
                return QColor(self._theme.colours.faint)
            case Qt.ItemDataRole.TextAlignmentRole if index.column() == VOLUME:
                return int(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        return None

    def setData(self, index: _Index, value: object, role: int = Qt.ItemDataRole.EditRole) -> bool:
        """Edit a tick, a group or a covariate."""
        member = self._members[index.row()]
        if role == Qt.ItemDataRole.CheckStateRole:
            included = Qt.CheckState(value) == Qt.CheckState.Checked
            text = f"{'Include' if included else 'Exclude'} {member.name}"
            changed = replace(member, included=included)
        elif index.column() == GROUP:
            text = f"Group of {member.name}"
            changed = replace(member, subject=replace(member.subject, group=str(value).strip() or None))
        else:
            name = self._columns[index.column() - len(_HEADS)]
            text = f"{name} of {member.name}"
            columns = {**member.subject.columns, name: str(value).strip()}
            changed = replace(member, subject=replace(member.subject, columns=columns))
        self._session.edit(text, self._session.study.with_members({member.name: changed}))
        return True

    def _receive(self) -> None:
        study = self._session.study
        rows_same = [member.name for member in study.members] == [member.name for member in self._members]
        if rows_same and study.columns == self._columns:
            self._members = study.members
            self._refresh()
            return
        self.beginResetModel()
        self._members, self._columns = study.members, study.columns
        self.endResetModel()

    def _refresh(self) -> None:
        self._triage = None
        if self._members:
            self.dataChanged.emit(self.index(0, 0), self.index(self.rowCount() - 1, self.columnCount() - 1))

    def _text(self, member: Member, column: int) -> str:
        survey = self._session.surveys.get(member.name)
        match column:
            case 0:
                return member.name
            case 1:
                return member.subject.group or ""
            case 2:
                return millilitres(survey.volume_ml) if survey and survey.volume_ml else ""
            case 3:
                return self._status(member)[0]
        return member.subject.columns.get(self._columns[column - len(_HEADS)], "")

    def _sort_key(self, member: Member, column: int) -> object:
        if column == VOLUME:
            survey = self._session.surveys.get(member.name)
            return survey.volume_ml if survey else -1.0
        text = self._text(member, column)
        try:
            return float(text) if column >= len(_HEADS) else text.casefold()
        except ValueError:
            return text.casefold()

    def _status(self, member: Member) -> tuple[str, str]:
        """Return text and icon of a subject's status."""
        survey = self._session.surveys.get(member.name)
        groomed = self._session.groomed.get(member.name)
        if survey is None:
            return "Reading…", ""
        if survey.awaits_choice:
            return "Choose a label", "warning"
        if survey.problem:
            return "Not usable", "error"
        if groomed is None:
            return "Read", ""
        if not self._session.is_groomed_as_set(member.subject):
            return "Settings changed", "redo_one"
        notes = groomed.subject.report.notes
        if notes:
            picture = "warning" if member.name in self.triage.look else "log"
            return ("1 note" if len(notes) == 1 else f"{len(notes)} notes"), picture
        return "Groomed", "done"

    @property
    def triage(self) -> Triage:
        """What grooming says of the subjects."""
        if self._triage is None:
            self._triage = Triage.of(self._session.groomed)
        return self._triage

    def _tip(self, member: Member) -> str:
        survey, groomed = self._session.surveys.get(member.name), self._session.groomed.get(member.name)
        notes = groomed.subject.report.notes if groomed else ()
        if survey is not None and survey.problem:
            notes = (survey.problem,)
        status = () if notes else (self._status(member)[0],)
        return "\n".join([str(member.subject.path), *status, *notes])

    def _picture(self, member: Member, column: int) -> QPixmap | None:
        colours = self._theme.colours
        if column == STATUS:
            name = self._status(member)[1]
            inks = {"error": colours.danger, "warning": colours.warning, "done": colours.accent}
            return pixmap(name, inks.get(name, colours.dim), 16) if name else None
        survey = self._session.surveys.get(member.name)
        if column != NAME or survey is None or survey.thumbnail is None:
            return None
        key = (f"{member.name}/{survey.groom.source}", colours.bone)
        if key not in self._pictures:
            self._pictures[key] = thumbnail(survey.thumbnail, colours.bone)
        return self._pictures[key]
