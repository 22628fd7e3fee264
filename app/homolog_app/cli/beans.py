"""``homolog beans``: the paper's synthetic cohort as volumes."""

import argparse
import sys
from pathlib import Path
from typing import Any

from homolog_app.cli.progress import add_progress_option, show_progress

__all__ = ["add_parser", "run"]

_GEOMETRIES = ("wide", "narrow")


def add_parser(subparsers: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the command."""
    parser = subparsers.add_parser(
        "beans",
        description="Generate the paper's coffee-bean cohort: label volumes (NRRD) and truth.csv.",
    )
    parser.add_argument("out", type=Path, help="output folder")
    parser.add_argument("--shapes", type=int, default=10, help="number of beans (default 10)")
    parser.add_argument("--seed", type=int, default=5, help="random seed of positions and widths (default 5)")
    parser.add_argument(
        "--geometry",
        choices=_GEOMETRIES,
        default="wide",
        help="wide: slots overlap across the cohort (default); narrow: a stress test that no method passes",
    )
    add_progress_option(parser)


def run(arguments: argparse.Namespace) -> int:
    """Write the cohort; returns the exit code."""
    from homolog.beans.files import write_beans
    from homolog.beans.generate import NARROW, WIDE, draw_beans, draw_moments
    from homolog.errors import InputError

    if not 2 <= arguments.shapes <= 10000:
        raise InputError(f"--shapes {arguments.shapes}: must be between 2 and 10000")
    if arguments.seed < 0:
        raise InputError(f"--seed {arguments.seed}: must be 0 or more")
    geometry = {"wide": WIDE, "narrow": NARROW}[arguments.geometry]
    beans = draw_beans(arguments.shapes, arguments.seed, geometry)
    with show_progress(arguments.progress) as progress:
        write_beans(arguments.out, beans, arguments.seed, progress.tick)
    position, width, correlation = draw_moments(beans)
    sys.stdout.write(
        f"{arguments.out}: {len(beans)} {geometry.name} beans, seed {arguments.seed}; slot position "
        f"sd {position:.2f} mm, width sd {width:.2f} mm, correlation {correlation:+.2f}\n"
    )
    return 0
