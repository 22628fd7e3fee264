"""The subjects of two groups along their discriminant, or along the change that a number brings."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from homolog_app.rendering.text import short, signed
from homolog_app.window.explore.mode_plots import ELLIPSES, ScatterPlot
from homolog_app.window.theme import Theme

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

    from homolog_app.studies.answers import GroupAnswer

__all__ = ["GroupPlot"]


class GroupPlot(ScatterPlot):
    """Each subject's place between the groups, a line of markers for each; click selects, a drag morphs.

    `ends` are the places of the groups' means.
    """

    def __init__(self, theme: Theme) -> None:
        super().__init__(theme)
        self.setAccessibleName("Subjects along the discriminant")
        self.hint.setText(
            "The position of each subject between the groups appears here after the comparison."
        )
        del self.options[ELLIPSES]  # the height means nothing
        self.ends = (0.0, 1.0)
        self._answer: GroupAnswer | None = None

    def show_answer(self, answer: "GroupAnswer | None") -> None:
        """Show the places of an answer's subjects, or none."""
        if answer is None or answer.places is None:
            self._answer = None
            self.show_scores(np.empty((0, 2)), (), (), ("", ""))
            return
        self._answer = answer
        names = [answer.shape.result.names[subject] for subject in answer.pair.subjects]
        if answer.values is None:
            from homolog_app.plots import discriminant_points

            groups: Sequence[str] = [answer.study.labels[subject] for subject in answer.pair.subjects]
            second = np.array([group == answer.second for group in groups], dtype=bool)
            points = discriminant_points(answer.places, second)
            self.ends = float(answer.places[~second].mean()), float(answer.places[second].mean())
            self.title, label = "Subjects along the discriminant", "position along the discriminant (mm)"
        else:
            groups, points = answer.groups, np.column_stack([answer.values, answer.places])
            self.ends = float(answer.values.min()), float(answer.values.max())
            label = answer.study.request.column
            self.title = f"Subjects by {label}"
        self.show_scores(points, names, groups, (label, ""))

    def draw_data(self, axes: "Axes") -> None:
        """Draw the groups, or the line of the regression among the subjects."""
        from homolog_app.plots import draw_discriminant, draw_slope, group_order

        answer, colours = self._answer, self.theme.colours
        assert answer is not None
        assert answer.places is not None
        if answer.values is None:
            second = np.array([group == answer.second for group in self.groups], dtype=bool)
            order = group_order(answer.study.labels)
            draw_discriminant(axes, answer.places, second, (answer.first, answer.second), order, colours)
            return
        slope = float(np.linalg.norm(answer.pair.pointwise.effect[0])) / np.sqrt(len(answer.pair.mean))
        column = answer.study.request.column
        draw_slope(axes, answer.values, answer.places, self.groups, column, slope, colours)

    def draw_mark(self, axes: "Axes") -> "Artist":
        """Draw a line where the shape that is shown lies."""
        from homolog_app.plots import draw_place

        return draw_place(axes, self.mark[0], None, self.theme.colours)

    def text_of(self, name: str) -> str:
        """Return a subject's place in words."""
        index = self.names.index(name)
        x, y = self.points[index].tolist()
        if self._answer is None or self._answer.values is None:
            return f"{self.title_of(index)}: {signed(x)} mm"
        return f"{name}: {self.labels[0]} {short(x)}, {signed(y)} mm along the effect"
