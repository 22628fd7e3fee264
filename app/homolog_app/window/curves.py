"""Live curves of the three energies."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from homolog.arrays import FloatArray
from homolog_app.window.explore.plot import Plot
from homolog_app.window.theme import Theme

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["EnergyCurves"]

_MOST_POINTS = 400


class EnergyCurves(Plot):
    """The parts of the objective over the iterations."""

    def __init__(self, theme: Theme) -> None:
        super().__init__(
            theme, "Energies", "The three energies appear here while particles are being placed."
        )
        self._rows: FloatArray = np.empty((0, 4))

    @property
    def is_empty(self) -> bool:
        """Whether there are no two iterations."""
        return len(np.unique(self._rows[:, 0])) < 2

    def show_rows(self, rows: FloatArray | Sequence[Sequence[float]]) -> None:
        """Show energies of shape (T, 4): iteration and the three parts."""
        table = np.asarray(rows, dtype=np.float64).reshape(-1, 4)
        every = max(1, len(table) // _MOST_POINTS)
        self._rows = np.concatenate([table[::every], table[-1:]]) if len(table) else table
        self.redraw()

    def draw(self, figure: "Figure") -> None:
        """Draw the three curves."""
        from homolog_app.plots import draw_energies

        draw_energies(figure.subplots(1, 3), self._rows, self.theme.colours)
