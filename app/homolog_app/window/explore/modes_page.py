"""Modes."""

from homolog_app.window.explore.page import ExplorePage

__all__ = ["ModesPage"]


class ModesPage(ExplorePage):
    """What varies: move the mean shape along its modes of variation."""

    title = "Modes"
    hint = "What varies: move the mean shape along its modes of variation."

    def enter(self) -> None:
        """Fit the model."""
        self.fitted.want()
