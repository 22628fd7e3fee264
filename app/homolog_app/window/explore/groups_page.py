"""Groups."""

from homolog_app.window.explore.page import ExplorePage

__all__ = ["GroupsPage"]


class GroupsPage(ExplorePage):
    """What differs between groups, and whether to trust it."""

    title = "Groups"
    hint = "What differs between groups, and whether to trust it."

    def enter(self) -> None:
        """Fit the model."""
        self.fitted.want()

    def test(self) -> None:
        """Test."""
