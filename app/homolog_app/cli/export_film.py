"""``homolog export film``: modes, groups or a turning shape as MP4, GIF or numbered pictures."""

import argparse
import sys
from pathlib import Path
from typing import Any

from homolog.errors import InputError
from homolog_app.cli.motions import add_motion_options, chosen_motions
from homolog_app.cli.options import add_options, with_options
from homolog_app.cli.progress import add_progress_option, show_progress
from homolog_app.films.settings import FilmSettings

__all__ = ["add_parser", "run"]


def add_parser(kinds: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the kind."""
    parser = kinds.add_parser(
        "film",
        help="an animation as MP4, GIF or numbered pictures",
        description="Film the mean shape along modes, from one group's mean to another's, or on a turntable.",
    )
    parser.add_argument("project", type=Path, help="project folder")
    add_motion_options(parser)
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE",
        help="FILE.mp4, FILE.gif, or a new folder for numbered PNG pictures",
    )  # fmt: skip
    add_progress_option(parser)
    add_options(parser, FilmSettings)


def run(arguments: argparse.Namespace) -> int:
    """Write the film; returns the exit code."""
    settings = with_options(FilmSettings(), arguments)
    from homolog.progress import part_of
    from homolog_app.films.encode import FILM_SUFFIXES, write_film
    from homolog_app.films.film import Film

    if arguments.out.suffix.lower() not in FILM_SUFFIXES:
        raise InputError(f"--out {arguments.out}: must end in .mp4 or .gif, or in nothing for a folder")
    if not (arguments.mode or arguments.group or settings.turntable):
        raise InputError("nothing moves: name --mode K, --group COLUMN A B or --turntable")
    with show_progress(arguments.progress) as progress:
        progress.tick(0.0, "preparing")
        motions = chosen_motions(arguments, settings.deviations)
        film = Film(motions, arguments.view, settings, turntable=settings.turntable)
        write_film(
            arguments.out,
            lambda index: film.moment(index, settings),
            settings.frames,
            settings.fps,
            part_of(progress.tick, 0.05, 0.99),
        )
        progress.tick(1.0, "done")
    sys.stderr.write(f"{arguments.out}: {settings.frames} frames, {settings.fps} a second\n")
    return 0
