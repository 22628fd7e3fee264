"""The subjects of two groups along their discriminant."""

from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtGui import QPainter

from homolog_app.window.explore.mode_plots import ScatterPlot
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
        self.hint = "Here stands where each subject lies between the groups, once they are compared."
        self.y_ticks: list[float] = []
        self.unit = "mm"
        self.ends = (0.0, 1.0)

    def show_answer(self, answer: "GroupAnswer | None") -> None:
        """Show the places of an answer's subjects, or none."""
        if answer is None or answer.places is None:
            self.show_scores(np.empty((0, 2)), (), (), ("", ""))
            return
        pair, names = answer.pair, answer.shape.result.names
        groups = [answer.study.labels[subject] for subject in pair.subjects]
        rows = [(1.0 if group == answer.first else 0.0) for group in groups]
        heights = np.array(rows) + 0.3 * np.sin(_WAVE * np.arange(len(rows)))
        self.show_scores(
            np.column_stack([answer.places, heights]), [names[subject] for subject in pair.subjects], groups,
            ("place along the discriminant, RMS over the particles (mm)", ""),
        )  # fmt: skip
        reach = 1.1 * float(np.abs(answer.places).max())
        self.x_range, self.y_range = (-reach, reach), (-0.7, 1.7)
        first = np.array(groups) == answer.first
        self.ends = float(answer.places[first].mean()), float(answer.places[~first].mean())
        self.title = "Subjects along the discriminant"
        self.update()

    def paint_ground(self, painter: QPainter) -> None:
        """Paint the border between the groups."""
        painter.drawLine(self.place(0.0, self.y_range[0]), self.place(0.0, self.y_range[1]))

    def paint_cursor(self, painter: QPainter) -> None:
        """Paint a line where the shape that is shown lies."""
        x, _ = self.mark
        painter.drawLine(self.place(x, self.y_range[0]), self.place(x, self.y_range[1]))
