"""``homolog export plot``: one of the report's figures as vector graphics."""

import argparse
import sys
from typing import Any

from homolog.errors import InputError
from homolog.files.project import ProjectFolder
from homolog_app.cli.export_files import add_group_option, add_kind, exporting
from homolog_app.cli.options import add_options, with_options
from homolog_app.exports.settings import PlotSettings

__all__ = ["add_parser", "run"]

_SUFFIXES = (".svg", ".pdf", ".png")


def add_parser(kinds: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the kind."""
    parser = add_kind(
        kinds, "plot", "a plot as SVG, PDF or PNG", "Write a plot of the result.", "FILE (.svg, .pdf or .png)"
    )
    add_group_option(parser, "two groups of a column, for --kind difference and discriminant")
    parser.add_argument(
        "--colour-by",
        metavar="COLUMN",
        default="group",
        help="column whose values scores show (default group)",
    )
    add_options(parser, PlotSettings)


def run(arguments: argparse.Namespace) -> int:
    """Write the plot; returns the exit code."""
    settings = with_options(PlotSettings(), arguments)
    if arguments.out.suffix.lower() not in _SUFFIXES:
        raise InputError(f"--out {arguments.out}: must end in {', '.join(_SUFFIXES)}")
    from homolog.files.atomic import atomic_write
    from homolog_app.exports.plots import draw_plot
    from homolog_app.pictures import write_picture

    with exporting(arguments) as tick:
        groups = tuple(arguments.group) if arguments.group else None
        figure = draw_plot(ProjectFolder(arguments.project), settings, groups, arguments.colour_by, tick)
        with atomic_write(arguments.out) as part:
            write_picture(figure, part)
    sys.stderr.write(f"{arguments.out}\n")
    return 0
