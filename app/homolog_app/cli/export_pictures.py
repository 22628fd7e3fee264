"""Options and files of ``homolog export film``, ``still``, ``screenshot`` and ``plot``."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from homolog.errors import InputError
from homolog.io.project import ProjectFolder
from homolog.progress import Tick, part_of
from homolog_app.cli.options import one_of, option
from homolog_app.exports.settings import (
    SIGHTS,
    FilmSettings,
    PlotSettings,
    ScreenshotSettings,
    StillSettings,
    camera_view,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from homolog_app.exports.motion import Motion
    from homolog_app.rendering.camera import Canvas
    from homolog_app.rendering.content import ViewContents
    from homolog_app.scenes.states import Snapshot

__all__ = ["COLOUR_BY", "MOTION", "SCENE", "export_film", "export_plot", "export_screenshot", "export_still"]


def _direction(text: str) -> str:
    if text not in SIGHTS and camera_view(text) is None:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a view; choose {', '.join(SIGHTS)}, or camera: and six numbers"
        )
    return text


MOTION = (
    one_of(
        option(
            "--mode", type=int, nargs="+", metavar="K", help="modes of variation, from 1; several form a grid"
        ),
        option(
            "--group",
            nargs=3,
            metavar=("COLUMN", "A", "B"),
            help="from the mean of one group to that of another",
        ),
    ),
    option(
        "--view",
        nargs="+",
        type=_direction,
        metavar="VIEW",
        default=["oblique"],
        help=f"view directions; several form a grid: {', '.join(SIGHTS)} (default oblique), or "
        "camera:X,Y,Z,X,Y,Z, the directions to the viewer and upwards (LPS), as in the window's dialogs",
    ),
)


def chosen_motions(arguments: argparse.Namespace, deviations: float) -> "Sequence[Motion]":
    """Return the motions of the options; the static mean without any.

    Raises
    ------
    InputError
        If the project has no result, or no such mode or group.
    """
    from homolog.io.results import read_result
    from homolog_app.exports.motion import group_motion, mode_motions, static_motion

    result = read_result(ProjectFolder(arguments.project))
    if len(set(arguments.view)) < len(arguments.view) or len(set(arguments.mode or [])) < len(
        arguments.mode or []
    ):
        raise InputError("--mode and --view: give each value once")
    if arguments.mode:
        return mode_motions(result, arguments.mode, deviations)
    if arguments.group:
        return [group_motion(result, *arguments.group)]
    return [static_motion(result)]


def export_film(arguments: argparse.Namespace, settings: FilmSettings, out: Path, tick: Tick) -> str:
    """Write the film; return the facts about it."""
    from homolog_app.exports.film import Film
    from homolog_app.exports.pictures import FILM_SUFFIXES, write_film

    if out.suffix.lower() not in FILM_SUFFIXES:
        raise InputError(f"--out {out}: use .mp4 or .gif, or no suffix for a folder of PNG frames")
    if not (arguments.mode or arguments.group or settings.turntable):
        arguments.mode = [1]
    motions = chosen_motions(arguments, settings.deviations)
    film = Film(motions, arguments.view, settings, turntable=settings.turntable)
    write_film(
        out,
        lambda index: film.moment(index, settings),
        settings.frames,
        settings.fps,
        part_of(tick, 0.05, 0.99),
    )
    return f"{settings.frames} frames at {settings.fps} fps"


def export_still(arguments: argparse.Namespace, settings: StillSettings, out: Path, tick: Tick) -> str:
    """Write the picture; return the facts about it."""
    from homolog_app.exports.film import Film
    from homolog_app.exports.pictures import write_still

    motions = chosen_motions(arguments, settings.deviations)
    low, high = motions[0].low, motions[0].high
    at = high if settings.at is None else settings.at
    if not low <= at <= high:
        raise InputError(f"--at {at:g}: must be from {low:g} to {high:g}")
    film = Film(motions, arguments.view, settings, transparent=settings.transparent)
    tick(0.5, "drawing")
    write_still(out, film.draw((at - low) / (high - low) if high > low else 0.0))
    return f"{settings.width} x {settings.height} pixels"


SCENE = (option("--scene", required=True, metavar="SCENE", help="JSON, or a file that contains it"),)


def export_screenshot(
    arguments: argparse.Namespace, settings: ScreenshotSettings, out: Path, tick: Tick
) -> str:
    """Write the picture; return the facts about it."""
    from homolog_app.exports.pictures import write_still
    from homolog_app.rendering.content import open_page
    from homolog_app.rendering.draw import with_opengl
    from homolog_app.scenes.snapshot import view_contents_of

    snapshot = _snapshot(arguments.scene)
    shown = view_contents_of(ProjectFolder(arguments.project), snapshot, tick)
    tick(0.9, "drawing")
    page = open_page(shown, snapshot.canvas)
    pixels = with_opengl(_drawn, *page, settings.scale, settings.transparent)
    write_still(out, pixels)
    return f"{pixels.shape[1]} x {pixels.shape[0]} pixels"


def _drawn(shown: "ViewContents", canvas: "Canvas", scale: int, transparent: bool) -> "NDArray[np.uint8]":
    from homolog_app.rendering.grid import drawn

    return drawn(shown, canvas, scale, transparent=transparent)


def _snapshot(text: str) -> "Snapshot":
    from pydantic import ValidationError

    from homolog.parameters import fault_text
    from homolog_app.scenes.states import Snapshot

    try:
        content = text if text.lstrip().startswith("{") else Path(text).read_bytes()
        return Snapshot.model_validate_json(content)
    except OSError as error:
        raise InputError(f"--scene {text}: can't be read: {error.strerror}") from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "the JSON"
        raise InputError(f"--scene: {where}: {fault_text(first)}") from error


_PLOT_SUFFIXES = (".svg", ".pdf", ".png")


COLOUR_BY = option(
    "--colour-by", metavar="COLUMN", default="group", help="column for the colours of scores (default group)"
)


def export_plot(arguments: argparse.Namespace, settings: PlotSettings, out: Path, tick: Tick) -> str:
    """Write the plot; return no facts."""
    if out.suffix.lower() not in _PLOT_SUFFIXES:
        raise InputError(f"--out {out}: must end in {', '.join(_PLOT_SUFFIXES)}")
    from homolog_app.exports.pictures import draw_plot
    from homolog_app.pictures import write_picture

    groups = tuple(arguments.group) if arguments.group else None
    write_picture(
        draw_plot(ProjectFolder(arguments.project), settings, groups, arguments.colour_by, tick), out
    )
    return ""
