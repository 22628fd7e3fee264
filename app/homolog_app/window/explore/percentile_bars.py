"""A patient's numbers among those of the controls, a line each."""

from typing import TYPE_CHECKING

from homolog_app.window.explore.plot import Plot
from homolog_app.window.theme import Theme

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from homolog.patient import PatientComparison, Reference

__all__ = ["PercentileBars"]

_HIGH = 232


class PercentileBars(Plot):
    """Controls as marks, their middle 90 % as a band, the patient as a diamond."""

    def __init__(self, theme: Theme) -> None:
        super().__init__(theme, "The patient among the controls", "")
        self._shown: tuple[PatientComparison, Reference] | None = None

    @property
    def is_empty(self) -> bool:
        """Whether there is no patient."""
        return self._shown is None

    def show_patient(self, comparison: "PatientComparison | None", reference: "Reference | None") -> None:
        """Show a patient, or nothing."""
        self._shown = None if comparison is None or reference is None else (comparison, reference)
        self.setFixedHeight(0 if self._shown is None else _HIGH)
        if self._shown is not None:
            from homolog_app.plots import percentile_rows

            texts = (f"{name}: {text}" for name, text, *_ in percentile_rows(*self._shown))
            self.setAccessibleDescription("; ".join(texts))
        self.redraw()

    def draw(self, figure: "Figure") -> None:
        """Draw the lines."""
        from homolog_app.plots import draw_percentiles

        assert self._shown is not None
        draw_percentiles(figure.subplots(4, 1), *self._shown, self.theme.colours)
