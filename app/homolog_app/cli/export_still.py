"""``homolog export still``: one picture of a mode, a group or the mean shape, of any size."""

import argparse
import sys
from typing import Any

from homolog.errors import InputError
from homolog_app.cli.export_files import add_kind, exporting
from homolog_app.cli.motions import add_motion_options, chosen_motions
from homolog_app.cli.options import add_options, with_options
from homolog_app.films.settings import StillSettings

__all__ = ["add_parser", "run"]


def add_parser(kinds: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
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


def run(arguments: argparse.Namespace) -> int:
    """Write the picture; returns the exit code."""
    settings = with_options(StillSettings(), arguments)
    from homolog_app.films.encode import write_still
    from homolog_app.films.film import Film
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
