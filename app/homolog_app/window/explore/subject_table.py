"""The subjects with their measures, to sort and to choose from."""

import math
from collections.abc import Sequence

from PySide6.QtCore import QAbstractTableModel, QModelIndex, QObject, QPersistentModelIndex, Qt

__all__ = ["SubjectTable"]

_Index = QModelIndex | QPersistentModelIndex
SORTED_BY = Qt.ItemDataRole.UserRole


class SubjectTable(QAbstractTableModel):
    """Rows of texts and numbers; numbers are shown with equal digits a column and sorted as numbers."""

    def __init__(self, heads: Sequence[str], parent: QObject) -> None:
        super().__init__(parent)
        self._heads = heads
        self._rows: list[tuple[str | float, ...]] = []
        self._digits: list[int] = []

    def show_rows(self, rows: Sequence[tuple[str | float, ...]]) -> None:
        """Show other rows."""
        self.beginResetModel()
        self._rows = list(rows)
        columns = zip(*rows, strict=True) if rows else ()
        self._digits = [
            _digits([value for value in column if isinstance(value, float)]) for column in columns
        ]
        self.endResetModel()

    def rowCount(self, parent: _Index = QModelIndex()) -> int:  # noqa: B008 - Qt's
        """Return the number of subjects."""
        return 0 if parent.isValid() else len(self._rows)

    def columnCount(self, parent: _Index = QModelIndex()) -> int:  # noqa: B008 - Qt's
        """Return the number of columns."""
        return 0 if parent.isValid() else len(self._heads)

    def headerData(
        self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole
    ) -> object:
        """Return a column's name."""
        across = orientation == Qt.Orientation.Horizontal
        return self._heads[section] if across and role == Qt.ItemDataRole.DisplayRole else None

    def data(self, index: _Index, role: int = Qt.ItemDataRole.DisplayRole) -> object:
        """Return a cell: its text, its value to sort by, and its place."""
        value = self._rows[index.row()][index.column()]
        if role == Qt.ItemDataRole.DisplayRole:
            return f"{value:.{self._digits[index.column()]}f}" if isinstance(value, float) else value
        if role == SORTED_BY:
            return value
        if role == Qt.ItemDataRole.TextAlignmentRole and isinstance(value, float):
            return Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        return None


def _digits(values: Sequence[float]) -> int:
    """Return the decimals that give the largest value three digits."""
    most = max((abs(value) for value in values), default=0.0)
    return max(0, 2 - math.floor(math.log10(most))) if most > 0.0 else 0
