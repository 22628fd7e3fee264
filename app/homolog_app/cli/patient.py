"""``homolog patient``: patients compared with a reference."""

import argparse
import signal
import sys
from pathlib import Path
from typing import Any

from homolog.errors import InputError
from homolog_app.cli.progress import add_progress_option, show_progress
from homolog_app.signals import handling

__all__ = ["add_parser", "add_patient_options", "given_covariates", "run"]


def add_parser(subparsers: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the command."""
    parser = subparsers.add_parser(
        "patient",
        help="compare a patient's shape with a reference: how unusual, and where",
        description="Compare patients with a reference made by homolog reference. Writes a report (HTML, "
        "PDF), tables and surfaces for each, and one table of all. For research use only; not for diagnosis.",
    )
    parser.add_argument("reference", type=Path, help="file that homolog reference wrote")
    parser.add_argument(
        "files",
        type=Path,
        nargs="+",
        metavar="FILE",
        help="segmentations, meshes, a folder of them or a cohort.csv",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="a new or empty folder")
    parser.add_argument(
        "--against",
        type=Path,
        nargs="+",
        default=[],
        metavar="REFERENCE",
        help="references of further groups: how typical the patient is of each, never a diagnosis",
    )
    parser.add_argument(
        "--follow-up",
        action="store_true",
        help="the files are one patient at several times, the first time first: maps of change",
    )
    parser.add_argument(
        "--repeat",
        type=Path,
        nargs="+",
        default=[],
        metavar="FILE",
        help="further segmentations of the first time, for the measurement error (three and more are best)",
    )
    add_patient_options(parser)
    add_progress_option(parser)


def add_patient_options(parser: argparse.ArgumentParser) -> None:
    """Declare covariates, side and label of a patient."""
    parser.add_argument("--age", help="of the patient, if the reference is adjusted for a column age")
    parser.add_argument("--sex", help="likewise; f is enough for female")
    parser.add_argument(
        "--value",
        action="append",
        default=[],
        metavar="COLUMN=VALUE",
        help="any other covariate of the reference",
    )
    parser.add_argument(
        "--side", choices=["left", "right"], help="side of the body, mirrored if controls are of the other"
    )
    parser.add_argument(
        "--label", help="label value or name of the structure, if it differs from the controls'"
    )
    parser.add_argument(
        "--force", action="store_true", help="compare even what looks like another structure or side"
    )


def given_covariates(arguments: argparse.Namespace) -> dict[str, str]:
    """Return the covariates on the command line, by column."""
    given = {name: value for name in ("age", "sex") if (value := getattr(arguments, name)) is not None}
    for item in arguments.value:
        name, sign, value = item.partition("=")
        if not (sign and name and value):
            raise InputError(f"--value {item}: must be COLUMN=VALUE")
        given[name] = value
    return given


def run(arguments: argparse.Namespace) -> int:
    """Compare; returns the exit code."""
    from homolog.files.atomic import replace_folder
    from homolog.patient.reference import Reference
    from homolog_app.report.patient import PatientRequest, write_patients

    if arguments.repeat and not arguments.follow_up:
        raise InputError("--repeat: gives the measurement error of a follow-up; add --follow-up")
    reference = Reference.load(arguments.reference)
    request = PatientRequest(
        tuple(arguments.files),
        given_covariates(arguments),
        arguments.side or "",
        arguments.label,
        arguments.force,
        tuple(arguments.against),
        arguments.follow_up,
        tuple(arguments.repeat),
    )
    with (
        handling(signal.SIGTERM, signal.default_int_handler),  # tidy up as for Ctrl-C
        show_progress(arguments.progress) as progress,
        replace_folder(arguments.out) as folder,
    ):
        summary = write_patients(folder, reference, request, progress.tick)
    sys.stdout.write("".join(f"{line}\n" for line in summary.lines))
    for line in summary.problems:
        sys.stderr.write(f"homolog: {line}\n")
    sys.stdout.write(f"{arguments.out}\n")
    return 2 if summary.problems else 0
