"""``homolog export patient``: the report of one patient as a single file."""

import argparse
import sys
from pathlib import Path
from typing import Any

from homolog.errors import InputError
from homolog_app.cli.export_files import exporting
from homolog_app.cli.patient import add_patient_options, given_covariates
from homolog_app.cli.progress import add_progress_option

__all__ = ["add_parser", "run"]

_SUFFIXES = (".pdf", ".html")


def add_parser(kinds: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the kind."""
    parser = kinds.add_parser(
        "patient",
        help="report of one patient against a reference as PDF or HTML",
        description="Compare a patient with a reference made by homolog reference and write the report "
        "alone, as two pages of PDF or one HTML page. homolog patient also writes tables and surfaces.",
    )
    parser.add_argument("reference", type=Path, help="file that homolog reference wrote")
    parser.add_argument("file", type=Path, help="segmentation or mesh of the patient")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE", help="FILE (.pdf or .html); replaced if it exists"
    )
    add_patient_options(parser)
    add_progress_option(parser)


def run(arguments: argparse.Namespace) -> int:
    """Write the report; returns the exit code."""
    if arguments.out.suffix.lower() not in _SUFFIXES:
        raise InputError(f"{arguments.out}: the report is written as .pdf or .html; choose such a name")
    from homolog.patient.reference import Reference
    from homolog_app.report.patient import PatientRequest, write_report_file

    with exporting(arguments) as tick:
        request = PatientRequest(
            (arguments.file,),
            given_covariates(arguments),
            arguments.side or "",
            arguments.label,
            arguments.force,
        )
        summary = write_report_file(arguments.out, Reference.load(arguments.reference), request, tick)
    sys.stderr.write(f"{summary}\n{arguments.out}\n")
    return 0
