"""What the user prefers and opened last, kept between starts."""

import logging
from pathlib import Path

from PySide6.QtCore import QByteArray, QSettings
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QFormLayout,
    QVBoxLayout,
    QWidget,
)

from homolog_app.window.widgets import GRID, label

__all__ = ["Preferences", "PreferencesDialog"]

_log = logging.getLogger(__name__)
_MOST_RECENT = 10
SCHEMES = {"system": "Follow the system", "light": "Light", "dark": "Dark"}


class Preferences:
    """A small file in the user's configuration folder."""

    def __init__(self, path: Path) -> None:
        self._store = QSettings(str(path), QSettings.Format.IniFormat)

    def _put(self, name: str, value: object) -> None:
        """Store a value at once; preferences that can't be kept are told in the log, and work goes on."""
        self._store.setValue(name, value)
        self._store.sync()
        if self._store.status() != QSettings.Status.NoError:
            _log.warning(
                "%s: can't be written; make room on its disk or make its folder writable",
                self._store.fileName(),
            )

    @property
    def scheme(self) -> str:
        """``"system"``, ``"light"`` or ``"dark"``."""
        value = str(self._store.value("scheme", "system"))
        return value if value in SCHEMES else "system"

    @scheme.setter
    def scheme(self, value: str) -> None:
        self._put("scheme", value)

    @property
    def ask_on_close(self) -> bool:
        """Whether to ask before unsaved edits or a run are given up."""
        return str(self._store.value("ask_on_close", "true")) == "true"

    @ask_on_close.setter
    def ask_on_close(self, value: bool) -> None:
        self._put("ask_on_close", "true" if value else "false")

    @property
    def recent(self) -> list[Path]:
        """Projects opened last, newest first."""
        stored = self._store.value("recent", [])
        listed = [stored] if isinstance(stored, str) else stored if isinstance(stored, list) else []
        return [Path(path) for path in listed if path]

    def remember(self, folder: Path) -> None:
        """Put a project at the top of the list."""
        others = [other for other in self.recent if other != folder]
        self._put("recent", [str(path) for path in [folder, *others]][:_MOST_RECENT])

    def relocate(self, before: Path, after: Path) -> None:
        """Put a project that was moved in the place of the one that is gone."""
        listed = [after if path == before else path for path in self.recent]
        self._put("recent", [str(path) for path in dict.fromkeys(listed)])

    def forget(self) -> None:
        """Clear the list: folders' names may tell who was a patient."""
        self._put("recent", [])

    def keep_geometry(self, geometry: QByteArray, state: QByteArray) -> None:
        """Remember where the window was."""
        self._put("geometry", geometry)
        self._put("state", state)

    @property
    def geometry(self) -> tuple[QByteArray, QByteArray] | None:
        """Where the window was, if that is known."""
        geometry, state = self._store.value("geometry"), self._store.value("state")
        known = isinstance(geometry, QByteArray) and isinstance(state, QByteArray)
        return (geometry, state) if known else None


class PreferencesDialog(QDialog):
    """Colour scheme and confirmations."""

    def __init__(self, parent: QWidget, preferences: Preferences) -> None:
        super().__init__(parent)
        self.setWindowTitle("Preferences")
        self.setMinimumWidth(440)
        self.scheme = QComboBox()
        for value, text in SCHEMES.items():
            self.scheme.addItem(text, value)
        self.scheme.setCurrentIndex(self.scheme.findData(preferences.scheme))
        self.ask = QCheckBox("Ask before discarding unsaved edits or stopping a run")
        self.ask.setChecked(preferences.ask_on_close)
        form = QFormLayout()
        form.setVerticalSpacing(2 * GRID)
        form.addRow("Colours", self.scheme)
        form.addRow("Closing", self.ask)
        buttons = QDialogButtonBox(
            QDialogButtonBox.StandardButton.Ok | QDialogButtonBox.StandardButton.Cancel
        )
        buttons.accepted.connect(self.accept)
        buttons.rejected.connect(self.reject)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(3 * GRID, 3 * GRID, 3 * GRID, 2 * GRID)
        layout.setSpacing(2 * GRID)
        layout.addWidget(label("Preferences", "PanelTitle"))
        layout.addLayout(form)
        layout.addWidget(
            label("Device, method and particles belong to the study: see Correspond.", "Hint", wrap=True)
        )
        layout.addWidget(buttons)

    def store(self, preferences: Preferences) -> None:
        """Write down what was chosen."""
        preferences.scheme = self.scheme.currentData()
        preferences.ask_on_close = self.ask.isChecked()
