"""Cameras and the cutting plane, for pictures, films and the window."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from homolog.arrays import FloatArray
from homolog_app.rendering.colours import (
    DARK_SCHEME,
    LIGHT_SCHEME,
    Colours,
    rgb_bytes,
    structure_colour,
)

__all__ = [
    "VIEWS",
    "Box",
    "CameraState",
    "Canvas",
    "Clip",
    "ClipPlane",
    "Cut",
    "Display",
    "Frame",
    "Layer",
    "View",
    "around",
    "cut_of",
    "extent_of",
    "frame_around",
    "round_length",
    "three_quarter_view",
]


_UP = np.array([0.0, 0.0, 1.0])
_FORWARD = np.array([0.0, -1.0, 0.0])
_MARGIN = 0.03


@dataclass(frozen=True, slots=True)
class View:
    """A view direction in LPS.

    Attributes
    ----------
    toward : tuple of 3 float
        Direction from the shape to the viewer; any length.
    up : tuple of 3 float
        Approximate upward direction in the picture; not parallel to `toward`.
    name : str
        Caption in pictures with several views; may be empty.
    """

    toward: tuple[float, float, float]
    up: tuple[float, float, float]
    name: str = ""

    @property
    def opposite(self) -> "View":
        """The view from the other side, without a name."""
        x, y, z = self.toward
        return View((-x, -y, -z), self.up)

    @property
    def axes(self) -> FloatArray:
        """Rows: the picture's right and up and the direction to the viewer, orthonormal, shape (3, 3)."""
        back = np.array(self.toward) / np.linalg.norm(self.toward)
        right = np.cross(self.up, back)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(back, right), back])


VIEWS = {
    view.name: view
    for view in (
        View((0.0, -1.0, 0.0), (0.0, 0.0, 1.0), "anterior"),
        View((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), "posterior"),
        View((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), "left"),
        View((-1.0, 0.0, 0.0), (0.0, 0.0, 1.0), "right"),
        View((0.0, 0.0, 1.0), (0.0, -1.0, 0.0), "superior"),
        View((0.0, 0.0, -1.0), (0.0, -1.0, 0.0), "inferior"),
    )
}
"""The anatomical views, for shapes in patient coordinates (LPS)."""


def three_quarter_view(points: FloatArray, weights: FloatArray | None = None) -> View:
    """Return an oblique view of the shape's broad side.

    Parameters
    ----------
    points : (n, 3) array
        Points of the shape, such as the mean particles [mm].
    weights : (n,) array, optional
        Weights, such as the variance of each particle: the broad side with the larger total weight faces the
        viewer. With equal weights the viewer is to the left, in front and above (LPS).
    """
    centred = points - points.mean(axis=0)
    _, _, axes = np.linalg.svd(centred, full_matrices=False)
    lean = (axes * [1.0, -1.0, 1.0])[range(3), np.abs(axes).argmax(axis=1)]
    if weights is not None:
        lean[2] = weights @ (centred @ axes[2])
    axes = axes * np.where(lean < 0.0, -1.0, 1.0)[:, None]
    toward = np.array([0.24, 0.36, 0.90]) @ axes
    up = _UP if abs(toward[2]) < 0.7 else _FORWARD
    return View(_triple(toward), _triple(up))


@dataclass(frozen=True, slots=True)
class Frame:
    """The part of the world that a picture shows.

    Attributes
    ----------
    view : View
        View direction.
    centre : tuple of 3 float
        World point at the centre of the picture [mm].
    width, height, depth : float
        Extent along the picture's right, up and the direction to the viewer [mm].
    """

    view: View
    centre: tuple[float, float, float]
    width: float
    height: float
    depth: float


def frame_around(
    shapes: Iterable[FloatArray], view: View, *, border: float = 0.0, width: float = 0.0
) -> Frame:
    """Return the smallest frame that contains all the shapes.

    Parameters
    ----------
    shapes : iterable of (n, 3) array
        Points of all objects to be drawn in this frame [mm].
    view : View
        View direction.
    border : float
        Margin around the points, such as the radius of balls drawn there [mm].
    width : float
        Least width [mm]; frames of equal width have the same scale.
    """
    points = np.concatenate([np.asarray(shape) for shape in shapes]) @ view.axes.T
    low, high = points.min(axis=0), points.max(axis=0)
    size = high - low + 2.0 * border
    size += _MARGIN * size[:2].max()
    centre = (low + high) / 2.0 @ view.axes
    return Frame(view, _triple(centre), max(float(size[0]), width), float(size[1]), float(size[2]))


def round_length(most: float) -> float:
    """Return the length of a scale bar: the largest of 1, 2, 5, 10, … up to a limit."""
    power = 10.0 ** np.floor(np.log10(most))
    return float(power * max(length for length in (1.0, 2.0, 5.0) if length * power <= most * (1.0 + 1e-9)))


def _triple(values: FloatArray) -> tuple[float, float, float]:
    x, y, z = map(float, values)
    return x, y, z


Box = tuple[float, float, float, float, float, float]
"""Extent along x, y and z [mm]: lowest and highest value of each."""

Cut = tuple[FloatArray, FloatArray]
"""Unit normal (3,) towards the part that is kept, and a point (3,) of the plane [mm]."""


class ClipPlane(StrEnum):
    """Orientation of the cutting plane, in the common LPS coordinates."""

    AXIAL = "axial"
    CORONAL = "coronal"
    SAGITTAL = "sagittal"
    VIEW = "view"
    FREE = "free"


_ALONG = {
    ClipPlane.AXIAL: np.array([0.0, 0.0, 1.0]),
    ClipPlane.CORONAL: np.array([0.0, 1.0, 0.0]),
    ClipPlane.SAGITTAL: np.array([1.0, 0.0, 0.0]),
}
_KEPT = {ClipPlane.AXIAL: -1.0, ClipPlane.CORONAL: 1.0, ClipPlane.SAGITTAL: 1.0}


class Clip(BaseModel):
    """A cutting plane.

    Attributes
    ----------
    plane : ClipPlane
        Orientation of the plane; a view plane faces the camera and rotates with it.
    position : float
        Position: 0 at the feet, the front, the right or the viewer, 1 at the opposite end; from 0 to 1 along
        the normal of a free plane.
    flipped : bool
        Whether to remove the other side instead of that of the head, the front, the right or the viewer, or
        the one away from which the normal of a free plane points.
    normal : tuple of 3 float
        Unit normal of a free plane, towards the part that is kept.
    box : tuple of 6 float or None
        Extent to which the position refers [mm]; None for that of the shapes.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    plane: ClipPlane = ClipPlane.AXIAL
    position: Annotated[float, Field(ge=0.0, le=1.0)] = 0.5
    flipped: bool = False
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    box: Box | None = None

    @classmethod
    def free(cls, normal: FloatArray, origin: FloatArray, box: Box) -> "Clip":
        """Return the plane through a point, with a normal towards the part that is kept."""
        low, high = np.reshape(np.array(box), (3, 2)).T
        reach = float(np.abs(normal) @ (high - low) / 2.0)
        share = (1.0 + float((origin - (low + high) / 2.0) @ normal) / max(reach, 1e-9)) / 2.0
        return cls(plane=ClipPlane.FREE, normal=_triple(normal), position=min(max(share, 0.0), 1.0), box=box)

    def cut(self, box: Box, ahead: FloatArray) -> Cut:
        """Return the plane.

        Parameters
        ----------
        box : tuple of 6 float
            Extent of the shapes, used if the clip has no box [mm].
        ahead : (3,) array
            Unit view direction.
        """
        low, high = np.reshape(np.array(self.box or box), (3, 2)).T
        free = np.array(self.normal) if self.plane is ClipPlane.FREE else ahead
        along = _ALONG.get(self.plane, free)
        half = (high - low) / 2.0
        reach = float(np.linalg.norm(half)) if self.plane is ClipPlane.VIEW else float(np.abs(along) @ half)
        origin = (low + high) / 2.0 + (2.0 * self.position - 1.0) * reach * along
        side = _KEPT.get(self.plane, 1.0) * (-1.0 if self.flipped else 1.0)
        return side * along, origin


def cut_of(clip: Clip | None, points: FloatArray, toward: FloatArray) -> Cut | None:
    """Return the plane that cuts points (n, 3), seen from a direction; None without a clip."""
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


_Point = tuple[float, float, float]
_Pixels = Annotated[int, Field(ge=1, le=10_000)]


class CameraState(BaseModel):
    """Camera of a view, in parallel projection [mm]."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    at: _Point
    eye: _Point
    up: _Point
    height: Annotated[float, Field(gt=0.0)]

    @classmethod
    def of(cls, camera: Any) -> "CameraState":  # noqa: ANN401 - VTK is untyped
        """Return the state of a VTK camera."""
        return cls(
            at=camera.GetFocalPoint(),
            eye=camera.GetPosition(),
            up=camera.GetViewUp(),
            height=2.0 * camera.GetParallelScale(),
        )

    def set(self, camera: Any) -> None:  # noqa: ANN401
        """Apply this state to a VTK camera."""
        camera.SetFocalPoint(*self.at)
        camera.SetPosition(*self.eye)
        camera.SetViewUp(*self.up)
        camera.SetParallelScale(self.height / 2.0)


class Layer(BaseModel):
    """How a structure is shown.

    Attributes
    ----------
    name : str
    shown : bool
    opacity : float
        Of its surfaces, beside that of all.
    colour : str
        As ``#rrggbb``; that of its place among the structures if empty.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    name: str
    shown: bool = True
    opacity: Annotated[float, Field(ge=0.0, le=1.0)] = 1.0
    colour: Annotated[str, Field(pattern="^(#[0-9a-f]{6})?$")] = ""

    def colour_at(self, place: int) -> tuple[int, int, int]:
        """Return red, green and blue of the structure at a place among all."""
        return rgb_bytes(self.colour) if self.colour else structure_colour(place)


class Display(BaseModel):
    """What the user chose to see in the views, on every page.

    Attributes
    ----------
    scheme : str
    layout, page : int
        Number of subjects per page, and the open page; shapes of the model have their own layout.
    raw, groomed, particles : bool
        Whether these are shown.
    opacity : float
        Opacity of the surfaces.
    letters, scale_bar : bool
        Whether the anatomical directions and a scale bar are shown.
    clip : Clip or None
        The plane that cuts the shapes open.
    layers : tuple of Layer
        Structures that are not shown as usual.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    scheme: Literal["light", "dark"] = "light"
    layout: Literal[1, 4, 9, 16] = 4
    page: Annotated[int, Field(ge=0)] = 0
    raw: bool = False
    groomed: bool = True
    particles: bool = True
    opacity: Annotated[float, Field(ge=0.0, le=1.0)] = 1.0
    letters: bool = True
    scale_bar: bool = True
    clip: Clip | None = None
    layers: tuple[Layer, ...] = ()

    def layer(self, name: str) -> Layer:
        """Return how a structure is shown."""
        return next((layer for layer in self.layers if layer.name == name), Layer(name=name))

    def with_layer(self, layer: Layer) -> tuple[Layer, ...]:
        """Return the layers with one of them replaced."""
        return (*(other for other in self.layers if other.name != layer.name), layer)

    def changed(self, **fields: object) -> Self:
        """Return a copy with other values."""
        return self.model_copy(update=fields)

    @property
    def colours(self) -> Colours:
        """Colours of the scheme."""
        return DARK_SCHEME if self.scheme == "dark" else LIGHT_SCHEME


class Canvas(Display):
    """A picture of the views: what is displayed, its size and its cameras.

    Attributes
    ----------
    width, height : int
        Size of the views on the screen [pixels of the screen].
    ratio : float
        Pixels of the picture per pixel of the screen.
    text : float
        Size of the texts relative to a system font of 12 pixels.
    cameras : tuple of CameraState
        A camera for all views, or one for each view.
    """

    width: _Pixels = 1280
    height: _Pixels = 720
    ratio: Annotated[float, Field(gt=0.0, le=8.0)] = 1.0
    text: Annotated[float, Field(gt=0.0, le=8.0)] = 1.0
    cameras: tuple[CameraState, ...] = ()
