"""``homolog export film``: modes, groups or a turning shape as MP4, GIF or numbered pictures."""

import argparse
import sys
from typing import Any

from homolog.errors import InputError
from homolog_app.cli.export_files import add_kind, exporting
from homolog_app.cli.motions import add_motion_options, chosen_motions
from homolog_app.cli.options import add_options, with_options
from homolog_app.films.settings import FilmSettings

__all__ = ["add_parser", "run"]


def add_parser(kinds: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the kind."""
    parser = add_kind(
        kinds,
        "film",
        "animation as MP4, GIF or numbered pictures",
        "Animate the mean shape along modes, from one group's mean to another's, or on a turntable.",
        "FILE (.mp4, .gif, or no suffix for a folder of PNG pictures)",
    )
    add_motion_options(parser)
    add_options(parser, FilmSettings)


def run(arguments: argparse.Namespace) -> int:
    """Write the film; returns the exit code."""
    settings = with_options(FilmSettings(), arguments)
    from homolog.progress import part_of
    from homolog_app.films.encode import FILM_SUFFIXES, write_film
    from homolog_app.films.film import Film
    from homolog_app.rendering.draw import renderer_name

    if arguments.out.suffix.lower() not in FILM_SUFFIXES:
        raise InputError(f"--out {arguments.out}: use .mp4 or .gif, or no suffix for a folder of PNG frames")
    if not (arguments.mode or arguments.group or settings.turntable):
        raise InputError("nothing moves; give --mode K, --group COLUMN A B or --turntable")
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
