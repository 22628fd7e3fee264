"""The subjects of two groups along their discriminant, or along the change that a number brings."""

from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtGui import QPainter

from homolog.arrays import FloatArray
from homolog_app.window.explore.mode_plots import ELLIPSES, ScatterPlot
from homolog_app.window.quantities import short, signed
from homolog_app.window.theme import Theme

if TYPE_CHECKING:
    from homolog_app.window.explore.group_answer import GroupAnswer

__all__ = ["GroupPlot"]

_WAVE = 2.4  # radians from subject to subject, so that neighbours don't hide each other


class GroupPlot(ScatterPlot):
    """Each subject's place between the groups, a line of markers for each; click selects, a drag morphs.

    `ends` are the places of the groups' means.
    """

    def __init__(self, theme: Theme) -> None:
        super().__init__(theme)
        self.setAccessibleName("Subjects along the discriminant")
        self.hint = "The position of each subject between the groups appears here after the comparison."
        self.y_ticks: list[float] | None = []
        self.unit = "mm"
        del self.options[ELLIPSES]  # the height means nothing
        self.ends = (0.0, 1.0)
        self._line: tuple[float, float] | None = None

    def show_answer(self, answer: "GroupAnswer | None") -> None:
        """Show the places of an answer's subjects, or none."""
        if answer is None or answer.places is None:
            self.show_scores(np.empty((0, 2)), (), (), ("", ""))
            return
        if answer.values is not None:
            self._show_slope(answer, answer.places, answer.values)
            return
        pair, names = answer.pair, answer.shape.result.names
        groups = [answer.study.labels[subject] for subject in pair.subjects]
        rows = [(1.0 if group == answer.first else 0.0) for group in groups]
        heights = np.array(rows) + 0.3 * np.sin(_WAVE * np.arange(len(rows)))
        self.show_scores(
            np.column_stack([answer.places, heights]), [names[subject] for subject in pair.subjects], groups,
            ("position along the discriminant, RMS over the particles (mm)", ""),
        )  # fmt: skip
        reach = 1.1 * float(np.abs(answer.places).max())
        self.x_range, self.y_range = (-reach, reach), (-0.7, 1.7)
        self._line, self.y_ticks = None, []
        first = np.array(groups) == answer.first
        self.ends = float(answer.places[first].mean()), float(answer.places[~first].mean())
        self.title = "Subjects along the discriminant"
        self.update()

    def _show_slope(self, answer: "GroupAnswer", places: FloatArray, values: FloatArray) -> None:
        """Show the number across, and how far each subject lies along its effect upwards."""
        column, names = answer.study.request.column, answer.shape.result.names
        subjects = [names[subject] for subject in answer.pair.subjects]
        self.show_scores(
            np.column_stack([values, places]), subjects, answer.groups, (column, "along the effect (mm)")
        )
        self.ends = float(values.min()), float(values.max())
        rim = 0.06 * (self.ends[1] - self.ends[0])
        reach = 1.15 * float(np.abs(places).max())
        self.x_range, self.y_range = (self.ends[0] - rim, self.ends[1] + rim), (-reach, reach)
        length = float(np.linalg.norm(answer.pair.pointwise.effect[0])) / np.sqrt(len(answer.pair.mean))
        self._line, self.y_ticks = (float(values.mean()), length), None
        self.title = f"Subjects by {column}"
        self.update()

    def paint_ground(self, painter: QPainter) -> None:
        """Paint the border between the groups, or the line of the regression."""
        if self._line is None:
            painter.drawLine(self.place(0.0, self.y_range[0]), self.place(0.0, self.y_range[1]))
            return
        middle, slope = self._line
        low, high = (self.place(x, slope * (x - middle)) for x in self.ends)
        painter.drawLine(low, high)

    def paint_cursor(self, painter: QPainter) -> None:
        """Paint a line where the shape that is shown lies."""
        x, _ = self.mark
        painter.drawLine(self.place(x, self.y_range[0]), self.place(x, self.y_range[1]))

    def words_of(self, name: str) -> str:
        """Return a subject's place in words."""
        if self._line is None:
            return super().words_of(name)
        x, y = self.point_of(name)
        return f"{name}: {self.x_label} {short(x)}, {signed(y)} mm along the effect"
