"""``homolog reference``: the model of a project's controls, frozen for comparing patients with it."""

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
        "reference",
        help="freeze a project's controls as a reference for single patients",
        description="Freeze the model of a finished project's controls in one file, for homolog patient. "
        "Each control is fitted as a patient to the model of the others, so that limits and percentiles "
        "hold for new subjects. The file contains no control's surface, particles or file.",
    )
    parser.add_argument("project", type=Path, help="project folder")
    parser.add_argument("--group", metavar="VALUE", help="who the controls are (default: all subjects)")
    parser.add_argument(
        "--column", default="group", help="column of the cohort's table for --group (default group)"
    )
    parser.add_argument(
        "--adjust", nargs="+", metavar="COLUMN", default=[], help="covariates to adjust for, such as age sex"
    )
    parser.add_argument(
        "--pairs",
        metavar="COLUMN",
        help="column that names the person, if controls were seen twice: the change that a follow-up expects",
    )
    parser.add_argument(
        "--time", metavar="COLUMN", default="time", help="column that orders a person's times (default time)"
    )
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FILE",
        help="reference to write (.npz); replaced if it exists",
    )
    parser.add_argument(
        "--scores",
        action="store_true",
        help="keep each control's scores, to tell how near the nearest controls are to a patient",
    )
    parser.add_argument("--names", action="store_true", help="likewise, with the controls' names")
    parser.add_argument("--workers", type=int, help="number of processes (default: one per core)")
    add_progress_option(parser)


def run(arguments: argparse.Namespace) -> int:
    """Make the reference; returns the exit code."""
    from homolog.patient.build import make_reference
    from homolog.patient.reference import check_name
    from homolog_app.report.patient_words import reference_words

    check_name(arguments.out)
    with show_progress(arguments.progress) as progress:
        reference = make_reference(
            ProjectFolder(arguments.project),
            group=arguments.group,
            column=arguments.column,
            adjust=arguments.adjust,
            pairs=arguments.pairs,
            time=arguments.time,
            scores=arguments.scores,
            names=arguments.names,
            workers=arguments.workers,
            tick=progress.tick,
        )
        reference.save(arguments.out)
    sys.stdout.write("".join(f"{line}\n" for line in [*reference_words(reference), str(arguments.out)]))
    return 0
