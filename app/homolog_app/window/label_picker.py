"""Which label of the files is the structure to study."""

from dataclasses import replace
from typing import TYPE_CHECKING

from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QIcon
from PySide6.QtWidgets import QComboBox, QCompleter, QFrame, QVBoxLayout

from homolog.arrays import Array
from homolog_app.rendering.text import millilitres
from homolog_app.window.cohort_model import thumbnail
from homolog_app.window.session import Session
from homolog_app.window.theme import Theme
from homolog_app.window.widgets import GRID, label

if TYPE_CHECKING:
    from homolog.grooming.structures import Structure

__all__ = ["LabelPicker"]

_PICTURE = 40
_VISIBLE = 14
_QUESTION = "The files contain several structures. Choose one, or type part of its name."


class LabelPicker(QFrame):
    """Shown where a subject has several structures: a list with name, picture, volume and how many have it.

    What is typed is looked for anywhere in the names.
    """

    def __init__(self, session: Session, theme: Theme) -> None:
        super().__init__()
        self.setObjectName("Banner")
        self._session, self._theme = session, theme
        self._shown: object = None
        self.choice = QComboBox()
        self.choice.setAccessibleName("Label to study")
        self.choice.setIconSize(QSize(_PICTURE, _PICTURE))
        self.choice.setEditable(True)
        self.choice.setInsertPolicy(QComboBox.InsertPolicy.NoInsert)
        self.choice.setMaxVisibleItems(_VISIBLE)
        completer = QCompleter(self.choice.model(), self.choice)
        completer.setCompletionMode(QCompleter.CompletionMode.PopupCompletion)
        completer.setCaseSensitivity(Qt.CaseSensitivity.CaseInsensitive)
        completer.setFilterMode(Qt.MatchFlag.MatchContains)
        self.choice.setCompleter(completer)
        self.choice.activated.connect(self._choose)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(2 * GRID, GRID, 2 * GRID, 2 * GRID)
        layout.addWidget(
            label("The files contain several structures. Choose one, or type part of its name.", wrap=True)
        )
        layout.addWidget(self.choice)
        session.facts_changed.connect(self._fill)
        session.study_changed.connect(self._fill)
        theme.changed.connect(self._fill)
        self.hide()

    def _fill(self) -> None:
        surveys = self._session.surveys
        if not any(survey.labels for survey in surveys.values()):
            self.hide()
            return
        from homolog.grooming.names import same_name
        from homolog.grooming.structures import Found, joined  # slow to import, and there once files are read

        groom = self._session.study.settings.groom
        count = len(self._session.study.members)
        labels_of = {
            name: [
                Found(label.name, label.value, label.volume_ml or 0.0, label.at_border)
                for label in survey.labels
            ]
            for name, survey in surveys.items()
        }
        structures = joined(labels_of)
        self.setVisible(len(structures) > 1)
        texts = [_text(structure, count) for structure in structures]
        state = (self._theme.colours, groom.label, groom.segment, texts)
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
        self.choice.setCurrentIndex(chosen)

    def _icon(self, picture: Array) -> QIcon:
        return QIcon(thumbnail(picture, self._theme.colours.bone, _PICTURE))

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


def _text(structure: "Structure", subjects: int) -> str:
    """Return what the list says of a structure."""
    median = structure.volumes[1]
    parts = [structure.title, *([millilitres(median)] if median else [])]
    parts.append(f"in {len(structure.by_subject)} of {subjects} subjects")
    if structure.at_border:
        parts.append(f"at the border in {len(structure.at_border)}")
    return " · ".join(parts)
