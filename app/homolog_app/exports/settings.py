"""What is exported, and how: command line and dialogs are made from these."""

from enum import StrEnum
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from homolog_app.films.settings import Background

__all__ = [
    "Coordinates",
    "MeshFormat",
    "MeshSettings",
    "ParticleSettings",
    "Plot",
    "PlotSettings",
    "ScreenshotSettings",
    "TableSettings",
]

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
    """What a plot shows."""

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
            "compactness, generalization, specificity; energies: the run; modes: mean and both ends; "
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
    """Which frame points are in."""

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
    transparent: Annotated[bool, Field(description="Transparent background.")] = False
