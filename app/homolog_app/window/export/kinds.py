"""The exports that the window offers, as data."""

from dataclasses import dataclass

from pydantic import BaseModel

from homolog_app.exports.settings import (
    MeshSettings,
    ParticleSettings,
    PlotSettings,
    ScreenshotSettings,
    TableSettings,
)
from homolog_app.films.settings import CutSettings, FilmSettings, StillSettings

__all__ = ["KINDS", "SCREENSHOT", "ExportKind"]


@dataclass(frozen=True, slots=True)
class ExportKind:
    """One export.

    Attributes
    ----------
    name : str
        Its word on the command line.
    title : str
        Of the dialog.
    hint : str
        What it makes, in a sentence.
    settings : model or None
        Its options.
    main : tuple of str
        The options that are not folded away.
    suffixes : tuple of str
        Of the file; a folder is made if there are none, or if one of them is empty.
    content : str
        What is chosen besides: ``"motion"``, ``"groups"`` or nothing.
    place : bool
        Whether the user says where it goes.
    """

    name: str
    title: str
    hint: str
    settings: type[BaseModel] | None = None
    main: tuple[str, ...] = ()
    suffixes: tuple[str, ...] = ()
    content: str = ""
    place: bool = True


SCREENSHOT = ExportKind(
    "screenshot",
    "Screenshot",
    "The views as they are now, with what colours mean.",
    ScreenshotSettings,
    suffixes=(".png",),
)
"""The picture of the views, which the window draws itself."""

KINDS = {
    kind.name: kind
    for kind in (
        ExportKind(
            "film",
            "Film",
            "The shape moves along modes or from group to group, or turns.",
            FilmSettings,
            ("width", "height", "fps", "seconds", "deviations", "loop", "turntable"),
            (".mp4", ".gif", ""),
            "motion",
        ),
        ExportKind(
            "still",
            "Picture",
            "One picture of any size for a paper, a slide or a poster.",
            StillSettings,
            ("width", "height", "at", "transparent", "background"),
            (".png",),
            "motion",
        ),
        ExportKind(
            "plot",
            "Plot",
            "Vector graphics: eigenvalues, scores, model quality, groups.",
            PlotSettings,
            ("kind", "background"),
            (".svg", ".pdf", ".png"),
            "groups",
        ),
        ExportKind(
            "meshes",
            "Meshes",
            "Mean, modes, groups and subjects with displacement, p and q at the vertices.",
            MeshSettings,
            ("format", "modes", "deviations", "subjects"),
            (),
            "groups",
        ),
        ExportKind(
            "table",
            "Tables",
            "Scores, modes, measures of the subjects and group results as CSV.",
            TableSettings,
            (),
            (),
            "groups",
        ),
        ExportKind(
            "particles",
            "Particles",
            "A .particles file for each subject.",
            ParticleSettings,
        ),
        ExportKind("shapeworks", "ShapeWorks project", "A project that ShapeWorks Studio opens."),
        ExportKind(
            "markups",
            "Slicer markups",
            "A point list for each subject, for 3D Slicer.",
            ParticleSettings,
        ),
        ExportKind(
            "report",
            "Report",
            "One page about the model and its studies, in the project's folder.",
            CutSettings,
            place=False,
        ),
    )
}
