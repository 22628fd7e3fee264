"""Where the views look from: one camera for all of them, or one each."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from homolog_app.rendering.camera import VIEWS as ANATOMICAL
from homolog_app.rendering.camera import View

if TYPE_CHECKING:
    from homolog_app.window.scene.cell import ViewCell

__all__ = ["VIEWS", "Cameras", "ViewMargins"]

VIEWS = {
    "right": ANATOMICAL["right"],
    "left": ANATOMICAL["left"],
    "front": ANATOMICAL["anterior"],
    "back": ANATOMICAL["posterior"],
    "feet": ANATOMICAL["inferior"],
    "head": ANATOMICAL["superior"],
    "corner": View((-0.45, -1.0, 0.75), (0.0, 0.0, 1.0)),
}
"""From where the window's commands look."""

_FREE = 0.6
"""Share of a view that shapes may always take."""


@dataclass(frozen=True, slots=True)
class ViewMargins:
    """A view and the rim of it that shapes leave to texts; lengths in pixels.

    Attributes
    ----------
    width, height : float
        Of the view.
    beside, above : float
        Rims at the left and right, and at the top and bottom.
    """

    width: float
    height: float
    beside: float
    above: float

    def scale(self, across: float, along: float) -> float:
        """Return the parallel scale that shows shapes so many millimetres from the middle at most."""
        free = max(self.width - 2.0 * self.beside, _FREE * self.width)
        free_along = max(self.height - 2.0 * self.above, _FREE * self.height)
        return self.height * max(across / free, along / free_along)


class Cameras:
    """The cameras of all views, linked at first."""

    def __init__(self, cells: "Sequence[ViewCell]") -> None:
        self._cells = cells
        self._linked = True
        for cell in cells:
            cell.renderer.GetActiveCamera().ParallelProjectionOn()
        self.link(True)

    @property
    def linked(self) -> bool:
        """Whether there is one camera for all views."""
        return self._linked

    @property
    def each(self) -> list[Any]:
        """The camera of all views, or those of each if they are not linked."""
        return [cell.renderer.GetActiveCamera() for cell in self._first(self._cells)]

    def link(self, linked: bool) -> None:
        """Turn all views together, or each alone."""
        self._linked = linked
        camera = self._cells[0].renderer.GetActiveCamera()
        for cell in self._cells[1:]:
            if linked:
                cell.renderer.SetActiveCamera(camera)
            else:
                alone = camera.NewInstance()
                alone.DeepCopy(camera)
                cell.renderer.SetActiveCamera(alone)

    def turn(self, view: str) -> None:
        """Look from one of `VIEWS`."""
        look = VIEWS[view]
        for camera in self.each:
            camera.SetFocalPoint(0.0, 0.0, 0.0)
            camera.SetPosition(*look.toward)
            camera.SetViewUp(*look.up)

    def fit(self, count: int, room: ViewMargins) -> bool:
        """Show the whole shapes of the first views, as large as the largest allows.

        Parameters
        ----------
        count : int
            Number of views.
        room : Room
            Of a view.

        Returns
        -------
        bool
            Whether there is anything to show.
        """
        cells = self._cells[:count]
        points = np.concatenate([cell.points for cell in cells])
        for cell in self._first(cells) if len(points) else ():
            cell.fit(points, room)
        return len(points) > 0

    def widen(self, count: int, room: ViewMargins) -> None:
        """Zoom out where shapes of the first views would be cut; parameters as for `fit`."""
        cells = self._cells[:count]
        points = np.concatenate([cell.points for cell in cells])
        for cell in self._first(cells) if len(points) else ():
            cell.widen(points, room)

    def _first(self, cells: "Sequence[ViewCell]") -> "Sequence[ViewCell]":
        return cells[: 1 if self._linked else None]
