"""``homolog report``: one page about a project's model and studies, as HTML and PDF."""

import argparse
import sys
from pathlib import Path
from typing import Any

from homolog.files.project import ProjectFolder
from homolog_app.cli.options import add_options, with_options
from homolog_app.cli.progress import add_progress_option, show_progress
from homolog_app.films.settings import CutSettings

__all__ = ["add_parser", "run"]


def add_parser(subparsers: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the command."""
    parser = subparsers.add_parser(
        "report",
        help="write one page about a project's model and studies, as HTML and PDF",
        description="Write one page about a project's shape model and its studies (see homolog analyze) to "
        "PROJECT/report, as HTML and PDF, with its figures as SVG and PDF. It opens in a browser without a "
        "network.",
    )
    parser.add_argument("project", type=Path, help="project folder")
    add_options(parser, CutSettings)
    add_progress_option(parser)


def run(arguments: argparse.Namespace) -> int:
    """Write the report; returns the exit code."""
    from homolog_app.report.write import write_report

    clip = with_options(CutSettings(), arguments).cutting
    project = ProjectFolder(arguments.project)
    with project.locked(new=False), show_progress(arguments.progress) as progress:
        path = write_report(project, progress.tick, clip)
    sys.stdout.write(f"{path}\n")
    return 0
