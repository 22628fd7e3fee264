"""Which label of the files is the structure to study."""

from dataclasses import replace

from PySide6.QtCore import QSize
from PySide6.QtGui import QIcon
from PySide6.QtWidgets import QComboBox, QFrame, QVBoxLayout

from homolog.arrays import Array
from homolog_app.window.cohort_model import thumbnail
from homolog_app.window.quantities import millilitres
from homolog_app.window.session import Session
from homolog_app.window.theme import Theme
from homolog_app.window.widgets import GRID, label

__all__ = ["LabelPicker"]

_PICTURE = 40


class LabelPicker(QFrame):
    """Shown where a file holds several labels: a list of them, each with name, picture and mean volume."""

    def __init__(self, session: Session, theme: Theme) -> None:
        super().__init__()
        self.setObjectName("Banner")
        self._session, self._theme = session, theme
        self._shown: object = None
        self.choice = QComboBox()
        self.choice.setAccessibleName("Label to study")
        self.choice.setIconSize(QSize(_PICTURE, _PICTURE))
        self.choice.activated.connect(self._choose)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(2 * GRID, GRID, 2 * GRID, 2 * GRID)
        layout.addWidget(label("The files hold several labels. Which one is the structure?", wrap=True))
        layout.addWidget(self.choice)
        session.facts_changed.connect(self._fill)
        session.study_changed.connect(self._fill)
        theme.changed.connect(self._fill)
        self.hide()

    def _fill(self) -> None:
        found: dict[int | str, list[tuple[float, Array]]] = {}
        for survey in self._session.surveys.values():
            for one in survey.labels:
                found.setdefault(one.name or one.value, []).append((one.volume_ml, one.thumbnail))
        self.setVisible(len(found) > 1)
        groom = self._session.study.settings.groom
        chosen = groom.segment if groom.segment in found else groom.label
        count = len(self._session.study.members)
        state = (self._theme.colours, chosen, {value: len(seen) for value, seen in found.items()})
        if len(found) < 2 or state == self._shown:
            return
        self._shown = state
        self.choice.clear()
        self.choice.addItem("All labels together", None)
        for value, seen in sorted(found.items(), key=lambda one: (isinstance(one[0], int), one[0])):
            mean = sum(volume for volume, _ in seen) / len(seen)
            name = f"Label {value}" if isinstance(value, int) else value
            text = f"{name} · {millilitres(mean)} · in {len(seen)} of {count} subjects"
            self.choice.addItem(QIcon(thumbnail(seen[0][1], self._theme.colours.bone, _PICTURE)), text, value)
        self.choice.setCurrentIndex(max(0, self.choice.findData(chosen)))

    def _choose(self) -> None:
        settings = self._session.study.settings
        chosen = self.choice.currentData()
        picked = (
            {"segment": chosen, "label": None}
            if isinstance(chosen, str)
            else {"label": chosen, "segment": None}
        )
        groom = settings.groom.model_copy(update=picked)
        self._session.edit(
            "Label", replace(self._session.study, settings=settings.model_copy(update={"groom": groom}))
        )
