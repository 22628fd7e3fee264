"""``homolog export table``: scores, modes, measures and studies as CSV."""

import argparse
import sys
from typing import Any

from homolog.files.project import ProjectFolder
from homolog_app.cli.export_files import add_group_option, add_kind, exporting
from homolog_app.cli.options import add_options, with_options
from homolog_app.exports.settings import TableSettings

__all__ = ["add_parser", "run"]


def add_parser(kinds: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the kind."""
    parser = add_kind(
        kinds,
        "table",
        "scores, modes, measures and group results as CSV",
        "Write scores.csv, modes.csv and subjects.csv (volume, area, size, distance from the mean), and a "
        "folder of tables for each study that homolog analyze stored, or for the groups given here.",
        "FOLDER",
    )
    add_group_option(parser, "compare two groups of a column instead of exporting the stored studies")
    add_options(parser, TableSettings)


def run(arguments: argparse.Namespace) -> int:
    """Write the tables; returns the exit code."""
    settings = with_options(TableSettings(), arguments)
    from homolog.files.atomic import replace_folder
    from homolog_app.exports.tables import write_tables

    groups = tuple(arguments.group) if arguments.group else None
    with exporting(arguments) as tick, replace_folder(arguments.out) as folder:
        write_tables(ProjectFolder(arguments.project), folder, settings, groups, tick)
    sys.stderr.write(f"{arguments.out}\n")
    return 0
