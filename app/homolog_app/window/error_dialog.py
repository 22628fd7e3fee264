"""One dialog for what went wrong: what happened, what to do, details folded."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QDialog, QHBoxLayout, QLabel, QPlainTextEdit, QVBoxLayout, QWidget

from homolog_app.window.icons import pixmap
from homolog_app.window.theme import Theme
from homolog_app.window.widgets import GRID, button, label

__all__ = ["ErrorDialog"]


class ErrorDialog(QDialog):
    """Shows an error; the details can be unfolded, a report saved, and remedies tried, each with a button."""

    def __init__(
        self,
        parent: QWidget,
        theme: Theme,
        title: str,
        message: str,
        details: str,
        save: Callable[[str], None],
        remedies: Mapping[str, Callable[[], object]] = MappingProxyType({}),
    ) -> None:
        super().__init__(parent)
        self.setWindowTitle(title)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.setMinimumWidth(560)
        sign = QLabel()
        sign.setPixmap(pixmap("warning", theme.colours.warning, 40))
        sign.setAlignment(Qt.AlignmentFlag.AlignTop)
        text = label(message, wrap=True)
        text.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.details = QPlainTextEdit(details, readOnly=True)
        self.details.setAccessibleName("Details")
        self.details.setMinimumHeight(200)
        self.details.hide()
        words_column = QVBoxLayout()
        words_column.setSpacing(GRID)
        words_column.addWidget(label(title, "PanelTitle", wrap=True))
        words_column.addWidget(text)
        head = QHBoxLayout()
        head.setSpacing(2 * GRID)
        head.addWidget(sign)
        head.addLayout(words_column, 1)
        unfold = button("Details", "flat")
        unfold.setCheckable(True)
        unfold.setAutoDefault(False)  # Enter closes the dialog, whatever has the focus
        unfold.toggled.connect(self._unfold)
        report = button("Save report…")
        report.setAutoDefault(False)
        report.clicked.connect(lambda: save(details))
        close = button("Close", "primary")
        close.setDefault(True)
        close.clicked.connect(self.accept)
        row = QHBoxLayout()
        row.addWidget(unfold)
        row.addStretch()
        row.addWidget(report)
        row.addWidget(close)
        for words_of_one, remedy in remedies.items():
            single = button(words_of_one)
            single.setAutoDefault(False)
            single.clicked.connect(self.accept)
            single.clicked.connect(lambda _, remedy=remedy: remedy())
            row.insertWidget(row.count() - 2, single)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(3 * GRID, 3 * GRID, 3 * GRID, 2 * GRID)
        layout.setSpacing(2 * GRID)
        layout.addLayout(head)
        layout.addWidget(self.details)
        layout.addLayout(row)
        close.setFocus()

    def _unfold(self, shown: bool) -> None:
        self.details.setVisible(shown)
        self.adjustSize()
