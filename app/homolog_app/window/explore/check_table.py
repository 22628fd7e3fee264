"""The suspects as a table."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import QAbstractTableModel, QModelIndex, QPersistentModelIndex, QSize, Qt
from PySide6.QtWidgets import QHeaderView, QTableView

from homolog_app.window.icons import icon
from homolog_app.window.theme import Theme
from homolog_app.window.widgets import dress_table

if TYPE_CHECKING:
    from homolog.inspection import Suspect

__all__ = ["SuspectModel", "suspect_table"]

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
    """One suspect a row, the most severe first."""

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
        return None

    def data(self, index: _Index, role: int = 0) -> Any:  # noqa: ANN401 - what Qt's roles ask for
        """Return what a cell shows."""
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
    head.resizeSection(2, 72)
    return table
