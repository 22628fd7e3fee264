"""``homolog export measures``: distance of two particles, volume and surface area of each subject as CSV."""

import argparse
import sys
from typing import Any

from homolog.files.project import ProjectFolder
from homolog_app.cli.export_files import add_kind, exporting

__all__ = ["add_parser", "run"]


def add_parser(kinds: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the kind."""
    parser = add_kind(
        kinds,
        "measures",
        "distance of two particles, volume and surface area of each subject as CSV",
        "Write the straight distance of two particles, the volume and the surface area of each subject's "
        "groomed surface, in the size of its file.",
        "FILE.csv",
    )
    parser.add_argument(
        "--particles",
        nargs=2,
        type=int,
        required=True,
        metavar=("P", "Q"),
        help="numbers of two particles, from 0",
    )


def run(arguments: argparse.Namespace) -> int:
    """Write the table; returns the exit code."""
    from homolog.files.results import read_result, read_surface
    from homolog_app.exports.measures import measure_meshes, write_measures

    project = ProjectFolder(arguments.project)
    with exporting(arguments) as tick:
        result, record = read_result(project), project.read().result
        assert record is not None, "a result that was read has a record"
        meshes = [read_surface(project, subject) for subject in record.subjects]
        write_measures(arguments.out, result, measure_meshes(meshes, tick), *arguments.particles)
    sys.stderr.write(f"{arguments.out}\n")
    return 0
