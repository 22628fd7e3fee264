"""Plots of the modes: eigenvalues, and the subjects' scores in two modes."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, cast

import numpy as np
from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QMenu, QToolTip, QWidget

from homolog.arrays import FloatArray
from homolog.statistics.parallel import ParallelAnalysis
from homolog_app.rendering.text import signed
from homolog_app.scenes.states import REACH
from homolog_app.window.explore.plot import Plot
from homolog_app.window.session import Session
from homolog_app.window.theme import Theme
from homolog_app.window.widgets import row

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.backend_bases import LocationEvent, MouseEvent
    from matplotlib.figure import Figure

    from homolog_app.scenes.model_shape import ModelShape
    from homolog_app.window.explore.plot_canvas import PlotCanvas

__all__ = ["ELLIPSES", "ModePlots", "ScatterPlot", "ScreePlot", "axis_menu"]

_NEAR_PX, _DRAG_PX = 10.0, 4.0
_OPENS = "▾"
NAMES, ELLIPSES = "Names of all subjects", "95 % ellipses of the groups"


class ScreePlot(Plot):
    """Variance of each mode as a bar, and the threshold of parallel analysis. A click chooses a mode."""

    mode_chosen = Signal(int)

    def __init__(self, theme: Theme) -> None:
        super().__init__(theme, "Variance of the modes", "The variance of each mode appears here.")
        self._parallel: ParallelAnalysis | None = None

    @property
    def is_empty(self) -> bool:
        """Whether there is no model yet."""
        return self._parallel is None

    def show_model(self, shape: "ModelShape | None") -> None:
        """Show the eigenvalues of a model."""
        self._parallel = parallel = shape.parallel if shape is not None else None
        if parallel is not None:
            shares = 100.0 * parallel.eigenvalues / parallel.eigenvalues.sum()
            each = ", ".join(f"mode {mode}: {share:.1f} %" for mode, share in enumerate(shares[:16], start=1))
            noun = "mode" if parallel.n_retained == 1 else "modes"
            self.setAccessibleDescription(f"{parallel.n_retained} {noun} retained; {each}")
        self.redraw()

    def draw(self, figure: "Figure") -> None:
        """Draw the bars and the threshold."""
        from homolog_app.plots import draw_scree

        parallel = self._parallel
        assert parallel is not None
        axes, colours = figure.subplots(), self.theme.colours
        draw_scree(
            axes, parallel.eigenvalues, parallel.threshold, parallel.n_retained, parallel.percentile, colours
        )

    def press(self, event: "MouseEvent") -> None:
        """Choose the mode whose bar is clicked."""
        if self._parallel is not None and event.xdata is not None:
            mode = round(event.xdata) - 1
            if 0 <= mode < len(self._parallel.eigenvalues):
                self.mode_chosen.emit(mode)


class ScatterPlot(Plot):
    """Each subject's scores in two modes. Click selects; a drag morphs the shape to the pointer.

    A click with Ctrl adds a subject to the selection, or removes it; selected subjects are named.

    With the keyboard, the left and right arrow go from subject to subject. Where there is a choice of what is
    plotted, a click on the label of an axis offers it, and so does the menu.
    """

    subject_chosen = Signal(str)
    subject_toggled = Signal(str)
    axes_chosen = Signal(int, int)
    morphed = Signal(float, float)
    is_marked = True
    """Whether the position of the shape shown is drawn."""

    def __init__(self, theme: Theme) -> None:
        super().__init__(theme, "Subjects in two modes", "The scores of the subjects appear here.")
        self.points: FloatArray = np.empty((0, 2))
        self.names: Sequence[str] = ()
        self.groups: Sequence[str] = ()
        self.labels = ("", "")
        self.mark = (0.0, 0.0)
        self.choices: Sequence[str] = ()
        self.axes = (0, 1)
        self._selected: Sequence[str] = ()
        self._pressed: tuple[float, float] | None = None
        self._is_dragged = False
        self.options = {NAMES: False, ELLIPSES: False}
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)

    @property
    def is_empty(self) -> bool:
        """Whether there are no scores yet."""
        return not len(self.points)

    def show_scores(
        self, points: FloatArray, names: Sequence[str], groups: Sequence[str], labels: tuple[str, str]
    ) -> None:
        """Show scores (M, 2) [SD] of subjects, with their groups and axis labels."""
        self.points, self.names, self.groups, self.labels = points, names, groups, labels
        self.setAccessibleDescription(f"{' and '.join(filter(None, labels))} of {len(names)} subjects")
        self.redraw()

    def offer_axes(self, choices: Sequence[str]) -> None:
        """Offer quantities to plot, initially the first two."""
        last = max(0, len(choices) - 1)
        self.choices, self.axes = choices, (0, min(1, last))

    def choose_axis(self, axis: int, choice: int) -> None:
        """Plot one of the choices on the x axis (0) or y axis (1)."""
        self.axes = (choice, self.axes[1]) if axis == 0 else (self.axes[0], choice)
        self.axes_chosen.emit(*self.axes)

    def submenus(self, menu: QMenu) -> Sequence[QMenu]:
        """Return the choices of both axes."""
        return [axis_menu(self, axis, menu) for axis in (0, 1)] if self.choices else ()

    def show_selection(self, names: Sequence[str]) -> None:
        """Mark selected subjects."""
        self._selected = names
        if self.options[NAMES]:
            self.redraw()
        else:
            self.follow()

    def follow_selection(self, session: Session) -> None:
        """Show the selection of a session, and let clicks change it."""
        self.subject_chosen.connect(lambda name: session.select([name]))
        self.subject_toggled.connect(session.toggle_selected)
        session.selection_changed.connect(lambda: self.show_selection(session.selection))

    def show_cursor(self, x: float, y: float) -> None:
        """Mark the position of the shape shown [SD]."""
        self.mark = (x, y)
        self.follow()

    def draw(self, figure: "Figure") -> None:
        """Draw the subjects, and optionally the names of all."""
        from homolog_app.plots import draw_all_names

        axes = figure.subplots()
        self.draw_data(axes)
        for name in (axes.xaxis.label, axes.yaxis.label) if self.choices else ():
            name.set(text=f"{name.get_text()} {_OPENS}", color=self.theme.colours.accent)
        if self.options[NAMES]:
            draw_all_names(axes, self.points, self.names, self._selected, self.theme.colours)

    def draw_data(self, axes: "Axes") -> None:
        """Draw the subjects by group."""
        from homolog_app.plots import draw_scores

        ellipses = self.options[ELLIPSES]
        draw_scores(axes, self.points, self.groups, self.labels, self.theme.colours, ellipses=ellipses)
        reach = 1.1 * max(REACH, float(np.abs(self.points).max()))
        axes.set(xlim=(-reach, reach), ylim=(-reach, reach))

    def draw_moving(self, figure: "Figure") -> "Sequence[Artist]":
        """Draw the names of selected subjects, and the position of the shape shown."""
        from homolog_app.plots import draw_subjects

        axes = figure.axes[0]
        mark = [self.draw_mark(axes)] if self.is_marked else []
        if self.options[NAMES] or not set(self.names) & set(self._selected):
            return mark
        named = draw_subjects(axes, self.points, self.names, self._selected, self.theme.colours, others=False)
        return [*named, *mark]

    def draw_mark(self, axes: "Axes") -> "Artist":
        """Draw a cross at the shape shown."""
        from homolog_app.plots import draw_place

        return draw_place(axes, *self.mark, self.theme.colours)

    def listen(self, canvas: "PlotCanvas") -> None:
        """Handle clicks, drags and the pointer over a subject."""
        super().listen(canvas)
        canvas.mpl_connect("motion_notify_event", self._hover_or_drag)
        canvas.mpl_connect("button_release_event", self._release)
        canvas.mpl_connect("figure_leave_event", lambda _: QToolTip.hideText())

    def press(self, event: "MouseEvent") -> None:
        """Start a click or a drag, or offer the choices of an axis."""
        axis = self._axis_at(event)
        if axis is not None:
            menu = axis_menu(self, axis)
            menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
            menu.popup(event.guiEvent.globalPosition().toPoint())
            return
        self._pressed, self._is_dragged = (event.x, event.y), False

    def _hover_or_drag(self, event: "MouseEvent") -> None:
        if self.is_empty:
            return
        if self._pressed is None:
            name = self._nearest(event)
            at = event.guiEvent.globalPosition().toPoint()
            canvas = cast("QWidget", event.canvas)
            QToolTip.showText(at, self.text_of(name) if name else "", canvas)
            on_label = self._axis_at(event) is not None
            canvas.setCursor(Qt.CursorShape.PointingHandCursor if on_label else Qt.CursorShape.ArrowCursor)
            return
        way = np.hypot(event.x - self._pressed[0], event.y - self._pressed[1])
        if self._is_dragged or way > _DRAG_PX * event.canvas.device_pixel_ratio:
            self._is_dragged = True
            axes = event.canvas.figure.axes[0]
            self.morphed.emit(*axes.transData.inverted().transform((event.x, event.y)).tolist())

    def _release(self, event: "MouseEvent") -> None:
        """Select the clicked subject."""
        name = self._nearest(event)
        if self._pressed is not None and not self._is_dragged and name is not None:
            adds = "ctrl" in event.modifiers
            (self.subject_toggled if adds else self.subject_chosen).emit(name)
        self._pressed = None

    def _axis_at(self, event: "LocationEvent") -> int | None:
        """Return the axis, x (0) or y (1), whose label is under the pointer."""
        if self.is_empty or not self.choices:
            return None
        axes = event.canvas.figure.axes[0]
        labels = (axes.xaxis.label, axes.yaxis.label)
        boxes = [label.get_window_extent().padded(_NEAR_PX / 2.0) for label in labels]
        return next((axis for axis, box in enumerate(boxes) if box.contains(event.x, event.y)), None)

    def _nearest(self, event: "LocationEvent") -> str | None:
        if self.is_empty:
            return None
        places = event.canvas.figure.axes[0].transData.transform(self.points)
        gaps = np.hypot(*(places - [event.x, event.y]).T)
        nearest = int(gaps.argmin())
        near = gaps[nearest] <= _NEAR_PX * event.canvas.device_pixel_ratio
        return self.names[nearest] if near else None

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Go to the next or previous subject."""
        step = {Qt.Key.Key_Right: 1, Qt.Key.Key_Left: -1}.get(Qt.Key(event.key()), 0)
        if not step or self.is_empty:
            super().keyPressEvent(event)
            return
        chosen = [self.names.index(name) for name in self._selected if name in self.names]
        following = (chosen[0] + step) % len(self.names) if chosen else 0
        self.subject_chosen.emit(self.names[following])

    def text_of(self, name: str) -> str:
        """Return a subject's position as text."""
        index = self.names.index(name)
        x, y = self.points[index].tolist()
        return f"{self.title_of(index)}: {signed(x)}, {signed(y)} SD"

    def title_of(self, index: int) -> str:
        """Return a subject's name and group."""
        group = self.groups[index]
        return f"{self.names[index]} ({group})" if group else self.names[index]


def axis_menu(plot: ScatterPlot, axis: int, parent: QWidget | None = None) -> QMenu:
    """Return the menu of choices for the x axis (0) or y axis (1)."""
    menu = QMenu(("Horizontal axis", "Vertical axis")[axis], parent or plot)
    for index, text in enumerate(plot.choices):
        action = menu.addAction(text)
        action.setCheckable(True)
        action.setChecked(index == plot.axes[axis])
        action.triggered.connect(lambda _, index=index: plot.choose_axis(axis, index))
    return menu


class ModePlots(QWidget):
    """Eigenvalues at the left, subjects in two modes at the right."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.setObjectName("Curves")
        self.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        self.scree, self.scatter = ScreePlot(theme), ScatterPlot(theme)
        row((self.scree, 2), (self.scatter, 3), on=self, gap=0)

    def show_model(self, shape: "ModelShape | None") -> None:
        """Show the eigenvalues of a model and offer its modes."""
        self.scree.show_model(shape)
        self.scatter.offer_axes([f"Mode {mode + 1}" for mode in range(shape.modes if shape else 0)])

    def show_scores(self, scores: FloatArray, shape: "ModelShape", groups: Sequence[str]) -> None:
        """Show the subjects' scores (M, K) [SD] in the two modes."""
        x, y = self.scatter.axes
        texts = [
            f"mode {mode + 1} ({100 * shape.model.explained_variance_ratio_[mode]:.1f} %), SD"
            for mode in (x, y)
        ]
        self.scatter.show_scores(scores[:, [x, y]], shape.result.names, groups, (texts[0], texts[1]))
