"""``homolog table``: groups and covariates of a project from a table, without touching its particles."""

import argparse
import sys
from pathlib import Path
from typing import Any

from homolog.cohort import with_table
from homolog.files.project import ProjectFolder

__all__ = ["add_parser", "run"]


def add_parser(subparsers: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the command."""
    parser = subparsers.add_parser(
        "table",
        description="Add or replace groups and covariates of a project from a table (CSV with commas, "
        "semicolons or tabs, or XLSX). Its column name, subject or id, else the first one, names the "
        "subjects, as the project does or as their files are called. Empty cells leave what is there. "
        "Particles stay.",
    )
    parser.add_argument("project", type=Path, help="project folder")
    parser.add_argument("table", type=Path, help="table to read")
    parser.add_argument("--dry-run", action="store_true", help="show what would change, and change nothing")


def run(arguments: argparse.Namespace) -> int:
    """Say what changes and write it; returns the exit code."""
    from homolog.files.project_table import update_table

    project = ProjectFolder(arguments.project)
    with project.locked(new=False):
        changes = with_table(project.cohort().subjects, arguments.table)
        sys.stdout.write("".join(f"{line}\n" for line in changes.lines))
        if arguments.dry_run:
            sys.stdout.write("nothing was written (--dry-run)\n")
        elif not changes.is_empty:
            update_table(project, changes.subjects)
            sys.stdout.write(f"written to {project.folder}\n")
    return 0
