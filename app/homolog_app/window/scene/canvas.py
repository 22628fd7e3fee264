"""How the views are looked at, as numbers and words that a file or a command line can hold."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from homolog_app.rendering.camera import Clip

__all__ = ["CameraState", "Canvas"]

_Point = tuple[float, float, float]
_Pixels = Annotated[int, Field(ge=1, le=10_000)]


class CameraState(BaseModel):
    """From where a view looks, in parallel projection [mm]."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    at: _Point
    eye: _Point
    up: _Point
    height: Annotated[float, Field(gt=0.0)]

    @classmethod
    def of(cls, camera: Any) -> "CameraState":  # noqa: ANN401 - VTK is untyped
        """Return what a camera of VTK does."""
        return cls(
            at=camera.GetFocalPoint(), eye=camera.GetPosition(), up=camera.GetViewUp(),
            height=2.0 * camera.GetParallelScale(),
        )  # fmt: skip

    def set(self, camera: Any) -> None:  # noqa: ANN401
        """Let a camera of VTK do this."""
        camera.SetFocalPoint(*self.at)
        camera.SetPosition(*self.eye)
        camera.SetViewUp(*self.up)
        camera.SetParallelScale(self.height / 2.0)


class Canvas(BaseModel):
    """Size, layout and look of the views.

    Attributes
    ----------
    width, height : int
        Of the views on the screen, in its pixels …
    ratio : float
        … of which each takes so many of the picture.
    text : float
        Size of the texts relative to a system font of 12 pixels.
    scheme : str
    layout, page : int
        Number of subjects a page, and which one is open; shapes of the model have a layout of their own.
    raw, groomed, particles : bool
        What is shown.
    opacity : float
        Of the surfaces.
    cameras : tuple of CameraState
        One for all views, or one each.
    letters, scale_bar : bool
        Whether the anatomical directions and a scale bar are shown.
    clip : Clip or None
        The plane that cuts the shapes open.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    width: _Pixels = 1280
    height: _Pixels = 720
    ratio: Annotated[float, Field(gt=0.0, le=8.0)] = 1.0
    text: Annotated[float, Field(gt=0.0, le=8.0)] = 1.0
    scheme: Literal["light", "dark"] = "light"
    layout: Literal[1, 4, 9, 16] = 4
    page: Annotated[int, Field(ge=0)] = 0
    raw: bool = False
    groomed: bool = True
    particles: bool = True
    opacity: Annotated[float, Field(ge=0.0, le=1.0)] = 1.0
    cameras: tuple[CameraState, ...] = ()
    letters: bool = True
    scale_bar: bool = True
    clip: Clip | None = None
