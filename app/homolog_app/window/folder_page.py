"""What a folder means: the patterns and tables that fit it as choices, with the cohort that each gives."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path

from PySide6.QtCore import QSize, Qt, QTimer, Signal
from PySide6.QtGui import QPixmap
from PySide6.QtWidgets import (
    QDialog,
    QLabel,
    QLineEdit,
    QListWidget,
    QListWidgetItem,
    QTableWidget,
    QTableWidgetItem,
    QWidget,
)

from homolog.cohort import Cohort, Subject, counts_text, read_cohort, tables_beside, with_values
from homolog.errors import InputError
from homolog.settings import GroomSettings
from homolog_app.exports.tables import cohort_rows, write_cohort
from homolog_app.scenes.file_survey import FileSurvey, surveys
from homolog_app.window.cohort_model import thumbnail
from homolog_app.window.study import Reading
from homolog_app.window.theme import Theme, scaled
from homolog_app.window.widgets import (
    DIALOG_EDGES,
    GRID,
    button,
    choice,
    column,
    dress_table,
    having,
    label,
    offer,
    row,
)

__all__ = ["FolderPage"]

_SHAPES = 5
_SHAPE_PX = 88
_CHOICES_PX, _WIDTH_PX, _HEIGHT_PX = 380, 1000, 620
_TYPED_MS, _LOOK_MS = 300, 60
_MOST_ROWS = 200  # of the preview
_HINT = (
    "Choose what tells the subjects, or type a pattern: {subject} is needed, {structure} tells the files of "
    "a subject apart, {group} and other fields become columns, * is any text."
)


class FolderPage(QDialog):
    """Choices of what a folder means; `chosen` passes on the cohort."""

    chosen = Signal(object)

    def __init__(
        self,
        parent: QWidget,
        theme: Theme,
        folder: Path,
        readings: Sequence[Reading],
        save: Callable[[], Path | None],
    ) -> None:
        super().__init__(parent)
        self.setWindowTitle("Cohort")
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.resize(scaled(_WIDTH_PX), scaled(_HEIGHT_PX))
        self._theme, self._folder, self._save = theme, folder, save
        self._readings = list(readings)
        self._plain = self.cohort = Cohort((), folder)
        self._reader = ThreadPoolExecutor(1, thread_name_prefix="homolog-shapes")
        self._surveys: list[Future[FileSurvey]] = []
        self._typed = QTimer(self, singleShot=True, interval=_TYPED_MS)
        self._typed.timeout.connect(self._read_pattern)
        self._look = QTimer(self, interval=_LOOK_MS)
        self._look.timeout.connect(self._show_shapes)
        self.finished.connect(lambda: self._reader.shutdown(wait=False, cancel_futures=True))
        self.choices, self.pattern = QListWidget(), QLineEdit()
        self.tables = choice("Table with groups and covariates", {"No table": None})
        self.preview = QTableWidget()
        self.message = label("", "Hint", wrap=True)
        self.shapes = [(QLabel(), label("", "Hint")) for _ in range(_SHAPES)]
        self.accept_button = button("Open", "primary", self._accept, default=True)
        self._lay_out()
        self._fill()

    def _lay_out(self) -> None:
        wide = scaled(_CHOICES_PX)
        listed = "Patterns and tables that fit"
        having(self.choices, accessibleName=listed, minimumWidth=wide, maximumWidth=wide)
        having(self.pattern, accessibleName="Pattern", maximumWidth=wide)
        dress_table(self.preview, "Subjects", 160)
        self.preview.setEditTriggers(QTableWidget.EditTrigger.NoEditTriggers)
        for picture, name in self.shapes:
            picture.setFixedSize(QSize(_SHAPE_PX, _SHAPE_PX))
            name.setMaximumWidth(_SHAPE_PX)
        title = partial(label, name="SectionTitle")
        left = column(self.choices, title("Pattern"), self.pattern, title("Table"), self.tables)
        shapes = [column(picture, name) for picture, name in self.shapes]
        right = column((self.preview, 1), self.message, [*shapes, ...])
        self.save_button = button("Save as table…", does=self._save_table, autoDefault=False)
        cancel = button("Cancel", does=self.reject, autoDefault=False)
        column(
            label(f"What are the subjects in {self._folder.name}?", "PanelTitle"),
            label(_HINT, "Hint", wrap=True),
            (row(left, (right, 1), gap=2 * GRID), 1),
            [self.save_button, ..., cancel, self.accept_button],
            on=self,
            edges=DIALOG_EDGES,
            gap=2 * GRID,
        )

    def _fill(self) -> None:
        for reading in self._readings:
            item = QListWidgetItem(f"{reading.title}\n{counts_text(reading.cohort)}")
            item.setToolTip(reading.title)
            self.choices.addItem(item)
        self.choices.currentRowChanged.connect(self._choose)
        self.pattern.textEdited.connect(lambda _: self._typed.start())
        self.tables.activated.connect(lambda _: self._use_table())
        self.choices.setCurrentRow(0)

    def _choose(self, row: int) -> None:
        reading = self._readings[row]
        self.pattern.setText(reading.title if reading.kind == "pattern" else "")
        self._show(reading.cohort)

    def _read_pattern(self) -> None:
        try:
            cohort = read_cohort(self._folder, self.pattern.text())
        except InputError as error:
            reason = str(error).partition("; these patterns fit")[0]
            cohort = Cohort((), self._folder, (reason,))
        self._show(cohort)

    def _use_table(self) -> None:
        self._show(self._plain, keep_tables=True)

    def _show(self, cohort: Cohort, *, keep_tables: bool = False) -> None:
        """Show a cohort, with the values of the chosen table."""
        self._plain = cohort
        if not keep_tables:
            self._offer_tables(cohort)
        table = self.tables.currentData()
        self.cohort = with_values(cohort, table) if table else cohort
        heads, *rows = cohort_rows(self.cohort, self._folder)
        self.preview.setColumnCount(len(heads))
        self.preview.setHorizontalHeaderLabels(heads)
        self.preview.setRowCount(min(len(rows), _MOST_ROWS))
        for number, texts in enumerate(rows[:_MOST_ROWS]):
            for place, text in enumerate(texts):
                self.preview.setItem(number, place, QTableWidgetItem(text))
        self.preview.resizeColumnsToContents()
        count = counts_text(self.cohort) if rows else ""
        self.message.setText(" · ".join(filter(None, [count, *self.cohort.notes])))
        self.accept_button.setEnabled(len(rows) > 0)
        self._read_shapes(self.cohort.subjects[:_SHAPES])

    def _offer_tables(self, cohort: Cohort) -> None:
        """Offer the tables beside the files; the first one is used."""
        places = tables_beside(cohort) if cohort.subjects else []
        offer(self.tables, {"No table": None} | {place.name: place for place in places})
        self.tables.setEnabled(bool(places))
        self.tables.setCurrentIndex(min(1, len(places)))

    def _read_shapes(self, subjects: Sequence[Subject]) -> None:
        """Read the first shapes in a thread; the window polls it."""
        for survey in self._surveys:
            survey.cancel()
        for picture, name in self.shapes:
            picture.setPixmap(QPixmap())
            name.setText("")
        self._surveys = [
            self._reader.submit(_survey, subject, GroomSettings(segment=first))
            for subject in subjects
            for first in [next(iter(subject.structures), None)]
        ]
        self._look.start()

    def _show_shapes(self) -> None:
        for survey, (picture, name) in zip(self._surveys, self.shapes, strict=False):
            if survey.done() and not survey.cancelled() and not name.text():
                shape = survey.result()
                elide = Qt.TextElideMode.ElideMiddle
                name.setText(self.fontMetrics().elidedText(shape.subject.name, elide, _SHAPE_PX))
                name.setToolTip(shape.problem or shape.subject.name)
                if shape.thumbnail is not None:
                    picture.setPixmap(thumbnail(shape.thumbnail, self._theme.colours.bone, _SHAPE_PX))
        if all(survey.done() for survey in self._surveys):
            self._look.stop()

    def _save_table(self) -> None:
        if (path := self._save()) is not None:
            write_cohort(path, self.cohort)
            self.message.setText(f"Written to {path}; edit it, and open it in place of the folder")

    def _accept(self) -> None:
        self.chosen.emit(self.cohort)
        self.accept()


def _survey(subject: Subject, groom: GroomSettings) -> FileSurvey:
    (survey,) = surveys([subject], groom)
    return survey
