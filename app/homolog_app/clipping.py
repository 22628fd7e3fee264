"""The plane that cuts shapes open, for the window's views, films and pictures alike."""

from collections.abc import Sequence
from enum import StrEnum
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from homolog.arrays import FloatArray

__all__ = ["Box", "Clip", "ClipPlane", "Cut", "around", "cut_of", "extent_of"]

Box = tuple[float, float, float, float, float, float]
"""Extent along x, y and z [mm]: low and high of each."""

Cut = tuple[FloatArray, FloatArray]
"""Unit normal (3,) towards what stays, and a point (3,) of the plane [mm]."""


class ClipPlane(StrEnum):
    """How the cutting plane lies, in the common LPS coordinates."""

    AXIAL = "axial"
    CORONAL = "coronal"
    SAGITTAL = "sagittal"
    VIEW = "view"


_ALONG = {
    ClipPlane.AXIAL: np.array([0.0, 0.0, 1.0]),
    ClipPlane.CORONAL: np.array([0.0, 1.0, 0.0]),
    ClipPlane.SAGITTAL: np.array([1.0, 0.0, 0.0]),
}
_KEPT = {ClipPlane.AXIAL: -1.0, ClipPlane.CORONAL: 1.0, ClipPlane.SAGITTAL: 1.0, ClipPlane.VIEW: 1.0}


class Clip(BaseModel):
    """A cutting plane.

    Attributes
    ----------
    plane : ClipPlane
        A view plane faces the camera and turns with it.
    position : float
        0 is at the feet, the front, the right or the viewer, 1 at the opposite end.
    flipped : bool
        Whether the other side is removed than that of the head, the front, the right or the viewer.
    box : tuple of 6 float or None
        Extent that the position refers to [mm]; that of the shapes if None.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    plane: ClipPlane = ClipPlane.AXIAL
    position: Annotated[float, Field(ge=0.0, le=1.0)] = 0.5
    flipped: bool = False
    box: Box | None = None

    def cut(self, box: Box, ahead: FloatArray) -> Cut:
        """Return the plane.

        Parameters
        ----------
        box : tuple of 6 float
            Extent of the shapes, where the clip has none of its own [mm].
        ahead : (3,) array
            Unit direction of sight.
        """
        low, high = np.reshape(np.array(self.box or box), (3, 2)).T
        along = _ALONG.get(self.plane, ahead)
        half = (high - low) / 2.0
        reach = float(np.linalg.norm(half)) if self.plane is ClipPlane.VIEW else float(np.abs(along) @ half)
        origin = (low + high) / 2.0 + (2.0 * self.position - 1.0) * reach * along
        side = _KEPT[self.plane] * (-1.0 if self.flipped else 1.0)
        return side * along, origin


def cut_of(clip: Clip | None, points: FloatArray, toward: FloatArray) -> Cut | None:
    """Return the plane that cuts a shape with such points (n, 3), seen from a direction; None without one."""
    return None if clip is None else clip.cut(extent_of(points), -toward)


def extent_of(points: FloatArray) -> Box:
    """Return the extent of points (n, 3)."""
    low, high = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    return low[0], high[0], low[1], high[1], low[2], high[2]


def around(boxes: Sequence[Box]) -> Box | None:
    """Return the extent of all boxes; None if there are none."""
    if not boxes:
        return None
    ends = np.array(boxes)
    low, high = ends[:, ::2].min(axis=0).tolist(), ends[:, 1::2].max(axis=0).tolist()
    return low[0], high[0], low[1], high[1], low[2], high[2]
