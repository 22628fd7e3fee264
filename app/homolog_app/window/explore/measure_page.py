"""Measure."""

from pathlib import Path

from homolog_app.window.explore.page import ExplorePage

__all__ = ["MeasurePage"]


class MeasurePage(ExplorePage):
    """Distance, volume and area along a mode and for each subject."""

    title = "Measure"
    hint = "Distance, volume and area along a mode and for each subject."

    def enter(self) -> None:
        """Fit the model."""
        self.fitted.want()

    def write(self, path: Path) -> None:
        """Write."""
