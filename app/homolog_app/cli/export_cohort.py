"""``homolog export cohort``: names, files, groups and covariates as CSV."""

import argparse
import sys
from typing import Any

from homolog.files.project import ProjectFolder
from homolog_app.cli.export_files import add_kind, exporting

__all__ = ["add_parser", "run"]


def add_parser(kinds: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the kind."""
    add_kind(
        kinds,
        "cohort",
        "names, files, groups and covariates as CSV",
        "Write the table of the project's subjects; it can be read as a cohort again.",
        "FILE.csv",
    )


def run(arguments: argparse.Namespace) -> int:
    """Write the table; returns the exit code."""
    from homolog_app.exports.cohort import write_cohort

    with exporting(arguments):
        write_cohort(arguments.out, ProjectFolder(arguments.project).cohort())
    sys.stderr.write(f"{arguments.out}\n")
    return 0
