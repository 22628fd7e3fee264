"""Live curves of the three energies."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from homolog.arrays import FloatArray
from homolog_app.window.explore.plot import Plot
from homolog_app.window.theme import Theme

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

__all__ = ["EnergyCurves"]

_MOST_POINTS = 400
_AHEAD = 0.25  # share of further iterations of a run for which there is room


class EnergyCurves(Plot):
    """The parts of the objective over the iterations."""

    def __init__(self, theme: Theme) -> None:
        super().__init__(
            theme, "Energies", "The three energies appear here while particles are being placed."
        )
        self._rows: FloatArray = np.empty((0, 4))
        self._ahead = 0.0

    @property
    def is_empty(self) -> bool:
        """Whether there are no two iterations."""
        return len(np.unique(self._rows[:, 0])) < 2

    def show_rows(self, rows: FloatArray | Sequence[Sequence[float]], *, is_live: bool = False) -> None:
        """Show energies (T, 4): iteration and the three parts. Further ones follow if they are live."""
        table = np.asarray(rows, dtype=np.float64).reshape(-1, 4)
        every = max(1, len(table) // _MOST_POINTS)
        self._rows = np.concatenate([table[::every], table[-1:]]) if len(table) else table
        if is_live and self._ahead and self._fits():
            self.follow()
        else:
            self._ahead = _AHEAD if is_live else 0.0
            self.redraw()

    def draw(self, figure: "Figure") -> None:
        """Draw the frames."""
        from homolog_app.plots import draw_energy_frames

        draw_energy_frames(figure.subplots(1, 3), self._rows, self.theme.colours, self._ahead)

    def draw_moving(self, figure: "Figure") -> "Sequence[Artist]":
        """Draw the curves."""
        from homolog_app.plots import draw_energy_curves

        return draw_energy_curves(figure.axes, self._rows, self.theme.colours)

    def _fits(self) -> bool:
        """Whether the newest values are within the frames that were drawn."""
        axes = self.canvas.figure.axes if self.canvas is not None else []
        iteration, *values = self._rows[-1].tolist()
        return bool(axes) and all(
            frame.viewLim.x0 <= self._rows[0, 0] and frame.viewLim.contains(iteration, value)
            for frame, value in zip(axes, values, strict=True)
            if np.isfinite(value) and value
        )
