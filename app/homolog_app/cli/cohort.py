"""What a folder or table means: the options of every command that takes a cohort, and ``homolog cohort``."""

import argparse
from pathlib import Path
from shlex import quote

from homolog.cohort import Cohort, declared_missing, read_cohort
from homolog.errors import InputError
from homolog.io.project import ProjectFolder
from homolog_app.cli.options import PROGRESS, Part, command, note, one_of, option, show_progress, write_lines
from homolog_app.rendering.text import aligned

__all__ = ["MISSING", "as_options", "cohort_of", "cohort_options", "read_with_notes", "run_cohort", "run_cut"]


def cohort_options(what: str) -> tuple[Part, ...]:
    """Return the arguments that name a cohort."""
    return (
        option("cohort", type=Path, help=what),
        option(
            "--pattern",
            metavar="PATTERN",
            help="where the files are below the folder: {group}/{subject}/seg_{structure}.nii.gz. Fields "
            "other than subject, group and structure become columns, such as {side} or {time}; * is any "
            "text. Needed if the folder is in none of the known layouts: one file per subject; a folder per "
            "subject with one file per structure; BIDS derivatives; nnU-Net; TotalSegmentator",
        ),
        option("--table", type=Path, metavar="FILE", help="table with groups and covariates of the subjects"),
        MISSING,
    )


MISSING = option(
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
    note(*(f"note: {text}" for text in cohort.notes))
    return cohort


def as_options(message: str) -> str:
    """Return a message with the patterns that it lists as options to copy."""
    return message.replace('\n  "', '\n  --pattern "')


@command(
    "Read a folder or table as homolog run does, and write its subjects, files, groups and "
    "columns as a table, which can be edited and run: homolog run cohort.csv. Without --out, the table "
    "is printed.",
    *cohort_options("folder of segmentations or meshes, table, or ShapeWorks project"),
    option("--out", type=Path, metavar="FILE", help="table to write: cohort.csv"),
)
def run_cohort(arguments: argparse.Namespace) -> int:
    """Write the table; return the exit code."""
    from homolog_app.exports.tables import cohort_rows, write_cohort

    cohort = cohort_of(arguments)
    if arguments.out is None:
        write_lines(*aligned(cohort_rows(cohort, cohort.folder)))
        return 0
    write_cohort(arguments.out, cohort)
    write_lines(f"{len(cohort.subjects)} subjects written to {arguments.out}", _following(arguments.out))
    return 0


def _following(table: Path) -> str:
    return f"Next: homolog run {quote(str(table))} --out PROJECT"


_ENDS = {
    name: tuple(sign * float(axis == place) for place in range(3))
    for (name, sign), axis in zip(
        (("left", 1), ("right", -1), ("posterior", 1), ("anterior", -1), ("superior", 1), ("inferior", -1)),
        (0, 0, 1, 1, 2, 2),
        strict=True,
    )
}
"""Directions in LPS."""


@command(
    "Place a cutting plane on every subject, at corresponding places, and write the subjects with their cuts "
    "as a table, which can be edited and run: homolog run cohort.csv. In the column cut, six numbers are a "
    "plane (x y z of a point and of the direction that is kept, in mm, LPS), four a painted place that is "
    "removed (x y z and radius). Without an option, planes cut off the open ends of all subjects where the "
    "one that lacks most ends.",
    *cohort_options("folder of segmentations or meshes, or table"),
    one_of(
        option(
            "--plane",
            nargs=7,
            metavar=("SUBJECT", "X", "Y", "Z", "NX", "NY", "NZ"),
            help="plane of one subject: a point and the direction that is kept; it is carried to the others",
        ),
        option(
            "--carry",
            metavar="SUBJECT",
            help="carry the planes and painted places that the table gives a subject to the others",
        ),
        option(
            "--landmarks",
            nargs=3,
            metavar="NAME",
            help="plane through three landmarks that every subject has",
        ),
        option(
            "--region",
            metavar="PATTERN",
            help="file of each subject, such as regions/{subject}.json, that says what is removed: "
            "constraints of ShapeWorks (.json), a surface with an array cut (1 removed) or ffc_paint "
            "(1 kept) of its vertices or faces (.vtp), or a text with 0 (removed) or 1 (kept) for each "
            "vertex of its mesh",
        ),
        option("--keep", type=float, metavar="MM", help="length kept along the long axis, from one end"),
    ),
    option(
        "--end",
        choices=tuple(_ENDS),
        help="end that is kept with --keep; the one far from the rim if not given",
    ),
    option("--out", type=Path, required=True, metavar="FILE", help="table to write: cohort.csv"),
    PROGRESS,
)
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
    write_lines(
        f"cuts of {len(planned.subjects)} subjects written to {arguments.out}", _following(arguments.out)
    )
    return 0
