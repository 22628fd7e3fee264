"""What a folder or table means: the options of every command that takes a cohort, and ``homolog cohort``."""

import argparse
import sys
from pathlib import Path
from shlex import quote
from typing import Any

from homolog.cohort import Cohort, declared_missing, read_cohort
from homolog.errors import InputError
from homolog.io.project import ProjectFolder
from homolog_app.cli.options import add_progress_option, show_progress

__all__ = [
    "add_cohort",
    "add_cohort_options",
    "add_cut",
    "add_missing_option",
    "as_options",
    "cohort_of",
    "read_with_notes",
    "run_cohort",
    "run_cut",
]


def add_cohort_options(parser: argparse.ArgumentParser, what: str) -> None:
    """Declare the cohort, and the options that say what its folder or table means."""
    parser.add_argument("cohort", type=Path, help=what)
    parser.add_argument(
        "--pattern",
        metavar="PATTERN",
        help="where the files are below the folder: {group}/{subject}/seg_{structure}.nii.gz. Fields other "
        "than subject, group and structure become columns, such as {side} or {time}; * is any text. Needed "
        "if the folder is in none of the known layouts: one file per subject; a folder per subject with one "
        "file per structure; BIDS derivatives; nnU-Net; TotalSegmentator",
    )
    parser.add_argument(
        "--table", type=Path, metavar="FILE", help="table with groups and covariates of the subjects"
    )
    add_missing_option(parser)


def add_missing_option(parser: argparse.ArgumentParser) -> None:
    """Declare the option for values that stand for missing ones."""
    parser.add_argument(
        "--missing",
        action="append",
        default=[],
        metavar="VALUE",
        help="value that stands for a missing one in the table, such as -999; may be repeated",
    )


def cohort_of(arguments: argparse.Namespace) -> Cohort:
    """Return the cohort of a folder, table or project."""
    project = ProjectFolder(arguments.cohort)
    if not project.exists:
        return read_with_notes(arguments)
    if arguments.pattern or arguments.table:
        raise InputError(f"{arguments.cohort}: is a project; --pattern and --table are for folders of files")
    return declared_missing(project.cohort(), arguments.missing)


def read_with_notes(arguments: argparse.Namespace) -> Cohort:
    """Return the cohort of a folder or table, and print the notes on its files and values."""
    from homolog.io.shapeworks import is_shapeworks, read_shapeworks_cohort

    if is_shapeworks(arguments.cohort):
        return declared_missing(read_shapeworks_cohort(arguments.cohort), arguments.missing)
    try:
        cohort = read_cohort(
            arguments.cohort, arguments.pattern, table=arguments.table, missing=tuple(arguments.missing)
        )
    except InputError as error:
        raise InputError(as_options(str(error))) from error
    for note in cohort.notes:
        sys.stderr.write(f"homolog: note: {note}\n")
    return cohort


def as_options(message: str) -> str:
    """Return a message with the patterns that it lists as options to copy."""
    return message.replace('\n  "', '\n  --pattern "')


def add_cohort(subparsers: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the command."""
    parser = subparsers.add_parser(
        "cohort",
        description="Read a folder or table as homolog run does, and write its subjects, files, groups and "
        "columns as a table, which can be edited and run: homolog run cohort.csv. Without --out, the table "
        "is printed.",
    )
    add_cohort_options(parser, "folder of segmentations or meshes, table, or ShapeWorks project")
    parser.add_argument("--out", type=Path, metavar="FILE", help="table to write: cohort.csv")


def run_cohort(arguments: argparse.Namespace) -> int:
    """Write the table; return the exit code."""
    from homolog_app.exports.tables import cohort_rows, write_cohort

    cohort = cohort_of(arguments)
    count = f"{len(cohort.subjects)} subjects"
    if arguments.out is None:
        rows = cohort_rows(cohort, cohort.folder)
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        for row in rows:
            cells = [cell.ljust(width) for cell, width in zip(row, widths, strict=True)]
            sys.stdout.write("  ".join(cells).rstrip() + "\n")
        return 0
    write_cohort(arguments.out, cohort)
    sys.stdout.write(
        f"{count} written to {arguments.out}\nNext: homolog run {quote(str(arguments.out))} --out PROJECT\n"
    )
    return 0


_ENDS = {
    name: tuple(sign * float(axis == place) for place in range(3))
    for (name, sign), axis in zip(
        (("left", 1), ("right", -1), ("posterior", 1), ("anterior", -1), ("superior", 1), ("inferior", -1)),
        (0, 0, 1, 1, 2, 2),
        strict=True,
    )
}
"""Directions in LPS."""


def add_cut(subparsers: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the command."""
    parser = subparsers.add_parser(
        "cut",
        description="Place a cutting plane on every subject, at corresponding places, and write the subjects "
        "with their cuts as a table, which can be edited and run: homolog run cohort.csv. In the column cut, "
        "six numbers are a plane (x y z of a point and of the direction that is kept, in mm, LPS), four a "
        "painted place that is removed (x y z and radius). Without an option, planes cut off the open ends "
        "of all subjects where the one that lacks most ends.",
    )
    add_cohort_options(parser, "folder of segmentations or meshes, or table")
    way = parser.add_mutually_exclusive_group()
    way.add_argument(
        "--plane",
        nargs=7,
        metavar=("SUBJECT", "X", "Y", "Z", "NX", "NY", "NZ"),
        help="plane of one subject: a point and the direction that is kept; it is carried to the others",
    )
    way.add_argument(
        "--carry",
        metavar="SUBJECT",
        help="carry the planes and painted places that the table gives a subject to the others",
    )
    way.add_argument(
        "--landmarks", nargs=3, metavar="NAME", help="plane through three landmarks that every subject has"
    )
    way.add_argument(
        "--region",
        metavar="PATTERN",
        help="file of each subject, such as regions/{subject}.json, that says what is removed: constraints "
        "of ShapeWorks (.json), or a text with 0 (removed) or 1 (kept) for each vertex of its mesh",
    )
    way.add_argument("--keep", type=float, metavar="MM", help="length kept along the long axis, from one end")
    parser.add_argument(
        "--end",
        choices=tuple(_ENDS),
        help="end that is kept with --keep; the one far from the rim if not given",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="table to write: cohort.csv")
    add_progress_option(parser)


def run_cut(arguments: argparse.Namespace) -> int:
    """Write the table with planes; return the exit code."""
    from homolog.progress import run_in_background
    from homolog.run.planes import cut_cohort, with_regions
    from homolog_app.exports.tables import write_cohort

    cohort = cohort_of(arguments)
    with show_progress(arguments.progress) as progress:
        planned = run_in_background(
            lambda tick: (
                with_regions(cohort, arguments.region)
                if arguments.region
                else cut_cohort(
                    cohort,
                    tick,
                    plane=arguments.plane and (arguments.plane[0], " ".join(arguments.plane[1:])),
                    carry=arguments.carry,
                    landmarks=arguments.landmarks,
                    keep=arguments.keep,
                    end=arguments.end and _ENDS[arguments.end],
                )
            ),
            progress.tick,
            "cutting planes",
        )
    write_cohort(arguments.out, planned)
    sys.stdout.write(
        f"cuts of {len(planned.subjects)} subjects written to {arguments.out}\n"
        f"Next: homolog run {quote(str(arguments.out))} --out PROJECT\n"
    )
    return 0
