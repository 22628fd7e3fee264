"""What the kinds of ``homolog export`` have in common."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from homolog.progress import Tick
from homolog_app.cli.progress import add_progress_option, show_progress

__all__ = ["add_group_option", "add_kind", "exporting"]


def add_kind(kinds: Any, name: str, summary: str, description: str, out: str) -> argparse.ArgumentParser:  # noqa: ANN401
    """Declare a kind of export with what each has: project, place of the result, progress."""
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
    """Give the tick of an export; says at the end that it is done."""
    with show_progress(arguments.progress) as progress:
        progress.tick(0.0, "preparing")
        yield progress.tick
        progress.tick(1.0, "done")
