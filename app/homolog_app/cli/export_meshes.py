"""``homolog export meshes``: mean, modes, groups and subjects as mesh files."""

import argparse
import sys
from typing import Any

from homolog.files.project import ProjectFolder
from homolog_app.cli.export_files import add_group_option, add_kind, exporting
from homolog_app.cli.options import add_options, with_options
from homolog_app.exports.settings import MeshSettings

__all__ = ["add_parser", "run"]


def add_parser(kinds: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the kind."""
    parser = add_kind(
        kinds,
        "meshes",
        "surfaces as VTP, PLY, STL or GLB",
        "Write the mean, modes at both ends, and on request group means and subjects, in aligned LPS "
        "millimetres. VTP, PLY and GLB also contain outward displacement [mm], VTP and PLY p and q; "
        "meshes.csv describes the files.",
        "FOLDER",
    )
    add_group_option(parser, "also the means of two groups of a column, with p and q of their difference")
    add_options(parser, MeshSettings)


def run(arguments: argparse.Namespace) -> int:
    """Write the meshes; returns the exit code."""
    settings = with_options(MeshSettings(), arguments)
    from homolog.files.atomic import replace_folder
    from homolog_app.exports.meshes import write_meshes

    groups = tuple(arguments.group) if arguments.group else None
    with exporting(arguments) as tick, replace_folder(arguments.out) as folder:
        count = write_meshes(ProjectFolder(arguments.project), folder, settings, groups, tick)
    sys.stderr.write(f"{arguments.out}: {count} surfaces\n")
    return 0
