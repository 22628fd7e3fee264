"""Cutting one view's surfaces open with a plane: what is left of them, and the cut surface."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from vtkmodules.vtkCommonDataModel import vtkPlane
from vtkmodules.vtkFiltersCore import vtkCutter
from vtkmodules.vtkFiltersGeneral import vtkContourTriangulator
from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper

from homolog.arrays import BoolArray, FloatArray
from homolog_app.clipping import Cut

__all__ = ["Cutter"]

Vtk = Any  # VTK is untyped


class Cutter:
    """The cutting plane of a view, and the caps that close surfaces where it cuts them.

    VTK's mappers leave out what lies on one side of the plane. A cap fills the outline of the cut, so that
    solid parts look solid and only true cavities are open.

    Parameters
    ----------
    surfaces : sequence of vtkActor
        Each gets a cap.
    others : iterable of vtkActor
        Cut as well, without caps.
    """

    def __init__(self, surfaces: Sequence[Vtk], others: Iterable[Vtk]) -> None:
        self._plane = vtkPlane()
        self._surfaces = tuple(surfaces)
        self._mappers = [actor.GetMapper() for actor in (*surfaces, *others)]
        self._cutters = [vtkCutter() for _ in surfaces]
        self._cut: Cut | None = None
        self.caps = tuple(_cap(cutter, self._plane) for cutter in self._cutters)
        """Actors of the cut surfaces."""

    def move(self, cut: Cut | None) -> bool:
        """Cut at a plane, or not at all; return whether that is a change."""
        before, self._cut = self._cut, cut
        if cut is None or before is None:
            for mapper in self._mappers if (cut is None) is not (before is None) else ():
                mapper.RemoveAllClippingPlanes() if cut is None else mapper.AddClippingPlane(self._plane)
        if cut is not None:
            self._plane.SetNormal(*cut[0])
            self._plane.SetOrigin(*cut[1])
        if cut is None or before is None:
            return cut is not before
        return not all(np.array_equal(one, other) for one, other in zip(cut, before, strict=True))

    def cap(self) -> None:
        """Close the surfaces that are seen, as opaque as they are."""
        for actor, cap, cutter in zip(self._surfaces, self.caps, self._cutters, strict=True):
            seen = self._cut is not None and bool(actor.GetVisibility())
            cap.SetVisibility(seen)
            if seen:
                cutter.SetInputData(actor.GetMapper().GetInput())
                cap.GetProperty().SetOpacity(actor.GetProperty().GetOpacity())

    def keeps(self, points: FloatArray, radius: float) -> BoolArray:
        """Return which points (n, 3) stay; those at the plane, closer than a radius [mm], do."""
        if self._cut is None:
            return np.ones(len(points), bool)
        normal, origin = self._cut
        return np.asarray((points - origin) @ normal > -radius)

    def paint(self, colour: tuple[float, float, float]) -> None:
        """Colour the cut surfaces."""
        for cap in self.caps:
            cap.GetProperty().SetColor(*colour)


def _cap(cutter: Vtk, plane: Vtk) -> Vtk:
    filled = vtkContourTriangulator()
    cutter.SetCutFunction(plane)
    filled.SetInputConnection(cutter.GetOutputPort())
    mapper = vtkPolyDataMapper()
    mapper.SetInputConnection(filled.GetOutputPort())
    mapper.ScalarVisibilityOff()
    actor = vtkActor()
    actor.SetMapper(mapper)
    actor.SetVisibility(False)
    actor.GetProperty().LightingOff()
    return actor
