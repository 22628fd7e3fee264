"""How a film or still looks: command line and dialogs are made from these."""

from enum import StrEnum
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

__all__ = ["SIGHTS", "Background", "Colouring", "FilmSettings", "PictureSettings", "StillSettings"]

SIGHTS = ("oblique", "opposite", "anterior", "posterior", "left", "right", "superior", "inferior")
"""From where to look: obliquely at the side that moves most, from opposite, or along a patient axis."""


class Background(StrEnum):
    """Behind the shapes."""

    LIGHT = "light"
    DARK = "dark"


class Colouring(StrEnum):
    """What the surface's colours mean."""

    DISPLACEMENT = "displacement"
    PLAIN = "plain"


_PIXELS = {"unit": "pixels"}


class PictureSettings(BaseModel):
    """Picture."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    width: Annotated[
        int, Field(ge=480, le=7680, multiple_of=2, json_schema_extra=_PIXELS, description="An even number.")
    ] = 1280
    height: Annotated[
        int, Field(ge=320, le=7680, multiple_of=2, json_schema_extra=_PIXELS, description="An even number.")
    ] = 720
    deviations: Annotated[
        float,
        Field(
            gt=0.0,
            le=6.0,
            title="range",
            json_schema_extra={"unit": "SD"},
            description="How far a mode goes to either side of the mean; also the range of the colours.",
        ),
    ] = 2.0
    colours: Annotated[
        Colouring,
        Field(description="Outward displacement: blue expands, yellow contracts, with its scale; or plain."),
    ] = Colouring.DISPLACEMENT
    background: Annotated[Background, Field(description="Light for print, dark for slides.")] = (
        Background.LIGHT
    )
    caption: Annotated[bool, Field(description="Say what is shown and how far it has moved.")] = True
    scale_bar: Annotated[bool, Field(description="Draw a bar of known length in mm.")] = True


class FilmSettings(PictureSettings):
    """Film."""

    fps: Annotated[
        int,
        Field(
            ge=1,
            le=60,
            title="frames a second",
            json_schema_extra={"unit": "1/s"},
            description="25 is smooth; fewer make smaller files.",
        ),
    ] = 25
    seconds: Annotated[
        float,
        Field(ge=0.2, le=600.0, title="length", json_schema_extra={"unit": "s"}, description="Of the film."),
    ] = 4.0
    loop: Annotated[
        bool, Field(description="Go there and back, so that the film can be repeated without a jump.")
    ] = True
    turntable: Annotated[bool, Field(description="Turn the shape once around its upright axis.")] = False

    @property
    def frames(self) -> int:
        """Number of frames."""
        return max(round(self.fps * self.seconds), 2)


class StillSettings(PictureSettings):
    """Still."""

    at: Annotated[
        float | None,
        Field(
            ge=-6.0,
            le=6.0,
            title="place",
            description="Where: in SD along a mode, 0 (first) to 1 (second) between groups; upper end if not "
            "given.",
        ),
    ] = None
    transparent: Annotated[bool, Field(description="No background.")] = False
