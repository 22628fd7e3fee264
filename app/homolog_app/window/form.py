"""A form generated from a settings model: one row per setting, with unit, and help for the active one."""

from enum import Enum
from typing import Any

from pydantic import BaseModel, ValidationError
from PySide6.QtCore import QEvent, QObject, Qt, Signal, SignalInstance
from PySide6.QtGui import QEnterEvent, QFocusEvent, QKeyEvent, QKeySequence
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QGridLayout,
    QLabel,
    QLineEdit,
    QSpinBox,
    QWidget,
)

from homolog.parameters import Parameter, fault_text, parameters
from homolog.settings import RunSettings
from homolog_app.rendering.text import parse_number
from homolog_app.window.theme import scaled
from homolog_app.window.widgets import GRID, NumberBox, button, column, having, label, offer, restyle

__all__ = ["SettingsForm", "SettingsPair", "resources_form", "tab_before"]

_HINT = "Point at a setting for its help."
_LINES = 3
_EDITOR, _TEXT_EDITOR = 112, 280
_NOTHING = object()
_NO_BOUND = 2**31 - 1  # the largest value of a spin box
_LABELS = {
    "geodesic-normals": "Geodesics and normals",
    "geodesic": "Geodesics only",
    "normals": "Normals only",
    "euclidean": "Euclidean (Cates et al.)",
    "icp": "Closest points (ICP)",
    "axes": "Principal axes",
    "center": "Centre of mass",
    "none": "None",
    "view": "Facing the camera",
    "vtp": "VTP (ParaView, 3D Slicer)",
    "ply": "PLY",
    "stl": "STL",
    "glb": "GLB (browsers, slides)",
    "scree": "Eigenvalues and chance (scree)",
    "scores": "Subjects in two modes",
    "quality": "Quality of the model",
    "energies": "Energies of the run",
    "modes": "Modes",
    "difference": "Difference of two groups",
    "discriminant": "Discriminant of two groups",
    "world": "Aligned",
    "local": "As in the input files",
}


def tab_before(widget: QWidget, *added: QWidget) -> None:
    """Move widgets that were added later before another one (not the window's first) in the tab order."""
    before = widget
    while (before := before.previousInFocusChain() or widget) is not widget:
        if before.focusPolicy() & Qt.FocusPolicy.TabFocus:
            break
    for each in added:
        QWidget.setTabOrder(before, each)
        before = each


class _Help(QLabel):
    """The help of the setting under the pointer or with focus; its height is fixed."""

    def __init__(self) -> None:
        super().__init__(_HINT)
        self.setObjectName("FieldHelp")
        self.setWordWrap(True)
        self.setAlignment(Qt.AlignmentFlag.AlignTop)
        self.setFixedHeight(_LINES * self.fontMetrics().lineSpacing())
        self._texts: dict[str, str] = {}

    def show_text(self, reason: str, text: str) -> None:
        """Show the help for pointer or focus; if it is empty, that for the other."""
        self._texts[reason] = text
        self.setText(text or next(filter(None, self._texts.values()), _HINT))


class SettingsForm(QWidget):
    """Shows a settings model and reports each valid edit as a changed model.

    `help` is a label that the owner places where it is always visible. `name_px` is the width of the names,
    including those of omitted settings; it is at least `least_px`.
    """

    edited = Signal(str, object)
    marked = Signal()
    """A value became invalid or valid: see `problem`."""

    def __init__(
        self,
        model: type[BaseModel],
        leave_out: tuple[str, ...] = (),
        help_: _Help | None = None,
        least_px: int = 0,
    ) -> None:
        super().__init__()
        self._model = model()
        self.help = help_ or _Help()
        known = parameters(model)
        self.name_px = max(least_px, *(QLabel(item.label.capitalize()).sizeHint().width() for item in known))
        self._rows = {item.name: _Row(item, self.name_px) for item in known if item.name not in leave_out}
        column(*self._rows.values(), on=self)
        for each in self._rows.values():
            each.entered.connect(self._enter)
            each.helped.connect(self.help.show_text)
            each.marked.connect(self.marked)

    @property
    def problem(self) -> str:
        """Description of the first invalid value; empty if all are valid."""
        return next((row.problem for row in self._rows.values() if row.problem), "")

    def show_values(self, model: BaseModel) -> None:
        """Show the settings; nothing is reported."""
        self._model = model
        for name, row in self._rows.items():
            row.show_value(getattr(model, name))

    def _enter(self, name: str, value: object) -> None:
        try:
            changed = type(self._model).model_validate(self._model.model_dump() | {name: value})
        except ValidationError as error:
            self._rows[name].refuse(fault_text(error.errors()[0]))
            return
        self._rows[name].accept()
        if changed != self._model:
            self._model = changed
            self.edited.emit(name, changed)


class SettingsPair(QWidget):
    """The main settings, and the others folded below them."""

    edited = Signal(str, object)
    marked = Signal()

    def __init__(self, model: type[BaseModel], main: tuple[str, ...], least_px: int = 0) -> None:
        super().__init__()
        more = tuple(parameter.name for parameter in parameters(model) if parameter.name not in main)
        self.main = SettingsForm(model, leave_out=more, least_px=least_px)
        self.help, self.name_px = self.main.help, self.main.name_px
        self.more = SettingsForm(model, leave_out=main, help_=self.help, least_px=least_px)
        self.unfold = button("More settings ▸", "flat", checkable=True)
        self.unfold.toggled.connect(self._fold)
        self._column = column(self.main, [self.unfold, ...], on=self)
        self.add_folded(self.more)
        for form in (self.main, self.more):
            form.edited.connect(self._receive)
            form.marked.connect(self.marked)

    @property
    def problem(self) -> str:
        """Description of the first invalid value; empty if all are valid."""
        return self.main.problem or self.more.problem

    def show_values(self, values: BaseModel) -> None:
        """Show the settings in both parts."""
        self.main.show_values(values)
        self.more.show_values(values)

    def _receive(self, name: str, values: BaseModel) -> None:
        self.show_values(values)  # the next edit in the other part starts from these values
        self.edited.emit(name, values)

    def add_folded(self, form: SettingsForm) -> None:
        """Add another form below the folded settings."""
        form.hide()
        self.unfold.toggled.connect(form.setVisible)
        self._column.addWidget(form)

    def _fold(self, open_: bool) -> None:
        self.unfold.setText("More settings ▾" if open_ else "More settings ▸")


def resources_form(pair: SettingsPair, names: tuple[str, ...], edited: SignalInstance) -> SettingsForm:
    """Return a form for settings of the run, folded below others; edits are emitted as name and value."""
    others = tuple(name for name in RunSettings.model_fields if name not in names)
    form = SettingsForm(RunSettings, leave_out=others, help_=pair.help, least_px=pair.name_px)
    form.edited.connect(lambda name, settings: edited.emit(name, getattr(settings, name)))
    pair.add_folded(form)
    return form


class _Row(QWidget):
    """Label, editor and unit in one line; an error message below."""

    entered = Signal(str, object)
    helped = Signal(str, str)
    marked = Signal()

    def __init__(self, parameter: Parameter, name_px: int) -> None:
        super().__init__()
        self._parameter = parameter
        self._problem = label("", "Problem", wrap=True)
        self._problem.hide()
        self._shown: object = _NOTHING
        self._editor = self._make_editor()
        self._editor.installEventFilter(self)
        names = {"accessibleName": parameter.label, "accessibleDescription": parameter.help}
        having(self._editor, toolTip=_help(parameter), **names)
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setHorizontalSpacing(GRID)
        grid.setVerticalSpacing(GRID // 2)
        name = QLabel(parameter.label.capitalize())
        name.setBuddy(self._editor)
        grid.addWidget(name, 0, 0)
        grid.addWidget(self._editor, 0, 1)
        grid.addWidget(label(parameter.unit, "Unit"), 0, 2)
        grid.addWidget(self._problem, 1, 0, 1, 4)
        grid.setColumnMinimumWidth(0, name_px)  # editors are aligned
        grid.setColumnStretch(1 if parameter.kind is str else 3, 1)  # text editors take the free width

    def enterEvent(self, event: QEnterEvent) -> None:
        """Show the help of the setting under the pointer."""
        super().enterEvent(event)
        self.helped.emit("pointer", _help(self._parameter))

    def leaveEvent(self, event: QEvent) -> None:
        """End the help of the setting under the pointer."""
        super().leaveEvent(event)
        self.helped.emit("pointer", "")

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Show the help of the setting with focus, and leave Undo and Redo to the study."""
        if event.type() == QEvent.Type.FocusIn:
            self.helped.emit("focus", _help(self._parameter))
        elif event.type() == QEvent.Type.FocusOut and not self._focus_returns(event):
            self.helped.emit("focus", "")
        elif event.type() == QEvent.Type.ShortcutOverride and isinstance(event, QKeyEvent):
            undoes = event.matches(QKeySequence.StandardKey.Undo) or event.matches(
                QKeySequence.StandardKey.Redo
            )
            if undoes and not self._is_half_typed:
                event.ignore()
                return True
        return super().eventFilter(watched, event)

    @staticmethod
    def _focus_returns(event: QEvent) -> bool:
        """Whether the editor loses the focus only to its list or another window."""
        reasons = (Qt.FocusReason.PopupFocusReason, Qt.FocusReason.ActiveWindowFocusReason)
        return isinstance(event, QFocusEvent) and event.reason() in reasons

    @property
    def _is_half_typed(self) -> bool:
        """Whether the editor's text is not a valid value yet."""
        editor = self._editor
        return isinstance(editor, QSpinBox) and editor.text() != editor.textFromValue(editor.value())

    def show_value(self, value: object) -> None:
        """Show a value without reporting it."""
        if value == self._shown:
            return
        editor = self._editor
        self._shown = value
        editor.blockSignals(True)
        if isinstance(editor, QCheckBox):
            editor.setChecked(bool(value))
        elif isinstance(editor, QComboBox):
            editor.setCurrentIndex(editor.findData(value.value if isinstance(value, Enum) else value))
        elif isinstance(editor, QSpinBox):
            editor.setValue(int(str(value)))
        elif isinstance(editor, QLineEdit) and editor.hasFocus() and self._stands_for(value):
            self._shown = _NOTHING  # the text is formatted later
        elif isinstance(editor, QLineEdit):
            editor.setText("" if value is None else f"{value:g}" if isinstance(value, float) else str(value))
            editor.setCursorPosition(0)
        editor.blockSignals(False)
        self.accept()

    def _stands_for(self, value: object) -> bool:
        """Whether the text that is being typed, such as "2.", already means the value."""
        assert isinstance(self._editor, QLineEdit), "other editors show their values always"
        try:
            return self._parsed(self._editor.text()) == value
        except ValueError:
            return False

    @property
    def problem(self) -> str:
        """Setting and fault; empty if the value is valid."""
        fault = self._problem.text()
        return f"{self._parameter.label.capitalize()}: {fault[0].lower()}{fault[1:]}" if fault else ""

    def refuse(self, fault: str = "must be a number") -> None:
        """Mark the text as invalid, and show the bounds, or the fault."""
        self._shown = _NOTHING
        bounds = self._parameter.bounds
        text = f"must be {bounds} {self._parameter.unit}".strip() if bounds else fault
        self._mark(f"{text[0].upper()}{text[1:]}")

    def accept(self) -> None:
        """Clear the error message."""
        self._mark("")

    def _mark(self, problem: str) -> None:
        if problem != self._problem.text():
            self._problem.setText(problem)
            self._problem.setVisible(bool(problem))
            restyle(self._editor, "invalid", bool(problem))
            self.marked.emit()

    def _make_editor(self) -> QWidget:
        parameter = self._parameter
        if parameter.kind is bool:
            tick = QCheckBox()
            tick.toggled.connect(self._report)
            return tick
        if parameter.choices:
            choice = QComboBox()
            offer(choice, {_LABELS.get(value, value.capitalize()): value for value in parameter.choices})
            choice.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToContents)
            choice.setMinimumWidth(scaled(_EDITOR))
            choice.activated.connect(lambda _: self._report(choice.currentData()))
            return choice
        if (
            parameter.kind is int
            and not parameter.automatic
            and parameter.low is not None
            and parameter.high is not None
        ):
            number = NumberBox(int(parameter.low), int(parameter.high))
            number.setKeyboardTracking(False)
            number.setFixedWidth(scaled(_EDITOR))
            number.setAlignment(Qt.AlignmentFlag.AlignRight)
            number.valueChanged.connect(self._report)
            return number
        text = QLineEdit(placeholderText=parameter.if_none if parameter.automatic else parameter.example)
        if parameter.kind is str:
            text.setMinimumWidth(_TEXT_EDITOR)
        else:
            text.setFixedWidth(scaled(_EDITOR))
            text.setAlignment(Qt.AlignmentFlag.AlignRight)
        text.textEdited.connect(self._report_text)
        return text

    def _report(self, value: Any) -> None:  # noqa: ANN401 - whatever the editor holds
        self._shown = _NOTHING
        self.entered.emit(self._parameter.name, value)

    def _report_text(self, text: str) -> None:
        try:
            value = self._parsed(text)
        except ValueError:
            self.refuse()
            return
        self._report(value)

    def _parsed(self, text: str) -> object:
        """Return the value of a text; raises ValueError if there is none."""
        if not text.strip() and self._parameter.automatic:
            return None
        if self._parameter.kind is str:
            return text
        number = parse_number(text)
        return int(number) if self._parameter.kind is int and number.is_integer() else number


def _help(parameter: Parameter) -> str:
    bounds = (
        f"{parameter.low} or more"
        if parameter.high is not None and parameter.high >= _NO_BOUND
        else parameter.bounds
    )
    return f"{parameter.help} ({bounds} {parameter.unit})".replace(" )", ")") if bounds else parameter.help
