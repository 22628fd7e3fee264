"""Settings of exports: pictures, films, meshes, tables and plots; forms and options derive from them."""

from collections.abc import Sequence
from enum import StrEnum
from math import hypot, inf
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, field_validator
from pydantic_core import PydanticCustomError

from homolog.io.report_details import Axes, ReportDetails
from homolog_app.rendering.camera import Clip, ClipPlane, View

__all__ = [
    "SIGHTS",
    "Background",
    "Colouring",
    "Coordinates",
    "CutAway",
    "CutSettings",
    "FilmSettings",
    "MeshFormat",
    "MeshSettings",
    "ParticleSettings",
    "PictureSettings",
    "Plot",
    "PlotSettings",
    "ReportSettings",
    "ScreenshotSettings",
    "StillSettings",
    "TableSettings",
    "camera_direction",
    "camera_view",
]


SIGHTS = ("oblique", "opposite", "anterior", "posterior", "left", "right", "superior", "inferior")
"""View directions: oblique at the side that moves most, its opposite, or along a patient axis."""

_CAMERA = "camera:"


def camera_direction(toward: Sequence[float], up: Sequence[float]) -> str:
    """Return a camera as a command-line value: the directions to the viewer and upwards in LPS."""
    length = hypot(*toward)
    return _CAMERA + ",".join(f"{value:.4g}" for value in (*(part / length for part in toward), *up))


def camera_view(sight: str) -> View | None:
    """Return the view of such a value; None if it is invalid."""
    try:
        x, y, z, right, back, up = map(float, sight.removeprefix(_CAMERA).split(","))
    except ValueError:
        return None
    sides = x * x + y * y + z * z, right * right + back * back + up * up
    along = x * right + y * back + z * up
    upright = along * along < 0.999 * sides[0] * sides[1] < inf
    return View((x, y, z), (right, back, up), "camera") if sight.startswith(_CAMERA) and upright else None


class Background(StrEnum):
    """Background of the shapes."""

    LIGHT = "light"
    DARK = "dark"


class Colouring(StrEnum):
    """Meaning of the surface's colours."""

    DISPLACEMENT = "displacement"
    PLAIN = "plain"


class CutAway(StrEnum):
    """Plane that cuts the shapes open."""

    NONE = "none"
    AXIAL = "axial"
    CORONAL = "coronal"
    SAGITTAL = "sagittal"
    VIEW = "view"
    FREE = "free"


_PIXELS = {"unit": "pixels"}


class CutSettings(BaseModel):
    """Cut away."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    clip: Annotated[
        CutAway,
        Field(
            title="cut away",
            description="Plane that cuts the shapes open; view faces the viewer, free has the normal given.",
        ),
    ] = CutAway.NONE
    clip_at: Annotated[
        float,
        Field(
            ge=0.0,
            le=1.0,
            title="position of the cut",
            description="Position of the plane: 0 at the feet, front, right or viewer, 1 at the other end.",
        ),
    ] = 0.5
    clip_normal: Annotated[
        str,
        Field(
            title="normal of a free cut",
            description="Three numbers (LPS): the direction that a free plane keeps.",
        ),
    ] = "0 0 1"
    clip_flip: Annotated[
        bool, Field(title="flip the cut", description="Remove the other side of the plane.")
    ] = False

    @property
    def cutting(self) -> Clip | None:
        """The plane that cuts the shapes open."""
        if self.clip is CutAway.NONE:
            return None
        x, y, z = (float(word) for word in self.clip_normal.split())
        length = hypot(x, y, z)
        return Clip(
            plane=ClipPlane(self.clip.value),
            position=self.clip_at,
            flipped=self.clip_flip,
            normal=(x / length, y / length, z / length),
        )

    @field_validator("clip_normal")
    @classmethod
    def _check_normal(cls, text: str) -> str:
        """Refuse a text that is no direction."""
        try:
            x, y, z = (float(word) for word in text.split())
        except ValueError:
            x = y = z = 0.0
        if not 0.0 < hypot(x, y, z) < inf:
            raise PydanticCustomError("normal", "give three numbers that are not all 0, such as 0 0 1")
        return text


class ReportSettings(CutSettings, ReportDetails):
    """Report."""

    @property
    def emptied(self) -> list[str]:
        """Options that clear empty details, since a project would keep stored ones."""
        empty = [f"--{name}=" for name in ("structure", "cohort", "places") if not getattr(self, name)]
        return empty + (["--axes=auto"] if self.axes is Axes.AUTO else [])


class PictureSettings(CutSettings):
    """Picture."""

    width: Annotated[
        int,
        Field(
            ge=480, le=7680, multiple_of=2, json_schema_extra=_PIXELS, description="Width in pixels (even)."
        ),
    ] = 1280
    height: Annotated[
        int,
        Field(
            ge=320, le=7680, multiple_of=2, json_schema_extra=_PIXELS, description="Height in pixels (even)."
        ),
    ] = 720
    deviations: Annotated[
        float,
        Field(
            gt=0.0,
            le=6.0,
            title="range",
            json_schema_extra={"unit": "SD"},
            description="Range of a mode on both sides of the mean; also the range of the colours.",
        ),
    ] = 2.0
    colours: Annotated[
        Colouring,
        Field(description="displacement: blue out of the tissue, yellow into it, with a scale; or plain."),
    ] = Colouring.DISPLACEMENT
    background: Annotated[Background, Field(description="Light for print, dark for slides.")] = (
        Background.LIGHT
    )
    caption: Annotated[bool, Field(description="Show a caption with content and position.")] = True
    scale_bar: Annotated[bool, Field(description="Draw a scale bar in mm.")] = True
    directions: Annotated[
        bool, Field(description="Show the patient's directions as letters: R, L, A, P, S, I.")
    ] = True


class FilmSettings(PictureSettings):
    """Film."""

    fps: Annotated[
        int,
        Field(
            ge=1,
            le=60,
            title="frame rate",
            json_schema_extra={"unit": "fps"},
            description="Frames per second; 25 is smooth, fewer make smaller files.",
        ),
    ] = 25
    seconds: Annotated[
        float,
        Field(
            ge=0.2,
            le=600.0,
            title="length",
            json_schema_extra={"unit": "s"},
            description="Duration of the animation.",
        ),
    ] = 4.0
    loop: Annotated[
        bool, Field(description="Play forward and back, so that the film repeats without a jump.")
    ] = True
    turntable: Annotated[bool, Field(description="Rotate the shape once about its vertical axis.")] = False

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
            title="position",
            description="Position along a mode in SD, or between groups from 0 (first) to 1 (second). If not "
            "given, the upper end.",
        ),
    ] = None
    transparent: Annotated[bool, Field(description="Make the background transparent.")] = False


_Permutations = Annotated[
    int,
    Field(ge=99, le=1_000_000, description="Permutations for the p-values of groups, if groups are given."),
]
_Seed = Annotated[int, Field(ge=0, le=2**31 - 1, description="Random seed of the permutations.")]


class _Settings(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class MeshFormat(StrEnum):
    """Kind of mesh file; all are in LPS millimetres."""

    VTP = "vtp"
    PLY = "ply"
    STL = "stl"
    GLB = "glb"


class MeshSettings(_Settings):
    """Meshes."""

    format: Annotated[
        MeshFormat,
        Field(
            description="vtp and ply store values at vertices; glb shows them as colours; stl stores the "
            "surface only."
        ),
    ] = MeshFormat.VTP
    modes: Annotated[int, Field(ge=0, le=100, description="Number of modes, each at both ends.")] = 3
    deviations: Annotated[
        float,
        Field(gt=0.0, le=6.0, json_schema_extra={"unit": "SD"}, description="Range along the modes."),
    ] = 2.0
    subjects: Annotated[bool, Field(description="Also write the subjects' own surfaces, aligned.")] = False
    permutations: _Permutations = 10_000
    seed: _Seed = 0


class TableSettings(_Settings):
    """Tables."""

    permutations: _Permutations = 10_000
    seed: _Seed = 0


class Plot(StrEnum):
    """Content of a plot."""

    SCREE = "scree"
    SCORES = "scores"
    QUALITY = "quality"
    ENERGIES = "energies"
    MODES = "modes"
    DIFFERENCE = "difference"
    DISCRIMINANT = "discriminant"

    @property
    def needs_groups(self) -> bool:
        """Whether it compares two groups."""
        return self in (Plot.DIFFERENCE, Plot.DISCRIMINANT)


class PlotSettings(_Settings):
    """Plot."""

    kind: Annotated[
        Plot,
        Field(
            description="scree: eigenvalues with parallel analysis; scores: subjects in two modes; quality: "
            "compactness, generalization, specificity; energies: of the run; modes: mean and both ends; "
            "difference and discriminant: two groups."
        ),
    ] = Plot.SCREE
    horizontal: Annotated[int, Field(ge=1, le=1000, description="Mode along the x axis of scores.")] = 1
    vertical: Annotated[int, Field(ge=1, le=1000, description="Mode along the y axis of scores.")] = 2
    modes: Annotated[int, Field(ge=1, le=20, description="Number of modes in the plot of modes.")] = 3
    background: Annotated[Background, Field(description="Light for print, dark for slides.")] = (
        Background.LIGHT
    )
    permutations: _Permutations = 10_000
    seed: _Seed = 0


class Coordinates(StrEnum):
    """Coordinate frame of points."""

    WORLD = "world"
    LOCAL = "local"


class ParticleSettings(_Settings):
    """Points."""

    coordinates: Annotated[
        Coordinates,
        Field(description="world: aligned, as the statistics use them; local: those of the input files."),
    ] = Coordinates.WORLD


class ScreenshotSettings(_Settings):
    """Screenshot."""

    scale: Annotated[int, Field(ge=1, le=4, description="Magnification relative to the screen.")] = 2
    transparent: Annotated[bool, Field(description="Make the background transparent.")] = False
