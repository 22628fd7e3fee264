"""``homolog export film``, ``still``, ``screenshot`` and ``plot``: pictures of a project's result."""

import argparse
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from homolog.errors import InputError
from homolog.io.project import ProjectFolder
from homolog.progress import Tick
from homolog_app.cli.options import (
    add_former_name,
    add_options,
    add_progress_option,
    show_progress,
    with_options,
)
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

__all__ = [
    "add_film",
    "add_group_option",
    "add_kind",
    "add_plot",
    "add_screenshot",
    "add_still",
    "exporting",
    "run_film",
    "run_plot",
    "run_screenshot",
    "run_still",
]


def add_kind(kinds: Any, name: str, summary: str, description: str, out: str) -> argparse.ArgumentParser:  # noqa: ANN401
    """Declare a kind of export with its common options: project, output, progress."""
    parser: argparse.ArgumentParser = kinds.add_parser(name, help=summary, description=description)
    parser.add_argument("project", type=Path, help="project folder")
    what = "a new or empty folder" if out == "FOLDER" else f"{out}; replaced if it exists"
    parser.add_argument("--out", type=Path, required=True, metavar=out.partition(" ")[0], help=what)
    add_progress_option(parser)
    return parser


def add_group_option(parser: argparse.ArgumentParser, summary: str) -> None:
    """Declare ``--group COLUMN A B``."""
    parser.add_argument("--group", nargs=3, metavar=("COLUMN", "A", "B"), help=summary)


@contextmanager
def exporting(arguments: argparse.Namespace) -> Iterator[Tick]:
    """Yield the tick of an export; report completion at the end."""
    with show_progress(arguments.progress) as progress:
        progress.tick(0.0, "preparing")
        yield progress.tick
        progress.tick(1.0, "done")


def add_motion_options(parser: argparse.ArgumentParser) -> None:
    """Declare ``--mode``, ``--group`` and ``--view``."""
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        "--mode", type=int, nargs="+", metavar="K", help="modes of variation, from 1; several form a grid"
    )
    what.add_argument(
        "--group", nargs=3, metavar=("COLUMN", "A", "B"), help="from the mean of one group to that of another"
    )
    parser.add_argument(
        "--view",
        nargs="+",
        type=_direction,
        metavar="VIEW",
        default=["oblique"],
        help=f"view directions; several form a grid: {', '.join(SIGHTS)} (default oblique), or "
        "camera:X,Y,Z,X,Y,Z, the directions to the viewer and upwards (LPS), as in the window's dialogs",
    )


def _direction(text: str) -> str:
    if text not in SIGHTS and camera_view(text) is None:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a view; choose {', '.join(SIGHTS)}, or camera: and six numbers"
        )
    return text


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


def add_film(kinds: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the kind."""
    parser = add_kind(
        kinds,
        "film",
        "animation as MP4, GIF or numbered pictures",
        "Animate the mean shape along modes, from one group's mean to another's, or on a turntable; "
        "along mode 1 by default.",
        "FILE (.mp4, .gif, or no suffix for a folder of PNG pictures)",
    )
    add_motion_options(parser)
    add_options(parser, FilmSettings)


def run_film(arguments: argparse.Namespace) -> int:
    """Write the film; return the exit code."""
    settings = with_options(FilmSettings(), arguments)
    from homolog.progress import part_of
    from homolog_app.exports.film import Film
    from homolog_app.exports.pictures import FILM_SUFFIXES, write_film
    from homolog_app.rendering.draw import renderer_name

    if arguments.out.suffix.lower() not in FILM_SUFFIXES:
        raise InputError(f"--out {arguments.out}: use .mp4 or .gif, or no suffix for a folder of PNG frames")
    if not (arguments.mode or arguments.group or settings.turntable):
        arguments.mode = [1]
    with exporting(arguments) as tick:
        motions = chosen_motions(arguments, settings.deviations)
        film = Film(motions, arguments.view, settings, turntable=settings.turntable)
        write_film(
            arguments.out,
            lambda index: film.moment(index, settings),
            settings.frames,
            settings.fps,
            part_of(tick, 0.05, 0.99),
        )
    facts = f"{settings.frames} frames at {settings.fps} fps, drawn with {renderer_name()}"
    sys.stderr.write(f"{arguments.out}: {facts}\n")
    return 0


def add_still(kinds: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the kind."""
    parser = add_kind(
        kinds,
        "still",
        "picture of any size as PNG",
        "Draw the mean shape moved along modes or between group means: one frame of the film with the same "
        "options.",
        "FILE (.png)",
    )
    add_motion_options(parser)
    add_options(parser, StillSettings)


def run_still(arguments: argparse.Namespace) -> int:
    """Write the picture; return the exit code."""
    settings = with_options(StillSettings(), arguments)
    from homolog_app.exports.film import Film
    from homolog_app.exports.pictures import write_still
    from homolog_app.rendering.draw import renderer_name

    with exporting(arguments) as tick:
        motions = chosen_motions(arguments, settings.deviations)
        low, high = motions[0].low, motions[0].high
        at = high if settings.at is None else settings.at
        if not low <= at <= high:
            raise InputError(f"--at {at:g}: must be from {low:g} to {high:g}")
        film = Film(motions, arguments.view, settings, transparent=settings.transparent)
        tick(0.5, "drawing")
        write_still(arguments.out, film.draw((at - low) / (high - low) if high > low else 0.0))
    facts = f"{settings.width} x {settings.height} pixels, drawn with {renderer_name()}"
    sys.stderr.write(f"{arguments.out}: {facts}\n")
    return 0


def add_screenshot(kinds: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the kind."""
    parser = add_kind(
        kinds,
        "screenshot",
        "the window's views as PNG",
        "Draw the views as Screenshot does in the window. SCENE is JSON with page, shapes and cameras, as "
        'the dialog shows it. The shortest is \'{"view": {"page": "modes"}}\'; pages are subjects, '
        "modes, groups, measure and check. SCENE may also be a file NAME.views.npz, which the window writes "
        "with pictures of views that a project does not contain, such as those of a run in progress.",
        "FILE (.png)",
    )
    scene = parser.add_argument(
        "--scene", required=True, metavar="SCENE", help="JSON, or a file that contains it"
    )
    add_former_name(parser, "--view", scene)
    add_options(parser, ScreenshotSettings)


def run_screenshot(arguments: argparse.Namespace) -> int:
    """Write the picture; return the exit code."""
    settings = with_options(ScreenshotSettings(), arguments)
    from homolog_app.exports.pictures import write_still
    from homolog_app.rendering.content import KEPT, open_page, read_shown
    from homolog_app.rendering.draw import with_opengl
    from homolog_app.scenes.snapshot import view_contents_of

    with exporting(arguments) as tick:
        if arguments.scene.endswith(KEPT):
            shown, canvas = read_shown(Path(arguments.scene))
        else:
            snapshot = _snapshot(arguments.scene)
            shown = view_contents_of(ProjectFolder(arguments.project), snapshot, tick)
            canvas = snapshot.canvas
        tick(0.9, "drawing")
        pixels = with_opengl(_drawn, *open_page(shown, canvas), settings.scale, settings.transparent)
        write_still(arguments.out, pixels)
    sys.stderr.write(f"{arguments.out}: {pixels.shape[1]} x {pixels.shape[0]} pixels\n")
    return 0


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


def add_plot(kinds: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the kind."""
    parser = add_kind(
        kinds, "plot", "a plot as SVG, PDF or PNG", "Write a plot of the result.", "FILE (.svg, .pdf or .png)"
    )
    add_group_option(parser, "two groups of a column, for --kind difference and discriminant")
    parser.add_argument(
        "--colour-by",
        metavar="COLUMN",
        default="group",
        help="column for the colours of scores (default group)",
    )
    add_options(parser, PlotSettings)


def run_plot(arguments: argparse.Namespace) -> int:
    """Write the plot; return the exit code."""
    settings = with_options(PlotSettings(), arguments)
    if arguments.out.suffix.lower() not in _PLOT_SUFFIXES:
        raise InputError(f"--out {arguments.out}: must end in {', '.join(_PLOT_SUFFIXES)}")
    from homolog.io.atomic import atomic_write
    from homolog_app.exports.pictures import draw_plot
    from homolog_app.pictures import write_picture

    with exporting(arguments) as tick:
        groups = tuple(arguments.group) if arguments.group else None
        figure = draw_plot(ProjectFolder(arguments.project), settings, groups, arguments.colour_by, tick)
        with atomic_write(arguments.out) as part:
            write_picture(figure, part)
    sys.stderr.write(f"{arguments.out}\n")
    return 0
