"""``homolog import``: a model that another program made, as a project."""

import argparse
import sys
from pathlib import Path
from typing import Any

from homolog.files.project import ProjectFolder
from homolog_app.cli.progress import add_progress_option, show_progress

__all__ = ["add_parser", "run"]


def add_parser(subparsers: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the command."""
    parser = subparsers.add_parser(
        "import",
        description="Make a project, with a result that can be looked at and analyzed, of a ShapeWorks "
        "project (.swproj, .xlsx) or of a folder of .particles. Nothing is optimized.",
    )
    parser.add_argument("source", type=Path, help=".swproj or .xlsx file, or folder of .particles")
    parser.add_argument("project", type=Path, help="project folder to create")
    parser.add_argument("--domain", metavar="NAME", help="anatomy to import if the project has several")
    add_progress_option(parser)


def run(arguments: argparse.Namespace) -> int:
    """Import the model; returns the exit code."""
    from homolog.exchange import import_model

    project = ProjectFolder(arguments.project)
    with show_progress(arguments.progress) as progress:
        notes = import_model(arguments.source, project, domain=arguments.domain, tick=progress.tick)
    for note in notes:
        sys.stderr.write(f"homolog: note: {note}\n")
    result = project.read().result
    assert result is not None, "an imported project has a result"
    stream = sys.stderr if arguments.progress == "json" else sys.stdout
    stream.write(
        f"{len(result.subjects)} subjects x {result.particles} particles\nresults in {project.folder}\n"
    )
    return 0
