"""The stage of the views with its bars: display options, cutting plane, colour range, menu."""

from collections.abc import Callable, Sequence

import numpy as np
from PySide6.QtCore import QSignalBlocker, QSize, Qt, Signal, SignalInstance, Slot
from PySide6.QtGui import QColor, QIcon, QPixmap, QResizeEvent
from PySide6.QtWidgets import (
    QCheckBox,
    QColorDialog,
    QDialog,
    QDialogButtonBox,
    QFrame,
    QGridLayout,
    QLabel,
    QLineEdit,
    QMenu,
    QSplitter,
    QStackedWidget,
    QWidget,
)

from homolog_app.rendering.camera import Clip, ClipPlane, Display, Layer
from homolog_app.rendering.colours import ColourScale
from homolog_app.rendering.grid import VIEWS
from homolog_app.rendering.text import parse_number, short
from homolog_app.window.actions import Actions
from homolog_app.window.scene import Scene
from homolog_app.window.slice_view import SliceView
from homolog_app.window.theme import Theme, pixmap, scaled
from homolog_app.window.widgets import (
    DIALOG_EDGES,
    GRID,
    ActionButton,
    PercentEdit,
    button,
    choice,
    column,
    having,
    label,
    link,
    named_rows,
    row,
    set_primary,
    show_all,
    slider,
)

__all__ = ["ClipBar", "LayerBar", "RangeDialog", "Stage", "ViewBar", "ViewFooter", "view_menu"]


_IN_MENU = ("view.raw", "view.groomed", "view.particles", "view.clip")
_PICTURES = ("view.copy", "view.screenshot", "view.range")


def view_menu(window: QWidget, actions: Actions) -> QMenu:
    """Return the menu of a view, without the entries for its subject."""
    menu = QMenu(window)
    camera = menu.addMenu("Look from")
    for view in VIEWS:
        camera.addAction(actions[f"view.{view}"])
    menu.addAction(actions["view.reset"])
    menu.addSeparator()
    for part in (_IN_MENU, _PICTURES):
        for identifier in part:
            menu.addAction(actions[identifier])
        menu.addSeparator()
    return menu


_SHOWN = ("view.raw", "view.groomed", "view.particles", "view.slice", "view.clip")
_GRIDS = ("view.grid1", "view.grid4", "view.grid9", "view.grid16")
_LOOKS = ("view.link", "view.reset", "view.screenshot")
_SPACING = 2
_BAR_EDGES = (GRID, GRID // 2, GRID, GRID // 2)


class ViewBar(QFrame):
    """Buttons of the views' commands and the opacity of surfaces, in a narrow window without its slider."""

    opacity_changed = Signal(float)

    def __init__(self, actions: Actions) -> None:
        super().__init__()
        self.setObjectName("ViewBar")
        shown, grids, looks = (
            [actions.button(name, self) for name in part] for part in (_SHOWN, _GRIDS, _LOOKS)
        )
        self._name = label("Opacity", "Hint")
        self.opacity = slider("Opacity of surfaces", 10, 100, value=100, toolTip="Opacity of the surfaces")
        self.opacity.setFixedWidth(38)
        self.opacity.valueChanged.connect(lambda value: self.opacity_changed.emit(value / 100.0))
        self.percent = PercentEdit("Opacity of surfaces in percent", self.opacity)
        self.percent.setFixedWidth(scaled(46))
        opacity = (self._name, self.opacity, self.percent, label("%", "Unit"))
        row(*shown, GRID, *opacity, ..., *grids, GRID, *looks, on=self, edges=_BAR_EDGES, gap=_SPACING)

    def minimumSizeHint(self) -> QSize:
        """Return the size without the slider and its name."""
        least = super().minimumSizeHint()
        return least if self.opacity.isHidden() else least - QSize(self._spare, 0)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Show the slider and its name if there is room."""
        super().resizeEvent(event)
        fits = event.size().width() >= self.minimumSizeHint().width() + self._spare
        for part in (self._name, self.opacity):
            part.setVisible(fits)

    @property
    def _spare(self) -> int:
        """Width of the slider and its name."""
        return self._name.sizeHint().width() + self.opacity.width() + 2 * _SPACING


_IN_A_ROW = 4


class LayerBar(QFrame):
    """The structures of the subjects: colour, visibility and opacity of each; the legend of the views."""

    changed = Signal(object)

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("ViewBar")
        self._grid = QGridLayout(self)
        self._grid.setContentsMargins(GRID, GRID // 2, GRID, GRID // 2)
        self._grid.setHorizontalSpacing(2 * GRID)
        self._grid.setVerticalSpacing(_SPACING)
        self._grid.setColumnStretch(_IN_A_ROW, 1)
        self.rows: dict[str, _LayerRow] = {}
        self.hide()

    def show_layers(self, names: Sequence[str], display: Display, *, coloured: bool) -> None:
        """Show the structures, in the order of their colours; colours are hidden where they mean values."""
        self.setVisible(bool(names))
        if list(names) != list(self.rows):
            for row in self.rows.values():
                row.hide()  # the event loop deletes it later
                row.deleteLater()
            self.rows = {name: _LayerRow(name, self.changed) for name in names}
            for place, row in enumerate(self.rows.values()):
                self._grid.addWidget(row, *divmod(place, _IN_A_ROW))
        for place, (name, row) in enumerate(self.rows.items()):
            row.show_layer(display.layer(name), place, coloured=coloured)


class _LayerRow(QWidget):
    """One structure: colour, name with visibility, opacity."""

    def __init__(self, name: str, changed: SignalInstance) -> None:
        super().__init__()
        self._layer, self._changed = Layer(name=name), changed
        side = scaled(26)
        self.colour = button("", "flat", self._choose_colour, toolTip=f"Colour of {name}")
        self.colour.setAccessibleName(f"Colour of {name}")
        self.colour.setFixedSize(side, side)
        self.shown = having(QCheckBox(name), toolTip=f"Show {name}")
        self.shown.clicked.connect(lambda shown: self._change(shown=shown))
        self.opacity = slider(f"Opacity of {name}", 10, 100, toolTip=f"Opacity of {name}")
        self.opacity.setFixedWidth(scaled(48))
        self.opacity.valueChanged.connect(lambda value: self._change(opacity=value / 100.0))
        self.setFixedHeight(side)
        row(self.colour, self.shown, self.opacity, on=self, gap=GRID // 2)

    def show_layer(self, layer: Layer, place: int, *, coloured: bool) -> None:
        """Show the state of the structure at a place among all."""
        self._layer = layer
        picture = QPixmap(scaled(14), scaled(14))
        picture.fill(QColor(*layer.colour_at(place)))
        self.colour.setIcon(QIcon(picture))
        self.colour.setVisible(not coloured)
        self.shown.setChecked(layer.shown)
        with QSignalBlocker(self.opacity):
            self.opacity.setValue(round(100.0 * layer.opacity))
        self.opacity.setEnabled(layer.shown)

    def _change(self, **fields: object) -> None:
        self._changed.emit(self._layer.model_copy(update=fields))

    def _choose_colour(self) -> None:
        before = self.colour.icon().pixmap(1, 1).toImage().pixelColor(0, 0)
        chosen = QColorDialog.getColor(before, self, f"Colour of {self._layer.name}")
        if chosen.isValid():
            self._change(colour=chosen.name())


class ViewFooter(QFrame):
    """The strip below the views: pages, and the playback of a run."""

    frame_chosen = Signal(int)

    def __init__(self, actions: Actions) -> None:
        super().__init__()
        self.setObjectName("ViewFooter")
        self.play = actions.button("run.play", self)
        self.time = slider("Position in the run", 0, 0)
        self.time.valueChanged.connect(self.frame_chosen)
        self.moment, self.page = having(label("", "Hint"), minimumWidth=120), label("", "Hint")
        self.ready = ActionButton("Modes are ready", actions["explore.modes"])
        self.ready.hide()
        turns = (actions.button("view.previous", self), self.page, actions.button("view.next", self))
        row(self.ready, self.play, (self.time, 1), self.moment, ..., *turns, on=self, edges=_BAR_EDGES)
        self._of_run = True
        self.show_frames(0)

    def show_parts(self, *, run: bool, pages: bool) -> None:
        """Show the playback where the views show particles of a run, and pages where they show subjects."""
        self._of_run = run
        self.setVisible(run or pages)
        self._show_playback()

    def show_frames(self, count: int) -> None:
        """Set the number of a run's frames, or none; the last one is shown."""
        self.time.blockSignals(True)
        self.time.setRange(0, max(0, count - 1))
        self.time.setValue(max(0, count - 1))
        self.time.blockSignals(False)
        self._show_playback()

    def _show_playback(self) -> None:
        show_all(self._of_run and self.time.maximum() > 0, self.play, self.time, self.moment)

    def show_page(self, first: int, last: int, total: int) -> None:
        """Show the numbers of the subjects shown."""
        text = f"{first}–{last} of {total}" if last > first else f"{first} of {total}"
        self.page.setText(text if total else "")


class RangeDialog(QDialog):
    """Lowest and highest value of the colour scale, with immediate effect.

    Parameters
    ----------
    parent : QWidget
    scale : ColourScale
        The current range.
    choose : callable
        Receives the chosen range, or None for an automatic one.
    current : callable
        Returns the resulting range, None if colours are no longer shown.
    """

    def __init__(
        self,
        parent: QWidget,
        scale: ColourScale,
        choose: Callable[[tuple[float, float] | None], object],
        current: Callable[[], ColourScale | None],
    ) -> None:
        super().__init__(parent)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self._choose, self._current = choose, current
        having(self, windowTitle="Colour range", minimumWidth=360)
        self.low, self.high = QLineEdit(short(scale.low)), QLineEdit(short(scale.high))
        unit = f" ({scale.unit})" if scale.unit else ""
        self.symmetric = QCheckBox("Symmetric about 0")
        rows = ((f"Lowest{unit}", self.low), (f"Highest{unit}", self.high))
        for text, box in rows:
            box.setAccessibleName(text)
        form = named_rows(rows)
        form.setVerticalSpacing(GRID)
        form.addWidget(self.symmetric, len(rows), 1)
        self.problem = label("", "Problem", wrap=True)
        tip = "Set the range automatically from the values shown"
        self.automatic = button("Automatic", does=lambda: self._receive(None), toolTip=tip)
        buttons = QDialogButtonBox(
            QDialogButtonBox.StandardButton.Apply | QDialogButtonBox.StandardButton.Close,
            parent=self,  # its style sheet is needed when icons are created
        )
        buttons.addButton(self.automatic, QDialogButtonBox.ButtonRole.ResetRole)
        self.apply = buttons.button(QDialogButtonBox.StandardButton.Apply)
        self.apply.setDefault(True)
        set_primary(self.apply, primary=True)
        self.apply.clicked.connect(self._apply)
        buttons.rejected.connect(self.reject)
        title = label(scale.title, "SectionTitle", wrap=True)
        column(title, form, self.problem, buttons, on=self, edges=DIALOG_EDGES, gap=2 * GRID)
        self.symmetric.toggled.connect(self._follow)
        self.symmetric.setChecked(scale.low == -scale.high)
        self.high.textEdited.connect(self._follow)
        self.problem.hide()
        self.high.selectAll()
        self.high.setFocus()

    def _receive(self, chosen: tuple[float, float] | None) -> None:
        """Choose a range, and show the resulting one."""
        self._choose(chosen)
        if (scale := self._current()) is not None:
            self.low.setText(short(scale.low))
            self.high.setText(short(scale.high))

    @Slot()
    def _follow(self) -> None:
        """Keep the lower end at the negative of the upper one."""
        self.low.setEnabled(not self.symmetric.isChecked())
        if self.symmetric.isChecked():
            text = self.high.text().strip()
            self.low.setText(text[1:] if text[:1] in ("-", "−") else f"−{text}")

    @Slot()
    def _apply(self) -> None:
        try:
            low, high = parse_number(self.low.text()), parse_number(self.high.text())
        except ValueError:
            low = high = 0.0
        valid = low < high and abs(low) + abs(high) < float("inf")
        self.problem.setText("Enter two numbers; the lowest value must be less than the highest.")
        self.problem.setVisible(not valid)
        self.adjustSize()
        if valid:
            self._receive((low, high))


_AXES = ("long", "middle", "short")
_HAND = "hand"
_PLANES = {
    "Axial": ClipPlane.AXIAL,
    "Coronal": ClipPlane.CORONAL,
    "Sagittal": ClipPlane.SAGITTAL,
    "Facing the camera": ClipPlane.VIEW,
    "Across the long axis": "long",
    "Along it, broad section": "short",
    "Along it, narrow section": "middle",
    "By hand": _HAND,
}
_ENDS = {
    ClipPlane.AXIAL: ("I", "S"),
    ClipPlane.CORONAL: ("A", "P"),
    ClipPlane.SAGITTAL: ("R", "L"),
    ClipPlane.VIEW: ("near", "far"),
}
_STEPS = 200


class ClipBar(QFrame):
    """Orientation and position of the plane, and the removed side.

    Parameters
    ----------
    scene : Scene
        Its shapes have the axes of some planes, and its handle turns those that are not anatomical.
    """

    changed = Signal()

    def __init__(self, scene: Scene) -> None:
        super().__init__()
        self.setObjectName("ViewBar")
        self._scene = scene
        self._normal = np.array([0.0, 0.0, 1.0])
        tip = "Orientation of the cutting plane; the same for all shapes. Drag its arrow to turn it."
        self.plane = having(choice("Cutting plane", _PLANES, tip), minimumContentsLength=14)
        place = "Position of the cutting plane"
        self.position = slider(place, 0, _STEPS, value=_STEPS // 2, pageStep=_STEPS // 10, toolTip=place)
        self.position.setMinimumWidth(60)
        self.low, self.high = label("", "Hint"), label("", "Hint")
        self.percent = PercentEdit("Position of the cutting plane in percent", self.position)
        self.flip = button("Flip", "pick", checkable=True, toolTip="Remove the other side")
        ends = (self.low, (self.position, 1), self.high, self.percent, label("%", "Unit"))
        row(self.plane, *ends, self.flip, on=self, edges=_BAR_EDGES)
        self.plane.currentIndexChanged.connect(self.face)
        link(self._follow, self.position.valueChanged, self.flip.toggled)
        scene.plane_turned.connect(self._take)
        self._follow()
        self.hide()

    @property
    def clip(self) -> Clip:
        """The chosen plane."""
        plane = self.plane.currentData()
        x, y, z = self._normal.tolist()
        return Clip(
            plane=ClipPlane.FREE if plane in (*_AXES, _HAND) else plane,
            position=self.position.value() / _STEPS,
            flipped=self.flip.isChecked(),
            normal=(x, y, z),
        )

    @Slot()
    def face(self) -> None:
        """Turn the plane as chosen, and remove the side of the viewer."""
        plane, axes = self.plane.currentData(), self._scene.principal_axes
        if plane in _AXES and axes is not None:
            self._normal = axes[_AXES.index(plane)]
        ahead = self._scene.grid.cells[0].axes[2]
        kept, _ = self.clip.model_copy(update={"flipped": False}).cut((-1.0, 1.0) * 3, ahead)
        with QSignalBlocker(self.flip):
            self.flip.setChecked(bool(kept @ ahead < -_SIDEWAYS))
        self._follow()

    @Slot(object)
    def _take(self, clip: Clip) -> None:
        """Follow the handle."""
        self._normal = np.array(clip.normal)
        with QSignalBlocker(self.plane), QSignalBlocker(self.position), QSignalBlocker(self.flip):
            self.plane.setCurrentIndex(list(_PLANES.values()).index(_HAND))
            self.position.setValue(round(_STEPS * clip.position))
            self.flip.setChecked(False)
        self.percent.show_value(100.0 * clip.position)
        self._follow()

    @Slot()
    def _follow(self) -> None:
        low, high = _ENDS.get(self.plane.currentData(), ("", ""))
        self.low.setText(low)
        self.high.setText(high)
        self.changed.emit()


_SIDEWAYS = 1e-6
_NARROWEST = 160


class Stage(QWidget):
    """Contains scene and slices, and a hint that replaces them."""

    def __init__(self, theme: Theme, actions: Actions) -> None:
        super().__init__()
        self.bar = ViewBar(actions)
        self.layers = LayerBar()
        self.footer = ViewFooter(actions)
        self.slices = SliceView(theme)
        self.scene = Scene(self)
        self.clip = ClipBar(self.scene)
        self._theme = theme
        self._sign = QLabel(alignment=Qt.AlignmentFlag.AlignHCenter)
        self._title = label("", "EmptyTitle")
        self._text = having(label("", "Hint", wrap=True), alignment=Qt.AlignmentFlag.AlignHCenter)
        self._text.setFixedWidth(420)
        self._pages = QStackedWidget()
        self._split = QSplitter()
        self._split.setChildrenCollapsible(False)
        self.scene.setMinimumWidth(_NARROWEST)
        for widget in (self.scene, self.slices):
            self._split.addWidget(widget)
        for page in (self._empty(), self._split):
            self._pages.addWidget(page)
        parts = (self.bar, self.layers, self.clip, (self._pages, 1), self.footer)
        self._column = column(*parts, on=self, gap=0)
        theme.changed.connect(self._paint)
        self._paint()

    def show_hint(self, title: str, text: str) -> None:
        """Show a hint instead of the views."""
        self._title.setText(title)
        self._text.setText(text)
        self._pages.setCurrentIndex(0)

    def show_views(self) -> None:
        """Show the 3-D views."""
        self.slices.hide()
        self.scene.show()
        self._pages.setCurrentWidget(self._split)

    def show_slices(self) -> None:
        """Show the slices, alone or next to the views."""
        self.slices.show()
        self._split.setSizes([1, 1])
        self.scene.setVisible(self.slices.beside.isChecked())
        self._pages.setCurrentWidget(self._split)

    def place_card(self, card: QWidget) -> None:
        """Place a card between the views and the strip below them."""
        self._column.insertWidget(self._column.indexOf(self.footer), card)

    def _empty(self) -> QWidget:
        page = having(QWidget(), objectName="Workspace")
        page.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        column(..., *([..., part, ...] for part in (self._sign, self._title, self._text)), ..., on=page)
        return page

    def _paint(self) -> None:
        self._sign.setPixmap(pixmap("cohort", self._theme.colours.faint, 56))
        self.scene.paint(self._theme.colours)
